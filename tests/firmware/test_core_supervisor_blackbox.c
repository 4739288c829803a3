/* States, requests, faults, watchdog and emergency stop: what the bridge does, and when. */
#include "rig.h"

void setUp(void) {
    rig_start();
}

void tearDown(void) {}

static void test_boots_through_self_test_into_idle(void) {
    rig.command = false;
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_BOOT, rig_state());
    rig_until(TERRAPIN_STATE_SELF_TEST, 20U);
    rig_until(TERRAPIN_STATE_IDLE, 250U);
    TEST_ASSERT_TRUE(supervisor_ready(&rig.state));
    TEST_ASSERT_TRUE(rig.state.sense.trimmed);
    rig_run(1000);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    TEST_ASSERT_FALSE(rig.out.enable);
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
}

static void test_runs_and_brakes_to_idle(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(4000);
    TEST_ASSERT_TRUE(rig.out.enable);
    TEST_ASSERT_INT16_WITHIN(20, 16384, rig.out.duty_q15);
    TEST_ASSERT_TRUE(rig.omega > 11.0);
    rig_request(TERRAPIN_REQUEST_IDLE, 0);
    rig_run(100);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
    TEST_ASSERT_EQUAL_INT16(0, rig.out.duty_q15);
    rig_until(TERRAPIN_STATE_IDLE, 3000U);
    TEST_ASSERT_TRUE(fabs(rig.omega) < 0.1);
    TEST_ASSERT_FALSE(rig.out.enable);
}

static void test_braking_ends_even_when_the_robot_does_not_stop(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(1000);
    rig_request(TERRAPIN_REQUEST_IDLE, 0);
    for (int ms = 0; ms < 4200; ms++) {
        rig.omega = 5.0; /* something pushes it */
        rig_tick();
    }
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    TEST_ASSERT_FALSE(rig.out.enable);
}

static void test_emergency_stop_within_one_tick_and_latched(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(500);
    TEST_ASSERT_TRUE(rig.out.enable);
    rig.in.estop = true;
    rig_tick();
    TEST_ASSERT_FALSE(rig.out.enable);
    TEST_ASSERT_EQUAL_INT16(0, rig.out.duty_q15);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_ESTOP));
    rig.in.estop = false;
    rig_run(500);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
    TEST_ASSERT_FALSE_MESSAGE(rig.out.enable, "the request to run still stands, the fault too");
    rig.in.estop = true;
    rig_request(TERRAPIN_REQUEST_CLEAR, 0);
    rig_run(100);
    TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_STATE_SAFE, rig_state(), "its cause still stands");
    rig.in.estop = false;
    rig_run(100);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
    rig_request(TERRAPIN_REQUEST_IDLE, 0);
    rig_run(100);
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(100);
    TEST_ASSERT_TRUE(rig.out.enable);
}

static void test_emergency_stop_in_every_state(void) {
    for (int32_t state = TERRAPIN_STATE_BOOT; state <= TERRAPIN_STATE_SAFE; state++) {
        rig_start();
        rig_run(300);
        rig.state.supervisor.state = state;
        rig.in.estop = true;
        rig_tick();
        TEST_ASSERT_FALSE(rig.out.enable);
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
    }
}

static void test_watchdog_at_200_ms(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    while (!rig.in.command_fresh) {
        rig_tick();
    }
    rig.command = false;
    for (int ms = 1; ms <= 200; ms++) {
        rig_tick();
        TEST_ASSERT_TRUE_MESSAGE(rig.out.enable, "not before its time");
    }
    rig_tick();
    TEST_ASSERT_FALSE(rig.out.enable);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_COMMAND_TIMEOUT));
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
}

static void test_an_old_request_does_not_start_anything(void) {
    rig_set(TERRAPIN_PARAMETER_COMMAND_TIMEOUT, 100);
    rig.command = false;
    rig_run(49);
    rig.command = true;
    rig_request(TERRAPIN_REQUEST_RUN, 6000);
    rig_run(20); /* heard once, during the self test, 140 ms before its end */
    rig.command = false;
    rig_run(1000);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    TEST_ASSERT_FALSE(rig.out.enable);
}

static void command_now(uint8_t request) {
    rig_request(request, 6000);
    rig.in.tick++;
    rig.in.command_fresh = true;
    rig_step();
    rig.in.command_fresh = false;
}

