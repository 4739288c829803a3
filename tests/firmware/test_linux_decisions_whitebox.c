/* What the Linux controller decides: when the bridge may be on, when the e-stop is released, what each signal and each
 * mode does, in which order things are had and given back. */
#define _GNU_SOURCE

#include "linux_rig.h"

static controller c;
static gpio_line estop, enable, led;
static volatile bool lit;
static controller_options wanted;

void setUp(void) {
    steps = 0;
    steps_with_estop = 0;
    steps_until_the_end = 1000000;
    brought = 100000; /* nothing comes */
    opened[0] = '\0';
    outputs_set[0] = '\0';
    refused = '\0';
    offered = &enable;
    pwm_refuses = zero_refuses = enable_refuses = bridge_forbidden = false;
    closed_count = 0;
    modes_to_change = stops_kept = frames_sent = reopened = 0;
    idle_at = -1;
    wanted = (controller_options){.debounce_ms = 20U, .adc_bits = 13U};
    read_options.adc_bits = 13U;
    enable = (gpio_line){.output = enable_output, .letter = 'E'};
    led = (gpio_line){.output = &lit, .letter = 'L'};
    estop = (gpio_line){.descriptor = -1, .level = 1};
    TEST_ASSERT_TRUE(controller_open(&c, &wanted));
    c.estop = &estop;
    c.enable = &enable;
    c.clock.period_ns = TICK_NS;
    *enable_output = false;
}

void tearDown(void) {
    c.estop = NULL;
    c.led = NULL;
    c.direction = NULL;
    controller_close(&c);
}

/* ---- the bridge */

static void test_the_bridge_is_on_when_all_allow_it(void) {
    for (unsigned int bits = 0; bits < 64U; bits++) {
        c.outputs.enable = (bits & 1U) != 0U;
        bridge_forbidden = (bits & 2U) != 0U;
        c.stopped = (bits & 4U) != 0U;
        c.broken = (bits & 8U) != 0U;
        c.driving = (bits & 16U) != 0U;
        c.outputs.duty_q15 = (bits & 32U) != 0U ? 1000 : -1000;
        *enable_output = c.driving;
        outputs_set[0] = '\0';
        apply(&c);
        TEST_ASSERT_EQUAL((bits & 15U) == 1U, *enable_output);
        TEST_ASSERT_EQUAL((bits & 15U) == 1U, c.driving);
        if ((bits & 15U) != 1U) {
            TEST_ASSERT_NULL_MESSAGE(strpbrk(outputs_set, "E+-"), "nothing of it on the way to off");
        }
    }
}

static void test_an_output_that_cannot_be_set_ends_it_with_all_off(void) {
    for (int which = 0; which < 2; which++) {
        enable_refuses = which == 0;
        pwm_refuses = which == 1;
        c.broken = false;
        c.outputs.duty_q15 = 500;
        steps = 0;
        steps_until_the_end = 60;
        outputs_set[0] = '\0';
        TEST_ASSERT_EQUAL(1, controller_run(&c));
        TEST_ASSERT_TRUE(c.broken);
        TEST_ASSERT_LESS_THAN(60, steps);
        TEST_ASSERT_FALSE(*enable_output);
        TEST_ASSERT_FALSE(c.driving);
        if (which == 1) {
            TEST_ASSERT_NULL_MESSAGE(strchr(outputs_set, 'E'), "not enabled at a duty that was not set");
        }
    }
}

/* The duty of one direction, that could not be taken away, must not drive in the other. */
static void test_a_turn_whose_duty_does_not_go_ends_it(void) {
    volatile bool backward = true;
    gpio_line direction = {.output = &backward, .letter = 'D'};
    c.direction = &direction;
    c.stopped = c.broken = false;
    c.outputs.enable = true;
    c.outputs.duty_q15 = 500;
    for (int refuses = 0; refuses < 2; refuses++) {
        c.driving = c.backward = backward = true;
        *enable_output = true;
        zero_refuses = refuses == 1;
        apply(&c);
        TEST_ASSERT_EQUAL(refuses == 1, c.broken);
        TEST_ASSERT_EQUAL(refuses == 0, *enable_output);
        TEST_ASSERT_EQUAL(refuses == 0, c.driving);
        TEST_ASSERT_FALSE(backward);
    }
}

