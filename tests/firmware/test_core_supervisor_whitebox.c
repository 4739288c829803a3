/* The supervisor tick by tick: each bound at its last tick and at the next one, and what a new episode begins with.
 * What it calls is faked here, so that a test can put the state anywhere and see which calls were made. */
#include <string.h>

#include "unity.h"

#include "episode.c"
#include "integer.c"
#include "supervisor.c"

static terrapin_state state;
static terrapin_inputs inputs;
static terrapin_demand demand;
static calibration_result calibrated;
static bool stuck;
static bool extricated;
static int calibrations;
static int extrications;

void calibration_start(terrapin_state *unused) {
    (void)unused;
    calibrations++;
}

calibration_result calibration_update(terrapin_state *unused, int32_t *voltage_mv) {
    (void)unused;
    *voltage_mv = 1234;
    return calibrated;
}

bool extrication_watch(terrapin_state *unused, int32_t direction) {
    (void)unused;
    (void)direction;
    return stuck;
}

void extrication_start(terrapin_state *s, const terrapin_inputs *in, int32_t direction) {
    (void)in;
    (void)direction;
    extrications++;
    episode_enter(s, TERRAPIN_STATE_STUCK, PHASE_FIRST);
}

bool extrication_update(terrapin_state *unused, const terrapin_inputs *in, terrapin_demand *d) {
    (void)unused;
    (void)in;
    d->mode = DEMAND_VOLTAGE;
    return extricated;
}

void setUp(void) {
    memset(&state, 0, sizeof state);
    memset(&inputs, 0, sizeof inputs);
    calibrated = CALIBRATION_BUSY;
    stuck = extricated = false;
    calibrations = extrications = 0;
    state.gains.consistent = true;
    state.parameter[TERRAPIN_PARAMETER_COMMAND_TIMEOUT] = 200;
    state.supervisor.state = TERRAPIN_STATE_IDLE;
}

void tearDown(void) {}

/* One tick without a command, at the same time as the last command. */
static void tick(void) {
    supervisor_update(&state, &inputs, 0U, false, &demand);
}

static bool fault(uint32_t number) {
    return (state.supervisor.faults & (1UL << number)) != 0U;
}

/* As many ticks as leave the state as it is, at most 5000. */
static int ticks_in(int32_t which) {
    int count = 0;
    while ((state.supervisor.state == which) && (count < 5000)) {
        tick();
        count++;
    }
    return count;
}

static void in(int32_t which, terrapin_phase phase, int32_t request) {
    episode_enter(&state, which, phase);
    state.supervisor.request = request;
    state.supervisor.request_taken = request;
}

static void test_start_takes_its_times(void) {
    state.supervisor.state = TERRAPIN_STATE_BOOT;
    TEST_ASSERT_EQUAL_INT(10, ticks_in(TERRAPIN_STATE_BOOT));
    TEST_ASSERT_EQUAL_INT(180, ticks_in(TERRAPIN_STATE_SELF_TEST));
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, state.supervisor.state);
}

static void test_ready_is_idle_without_a_latched_fault(void) {
    TEST_ASSERT_TRUE(supervisor_ready(&state));
    state.supervisor.faults = TERRAPIN_FAULTS_LATCHED;
    TEST_ASSERT_FALSE(supervisor_ready(&state));
    state.supervisor.faults = 0U;
    state.supervisor.state = TERRAPIN_STATE_RUN;
    TEST_ASSERT_FALSE(supervisor_ready(&state));
}

/* The command is late after its timeout, in each state that drives, and in no other. */
static void test_a_late_command_counts_where_the_bridge_may_be_on(void) {
    static const struct {
        int32_t state;
        bool drives;
    } cases[] = {{TERRAPIN_STATE_BOOT, false},     {TERRAPIN_STATE_SELF_TEST, false}, {TERRAPIN_STATE_IDLE, false},
                 {TERRAPIN_STATE_CALIBRATE, true}, {TERRAPIN_STATE_RUN, true},        {TERRAPIN_STATE_LIMITING, true},
                 {TERRAPIN_STATE_STUCK, true},     {TERRAPIN_STATE_EXTRICATE, true},  {TERRAPIN_STATE_SAFE, false}};
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        setUp();
        in(cases[i].state, PHASE_FIRST, TERRAPIN_REQUEST_RUN);
        state.sense.tick = 200U;
        tick();
        TEST_ASSERT_FALSE(fault(TERRAPIN_FAULT_COMMAND_TIMEOUT));
        setUp();
        in(cases[i].state, PHASE_FIRST, TERRAPIN_REQUEST_RUN);
        state.sense.tick = 201U;
        tick();
        TEST_ASSERT_EQUAL(cases[i].drives, fault(TERRAPIN_FAULT_COMMAND_TIMEOUT));
    }
}

