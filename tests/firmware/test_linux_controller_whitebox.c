/* The Linux controller's loop and its end, on lines that vanish and on a stack that ends. The step, the bus and the
 * command line are stand-ins; descriptors, poll, signals and the clock are the system's. */
#define _GNU_SOURCE

#include "linux_rig.h"

/* ---- tests */

static gpio_line estop;
static gpio_line enable;
static gpio_line direction;
static volatile bool backward;
static controller c;
static int ends[2];
static const controller_options defaults = {.debounce_ms = 20U};

void setUp(void) {
    TEST_ASSERT_EQUAL(0, pipe2(ends, O_NONBLOCK | O_CLOEXEC));
    steps = 0;
    steps_with_estop = 0;
    TEST_ASSERT_TRUE(controller_open(&c, &defaults));
    estop = (gpio_line){.descriptor = ends[0], .level = 1};
    enable = (gpio_line){.output = enable_output, .letter = 'E'};
    direction = (gpio_line){.output = &backward, .letter = 'D'};
    c.estop = &estop;
    c.enable = &enable;
}

void tearDown(void) {
    c.estop = NULL;
    controller_close(&c);
    (void)close(ends[0]);
    if (ends[1] >= 0) {
        (void)close(ends[1]);
    }
}

/* The other end of the line's descriptor is closed: poll says POLLHUP, at once and for ever. */
static void vanishes(bool told) {
    steps_until_the_end = 60;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_GREATER_THAN_MESSAGE(20, steps - steps_with_estop, "it drove");
    estop.gone = told;
    (void)close(ends[1]);
    ends[1] = -1;
    steps_with_estop = 0;
    estop.looks = 0;
    steps_until_the_end = steps + 200;
    const int before = steps;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_EQUAL_MESSAGE(steps - before, steps_with_estop, "each step after it knows of the e-stop");
    TEST_ASSERT_FALSE(*enable_output);
    TEST_ASSERT_EQUAL_MESSAGE(1, estop.looks, "and it is not polled again, which would burn a core");
    estop.gone = false; /* a chip of that name comes back: what its line means is not known */
    steps_until_the_end = steps + 60;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_FALSE(*enable_output);
}

static void test_an_estop_that_vanishes_stops_for_good(void) {
    vanishes(true);
}

static void test_also_when_only_poll_says_so(void) {
    vanishes(false);
}

static void test_an_edge_is_timed(void) {
    struct timespec now;
    steps_until_the_end = 60;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_EQUAL(0, c.timed);
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    c.driving = true;
    estop.edge.time_ns = ((uint64_t)now.tv_sec * 1000000000U) + (uint64_t)now.tv_nsec;
    estop.has_edge = true;
    TEST_ASSERT_EQUAL(1, write(ends[1], "x", 1));
    steps_until_the_end = steps + 30;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_EQUAL(1, c.timed);
    TEST_ASSERT_GREATER_THAN(0, c.slowest_off_ns);
}

/* The level is seen first, as by gpio-sim: the press counts, but there is no time to tell. */
static void test_a_press_without_its_edge_is_not_timed(void) {
    steps_until_the_end = 60;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    estop.level = 0;
    steps_until_the_end = steps + 30;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_EQUAL(1, c.presses);
    TEST_ASSERT_EQUAL(0, c.timed);
    TEST_ASSERT_FALSE(*enable_output);
}

/* Its level cannot be read, though its descriptor is quiet: that is no healthy line. */
static void test_a_level_that_cannot_be_read_is_a_press(void) {
    steps_until_the_end = 60;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_EQUAL(0, c.presses);
    estop.level = -1;
    steps_until_the_end = steps + 30;
    steps_with_estop = 0;
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_EQUAL(30, steps_with_estop);
    TEST_ASSERT_EQUAL(1, c.presses);
    TEST_ASSERT_FALSE(*enable_output);
}

/* Released while nobody looked: the time of the ticks that were missed is no time without interruption. */
static void test_missed_ticks_release_no_estop(void) {
    const struct timespec stall = {.tv_nsec = 50000000};
    struct pollfd clock = {.fd = c.clock.descriptor, .events = POLLIN};
    steps_until_the_end = 1000;
    c.stopped = false;
    TEST_ASSERT_TRUE(tick_clock_start(&c.clock, TICK_NS));
    stop(&c);
    (void)nanosleep(&stall, NULL); /* more than debounce_ms */
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL(1, poll(&clock, 1, 1000));
        tick(&c);
        TEST_ASSERT_TRUE_MESSAGE(c.stopped, "three looks are not 20 ms");
    }
    TEST_ASSERT_GREATER_THAN(40, c.clock.missed);
}

