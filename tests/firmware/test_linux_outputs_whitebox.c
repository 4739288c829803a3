/* What the Linux port reads and drives by itself: PWM, also when the kernel refuses a write, converter files, encoders
 * whose edges wait on two lines, and the clock of the step. */
#define _GNU_SOURCE

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "unity.h"

#include "../../firmware/ports/linux/clock.c"
#include "../../firmware/ports/linux/edges.c"
#include "../../firmware/ports/linux/gpio.c"

struct gpio_line {
    int level;
    int open;
    gpio_edge edges[70];
    int count;
};
static gpio_line lines[2];
static int refused_line = -1;

gpio_line *gpio_open(const gpio_name *name, gpio_direction direction, char *why, size_t size) {
    const int which = name->line[0] - '0';
    TEST_ASSERT_EQUAL(GPIO_EDGES, direction);
    if (which == refused_line) {
        (void)snprintf(why, size, "refused");
        return NULL;
    }
    lines[which].open++;
    return &lines[which];
}
int gpio_get(gpio_line *line) {
    return line->level;
}
int gpio_edges(gpio_line *line, gpio_edge *edges, int most) {
    const int count = (line->count < most) ? line->count : most;
    for (int i = 0; i < count; i++) {
        edges[i] = line->edges[i];
    }
    line->count = 0;
    return count;
}
void gpio_close(gpio_line *line) {
    if (line != NULL) {
        line->open--;
    }
}

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

static void write_file(const char *folder, const char *name, const char *text) {
    char path[256];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *const file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs(text, file);
    (void)fclose(file);
}

static void reads_file(const char *folder, const char *name, const char *expected) {
    char path[256];
    char text[32] = "";
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *const file = fopen(path, "r");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_NOT_NULL(fgets(text, sizeof text, file));
    (void)fclose(file);
    TEST_ASSERT_EQUAL_STRING(expected, text);
}

static void remove_all(const char *folder) {
    static const char *const names[] = {"period", "enable", "duty_cycle"};
    char path[256];
    for (size_t i = 0; i < (sizeof names / sizeof names[0]); i++) {
        (void)snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        (void)unlink(path);
    }
    (void)rmdir(folder);
}

static void test_a_channel_of_sysfs(void) {
    char folder[] = "/tmp/terrapin-pwm-XXXXXX";
    pwm_output pwm;
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
    TEST_ASSERT_FALSE_MESSAGE(pwm_open(&pwm, folder), "none of its files is there");
    pwm_close(&pwm);
    write_file(folder, "period", "0\n");
    write_file(folder, "enable", "0\n");
    write_file(folder, "duty_cycle", "777\n");
    TEST_ASSERT_FALSE_MESSAGE(pwm_open(&pwm, folder), "its period is not set");
    TEST_ASSERT_EQUAL(EINVAL, errno);
    pwm_close(&pwm);
    write_file(folder, "period", "50000\n");
    TEST_ASSERT_TRUE(pwm_open(&pwm, folder));
    reads_file(folder, "duty_cycle", "0\n");
    reads_file(folder, "enable", "1\n");
    TEST_ASSERT_TRUE(pwm_set(&pwm, -16384)); /* the direction is a line of its own */
    reads_file(folder, "duty_cycle", "25000\n");
    TEST_ASSERT_TRUE(pwm_set(&pwm, 32767));
    reads_file(folder, "duty_cycle", "49998\n");
    TEST_ASSERT_TRUE(pwm_set(&pwm, INT16_MIN));
    reads_file(folder, "duty_cycle", "50000\n");
    pwm_close(&pwm);
    reads_file(folder, "duty_cycle", "0\n");
    TEST_ASSERT_EQUAL(-1, pwm.descriptor);
    remove_all(folder);
    TEST_ASSERT_TRUE(pwm_open(&pwm, NULL));
    TEST_ASSERT_TRUE(pwm_set(&pwm, 100));
    pwm_close(&pwm);
}