static void test_the_causes_of_faults(void) {
    inputs.estop = true;
    state.gains.consistent = false;
    state.slip.implausible = true;
    state.saturated_shown = true;
    tick();
    TEST_ASSERT_TRUE(fault(TERRAPIN_FAULT_ESTOP));
    TEST_ASSERT_TRUE(fault(TERRAPIN_FAULT_PARAMETER));
    TEST_ASSERT_TRUE(fault(TERRAPIN_FAULT_GROUND_SPEED));
    TEST_ASSERT_TRUE(fault(TERRAPIN_FAULT_SATURATED));
    setUp();
    state.estimator.saturated = true;
    tick();
    TEST_ASSERT_EQUAL_HEX32(1UL << TERRAPIN_FAULT_SATURATED, state.supervisor.faults);
    setUp();
    tick();
    TEST_ASSERT_EQUAL_HEX32(0U, state.supervisor.faults);
}

static void test_a_gap_in_the_ticks_is_shown_for_a_second(void) {
    int shown = 0;
    supervisor_update(&state, &inputs, 0U, true, &demand);
    while (fault(TERRAPIN_FAULT_OVERRUN) && (shown < 5000)) {
        shown++;
        tick();
    }
    TEST_ASSERT_EQUAL_INT(1000, shown);
    TEST_ASSERT_EQUAL_UINT32(0U, state.supervisor.overrun_ms);
}

static void test_only_clear_takes_a_latched_fault_away(void) {
    const uint32_t latched = 1UL << TERRAPIN_FAULT_ESTOP;
    supervisor_update(&state, &inputs, latched, false, &demand);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, state.supervisor.state);
    state.supervisor.request = TERRAPIN_REQUEST_CLEAR; /* an old one */
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, state.supervisor.state);
    state.supervisor.report = TERRAPIN_REPORT_CALIBRATED;
    inputs.command_fresh = true;
    inputs.command.request = TERRAPIN_REQUEST_CLEAR;
    supervisor_update(&state, &inputs, latched, false, &demand); /* the cause stands */
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, state.supervisor.state);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_NONE, state.supervisor.report);
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, state.supervisor.state);
    TEST_ASSERT_EQUAL_HEX32(0U, state.supervisor.faults);
}

/* The latched fault is there again after the clear, and the IDLE before it still holds. */
static void test_a_refused_run_clears_nothing(void) {
    state.supervisor.hold_ms = 100U;
    state.supervisor.request = TERRAPIN_REQUEST_CLEAR;
    state.supervisor.request_taken = TERRAPIN_REQUEST_CLEAR;
    state.supervisor.faults = 1UL << TERRAPIN_FAULT_ESTOP;
    state.supervisor.state = TERRAPIN_STATE_SAFE;
    inputs.command_fresh = true;
    inputs.command.request = TERRAPIN_REQUEST_RUN;
    tick();
    TEST_ASSERT_TRUE(state.supervisor.refused);
    TEST_ASSERT_TRUE(fault(TERRAPIN_FAULT_ESTOP));
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, state.supervisor.state);
}

static void test_a_refusal_is_shown_as_long_as_the_idle_holds(void) {
    state.supervisor.hold_ms = 2U;
    state.supervisor.refused = true;
    tick();
    TEST_ASSERT_TRUE(state.supervisor.refused);
    tick();
    TEST_ASSERT_FALSE(state.supervisor.refused);
}

static void test_the_guard_of_the_swing_begins_at_its_limit(void) {
    inputs.swing_valid = true;
    inputs.swing_angle_mrad = 500;
    tick(); /* no limit is set */
    TEST_ASSERT_FALSE(fault(TERRAPIN_FAULT_SWING));
    state.parameter[TERRAPIN_PARAMETER_SWING_LIMIT] = 1;
    inputs.swing_angle_mrad = 0;
    tick();
    TEST_ASSERT_FALSE(fault(TERRAPIN_FAULT_SWING));
    inputs.swing_angle_mrad = -1;
    tick();
    TEST_ASSERT_TRUE(fault(TERRAPIN_FAULT_SWING));
}