static void test_an_emergency_needs_no_step(void) {
    char text[8] = "";
    FILE *const file = tmpfile();
    TEST_ASSERT_NOT_NULL(file);
    c.pwm.descriptor = fileno(file);
    TEST_ASSERT_EQUAL(3, write(c.pwm.descriptor, "987", 3));
    *enable_output = true;
    controller_emergency(&c);
    TEST_ASSERT_FALSE(*enable_output);
    TEST_ASSERT_EQUAL(3, pread(c.pwm.descriptor, text, 3, 0));
    TEST_ASSERT_EQUAL_STRING_LEN("0\n", text, 2);
    c.pwm.descriptor = -1;
    (void)fclose(file);
}

/* Each of them ends the program as it would without a handler, the bridge off by then. */
static void test_every_fatal_signal_puts_the_bridge_off(void) {
    static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGSYS, SIGXCPU};
    for (size_t i = 0; i < (sizeof numbers / sizeof numbers[0]); i++) {
        int status = 0;
        *enable_output = true;
        const pid_t child = fork();
        if (child == 0) {
            const struct rlimit none = {0, 0};
            (void)setrlimit(RLIMIT_CORE, &none);
            the_controller.enable = &enable;
            the_controller.pwm.descriptor = -1;
            catch_fatal();
            (void)raise(numbers[i]);
            _exit(0);
        }
        TEST_ASSERT_EQUAL(child, waitpid(child, &status, 0));
        TEST_ASSERT_TRUE(WIFSIGNALED(status));
        TEST_ASSERT_EQUAL(numbers[i], WTERMSIG(status));
        TEST_ASSERT_FALSE(*enable_output);
    }
}

/* ---- the e-stop */

static void test_the_release_waits_for_its_time_without_a_break(void) {
    c.stopped = false;
    stop(&c);
    TEST_ASSERT_EQUAL(1, c.presses);
    for (int look = 0; look < 20; look++) {
        watch_estop(&c);
        TEST_ASSERT_TRUE(c.stopped);
    }
    estop.level = 0; /* one look in the last millisecond: all of it again, and the same press */
    watch_estop(&c);
    estop.level = 1;
    for (int look = 0; look < 20; look++) {
        watch_estop(&c);
        TEST_ASSERT_TRUE(c.stopped);
    }
    watch_estop(&c);
    TEST_ASSERT_FALSE(c.stopped);
    TEST_ASSERT_EQUAL(1, c.presses);
    watch_estop(&c);
    TEST_ASSERT_FALSE(c.stopped);
    stop(&c);
    TEST_ASSERT_EQUAL(2, c.presses);
    c.clock.period_ns = (uint64_t)CHORE_MS * TICK_NS; /* in test mode a look stands for 100 ms */
    watch_estop(&c);
    TEST_ASSERT_TRUE(c.stopped);
    watch_estop(&c);
    TEST_ASSERT_FALSE(c.stopped);
}

static void test_a_press_puts_the_bridge_off_at_once(void) {
    c.stopped = false;
    c.outputs.enable = true;
    apply(&c);
    TEST_ASSERT_TRUE(*enable_output);
    stop(&c);
    TEST_ASSERT_FALSE(*enable_output);
}

static void test_without_an_estop_there_is_nothing_to_release(void) {
    c.estop = NULL;
    watch_estop(&c);
    TEST_ASSERT_FALSE(c.stopped);
}

static void test_a_line_that_is_gone_is_not_believed_again(void) {
    c.stopped = false;
    estop.gone = true;
    take_estop_edges(&c, POLLIN);
    TEST_ASSERT_TRUE(c.stopped);
    TEST_ASSERT_TRUE(c.estop_gone);
    estop.gone = false;
    for (int look = 0; look < 100; look++) {
        watch_estop(&c);
    }
    TEST_ASSERT_TRUE(c.stopped);
}