/* Codes of 8 to 24 bits become 12; whatever is no code of the converter reads as 0, a broken sensor. */
static void test_converter_files(void) {
    static const struct {
        const char *text;
        unsigned int bits;
        uint16_t code;
    } cases[] = {
        {"4095\n", 12, 4095},   {"4096\n", 12, 0},
        {"1\n", 12, 1},         {"255\n", 8, 4080},
        {"256\n", 8, 0},        {"65535\n", 16, 4095},
        {"65536\n", 16, 0},     {"32768\n", 16, 2048},
        {"-1\n", 12, 0},        {"x\n", 12, 0},
        {"\n", 12, 0},          {"16777215", 24, 4095},
        {"8388608", 24, 2048},  {"99999999999999999999", 12, 0},
        {"-4294967295", 12, 0}, /* 1 where a long has 32 bits */
    };
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        char path[] = "/tmp/terrapin-adc-XXXXXX";
        analog_input input;
        const int file = mkstemp(path);
        TEST_ASSERT_GREATER_OR_EQUAL(0, file);
        TEST_ASSERT_GREATER_THAN(0, write(file, cases[i].text, strlen(cases[i].text)));
        TEST_ASSERT_TRUE(analog_open(&input, path, cases[i].bits));
        TEST_ASSERT_EQUAL_MESSAGE(cases[i].code, analog_read(&input), cases[i].text);
        TEST_ASSERT_EQUAL_MESSAGE(cases[i].code, analog_read(&input), "from the start each time");
        analog_close(&input);
        TEST_ASSERT_EQUAL(-1, input.descriptor);
        TEST_ASSERT_EQUAL(0, analog_read(&input));
        (void)close(file);
        (void)unlink(path);
        TEST_ASSERT_FALSE(analog_open(&input, path, 12));
    }
    analog_input none;
    TEST_ASSERT_TRUE(analog_open(&none, NULL, 12));
    TEST_ASSERT_EQUAL(0, analog_read(&none));
    analog_close(&none);
}

static void test_four_counts_a_period_both_ways(void) {
    static const unsigned int forward[] = {0, 1, 3, 2, 0}; /* B A */
    int step = 0;
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL(forward[i + 1], quadrature_next(forward[i], forward[i + 1], &step));
        TEST_ASSERT_EQUAL(1, step);
        (void)quadrature_next(forward[i + 1], forward[i], &step);
        TEST_ASSERT_EQUAL(-1, step);
        (void)quadrature_next(forward[i], forward[i], &step);
        TEST_ASSERT_EQUAL(0, step);
        (void)quadrature_next(forward[i], forward[i] ^ 3U, &step);
        TEST_ASSERT_EQUAL(0, step);
    }
}

static const gpio_name a_and_b[2] = {{.line = "0"}, {.line = "1"}};

/* The edges of two lines wait in two queues: their times put them in order, whichever came into the queue first. */
static void test_edges_of_two_lines_are_merged_by_time(void) {
    char why[64];
    quadrature encoder;
    memset(lines, 0, sizeof lines);
    TEST_ASSERT_TRUE(quadrature_open(&encoder, a_and_b, why, sizeof why));
    for (int i = 0; i < 3; i++) { /* A up, B up, A down, B down: 12 counts */
        const uint64_t at = (uint64_t)i * 100U;
        lines[0].edges[2 * i] = (gpio_edge){at + 10U, true};
        lines[1].edges[2 * i] = (gpio_edge){at + 20U, true};
        lines[0].edges[(2 * i) + 1] = (gpio_edge){at + 30U, false};
        lines[1].edges[(2 * i) + 1] = (gpio_edge){at + 40U, false};
    }
    lines[0].count = lines[1].count = 6;
    quadrature_update(&encoder);
    TEST_ASSERT_EQUAL(12, encoder.count);
    TEST_ASSERT_EQUAL(0, encoder.skipped);
    lines[1].edges[0] = (gpio_edge){510U, true}; /* back: B first, below zero */
    lines[1].count = 1;
    for (int i = 0; i < 13; i++) {
        quadrature_update(&encoder);
        lines[i & 1].edges[0] = (gpio_edge){600U + (uint64_t)i, (((i + 1) / 2) & 1) == 0};
        lines[i & 1].count = 1;
    }
    quadrature_update(&encoder);
    TEST_ASSERT_EQUAL_HEX16(0xFFFE, encoder.count);
    TEST_ASSERT_EQUAL(0, encoder.skipped);
    quadrature_close(&encoder);
    TEST_ASSERT_EQUAL(0, lines[0].open | lines[1].open);
}