static int32_t hold_shown(void) {
    terrapin_status_t status;
    TEST_ASSERT_TRUE(terrapin_decode_status(&rig.last[0], &status));
    return status.hold;
}

static void test_an_idle_holds_against_run_and_calibrate(void) {
    static const uint8_t starts[] = {TERRAPIN_REQUEST_RUN, TERRAPIN_REQUEST_CALIBRATE};
    for (size_t i = 0; i < sizeof starts; i++) {
        rig_start();
        rig.command = false;
        rig_run(400);
        command_now(TERRAPIN_REQUEST_IDLE);
        rig_run(100);
        TEST_ASSERT_EQUAL_INT32_MESSAGE(0, hold_shown(), "nothing was refused yet");
        command_now(starts[i]);
        rig_run(9);
        TEST_ASSERT_EQUAL_INT32(5, hold_shown());
        for (int ms = 0; ms < 489; ms++) {
            command_now(starts[i]);
            TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
            TEST_ASSERT_FALSE(rig.out.enable);
        }
        command_now(starts[i]);
        TEST_ASSERT_NOT_EQUAL_INT32_MESSAGE(TERRAPIN_STATE_IDLE, rig_state(), "600 ticks after the IDLE");
        rig_run(10);
        TEST_ASSERT_EQUAL_INT32(0, hold_shown());
    }
}

static void test_a_further_idle_holds_anew(void) {
    rig.command = false;
    rig_run(400);
    command_now(TERRAPIN_REQUEST_IDLE);
    rig_run(500);
    command_now(TERRAPIN_REQUEST_IDLE);
    for (int ms = 0; ms < 599; ms++) {
        command_now(TERRAPIN_REQUEST_RUN);
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    }
    command_now(TERRAPIN_REQUEST_RUN);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
}

/* Somebody else sends RUN or CALIBRATE all the time, or again after a pause: what a clear ends starts with an IDLE that
 * comes after it, and with nothing else. */
static void test_a_clear_starts_nothing(void) {
    static const uint8_t starts[] = {TERRAPIN_REQUEST_RUN, TERRAPIN_REQUEST_CALIBRATE};
    for (size_t i = 0; i < sizeof starts; i++) {
        rig_start();
        rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
        rig_run(500);
        rig.command = false;
        rig_run(201);
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_COMMAND_TIMEOUT));
        rig_run(5000); /* at rest: nothing else is in the way */
        command_now(TERRAPIN_REQUEST_IDLE);
        command_now(TERRAPIN_REQUEST_CLEAR);
        TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
        rig.command = true;
        rig_request(starts[i], 6000);
        for (int ms = 0; ms < 5000; ms++) {
            rig.command = (ms / 1000) % 2 == 0;
            rig_tick();
            TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
            TEST_ASSERT_FALSE(rig.out.enable);
        }
        TEST_ASSERT_EQUAL_INT32_MESSAGE(6, hold_shown(), "why: something holds against it");
        command_now(TERRAPIN_REQUEST_IDLE);
        for (int ms = 0; ms < 599; ms++) {
            command_now(starts[i]);
            TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
        }
        command_now(starts[i]);
        TEST_ASSERT_NOT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
        TEST_ASSERT_NOT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
    }
}

/* Also where there was nothing to clear: the running robot halts, and the RUN that goes on does not start it again. */
static void test_a_clear_in_a_run_halts_it(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(1000);
    command_now(TERRAPIN_REQUEST_CLEAR);
    rig_request(TERRAPIN_REQUEST_RUN, 6000);
    rig_until(TERRAPIN_STATE_IDLE, 3000U);
    rig_run(2000);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
}

/* A host that goes on talking while it is refused is no silent one: braking ends at rest, not in a fault. */
static void test_a_refused_run_keeps_the_command_timeout_away(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(2000);
    command_now(TERRAPIN_REQUEST_IDLE);
    rig_request(TERRAPIN_REQUEST_RUN, 6000);
    rig_run(550);
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.duty_q15);
}

static void test_a_state_that_does_not_exist_keeps_the_bridge_off(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig.state.supervisor.state = 13;
    rig_tick();
    TEST_ASSERT_FALSE(rig.out.enable);
}

typedef struct {
    uint32_t fault;
    uint32_t within_ms;
    uint32_t not_before_ms;
} expected;

