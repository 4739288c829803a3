/* Slip, its limiter, the speed loop, the current limit; stuck and the way back. */
#include "rig.h"

void setUp(void) {
    rig_start();
}

void tearDown(void) {}

static void on_sand(void) {
    rig.f_o = 0.092;
    rig.f_s = 0.28e-3;
    rig.traction = 0.20;
    rig.slip_constant = 0.20;
}

static double true_slip(void) {
    return 1.0 - rig.speed / (RADIUS * rig.omega);
}

/* A carriage holds the axle at a falling speed: the slip that the limiter leaves from `from` ms on. */
static double carriage(uint32_t from, double *greatest) {
    double worst = 0.0;
    *greatest = 0.0;
    rig.carriage = 0.36;
    rig_until(TERRAPIN_STATE_RUN, 300U);
    rig_run(3000);
    for (uint32_t ms = 0; ms < 10000U; ms++) {
        rig.carriage = 0.36 - 0.032e-3 * ms;
        rig_tick();
        *greatest = fmax(*greatest, true_slip());
        if (ms >= from) {
            worst = fmax(worst, fabs(true_slip() - 0.5));
        }
    }
    return worst;
}

static void test_limiter_holds_the_slip_on_a_carriage(void) {
    double greatest = 0.0;
    on_sand();
    rig_request(TERRAPIN_REQUEST_RUN, 8000);
    const double worst = carriage(5000U, &greatest);
    TEST_ASSERT_TRUE(greatest < 0.55);
    TEST_ASSERT_TRUE(worst < 0.02);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_LIMITING, rig_state());
    TEST_ASSERT_INT32_WITHIN(300, 5000, rig.state.slip.slip_e4);
    TEST_ASSERT_FALSE(rig.state.slip.slow);
}

static void test_without_the_limiter_slip_runs_away(void) {
    double greatest = 0.0;
    on_sand();
    rig.in.command.limiter = false;
    rig_request(TERRAPIN_REQUEST_RUN, 8000);
    (void)carriage(5000U, &greatest);
    TEST_ASSERT_TRUE(greatest > 0.9);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
}

static void test_limiter_works_backwards_and_with_the_speed_loop(void) {
    on_sand();
    rig.in.command.control = TERRAPIN_CONTROL_SPEED;
    rig_request(TERRAPIN_REQUEST_RUN, -700); /* 8.75 rad/s backwards; the carriage allows 0.15 m/s */
    rig.carriage = -0.15;
    rig_until(TERRAPIN_STATE_LIMITING, 2000U);
    rig_run(3000);
    TEST_ASSERT_TRUE(fabs(true_slip() - 0.5) < 0.02);
    rig.carriage = -0.60; /* the ground lets go: the speed loop takes over without a kick */
    int16_t before = rig.out.duty_q15;
    for (int ms = 0; ms < 3000; ms++) {
        rig_tick();
        TEST_ASSERT_INT16_WITHIN(2500, before, rig.out.duty_q15);
        before = rig.out.duty_q15;
    }
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
    TEST_ASSERT_TRUE(fabs(RADIUS * rig.omega + 0.7) < 0.02);
}

static void test_limiter_is_slow_without_a_swing_sensor(void) {
    on_sand();
    rig.in.swing_valid = false;
    rig_request(TERRAPIN_REQUEST_RUN, 8000);
    rig.carriage = 0.15;
    rig_until(TERRAPIN_STATE_LIMITING, 2000U);
    rig_run(3000);
    TEST_ASSERT_TRUE(rig.state.slip.slow);
    TEST_ASSERT_TRUE(fabs(true_slip() - 0.5) < 0.1);
}