static short edge_events = POLLIN;
static void edge(uint64_t time_ns, bool active) {
    int ends[2];
    TEST_ASSERT_EQUAL(0, pipe(ends));
    TEST_ASSERT_EQUAL(1, write(ends[1], "x", 1));
    estop.descriptor = ends[0];
    estop.edge = (gpio_edge){.time_ns = time_ns, .active = active};
    estop.has_edge = true;
    take_estop_edges(&c, edge_events);
    (void)close(ends[0]);
    (void)close(ends[1]);
}

static uint64_t now_ns_here(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return ((uint64_t)now.tv_sec * 1000000000U) + (uint64_t)now.tv_nsec;
}

static void test_only_an_edge_to_inactive_while_it_drives_is_timed(void) {
    c.stopped = false;
    edge(now_ns_here(), true); /* released */
    TEST_ASSERT_FALSE(c.stopped);
    TEST_ASSERT_FALSE(c.estop_gone);
    edge_events = POLLIN | POLLHUP; /* what waits is read before the end of it is believed */
    edge(now_ns_here(), true);
    edge_events = POLLIN;
    TEST_ASSERT_FALSE(c.estop_gone);
    edge(now_ns_here(), false); /* it does not drive */
    TEST_ASSERT_TRUE(c.stopped);
    TEST_ASSERT_EQUAL(0, c.timed);
    c.stopped = false;
    c.driving = true;
    edge(now_ns_here() + 3600000000000U, false); /* a clock that is not ours */
    TEST_ASSERT_TRUE(c.stopped);
    TEST_ASSERT_EQUAL(0, c.timed);
    for (uint64_t ago = 3; ago > 0U; ago--) { /* the slowest is kept */
        c.stopped = false;
        c.driving = true;
        edge(now_ns_here() - (ago * 1000000000U), false); /* s; no machine is up for less */
    }
    TEST_ASSERT_EQUAL(3, c.timed);
    TEST_ASSERT_GREATER_OR_EQUAL(3000000000U, c.slowest_off_ns);
    TEST_ASSERT_EQUAL(5, c.presses);
}

/* ---- modes, ticks and signals */

static void pass_a_period(void) {
    struct pollfd clock = {.fd = c.clock.descriptor, .events = POLLIN};
    TEST_ASSERT_EQUAL(1, poll(&clock, 1, 1000));
    tick(&c);
}

static void test_in_test_mode_the_bridge_is_off_and_the_clock_steps_no_more(void) {
    terrapin_frame command = {.id = TERRAPIN_ID_COMMAND};
    TEST_ASSERT_TRUE(tick_clock_start(&c.clock, TICK_NS));
    c.stopped = false;
    pass_a_period();
    TEST_ASSERT_EQUAL(1, steps);
    TEST_ASSERT_TRUE(*enable_output);
    modes_to_change = 2;
    TEST_ASSERT_TRUE(take_frame(&c, &command));
    TEST_ASSERT_TRUE(c.link.test_mode);
    TEST_ASSERT_FALSE(*enable_output);
    TEST_ASSERT_FALSE(c.outputs.enable);
    TEST_ASSERT_EQUAL(100 * TICK_NS, c.clock.period_ns);
    const uint32_t before = c.uptime_ms;
    const uint32_t told = c.inputs.tick;
    const int opened_again = reopened;
    pass_a_period();
    TEST_ASSERT_EQUAL(1, steps);
    TEST_ASSERT_EQUAL(told, c.inputs.tick);
    TEST_ASSERT_GREATER_OR_EQUAL(before + 100U, c.uptime_ms);
    TEST_ASSERT_EQUAL(opened_again + 1, reopened);
    TEST_ASSERT_EQUAL_STRING("WATCHDOG=1", told_systemd);
    TEST_ASSERT_TRUE(take_frame(&c, &command));
    TEST_ASSERT_EQUAL(TICK_NS, c.clock.period_ns);
    pass_a_period();
    TEST_ASSERT_EQUAL(2, steps);
}

