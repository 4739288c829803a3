/* The PWM output of the Linux port when the kernel refuses a write: what was not written must not count as written. */
#define _GNU_SOURCE

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "unity.h"

#include "../../firmware/ports/linux/edges.c"
#include "../../firmware/ports/linux/gpio.c"
#include "../../firmware/ports/linux/gpio_none.c"

void setUp(void) {}
void tearDown(void) {}

static void test_a_refused_off_is_tried_again(void) {
    char text[16] = "";
    FILE *const file = tmpfile();
    const int full = open("/dev/full", O_WRONLY | O_CLOEXEC); /* refuses each write */
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_GREATER_OR_EQUAL(0, full);
    pwm_output pwm = {.descriptor = fileno(file), .period_ns = 50000U};
    TEST_ASSERT_TRUE(pwm_set(&pwm, 16384));
    pwm.descriptor = full;
    TEST_ASSERT_FALSE(pwm_set(&pwm, 0));
    TEST_ASSERT_FALSE(pwm_set(&pwm, 0)); /* not `off already` */
    pwm.descriptor = fileno(file);
    TEST_ASSERT_TRUE(pwm_set(&pwm, 0));
    TEST_ASSERT_GREATER_THAN(0, pread(fileno(file), text, sizeof text - 1U, 0));
    TEST_ASSERT_EQUAL_STRING_LEN("0\n", text, 2);
    (void)close(full);
    (void)fclose(file);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_refused_off_is_tried_again);
    return UNITY_END();
}