/* Drives steadily, then breaks one thing at each tick through `break_it`; the fault must come within its time. */
static void expect_fault(expected e, void (*break_it)(void)) {
    rig_start();
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(1500);
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
    uint32_t ms = 0U;
    while (!rig_fault(e.fault) && ms <= e.within_ms) {
        rig.in.tick++;
        rig.in.motor_count = rig_count(rig.alpha * GEAR / WHEEL_TURN);
        rig.in.ground_count = rig_count(rig.ground / 0.030 / WHEEL_TURN);
        rig.in.current_code = (uint16_t)lrint(2048.0 + 1000.0 * rig.current);
        rig.in.command_fresh = true;
        break_it();
        rig_step();
        rig_plant();
        ms++;
    }
    TEST_ASSERT_TRUE(rig_fault(e.fault));
    TEST_ASSERT_TRUE(ms <= e.within_ms);
    TEST_ASSERT_TRUE(ms >= e.not_before_ms);
    TEST_ASSERT_FALSE(rig.out.enable);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
}

static void too_much_current(void) {
    rig.in.current_code = 2048U + 2010U;
}
static void current_at_low_rail(void) {
    rig.in.current_code = 2U;
}
static void current_at_high_rail(void) {
    rig.in.current_code = 4093U;
}
static void supply_at_low_rail(void) {
    rig.in.supply_code = 0U;
}
static void supply_at_high_rail(void) {
    rig.in.supply_code = 4095U;
}
static void temperature_at_low_rail(void) {
    rig.in.temperature_code = 0U;
}
static void temperature_at_high_rail(void) {
    rig.in.temperature_code = 4095U;
}
static void supply_sags(void) {
    rig.in.supply_code = 1300U;
}
static void supply_rises(void) {
    rig.in.supply_code = 3900U;
}
static void winding_burns(void) {
    rig.in.temperature_code = 3500U;
}
static void encoder_stands(void) {
    rig.in.motor_count = 77U;
}
static void encoder_jumps(void) {
    static uint16_t noise;
    noise = (uint16_t)(noise + 5000U);
    rig.in.motor_count = noise;
}

static void test_every_sensor_fault_switches_off(void) {
    expect_fault((expected){TERRAPIN_FAULT_OVER_CURRENT, 3U, 3U}, too_much_current);
    expect_fault((expected){TERRAPIN_FAULT_CURRENT_SENSOR, 3U, 3U}, current_at_low_rail);
    expect_fault((expected){TERRAPIN_FAULT_CURRENT_SENSOR, 3U, 3U}, current_at_high_rail);
    expect_fault((expected){TERRAPIN_FAULT_SUPPLY_SENSOR, 20U, 20U}, supply_at_low_rail);
    expect_fault((expected){TERRAPIN_FAULT_SUPPLY_SENSOR, 20U, 20U}, supply_at_high_rail);
    expect_fault((expected){TERRAPIN_FAULT_TEMPERATURE_SENSOR, 20U, 20U}, temperature_at_low_rail);
    expect_fault((expected){TERRAPIN_FAULT_TEMPERATURE_SENSOR, 20U, 20U}, temperature_at_high_rail);
    expect_fault((expected){TERRAPIN_FAULT_SUPPLY_LOW, 100U, 20U}, supply_sags);
    expect_fault((expected){TERRAPIN_FAULT_SUPPLY_HIGH, 100U, 20U}, supply_rises);
    expect_fault((expected){TERRAPIN_FAULT_OVER_TEMPERATURE, 100U, 20U}, winding_burns);
    expect_fault((expected){TERRAPIN_FAULT_MOTOR_ENCODER, 260U, 1U}, encoder_stands);
    expect_fault((expected){TERRAPIN_FAULT_MOTOR_ENCODER, 2U, 1U}, encoder_jumps);
}

static void test_a_short_disturbance_is_no_fault(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(1000);
    for (int i = 0; i < 5; i++) {
        const double keep = rig.current;
        rig.current = 2.03; /* two ticks at the rail and beyond over_current */
        rig_run(1);
        rig.current = 2.03;
        rig_run(1);
        rig.current = keep;
        rig_run(10);
    }
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
}

static void test_no_plausible_zero_is_a_fault(void) {
    rig.offset_codes = 40.0;
    rig_run(300);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_CURRENT_SENSOR));
    TEST_ASSERT_FALSE(rig.state.sense.trimmed);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
}