/* poll(2) may say so without a period behind it. */
static void test_without_a_period_there_is_no_tick(void) {
    TEST_ASSERT_TRUE(tick_clock_start(&c.clock, 1000U * (uint64_t)TICK_NS));
    c.inputs.tick = 5U;
    c.intake.ahead = 1U;
    tick(&c);
    TEST_ASSERT_EQUAL(0, steps);
    TEST_ASSERT_EQUAL(5, c.inputs.tick);
    TEST_ASSERT_EQUAL_MESSAGE(1, c.intake.ahead, "no budget of another tick, either");
}

static void test_ticks_that_were_missed_are_in_the_step_s_tick(void) {
    const struct timespec stall = {.tv_nsec = 30000000};
    TEST_ASSERT_TRUE(tick_clock_start(&c.clock, TICK_NS));
    (void)nanosleep(&stall, NULL);
    pass_a_period();
    TEST_ASSERT_EQUAL(1, steps);
    TEST_ASSERT_GREATER_OR_EQUAL(30, c.inputs.tick);
    TEST_ASSERT_EQUAL(c.inputs.tick, c.uptime_ms);
    TEST_ASSERT_EQUAL(c.inputs.tick - 1U, c.clock.missed);
}

static void test_the_step_senses_keeps_and_sends(void) {
    c.stopped = true;
    c.flash_open = true;
    c.outputs.frame_count = 2;
    c.inputs.tick = 4;
    sense(&c);
    TEST_ASSERT_TRUE(c.inputs.estop);
    TEST_ASSERT_EQUAL(2048, c.inputs.supply_code);
    TEST_ASSERT_EQUAL(0, c.inputs.temperature_code);
    TEST_ASSERT_EQUAL(2048, c.inputs.current_code);
    c.inputs.supply_code = 0;
    c.inputs.tick = 5;
    c.motor.count = 12U * (uint16_t)TERRAPIN_ENCODER_DIVIDER;
    c.ground.count = 77U;
    sense(&c);
    TEST_ASSERT_EQUAL(2048, c.inputs.temperature_code);
    TEST_ASSERT_EQUAL(0, c.inputs.supply_code);
    TEST_ASSERT_EQUAL(12, c.inputs.motor_count);
    TEST_ASSERT_EQUAL(77, c.inputs.ground_count);
    step(&c);
    TEST_ASSERT_EQUAL(1, stops_kept);
    TEST_ASSERT_EQUAL(2, frames_sent);
    TEST_ASSERT_EQUAL(1, c.steps);
    c.flash_open = false;
    step(&c);
    TEST_ASSERT_EQUAL(1, stops_kept);
}

static void seen_lit(char pattern[11]) {
    for (uint32_t i = 0; i < 10U; i++) {
        c.uptime_ms = (i + 20U) * CHORE_MS;
        chores(&c);
        pattern[i] = (char)(lit ? '#' : '.');
    }
    pattern[10] = '\0';
}

static void test_what_the_led_says(void) {
    char pattern[11];
    c.led = &led;
    seen_lit(pattern);
    TEST_ASSERT_EQUAL_STRING("#####.....", pattern);
    c.outputs.faults = TERRAPIN_FAULTS_LATCHED;
    seen_lit(pattern);
    TEST_ASSERT_EQUAL_STRING("#.#.#.#.#.", pattern);
    c.outputs.faults = ~(uint32_t)TERRAPIN_FAULTS_LATCHED; /* none that latches */
    seen_lit(pattern);
    TEST_ASSERT_EQUAL_STRING("#####.....", pattern);
    c.outputs.faults = TERRAPIN_FAULTS_LATCHED;
    c.link.test_mode = true;
    seen_lit(pattern);
    TEST_ASSERT_EQUAL_STRING("#.........", pattern);
    c.driving = true;
    seen_lit(pattern);
    TEST_ASSERT_EQUAL_STRING("##########", pattern);
    c.link.test_mode = false;
    c.driving = false;
}

static void test_signals(void) {
    static const int ending[] = {SIGTERM, SIGINT, SIGHUP, SIGQUIT};
    for (size_t i = 0; i < (sizeof ending / sizeof ending[0]); i++) {
        steps = 0;
        c.outputs.duty_q15 = 100;
        c.estop = NULL;
        (void)raise(SIGUSR1); /* is no end */
        TEST_ASSERT_TRUE(take_signal(&c));
        TEST_ASSERT_TRUE_MESSAGE(take_signal(&c), "nothing waits");
        (void)raise(ending[i]);
        TEST_ASSERT_EQUAL(0, controller_run(&c));
        TEST_ASSERT_FALSE(*enable_output);
        TEST_ASSERT_EQUAL_STRING("STOPPING=1", told_systemd);
    }
}