static void test_no_slip_below_the_dead_band(void) {
    rig_run(400);
    TEST_ASSERT_FALSE(rig.state.slip.valid);
    TEST_ASSERT_EQUAL_INT32(0, rig.state.slip.slip_e4);
    rig_drive(2000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(3000);
    TEST_ASSERT_TRUE(rig.state.slip.valid);
    TEST_ASSERT_INT32_WITHIN(400, 0, rig.state.slip.slip_e4);
}

static void test_swing_is_no_rolling(void) {
    rig_drive(4000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(3000);
    const double still = rig.state.slip.shell_urad_s * 1e-6;
    rig.in.swing_rate_centirad_s = 100; /* the inner device turns under the shell: the shell is slower than alpha */
    rig_run(200);
    TEST_ASSERT_TRUE(fabs(still - 1.0 - rig.state.slip.shell_urad_s * 1e-6) < 0.05);
}

static void test_two_ground_speeds_that_disagree(void) {
    rig.in.ground_speed_valid = true;
    rig_drive(4000, TERRAPIN_CONTROL_VOLTAGE);
    for (int ms = 0; ms < 3000; ms++) {
        rig.in.ground_speed_mm_s = (int16_t)lrint(1000.0 * rig.speed + 30.0);
        rig_tick();
    }
    TEST_ASSERT_FALSE(rig_fault(TERRAPIN_FAULT_GROUND_SPEED));
    TEST_ASSERT_TRUE(rig.state.slip.valid);
    rig.in.ground_speed_mm_s = 20; /* vision says that it stands: slip would be great */
    rig_run(450);
    TEST_ASSERT_FALSE(rig_fault(TERRAPIN_FAULT_GROUND_SPEED));
    rig_run(100);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_SPEED));
    TEST_ASSERT_TRUE(rig.state.slip.external);
    TEST_ASSERT_FALSE(rig.state.slip.valid);
    TEST_ASSERT_TRUE(rig.state.slip.slip_e4 > 9000);
    TEST_ASSERT_TRUE_MESSAGE(rig.out.enable, "a flag, and the lower speed for the limiter");
    rig.in.ground_speed_mm_s = 2000; /* now the wheel is the slower one */
    rig_run(100);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_SPEED));
    TEST_ASSERT_FALSE(rig.state.slip.external);
    rig.in.ground_speed_valid = false;
    rig_run(2);
    TEST_ASSERT_FALSE(rig_fault(TERRAPIN_FAULT_GROUND_SPEED));
}

static void test_speed_loop(void) {
    static const int16_t rim_mm_s[] = {500, -500, 100, 1000};
    for (size_t i = 0; i < sizeof rim_mm_s / sizeof rim_mm_s[0]; i++) {
        rig_start();
        rig.f_o = 0.045;
        rig_drive(rim_mm_s[i], TERRAPIN_CONTROL_SPEED);
        rig_run(4000);
        for (int ms = 0; ms < 500; ms++) {
            rig_tick();
            TEST_ASSERT_TRUE(fabs(1000.0 * RADIUS * rig.omega - rim_mm_s[i]) < 5.0);
        }
    }
}

static void test_supply_compensation(void) {
    rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(500);
    TEST_ASSERT_INT16_WITHIN(20, 16384, rig.out.duty_q15);
    rig.in.supply_code = (uint16_t)(8.0 / 0.004);
    rig_run(200);
    TEST_ASSERT_INT16_WITHIN(30, 24576, rig.out.duty_q15);
}

static void test_no_supply_no_duty(void) {
    rig_run(300);
    rig.state.sense.supply_q8_mv = 256 * 900;
    const terrapin_demand demand = {.mode = DEMAND_VOLTAGE, .voltage_mv = 5000};
    drive_update(&rig.state, &demand);
    TEST_ASSERT_EQUAL_INT16(0, rig.state.drive.duty_q15);
}

static void test_duty_ends_at_its_range(void) {
    rig_run(300);
    rig.state.sense.supply_q8_mv = 256 * 7000;
    const terrapin_demand demand = {.mode = DEMAND_VOLTAGE, .voltage_mv = 9000};
    drive_update(&rig.state, &demand);
    TEST_ASSERT_EQUAL_INT16(32767, rig.state.drive.duty_q15);
}