static void test_the_guard_of_the_swing_is_blind_after_twenty_ticks(void) {
    state.parameter[TERRAPIN_PARAMETER_SWING_LIMIT] = 1;
    for (int i = 1; i <= 30; i++) {
        tick();
        TEST_ASSERT_EQUAL(i >= 20, fault(TERRAPIN_FAULT_SWING_SENSOR));
    }
    TEST_ASSERT_EQUAL_UINT8(20U, state.supervisor.blind_ms); /* it counts no further */
}

static void test_what_is_heard(void) {
    inputs.command_fresh = true;
    inputs.tick = 77U;
    inputs.command.request = TERRAPIN_REQUEST_IDLE;
    inputs.command.control = TERRAPIN_CONTROL_SPEED;
    inputs.command.setpoint = -321;
    inputs.command.limiter = true;
    state.supervisor.request_taken = TERRAPIN_REQUEST_RUN;
    state.sense.tick = 77U;
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REQUEST_IDLE, state.supervisor.request);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REQUEST_IDLE, state.supervisor.request_taken);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_CONTROL_SPEED, state.supervisor.control);
    TEST_ASSERT_EQUAL_INT32(-321, state.supervisor.setpoint);
    TEST_ASSERT_TRUE(state.supervisor.limiter);
    TEST_ASSERT_EQUAL_UINT32(77U, state.supervisor.command_tick);
    inputs.command.request = TERRAPIN_REQUEST_CLEAR;
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REQUEST_CLEAR, state.supervisor.request_taken);
}

static void test_still_is_below_both_speeds(void) {
    static const struct {
        int32_t wheel, ground;
        bool still;
    } cases[] = {{39999, 4999, true}, {-39999, -4999, true}, {40000, 0, false}, {-40000, 0, false},
                 {0, 5000, false},    {0, -5000, false},     {0, 0, true}};
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        state.supervisor.still_ms = 7U;
        state.slip.wheel_urad_s = cases[i].wheel;
        state.slip.ground_um_s = cases[i].ground;
        tick();
        TEST_ASSERT_EQUAL_UINT32(cases[i].still ? 8U : 0U, state.supervisor.still_ms);
    }
}

static void test_a_run_begins_anew(void) {
    state.supervisor.request = TERRAPIN_REQUEST_RUN;
    state.supervisor.episode_ms = 99U;
    state.supervisor.digging = state.supervisor.moved = true;
    state.supervisor.no_progress_ms = 99U;
    state.slip.peak_e4 = 99;
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, state.supervisor.state);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REQUEST_RUN, state.supervisor.request_taken);
    TEST_ASSERT_EQUAL_UINT32(0U, state.supervisor.episode_ms);
    TEST_ASSERT_FALSE(state.supervisor.digging || state.supervisor.moved);
    TEST_ASSERT_EQUAL_UINT32(0U, state.supervisor.no_progress_ms);
    TEST_ASSERT_EQUAL_INT32(0, state.slip.peak_e4);
}

static void test_a_request_that_was_served_or_is_late_is_none(void) {
    in(TERRAPIN_STATE_IDLE, PHASE_FIRST, TERRAPIN_REQUEST_RUN);
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, state.supervisor.state);
    state.supervisor.request_taken = TERRAPIN_REQUEST_IDLE;
    state.sense.tick = 201U;
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, state.supervisor.state);
}

/* Calibration waits for rest, and for the zero of the current where that is asked for. */
static void calibrate_from(uint32_t still_ms, bool trimmed, int32_t trim, bool begins) {
    setUp();
    state.supervisor.request = TERRAPIN_REQUEST_CALIBRATE;
    state.supervisor.episode_ms = 99U;
    state.supervisor.still_ms = still_ms;
    state.sense.trimmed = trimmed;
    state.parameter[TERRAPIN_PARAMETER_TRIM_CURRENT] = trim;
    tick();
    TEST_ASSERT_EQUAL_INT32(begins ? TERRAPIN_STATE_CALIBRATE : TERRAPIN_STATE_IDLE, state.supervisor.state);
    TEST_ASSERT_EQUAL_INT(begins ? 1 : 0, calibrations);
    TEST_ASSERT_EQUAL_UINT32(begins ? 0U : 100U, state.supervisor.episode_ms);
    TEST_ASSERT_EQUAL_INT32(begins ? TERRAPIN_REQUEST_CALIBRATE : 0, state.supervisor.request_taken);
}