static void test_the_end_puts_the_bridge_off(void) {
    c.estop = NULL;
    steps_until_the_end = 30; /* by a signal, between two steps that drive */
    outputs_set[0] = '\0';
    TEST_ASSERT_EQUAL(0, controller_run(&c));
    TEST_ASSERT_NOT_NULL_MESSAGE(strchr(outputs_set, 'E'), "it drove");
    TEST_ASSERT_FALSE(*enable_output);
}

/* ---- what is told */

static char *told;
static size_t told_size;

static void listen(void) {
    told_to = open_memstream(&told, &told_size);
    TEST_ASSERT_NOT_NULL(told_to);
}

/* What was told since listen(); the text lives until the next one. */
static const char *heard(void) {
    static char copy[4096];
    (void)fclose(told_to);
    told_to = NULL;
    (void)snprintf(copy, sizeof copy, "%s", told);
    free(told);
    return copy;
}

static void test_the_report_has_each_count_in_its_place(void) {
    static const char begin[] =
        "terrapin-controller: 1 steps; dropped: 2 bad CRC, 3 repeated, 4 malformed, 5 out of place, 6 unknown, 7 too "
        "many to wait; e-stop 8 times, ";
    char line[512];
    c.steps = 1;
    c.link.bad_crc = 2;
    c.link.repeated = 3;
    c.link.malformed = 4;
    c.link.out_of_place = 5;
    c.link.unknown = 6;
    c.intake.lost = 7;
    c.presses = 8;
    c.motor.skipped = 4;
    c.ground.skipped = 6;
    listen();
    report(&c);
    const char *text = heard();
    (void)snprintf(line, sizeof line, "%s0 timed from the edge; encoders skipped 10\n", begin);
    TEST_ASSERT_NOT_NULL(strstr(text, line));
    TEST_ASSERT_NOT_NULL(strstr(text, "terrapin-controller: 0 ticks by the clock, 0 missed; late by"));
    c.timed = 9;
    c.slowest_off_ns = 12001;
    listen();
    report(&c);
    (void)snprintf(line, sizeof line, "%s9 timed from the edge, enable off within 13 us of it; encoders skipped 10\n",
                   begin);
    TEST_ASSERT_NOT_NULL(strstr(heard(), line));
}

static void test_a_start_without_a_flash_says_what_is_forgotten(void) {
    static const char warning[] = "no --flash FILE: a restart forgets a STOP_ALL, parameters, node number";
    for (int open = 0; open < 2; open++) {
        c.estop = NULL;
        c.flash_open = open == 1;
        c.bus.name = "can7";
        steps_until_the_end = steps + 1;
        listen();
        TEST_ASSERT_EQUAL(0, controller_run(&c));
        const char *text = heard();
        TEST_ASSERT_NOT_NULL(strstr(text, "terrapin-controller: ready on can7\n"));
        TEST_ASSERT_EQUAL(open == 0, strstr(text, warning) != NULL);
        TEST_ASSERT_NOT_NULL(strstr(text, "terrapin-controller: stopped by a signal, outputs off\n"));
        TEST_ASSERT_NULL(strstr(text, "the system failed it"));
    }
    c.flash_open = false;
}

static void name_everything(void) {
    wanted.enable = (line_option){.given = true, .name = {.line = "E"}, .text = "E"};
    wanted.direction = (line_option){.given = true, .name = {.line = "D"}, .text = "D"};
    wanted.estop = (line_option){.given = true, .name = {.line = "S"}, .text = "S"};
    wanted.led = (line_option){.given = true, .name = {.line = "L"}, .text = "L"};
    wanted.motor[0] = (line_option){.given = true, .name = {.line = "M"}, .text = "M"};
    wanted.ground[0] = (line_option){.given = true, .name = {.line = "G"}, .text = "G"};
    wanted.pwm = "P";
    wanted.current = "1";
    wanted.supply = "2";
    wanted.temperature = "3";
    wanted.link_key = "K";
}