static void test_current_limit(void) {
    rig.f_o = 0.6; /* it cannot turn */
    rig_set(TERRAPIN_PARAMETER_CURRENT_LIMIT, 600);
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(500);
    TEST_ASSERT_TRUE(rig.state.drive.current_limiting);
    TEST_ASSERT_TRUE(fabs(rig.current - 0.6) < 0.01);
    rig_start();
    rig.f_o = 0.6;
    rig_set(TERRAPIN_PARAMETER_CURRENT_LIMIT, 600);
    rig_set(TERRAPIN_PARAMETER_ARMATURE_RESISTANCE, 7000); /* a wrong model: the measured current trims it */
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(3000);
    TEST_ASSERT_TRUE(rig.current < 0.63);
    TEST_ASSERT_TRUE(rig.current > 0.55);
    rig_request(TERRAPIN_REQUEST_RUN, 500);
    rig_run(4000);
    TEST_ASSERT_EQUAL_INT32_MESSAGE(0, rig.state.drive.trim_mv, "the trim goes when it is not needed");
}

static void test_reversal_stays_within_the_current_limit(void) {
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(4000);
    rig_request(TERRAPIN_REQUEST_RUN, -8000);
    double greatest = 0.0;
    for (int ms = 0; ms < 4000; ms++) {
        rig_tick();
        greatest = fmax(greatest, fabs(rig.current));
    }
    TEST_ASSERT_TRUE(greatest < 1.9);
    TEST_ASSERT_TRUE(rig.omega < -12.0);
    TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
}

static void climb(int16_t millivolt) {
    on_sand();
    rig.slope = 14.0 / 180.0 * 3.14159265358979323846;
    rig.slope_from = 1.0;
    rig_drive(millivolt, TERRAPIN_CONTROL_VOLTAGE);
    rig_until(TERRAPIN_STATE_STUCK, 20000U);
}

static void test_stuck_on_a_slope_backs_out_and_reports(void) {
    climb(8000);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_STOPPED, rig.state.supervisor.report);
    TEST_ASSERT_TRUE(fabs(rig.speed) < 0.1);
    rig_until(TERRAPIN_STATE_EXTRICATE, 1000U);
    rig_until(TERRAPIN_STATE_IDLE, 15000U);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATED, rig.state.supervisor.report);
    TEST_ASSERT_TRUE(rig.state.supervisor.report_distance_mm < -300);
    TEST_ASSERT_TRUE(fabs(rig.speed) < 0.01);
    TEST_ASSERT_TRUE(rig.ground < 1.0);
    TEST_ASSERT_TRUE(supervisor_ready(&rig.state));
    rig_run(1000);
    TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_STATE_IDLE, rig_state(), "the old request does not start it again");
    rig_request(TERRAPIN_REQUEST_IDLE, 0);
    rig_run(60);
    rig_request(TERRAPIN_REQUEST_RUN, 3000);
    rig_run(TERRAPIN_LIMIT_STOP_HOLD + 60U);
    TEST_ASSERT_TRUE(rig.out.enable);
}

static void test_backs_out_until_the_pitch_is_gone(void) {
    rig.in.pitch_valid = true;
    on_sand();
    rig.slope = 14.0 / 180.0 * 3.14159265358979323846;
    rig.slope_from = 1.0;
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig.in.pitch_mrad = 244;
    rig_until(TERRAPIN_STATE_EXTRICATE, 20000U);
    rig_run(4000); /* the pitch still reads 14 degrees */
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_EXTRICATE, rig_state());
    TEST_ASSERT_EQUAL(PHASE_FIRST, rig.state.supervisor.phase);
    rig.in.pitch_mrad = 10;
    rig_until(TERRAPIN_STATE_IDLE, 4000U);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATED, rig.state.supervisor.report);
}