static void test_an_edge_that_was_lost_is_counted(void) {
    char why[64];
    quadrature encoder;
    memset(lines, 0, sizeof lines);
    lines[1].level = 1;
    TEST_ASSERT_TRUE(quadrature_open(&encoder, a_and_b, why, sizeof why));
    TEST_ASSERT_EQUAL(2, encoder.phase);        /* B is up */
    lines[1].edges[0] = (gpio_edge){10U, true}; /* again */
    lines[1].count = 1;
    quadrature_update(&encoder);
    TEST_ASSERT_EQUAL(1, encoder.skipped);
    TEST_ASSERT_EQUAL(0, encoder.count);
    lines[0].count = lines[1].count = -1; /* gone: no edges, and no harm */
    quadrature_update(&encoder);
    TEST_ASSERT_EQUAL(0, encoder.count);
    quadrature_close(&encoder);
    refused_line = 1;
    TEST_ASSERT_FALSE(quadrature_open(&encoder, a_and_b, why, sizeof why));
    TEST_ASSERT_EQUAL(0, lines[0].open);
    refused_line = -1;
    quadrature none = {0};
    quadrature_update(&none);
    TEST_ASSERT_EQUAL(0, none.count);
}

/* What the timer's descriptor tells: how many periods went by. */
static uint32_t takes(tick_clock *clock, uint64_t expired, uint64_t late_ns, bool measure) {
    int ends[2];
    TEST_ASSERT_EQUAL(0, pipe(ends));
    TEST_ASSERT_EQUAL(sizeof expired, write(ends[1], &expired, sizeof expired));
    (void)close(ends[1]);
    clock->descriptor = ends[0];
    clock->due_ns = now_ns() - late_ns - ((expired > 0U) ? ((expired - 1U) * clock->period_ns) : 0U);
    const uint64_t due = clock->due_ns;
    const uint32_t taken = tick_clock_take(clock, measure);
    TEST_ASSERT_EQUAL_UINT64(due + (expired * clock->period_ns), clock->due_ns);
    TEST_ASSERT_EQUAL_MESSAGE(0, tick_clock_take(clock, measure), "nothing more");
    (void)close(ends[0]);
    return taken;
}

static void test_the_clock_counts_what_was_missed_and_how_late_it_is(void) {
    static tick_clock clock;
    clock.period_ns = 1000000U;
    TEST_ASSERT_EQUAL(1, takes(&clock, 1U, 0U, true));
    TEST_ASSERT_EQUAL(0, clock.missed);
    TEST_ASSERT_EQUAL(5, takes(&clock, 5U, 100000000U, true));
    TEST_ASSERT_EQUAL(4, clock.missed);
    TEST_ASSERT_EQUAL(2, clock.ticks);
    TEST_ASSERT_GREATER_OR_EQUAL(100000000U, clock.latest_ns);
    TEST_ASSERT_EQUAL(1, clock.late_us[CLOCK_RANGE_US]);
    TEST_ASSERT_EQUAL(7, takes(&clock, 7U, 900000000U, false)); /* test mode: not measured */
    TEST_ASSERT_EQUAL(4, clock.missed);
    TEST_ASSERT_EQUAL(2, clock.ticks);
    TEST_ASSERT_LESS_THAN(900000000U, clock.latest_ns);
    TEST_ASSERT_EQUAL(1, takes(&clock, 1U, 0U, true)); /* the latest stays */
    TEST_ASSERT_GREATER_OR_EQUAL(100000000U, clock.latest_ns);
    TEST_ASSERT_EQUAL(3, clock.ticks);
}

static void test_quantiles_of_lateness(void) {
    static tick_clock clock;
    clock.late_us[3] = 50;
    clock.late_us[7] = 49;
    clock.late_us[CLOCK_RANGE_US] = 1;
    clock.ticks = 100;
    TEST_ASSERT_EQUAL(3, quantile(&clock, 1, 2));
    TEST_ASSERT_EQUAL(7, quantile(&clock, 51, 100));
    TEST_ASSERT_EQUAL(7, quantile(&clock, 99, 100));
    TEST_ASSERT_EQUAL(CLOCK_RANGE_US, quantile(&clock, 100, 100));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_refused_off_is_tried_again);
    RUN_TEST(test_a_channel_of_sysfs);
    RUN_TEST(test_converter_files);
    RUN_TEST(test_four_counts_a_period_both_ways);
    RUN_TEST(test_edges_of_two_lines_are_merged_by_time);
    RUN_TEST(test_an_edge_that_was_lost_is_counted);
    RUN_TEST(test_the_clock_counts_what_was_missed_and_how_late_it_is);
    RUN_TEST(test_quantiles_of_lateness);
    return UNITY_END();
}