static void test_an_output_that_cannot_be_set_is_told(void) {
    c.stopped = c.broken = false;
    c.outputs.enable = true;
    c.outputs.duty_q15 = 500;
    enable_refuses = true;
    listen();
    apply(&c);
    TEST_ASSERT_EQUAL_STRING("terrapin-controller: cannot set an output: Input/output error\n", heard());
}

static void test_what_cannot_be_had_is_named(void) {
    static const struct {
        char letter;
        const char *told;
    } cases[] = {{'E', "line E: refused"},    {'P', "cannot open PWM channel P: "},
                 {'D', "line D: refused"},    {'s', "line S: refused"},
                 {'L', "line L: refused"},    {'M', "encoder M: refused"},
                 {'G', "encoder G: refused"}, {'1', "cannot open 1: "},
                 {'2', "cannot open 2: "},    {'3', "cannot open 3: "}};
    name_everything();
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        c.estop = NULL;
        controller_close(&c);
        refused = cases[i].letter;
        listen();
        TEST_ASSERT_FALSE(controller_open(&c, &wanted));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(heard(), cases[i].told), cases[i].told);
    }
}

/* ---- opening and closing */

static void test_a_stop_that_was_kept_is_known_to_be(void) {
    wanted.flash = "F";
    for (int kept = 0; kept < 2; kept++) {
        c.estop = NULL;
        controller_close(&c);
        stop_was_kept = kept == 1;
        TEST_ASSERT_TRUE(controller_open(&c, &wanted));
        TEST_ASSERT_TRUE(c.flash_open);
        TEST_ASSERT_EQUAL(kept == 1, c.stop_kept);
        TEST_ASSERT_FALSE(c.driving || c.broken || c.estop_gone || c.backward);
        TEST_ASSERT_TRUE(c.stopped);
    }
    stop_was_kept = false;
}

/* First what switches the bridge off, last what lets others switch it on; the e-stop is asked for its edges. */
static void test_the_order_in_which_things_are_had(void) {
    static const char order[] = "EPDsLMG123*K";
    name_everything();
    controller_close(&c);
    opened[0] = '\0';
    TEST_ASSERT_TRUE(controller_open(&c, &wanted));
    TEST_ASSERT_EQUAL_STRING(order, opened);
    TEST_ASSERT_TRUE_MESSAGE(c.stopped, "until the line was seen healthy");
    for (size_t i = 0; order[i] != '\0'; i++) {
        controller_close(&c);
        opened[0] = '\0';
        refused = order[i];
        TEST_ASSERT_FALSE(controller_open(&c, &wanted));
        TEST_ASSERT_EQUAL(i + 1U, strlen(opened));
    }
    refused = '\0';
}

static int times_closed(const void *what) {
    int times = 0;
    for (int i = 0; i < closed_count; i++) {
        times += (closed[i] == what) ? 1 : 0;
    }
    return times;
}

static void test_closing_gives_everything_back_once(void) {
    gpio_line direction = {.output = &lit, .letter = 'D'};
    for (int open = 0; open < 2; open++) {
        c.estop = &estop;
        c.enable = &enable;
        c.led = &led;
        c.direction = &direction;
        c.flash_open = open == 1;
        const int clock = c.clock.descriptor;
        const int signals = c.signals;
        const void *const all[] = {&estop,    &enable,    &led,      &direction,     &c.pwm, &c.motor,
                                   &c.ground, &c.current, &c.supply, &c.temperature, &c.bus};
        closed_count = 0;
        controller_close(&c);
        for (size_t i = 0; i < (sizeof all / sizeof all[0]); i++) {
            TEST_ASSERT_EQUAL(1, times_closed(all[i]));
        }
        TEST_ASSERT_EQUAL(open, times_closed(&c.flash));
        TEST_ASSERT_EQUAL(11 + open, closed_count);
        TEST_ASSERT_EQUAL(-1, fcntl(clock, F_GETFD));
        TEST_ASSERT_EQUAL(-1, fcntl(signals, F_GETFD));
        TEST_ASSERT_TRUE(controller_open(&c, &wanted));
    }
    refused = '*'; /* what was never had is not given back */
    controller_close(&c);
    wanted.enable = (line_option){.given = true, .name = {.line = "*"}, .text = "*"};
    TEST_ASSERT_FALSE(controller_open(&c, &wanted));
    TEST_ASSERT_EQUAL(-1, c.clock.descriptor);
    TEST_ASSERT_EQUAL(-1, c.signals);
    controller_close(&c);
    refused = '\0';
    wanted.enable.given = false;
    TEST_ASSERT_TRUE(controller_open(&c, &wanted));
}