/* Faster than four times stuck_speed is progress: whoever slows down from it waits no longer. */
static void test_what_counts_as_having_moved(void) {
    rig_set(TERRAPIN_PARAMETER_STUCK_SPEED, 30);
    for (int32_t direction = -1; direction <= 1; direction += 2) {
        rig.state.supervisor.moved = false;
        rig.state.slip.ground_um_s = direction * 4 * 30000;
        (void)extrication_watch(&rig.state, direction);
        TEST_ASSERT_FALSE(rig.state.supervisor.moved);
        rig.state.slip.ground_um_s += direction;
        (void)extrication_watch(&rig.state, direction);
        TEST_ASSERT_TRUE(rig.state.supervisor.moved);
    }
}

static void test_extrication_is_bounded_in_time(void) {
    climb(8000);
    rig.traction = 1e-6; /* no grip at all, and held by a wall */
    rig.carriage = 0.0;
    rig_until(TERRAPIN_STATE_IDLE, 21000U);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATION_FAILED, rig.state.supervisor.report);
    TEST_ASSERT_FALSE(rig.out.enable);
}

static void test_the_operator_may_end_the_extrication(void) {
    climb(8000);
    rig_until(TERRAPIN_STATE_EXTRICATE, 1000U);
    rig_request(TERRAPIN_REQUEST_IDLE, 0);
    rig_run(60);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATION_FAILED, rig.state.supervisor.report);
    TEST_ASSERT_FALSE(rig.out.enable);
}

static void test_a_robot_that_never_moved_is_given_its_time(void) {
    on_sand();
    rig.carriage = 0.0; /* against a wall from the start */
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig_until(TERRAPIN_STATE_LIMITING, 500U);
    rig_run(350);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_LIMITING, rig_state());
    rig_until(TERRAPIN_STATE_STUCK, 200U);
}

static void test_a_change_of_direction_lets_the_limiter_go(void) {
    on_sand();
    rig.carriage = 0.15;
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig_until(TERRAPIN_STATE_LIMITING, 2000U);
    rig_request(TERRAPIN_REQUEST_RUN, -3000);
    rig_run(51);
    TEST_ASSERT_FALSE(rig.state.drive.limiting);
    TEST_ASSERT_TRUE(rig.out.duty_q15 < 0);
}

static void test_a_setpoint_of_nothing_does_not_limit(void) {
    on_sand();
    rig.carriage = 0.15;
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig_until(TERRAPIN_STATE_LIMITING, 2000U);
    rig_request(TERRAPIN_REQUEST_RUN, 0);
    rig_run(100);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
    TEST_ASSERT_FALSE(rig.state.drive.limiting);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_limiter_holds_the_slip_on_a_carriage);
    RUN_TEST(test_without_the_limiter_slip_runs_away);
    RUN_TEST(test_limiter_works_backwards_and_with_the_speed_loop);
    RUN_TEST(test_limiter_is_slow_without_a_swing_sensor);
    RUN_TEST(test_no_slip_below_the_dead_band);
    RUN_TEST(test_swing_is_no_rolling);
    RUN_TEST(test_two_ground_speeds_that_disagree);
    RUN_TEST(test_speed_loop);
    RUN_TEST(test_supply_compensation);
    RUN_TEST(test_no_supply_no_duty);
    RUN_TEST(test_duty_ends_at_its_range);
    RUN_TEST(test_current_limit);
    RUN_TEST(test_reversal_stays_within_the_current_limit);
    RUN_TEST(test_stuck_on_a_slope_backs_out_and_reports);
    RUN_TEST(test_backs_out_until_the_pitch_is_gone);
    RUN_TEST(test_what_counts_as_having_moved);
    RUN_TEST(test_extrication_is_bounded_in_time);
    RUN_TEST(test_the_operator_may_end_the_extrication);
    RUN_TEST(test_a_robot_that_never_moved_is_given_its_time);
    RUN_TEST(test_a_change_of_direction_lets_the_limiter_go);
    RUN_TEST(test_a_setpoint_of_nothing_does_not_limit);
    return UNITY_END();
}