static void test_parameters_that_contradict_each_other(void) {
    static const int32_t rows[][4] = {
        {TERRAPIN_PARAMETER_DRIVE_RADIUS, 80000, TERRAPIN_PARAMETER_DRIVE_RADIUS, 18000},
        {TERRAPIN_PARAMETER_SUPPLY_LOW, 15000, TERRAPIN_PARAMETER_SUPPLY_LOW, 6000},
        {TERRAPIN_PARAMETER_CALIBRATE_LOW, 6000, TERRAPIN_PARAMETER_CALIBRATE_LOW, 2000},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        rig_start();
        rig_run(300);
        rig_set((uint16_t)rows[i][0], rows[i][1]);
        rig_run(1);
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_PARAMETER));
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
        rig_set((uint16_t)rows[i][2], rows[i][3]);
        rig_request(TERRAPIN_REQUEST_CLEAR, 0);
        rig_run(60);
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    }
}

static void test_a_missed_tick_is_flagged_and_starts_the_windows_anew(void) {
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    TEST_ASSERT_TRUE(rig.state.estimator.valid);
    rig.in.tick += 30U;
    rig_plant();
    rig_tick();
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_OVERRUN));
    TEST_ASSERT_FALSE(rig.state.estimator.valid);
    TEST_ASSERT_TRUE_MESSAGE(rig.out.enable, "a flag only");
    rig_run(1100);
    TEST_ASSERT_FALSE(rig_fault(TERRAPIN_FAULT_OVERRUN));
    rig_run(1000);
    TEST_ASSERT_TRUE(rig.state.estimator.valid);
    rig.in.tick--; /* the same tick twice */
    rig_tick();
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_OVERRUN));
}

static void test_a_jump_of_the_encoder_over_a_gap_is_no_fault(void) {
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(3000);
    for (int ms = 0; ms < 60; ms++) { /* the link is silent, the robot rolls on */
        rig.in.tick++;
        rig_plant();
    }
    rig_tick();
    TEST_ASSERT_FALSE(rig_fault(TERRAPIN_FAULT_MOTOR_ENCODER));
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_OVERRUN));
}

/* A clock that jumps again and again, or stands still, leaves the drive without a speed: the loop would wind up against
 * the last one, and nothing would watch the encoder or the age of a command. */
static void test_ticks_lost_again_and_again_switch_off(void) {
    static const struct {
        int every; /* ticks from one gap to the next */
        uint32_t jump;
    } rows[] = {{2, 1U}, {7, 1U}, {20, 1U}, {1, UINT32_MAX}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        rig_start();
        rig_drive(500, TERRAPIN_CONTROL_SPEED);
        rig_run(4000);
        const double asked = 0.5 / 0.08;
        TEST_ASSERT_TRUE(fabs(rig.omega - asked) < (0.02 * asked));
        rig.omega = 0.7 * asked; /* the speed that is known last is too low by so much that the loop pushes */
        rig_run(25);
        int ms = 0;
        while (rig.out.enable && (ms < 221)) {
            rig.in.tick += ((ms % rows[i].every) == 0) ? rows[i].jump : 0U;
            rig_tick();
            TEST_ASSERT_TRUE(rig.omega < (1.2 * asked));
            ms++;
        }
        TEST_ASSERT_FALSE(rig.out.enable);
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_OVERRUN));
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_MOTOR_ENCODER));
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_SAFE, rig_state());
    }
}

static void test_a_tick_lost_now_and_then_does_not(void) {
    rig_drive(500, TERRAPIN_CONTROL_SPEED);
    rig_run(4000);
    for (int i = 0; i < 50; i++) {
        rig.in.tick++;
        rig_run(101);
    }
    TEST_ASSERT_TRUE(rig.out.enable);
    TEST_ASSERT_TRUE(fabs(rig.omega - (0.5 / 0.08)) < 0.2);
    TEST_ASSERT_EQUAL_HEX32(1U << TERRAPIN_FAULT_OVERRUN, rig.out.faults);
}

static void test_ticks_wrap_without_a_word(void) {
    rig.in.tick = UINT32_MAX - 3000U;
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(6000);
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
    TEST_ASSERT_TRUE(rig.in.tick < 6000U);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
}