static void test_the_bus_is_of_the_kind_that_was_named(void) {
    wanted.can = "can7";
    wanted.current = "1";
    wanted.bitrate = 125000;
    controller_close(&c);
    TEST_ASSERT_TRUE(controller_open(&c, &wanted));
    TEST_ASSERT_EQUAL_PTR(&bus_socketcan, c.bus.kind);
    TEST_ASSERT_EQUAL_STRING("can7", c.bus.name);
    wanted.can = NULL;
    wanted.current = NULL;
    wanted.adapter = "ttyACM0";
    controller_close(&c);
    TEST_ASSERT_TRUE(controller_open(&c, &wanted));
    TEST_ASSERT_EQUAL_PTR(&bus_adapter, c.bus.kind);
    TEST_ASSERT_EQUAL_STRING("ttyACM0", c.bus.name);
    TEST_ASSERT_EQUAL(125000, c.bus.bitrate);
}

/* A timer that cannot be set is no clock: the loop is not even begun. */
static void test_without_a_clock_nothing_runs(void) {
    const int clock = c.clock.descriptor;
    c.estop = NULL;
    c.clock.descriptor = -1;
    steps_until_the_end = 1;
    outputs_set[0] = '\0';
    listen();
    (void)raise(SIGTERM); /* the end of a loop that began all the same */
    TEST_ASSERT_EQUAL(1, controller_run(&c));
    const char *text = heard();
    TEST_ASSERT_NOT_NULL(strstr(text, "terrapin-controller: the system failed it: Bad file descriptor"));
    TEST_ASSERT_NULL(strstr(text, "stopped by a signal"));
    TEST_ASSERT_EQUAL(0, steps);
    TEST_ASSERT_NULL(strpbrk(outputs_set, "E+-"));
    TEST_ASSERT_FALSE_MESSAGE(take_signal(&c), "it waits still");
    c.clock.descriptor = clock;
}

static void test_closing_puts_off(void) {
    *enable_output = true;
    lit = true;
    c.led = &led;
    outputs_set[0] = '\0';
    controller_close(&c);
    TEST_ASSERT_FALSE(*enable_output);
    TEST_ASSERT_FALSE(lit);
    TEST_ASSERT_EQUAL('e', outputs_set[0]);
    TEST_ASSERT_TRUE(controller_open(&c, &wanted));
}

/* ---- main */

static int run_main(const char *first, const char *second, const char *third, const char *fourth) {
    char words[5][24] = {"controller"};
    char *arguments[6] = {words[0]};
    const char *given[4] = {first, second, third, fourth};
    int count = 1;
    for (int i = 0; (i < 4) && (given[i] != NULL); i++) {
        (void)snprintf(words[count], sizeof words[count], "%s", given[i]);
        arguments[count] = words[count];
        count++;
    }
    return linux_main(count, arguments);
}

