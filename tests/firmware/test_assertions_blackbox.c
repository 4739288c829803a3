/* Assertions are on in everything that runs on a host: each wrong value that is planted here ends the program, and the
 * same call without it does not. */
#include <signal.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "rig.h"

#include "parameters.h"
#include "service.h"

void setUp(void) {
    rig_start();
}
void tearDown(void) {}

/* How a child ends that spoils something and goes on: its signal, 0 when it lives. */
static int ends(void (*act)(bool spoil), bool spoil) {
    int status = 0;
    const pid_t child = fork();
    if (child == 0) {
        (void)close(STDERR_FILENO); /* the message is the same each time */
        (void)signal(SIGABRT, SIG_DFL);
        act(spoil);
        _exit(0);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    return WIFSIGNALED(status) ? WTERMSIG(status) : WEXITSTATUS(status);
}

static void limits_the_wrong_way_round(bool spoil) {
    (void)integer_clamp(5, spoil ? 7 : 3, 6);
}

static void divides_by_nothing(bool spoil) {
    (void)integer_scale(5, 3, spoil ? -1 : 1);
}

static void record_beyond_the_history(bool spoil) {
    rig_run(2000);
    rig.state.estimator.newest = spoil ? HISTORY_SLOTS : 0U;
    (void)estimator_record(&rig.state, 1U);
}

static void place_beyond_the_last_ticks(bool spoil) {
    rig_run(2000);
    rig.state.estimator.swing_ticks = 0U;
    rig.state.parameter[TERRAPIN_PARAMETER_SLIP_WINDOW] = spoil ? FAST_TICKS : 100;
    rig_run(1);
}

static void integral_beyond_its_limit(bool spoil) {
    rig_drive(1000, TERRAPIN_CONTROL_SPEED);
    rig_run(1000);
    rig.state.drive.speed_integral_uv += spoil ? 100000000 : 0;
    rig_run(1);
}

static void stuck_in_no_direction(bool spoil) {
    rig_drive(1000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(1000);
    rig.state.supervisor.state = TERRAPIN_STATE_EXTRICATE;
    rig.state.supervisor.direction = spoil ? 0 : 1;
    rig_run(1);
}

static void a_fit_without_windows(bool spoil) {
    rig_run(1000);
    rig.state.ground.todo = spoil ? (uint8_t)(FIT_STEPS + 1) : 0U;
    rig.in.tick -= rig.in.tick % 10U; /* before a tick that has work of the fit to do */
    rig.in.tick += 1U;
    rig_run(1);
}

static void a_report_that_does_not_exist(bool spoil) {
    episode_report(&rig.state, spoil ? TERRAPIN_REPORT_NONE : TERRAPIN_REPORT_STOPPED, 0);
}

static void a_step_without_inputs(bool spoil) {
    terrapin_step(&rig.state, spoil ? NULL : &rig.in, &rig.out);
}

static void a_line_longer_than_its_place(bool spoil) {
    terrapin_slcan parser;
    terrapin_frame frame = {0};
    terrapin_slcan_reply reply = {0};
    terrapin_slcan_init(&parser);
    parser.length = (uint8_t)(TERRAPIN_SLCAN_LINE_MAX + (spoil ? 1U : 0U));
    (void)terrapin_slcan_feed(&parser, (uint8_t)'a', &frame, &reply);
}

static void a_counter_that_no_frame_has(bool spoil) {
    static terrapin_link link;
    terrapin_frame frame = {0};
    terrapin_frame reply = {0};
    const terrapin_parameter_read_t message = {.index = 0};
    terrapin_link_init(&link, &rig.state, &rig.in);
    link.reply_counter = spoil ? 15U : 14U;
    (void)terrapin_encode_parameter_read(&message, &frame);
    (void)terrapin_accept(&link, &rig.state, &frame, &rig.in, &reply);
}

static void a_third_page(bool spoil) {
    static terrapin_store store;
    store.active = spoil ? 2U : 1U;
    (void)terrapin_store_work(&store, false);
}

#define PLANTED(name) {#name, name}

static void test_what_is_planted_is_found(void) {
    static const struct {
        const char *name;
        void (*act)(bool spoil);
    } planted[] = {
        PLANTED(limits_the_wrong_way_round),  PLANTED(divides_by_nothing),
        PLANTED(record_beyond_the_history),   PLANTED(place_beyond_the_last_ticks),
        PLANTED(integral_beyond_its_limit),   PLANTED(stuck_in_no_direction),
        PLANTED(a_fit_without_windows),       PLANTED(a_report_that_does_not_exist),
        PLANTED(a_step_without_inputs),       PLANTED(a_line_longer_than_its_place),
        PLANTED(a_counter_that_no_frame_has), PLANTED(a_third_page),
    };
    for (size_t i = 0; i < (sizeof planted / sizeof planted[0]); i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, ends(planted[i].act, false), planted[i].name);
#ifdef TERRAPIN_ASSERTIONS
        TEST_ASSERT_EQUAL_INT_MESSAGE(SIGABRT, ends(planted[i].act, true), planted[i].name);
#endif
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_is_planted_is_found);
    return UNITY_END();
}