static void test_clear_takes_the_report_away(void) {
    rig_run(300);
    episode_report(&rig.state, TERRAPIN_REPORT_STOPPED, 5);
    rig_request(TERRAPIN_REQUEST_CLEAR, 0);
    rig_run(60);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_NONE, rig.state.supervisor.report);
}

static void test_parameter_access(void) {
    int32_t value = 0;
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_UNKNOWN, terrapin_parameter_get(&rig.state, TERRAPIN_PARAMETER_COUNT, &value));
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_UNKNOWN, terrapin_parameter_set(&rig.state, TERRAPIN_PARAMETER_COUNT, 0));
    for (uint16_t i = 0U; i < TERRAPIN_PARAMETER_COUNT; i++) {
        const terrapin_parameter_entry entry = terrapin_parameter((uint16_t)i);
        TEST_ASSERT_EQUAL_INT32(entry.default_value, rig_get(i));
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_RANGE, terrapin_parameter_set(&rig.state, i, entry.minimum - 1));
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_RANGE, terrapin_parameter_set(&rig.state, i, entry.maximum + 1));
        TEST_ASSERT_EQUAL_INT32(entry.default_value, rig_get(i));
        rig_set(i, entry.minimum);
        rig_set(i, entry.maximum);
        TEST_ASSERT_EQUAL_INT32(entry.maximum, rig_get(i));
        rig_set(i, entry.default_value);
    }
}

static void test_protected_parameters_are_locked_while_the_bridge_is_on(void) {
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(10);
    for (uint16_t i = 0U; i < TERRAPIN_PARAMETER_COUNT; i++) {
        const int32_t value = terrapin_parameter((uint16_t)i).maximum;
        const terrapin_parameter_result expected_result =
            terrapin_parameter_protected(i) ? TERRAPIN_PARAMETER_LOCKED : TERRAPIN_PARAMETER_OK;
        TEST_ASSERT_EQUAL(expected_result, terrapin_parameter_set(&rig.state, i, value));
        TEST_ASSERT_EQUAL_INT32(terrapin_parameter_protected(i) ? terrapin_parameter((uint16_t)i).default_value : value,
                                rig_get(i));
    }
}

static void test_state_size_is_that_of_the_state(void) {
    TEST_ASSERT_EQUAL(sizeof(terrapin_state), terrapin_state_size());
}

/* What a write works out is what a whole preparation does, also where it takes the short way. */
static void test_every_write_prepares_what_follows_from_it(void) {
    for (uint16_t i = 0U; i < TERRAPIN_PARAMETER_COUNT; i++) {
        rig_start();
        const terrapin_parameter_entry entry = terrapin_parameter(i);
        rig_set(i, entry.minimum + ((entry.maximum - entry.minimum) / 3));
        const terrapin_gains gains = rig.state.gains;
        const terrapin_rates rates = rig.state.rates;
        gains_prepare(&rig.state);
        TEST_ASSERT_EQUAL_MEMORY(&gains, &rig.state.gains, sizeof gains);
        TEST_ASSERT_EQUAL_MEMORY(&rates, &rig.state.rates, sizeof rates);
    }
}

static void test_the_guard_of_the_swing(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(500);
    rig.in.swing_angle_mrad = 1200;
    rig_run(100);
    TEST_ASSERT_TRUE_MESSAGE(rig.out.enable, "no guard unless it is asked for");
    for (int32_t way = -1; way <= 1; way += 2) {
        rig_start();
        rig_set(TERRAPIN_PARAMETER_SWING_LIMIT, 1134);
        rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
        rig_run(500);
        rig.in.swing_angle_mrad = (int16_t)(way * 1133);
        rig_run(100);
        TEST_ASSERT_TRUE(rig.out.enable);
        rig.in.swing_angle_mrad = (int16_t)(way * 1134);
        rig_tick();
        TEST_ASSERT_FALSE(rig.out.enable);
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_SWING));
        rig.in.swing_angle_mrad = 0;
        rig_run(500);
        TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_STATE_SAFE, rig_state(), "it stays off");
        rig_request(TERRAPIN_REQUEST_CLEAR, 0);
        rig_run(100);
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    }
}