static void test_the_command_line_says_which_program_it_is(void) {
    read_as = OPTIONS_WRONG;
    TEST_ASSERT_EQUAL(2, run_main("--can", "can0", NULL, NULL));
    read_as = OPTIONS_DONE;
    TEST_ASSERT_EQUAL(0, run_main("--help", NULL, NULL, NULL));
    TEST_ASSERT_EQUAL(0, run_main(NULL, NULL, NULL, NULL));
    TEST_ASSERT_EQUAL(0, run_main("--flash", "file", NULL, NULL)); /* a process of which nothing follows */
    TEST_ASSERT_EQUAL(0, run_main("--flash", "file", "--can", "can0"));
    TEST_ASSERT_EQUAL(42, run_main("--pty", NULL, NULL, NULL)); /* the process, with two words */
    TEST_ASSERT_EQUAL(42, run_main("/dev/ttyACM0", NULL, NULL, NULL));
    TEST_ASSERT_EQUAL(44, run_main("--flash", "file", "--pty", NULL));
    TEST_ASSERT_EQUAL(44, run_main("--flash", "file", "device", NULL));
}

static void test_off_puts_the_outputs_off_and_says_what_it_could_not(void) {
    read_as = OPTIONS_RUN;
    name_everything();
    read_options = wanted;
    read_options.off = true;
    opened[0] = '\0';
    TEST_ASSERT_EQUAL(0, run_main("--off", NULL, NULL, NULL));
    TEST_ASSERT_EQUAL_STRING("EP", opened); /* an output: requested inactive, and given back */
    refused = 'E';
    TEST_ASSERT_EQUAL(1, run_main("--off", NULL, NULL, NULL));
    TEST_ASSERT_EQUAL_STRING("EPEP", opened);
    refused = 'P';
    TEST_ASSERT_EQUAL(1, run_main("--off", NULL, NULL, NULL));
    refused = '\0';
    read_as = OPTIONS_DONE;
}

static void test_what_cannot_be_had_is_status_1(void) {
    read_as = OPTIONS_RUN;
    name_everything();
    read_options = wanted;
    refused = '*';
    TEST_ASSERT_EQUAL(1, run_main("--can", "can0", NULL, NULL));
    refused = '\0';
    read_as = OPTIONS_DONE;
}

int main(void) {
    enable_output = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (enable_output == MAP_FAILED) {
        return 1;
    }
    UNITY_BEGIN();
    RUN_TEST(test_the_bridge_is_on_when_all_allow_it);
    RUN_TEST(test_an_output_that_cannot_be_set_ends_it_with_all_off);
    RUN_TEST(test_a_turn_whose_duty_does_not_go_ends_it);
    RUN_TEST(test_an_emergency_needs_no_step);
    RUN_TEST(test_every_fatal_signal_puts_the_bridge_off);
    RUN_TEST(test_the_release_waits_for_its_time_without_a_break);
    RUN_TEST(test_a_press_puts_the_bridge_off_at_once);
    RUN_TEST(test_without_an_estop_there_is_nothing_to_release);
    RUN_TEST(test_a_line_that_is_gone_is_not_believed_again);
    RUN_TEST(test_only_an_edge_to_inactive_while_it_drives_is_timed);
    RUN_TEST(test_in_test_mode_the_bridge_is_off_and_the_clock_steps_no_more);
    RUN_TEST(test_without_a_period_there_is_no_tick);
    RUN_TEST(test_ticks_that_were_missed_are_in_the_step_s_tick);
    RUN_TEST(test_the_step_senses_keeps_and_sends);
    RUN_TEST(test_what_the_led_says);
    RUN_TEST(test_signals);
    RUN_TEST(test_the_end_puts_the_bridge_off);
    RUN_TEST(test_the_report_has_each_count_in_its_place);
    RUN_TEST(test_a_start_without_a_flash_says_what_is_forgotten);
    RUN_TEST(test_an_output_that_cannot_be_set_is_told);
    RUN_TEST(test_what_cannot_be_had_is_named);
    RUN_TEST(test_a_stop_that_was_kept_is_known_to_be);
    RUN_TEST(test_the_order_in_which_things_are_had);
    RUN_TEST(test_closing_gives_everything_back_once);
    RUN_TEST(test_the_bus_is_of_the_kind_that_was_named);
    RUN_TEST(test_without_a_clock_nothing_runs);
    RUN_TEST(test_closing_puts_off);
    RUN_TEST(test_the_command_line_says_which_program_it_is);
    RUN_TEST(test_off_puts_the_outputs_off_and_says_what_it_could_not);
    RUN_TEST(test_what_cannot_be_had_is_status_1);
    return UNITY_END();
}