static void test_calibration_begins_at_rest_with_a_zero(void) {
    calibrate_from(199U, true, 1, true);
    calibrate_from(198U, true, 1, false);
    calibrate_from(199U, false, 1, false);
    calibrate_from(199U, false, 0, true);
    calibrate_from(199U, true, 0, true);
}

static void test_a_halt_ends_at_rest_or_after_its_time(void) {
    static const struct {
        int32_t state;
        uint32_t still_ms, timer_ms;
        bool ends;
    } cases[] = {{TERRAPIN_STATE_RUN, 199U, 0U, true},        {TERRAPIN_STATE_RUN, 198U, 0U, false},
                 {TERRAPIN_STATE_RUN, 0U, 3999U, true},       {TERRAPIN_STATE_RUN, 0U, 3998U, false},
                 {TERRAPIN_STATE_CALIBRATE, 199U, 0U, true},  {TERRAPIN_STATE_CALIBRATE, 198U, 0U, false},
                 {TERRAPIN_STATE_CALIBRATE, 0U, 3999U, true}, {TERRAPIN_STATE_CALIBRATE, 0U, 3998U, false}};
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        setUp();
        in(cases[i].state, PHASE_HALT, TERRAPIN_REQUEST_RUN);
        state.supervisor.still_ms = cases[i].still_ms;
        state.supervisor.timer_ms = cases[i].timer_ms;
        tick();
        TEST_ASSERT_EQUAL_INT32(cases[i].ends ? TERRAPIN_STATE_IDLE : cases[i].state, state.supervisor.state);
        TEST_ASSERT_EQUAL_INT(cases[i].ends ? DEMAND_OFF : DEMAND_VOLTAGE, demand.mode);
        TEST_ASSERT_EQUAL_INT32(0, demand.voltage_mv);
    }
}

static void test_calibration_drives_until_it_ends(void) {
    in(TERRAPIN_STATE_CALIBRATE, PHASE_FIRST, TERRAPIN_REQUEST_CALIBRATE);
    tick();
    TEST_ASSERT_EQUAL_INT(DEMAND_VOLTAGE, demand.mode);
    TEST_ASSERT_EQUAL_INT32(1234, demand.voltage_mv);
    calibrated = CALIBRATION_DONE;
    tick();
    TEST_ASSERT_EQUAL_INT(DEMAND_VOLTAGE, demand.mode);
    TEST_ASSERT_EQUAL_INT32(0, demand.voltage_mv);
    TEST_ASSERT_EQUAL_INT32(PHASE_HALT, state.supervisor.phase);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_CALIBRATED, state.supervisor.report);
    TEST_ASSERT_EQUAL_INT32(0, state.supervisor.report_distance_mm);
    TEST_ASSERT_EQUAL_UINT8(1U, state.supervisor.report_number);
    setUp();
    calibrated = CALIBRATION_DONE;
    in(TERRAPIN_STATE_CALIBRATE, PHASE_FIRST, TERRAPIN_REQUEST_RUN); /* asked for something else meanwhile */
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_CALIBRATION_FAILED, state.supervisor.report);
}

static void test_a_run_asks_the_drive_for_what_was_commanded(void) {
    in(TERRAPIN_STATE_RUN, PHASE_FIRST, TERRAPIN_REQUEST_RUN);
    state.supervisor.setpoint = -500;
    state.supervisor.limiter = true;
    demand.speed_urad_s = 55;
    tick();
    TEST_ASSERT_EQUAL_INT(DEMAND_VOLTAGE, demand.mode);
    TEST_ASSERT_EQUAL_INT32(-500, demand.voltage_mv);
    TEST_ASSERT_EQUAL_INT32(0, demand.speed_urad_s);
    TEST_ASSERT_TRUE(demand.limiter);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, state.supervisor.state);
    state.drive.limiting = true;
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_LIMITING, state.supervisor.state);
    state.supervisor.control = TERRAPIN_CONTROL_SPEED;
    tick();
    TEST_ASSERT_EQUAL_INT(DEMAND_SPEED, demand.mode);
    state.supervisor.request = TERRAPIN_REQUEST_IDLE;
    tick();
    TEST_ASSERT_EQUAL_INT32(PHASE_HALT, state.supervisor.phase);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, state.supervisor.state);
    TEST_ASSERT_FALSE(demand.limiter);
}