static void test_a_guard_without_a_swing_sensor_is_refused(void) {
    rig_set(TERRAPIN_PARAMETER_SWING_LIMIT, 1134);
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(500);
    rig.in.swing_valid = false;
    rig_run(19);
    TEST_ASSERT_TRUE_MESSAGE(rig.out.enable, "a gap is no failure");
    rig.in.swing_valid = true;
    rig_tick();
    rig.in.swing_valid = false;
    rig_run(19);
    TEST_ASSERT_TRUE(rig.out.enable);
    rig_tick();
    TEST_ASSERT_FALSE(rig.out.enable);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_SWING_SENSOR));
    rig_request(TERRAPIN_REQUEST_CLEAR, 0);
    rig_run(100);
    TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_STATE_SAFE, rig_state(), "nothing watches the swing yet");
    rig_set(TERRAPIN_PARAMETER_SWING_LIMIT, 0);
    rig_run(100);
    TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_STATE_IDLE, rig_state(), "without a guard it may run");
}

/* A sensor takes its time to start: that is no failure before the self test is over. */
static void test_a_swing_sensor_may_start_during_the_self_test(void) {
    for (uint32_t late = 0U; late < 2U; late++) {
        terrapin_init(&rig.state);
        rig_set(TERRAPIN_PARAMETER_SWING_LIMIT, 1134);
        rig.in.swing_valid = false;
        rig_run(190 + 19 + late);
        rig.in.swing_valid = true;
        rig_run(50);
        TEST_ASSERT_EQUAL(late == 1U, rig_fault(TERRAPIN_FAULT_SWING_SENSOR));
    }
}

/* Boot and self test are not yet at work; a latched fault is not either. */
static void test_at_work_from_idle_on(void) {
    for (int32_t number = TERRAPIN_STATE_BOOT; number <= TERRAPIN_STATE_SAFE; number++) {
        rig.state.supervisor.state = number;
        rig.state.supervisor.faults = 0U;
        TEST_ASSERT_EQUAL(number > TERRAPIN_STATE_SELF_TEST, terrapin_at_work(&rig.state));
        rig.state.supervisor.faults = TERRAPIN_FAULTS_LATCHED & (~TERRAPIN_FAULTS_LATCHED + 1U);
        TEST_ASSERT_FALSE(terrapin_at_work(&rig.state));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_boots_through_self_test_into_idle);
    RUN_TEST(test_runs_and_brakes_to_idle);
    RUN_TEST(test_braking_ends_even_when_the_robot_does_not_stop);
    RUN_TEST(test_emergency_stop_within_one_tick_and_latched);
    RUN_TEST(test_emergency_stop_in_every_state);
    RUN_TEST(test_watchdog_at_200_ms);
    RUN_TEST(test_an_old_request_does_not_start_anything);
    RUN_TEST(test_an_idle_holds_against_run_and_calibrate);
    RUN_TEST(test_a_further_idle_holds_anew);
    RUN_TEST(test_a_clear_starts_nothing);
    RUN_TEST(test_a_clear_in_a_run_halts_it);
    RUN_TEST(test_a_refused_run_keeps_the_command_timeout_away);
    RUN_TEST(test_a_state_that_does_not_exist_keeps_the_bridge_off);
    RUN_TEST(test_every_sensor_fault_switches_off);
    RUN_TEST(test_a_short_disturbance_is_no_fault);
    RUN_TEST(test_no_plausible_zero_is_a_fault);
    RUN_TEST(test_the_guard_of_the_swing);
    RUN_TEST(test_a_guard_without_a_swing_sensor_is_refused);
    RUN_TEST(test_parameters_that_contradict_each_other);
    RUN_TEST(test_a_missed_tick_is_flagged_and_starts_the_windows_anew);
    RUN_TEST(test_a_jump_of_the_encoder_over_a_gap_is_no_fault);
    RUN_TEST(test_ticks_lost_again_and_again_switch_off);
    RUN_TEST(test_a_tick_lost_now_and_then_does_not);
    RUN_TEST(test_ticks_wrap_without_a_word);
    RUN_TEST(test_clear_takes_the_report_away);
    RUN_TEST(test_parameter_access);
    RUN_TEST(test_protected_parameters_are_locked_while_the_bridge_is_on);
    RUN_TEST(test_state_size_is_that_of_the_state);
    RUN_TEST(test_every_write_prepares_what_follows_from_it);
    RUN_TEST(test_a_swing_sensor_may_start_during_the_self_test);
    RUN_TEST(test_at_work_from_idle_on);
    return UNITY_END();
}