/* A flood on the bus: a tick takes four reads, however many come, and three where an IDLE came before it. */
static void test_of_a_flood_a_tick_takes_its_budget(void) {
    int flood[2];
    TEST_ASSERT_EQUAL(0, pipe(flood));
    TEST_ASSERT_EQUAL(1, write(flood[1], "x", 1)); /* it stays there: the bus is always ready */
    brought = 1;
    last_taken = 0;
    idle_at = 30;
    idle_taken_at = -1;
    memset(taken_in, 0, sizeof taken_in);
    steps_until_the_end = 60;
    c.bus.descriptor = flood[0];
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    c.bus.descriptor = -1;
    for (int i = 1; i < 60; i++) {
        TEST_ASSERT_EQUAL((i == (idle_taken_at + 1)) ? 3 : 4, taken_in[i]);
    }
    TEST_ASSERT_EQUAL(30, idle_taken_at);
    TEST_ASSERT_LESS_OR_EQUAL(TERRAPIN_INTAKE_SIZE, c.intake.count); /* less where the last tick caught up */
    TEST_ASSERT_GREATER_THAN_MESSAGE(100, c.intake.lost, "it was full");
    (void)close(flood[0]);
    (void)close(flood[1]);
}

/* A line may take its time (an expander on I2C): off does not wait for it, and no duty acts in the other direction. */
static void test_the_order_of_the_outputs(void) {
    c.direction = &direction;
    c.outputs.duty_q15 = -1000;
    TEST_ASSERT_TRUE(drive(&c, true));
    outputs_set[0] = '\0';
    TEST_ASSERT_TRUE(drive(&c, true));
    TEST_ASSERT_EQUAL_STRING("D-E", outputs_set);
    outputs_set[0] = '\0';
    c.outputs.duty_q15 = 1000;
    TEST_ASSERT_TRUE(drive(&c, true));
    TEST_ASSERT_EQUAL_STRING("0d+E", outputs_set);
    outputs_set[0] = '\0';
    TEST_ASSERT_TRUE(drive(&c, false));
    TEST_ASSERT_EQUAL_STRING_LEN("e0d", outputs_set, 3);
    TEST_ASSERT_NULL(strpbrk(outputs_set, "+-ED"));
    c.direction = NULL;
}

/* The compiler must neither see the end nor make a loop of it. */
static int (*volatile deeper)(int);
static int dig(int depth) {
    volatile char frame[4096];
    frame[0] = (char)depth;
    return deeper(depth + 1) + frame[0];
}

static void test_a_stack_that_ends_puts_the_output_off(void) {
    *enable_output = true;
    const pid_t child = fork();
    if (child == 0) {
        const struct rlimit none = {0, 0};
        (void)setrlimit(RLIMIT_CORE, &none);
        the_controller.enable = &enable;
        the_controller.pwm.descriptor = -1;
        catch_fatal();
        deeper = dig;
        _exit(dig(0));
    }
    int status = 0;
    TEST_ASSERT_EQUAL(child, waitpid(child, &status, 0));
    TEST_ASSERT_TRUE(WIFSIGNALED(status));
    TEST_ASSERT_EQUAL(SIGSEGV, WTERMSIG(status));
    TEST_ASSERT_FALSE(*enable_output);
}

int main(void) {
    enable_output = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (enable_output == MAP_FAILED) {
        return 1;
    }
    UNITY_BEGIN();
    RUN_TEST(test_an_estop_that_vanishes_stops_for_good);
    RUN_TEST(test_also_when_only_poll_says_so);
    RUN_TEST(test_an_edge_is_timed);
    RUN_TEST(test_a_press_without_its_edge_is_not_timed);
    RUN_TEST(test_a_level_that_cannot_be_read_is_a_press);
    RUN_TEST(test_missed_ticks_release_no_estop);
    RUN_TEST(test_of_a_flood_a_tick_takes_its_budget);
    RUN_TEST(test_the_order_of_the_outputs);
    RUN_TEST(test_a_stack_that_ends_puts_the_output_off);
    return UNITY_END();
}