static void test_off_asks_for_nothing(void) {
    demand = (terrapin_demand){.mode = DEMAND_SPEED, .voltage_mv = 1, .speed_urad_s = 1, .limiter = true};
    tick();
    TEST_ASSERT_EQUAL_INT(DEMAND_OFF, demand.mode);
    TEST_ASSERT_EQUAL_INT32(0, demand.voltage_mv);
    TEST_ASSERT_EQUAL_INT32(0, demand.speed_urad_s);
    TEST_ASSERT_FALSE(demand.limiter);
}

static void test_stuck_stops_at_once(void) {
    in(TERRAPIN_STATE_RUN, PHASE_FIRST, TERRAPIN_REQUEST_RUN);
    state.supervisor.control = TERRAPIN_CONTROL_SPEED;
    state.supervisor.setpoint = 500;
    stuck = true;
    tick();
    TEST_ASSERT_EQUAL_INT(1, extrications);
    TEST_ASSERT_EQUAL_INT(DEMAND_VOLTAGE, demand.mode);
    TEST_ASSERT_EQUAL_INT32(0, demand.voltage_mv);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_STUCK, state.supervisor.state);
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_STUCK, state.supervisor.state);
    extricated = true;
    tick();
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, state.supervisor.state);
    TEST_ASSERT_EQUAL_INT(DEMAND_OFF, demand.mode);
}

static void test_a_state_that_does_not_exist_is_off(void) {
    state.supervisor.state = TERRAPIN_STATE_SAFE + 1;
    demand.mode = DEMAND_VOLTAGE;
    tick();
    TEST_ASSERT_EQUAL_INT(DEMAND_OFF, demand.mode);
}

static void test_reports_count_to_fifteen_and_hold_a_long_time(void) {
    state.supervisor.report_number = 15U;
    state.supervisor.episode_ms = 655360U;
    episode_report(&state, TERRAPIN_REPORT_CALIBRATED, 5);
    TEST_ASSERT_EQUAL_UINT8(0U, state.supervisor.report_number);
    TEST_ASSERT_EQUAL_INT32(65535, state.supervisor.report_duration_10ms);
    TEST_ASSERT_EQUAL_INT32(5, state.supervisor.report_distance_mm);
    state.supervisor.episode_ms = 655339U;
    episode_report(&state, TERRAPIN_REPORT_CALIBRATED, 5);
    TEST_ASSERT_EQUAL_INT32(65533, state.supervisor.report_duration_10ms);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_start_takes_its_times);
    RUN_TEST(test_ready_is_idle_without_a_latched_fault);
    RUN_TEST(test_a_late_command_counts_where_the_bridge_may_be_on);
    RUN_TEST(test_the_causes_of_faults);
    RUN_TEST(test_a_gap_in_the_ticks_is_shown_for_a_second);
    RUN_TEST(test_only_clear_takes_a_latched_fault_away);
    RUN_TEST(test_a_refused_run_clears_nothing);
    RUN_TEST(test_a_refusal_is_shown_as_long_as_the_idle_holds);
    RUN_TEST(test_the_guard_of_the_swing_begins_at_its_limit);
    RUN_TEST(test_the_guard_of_the_swing_is_blind_after_twenty_ticks);
    RUN_TEST(test_what_is_heard);
    RUN_TEST(test_still_is_below_both_speeds);
    RUN_TEST(test_a_run_begins_anew);
    RUN_TEST(test_a_request_that_was_served_or_is_late_is_none);
    RUN_TEST(test_calibration_begins_at_rest_with_a_zero);
    RUN_TEST(test_a_halt_ends_at_rest_or_after_its_time);
    RUN_TEST(test_calibration_drives_until_it_ends);
    RUN_TEST(test_a_run_asks_the_drive_for_what_was_commanded);
    RUN_TEST(test_off_asks_for_nothing);
    RUN_TEST(test_stuck_stops_at_once);
    RUN_TEST(test_a_state_that_does_not_exist_is_off);
    RUN_TEST(test_reports_count_to_fifteen_and_hold_a_long_time);
    return UNITY_END();
}
