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
    rig_run(2500); /* behind where it dug in, and the pitch still reads 14 degrees */
    TEST_ASSERT_TRUE(rig.ground < 0.85);
    TEST_ASSERT_EQUAL(PHASE_FIRST, rig.state.supervisor.phase);
    rig.in.pitch_mrad = 10;
    rig_until(TERRAPIN_STATE_IDLE, 4000U);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATED, rig.state.supervisor.report);
}

/* Whatever pitch and ground wheel say: the shell turns back once. */
static void test_backs_out_one_turn_at_most(void) {
    for (int sticks = 0; sticks <= 1; sticks++) {
        rig_start();
        rig.in.pitch_valid = true;
        on_sand();
        rig.slope = 14.0 / 180.0 * 3.14159265358979323846;
        rig.slope_from = 1.0;
        rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
        rig.in.pitch_mrad = 244;
        rig_until(TERRAPIN_STATE_EXTRICATE, 20000U);
        const double from = rig.alpha;
        double least = from;
        rig.slope = 0.0; /* no help from gravity */
        for (int ms = 0; (ms < 15000) && (rig_state() != TERRAPIN_STATE_IDLE); ms++) {
            rig.stuck = rig.stuck || ((sticks == 1) && (ms == 1500));
            rig_tick();
            least = fmin(least, rig.alpha);
        }
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATION_FAILED, rig.state.supervisor.report);
        TEST_ASSERT_TRUE(least > from - 1.03 * WHEEL_TURN);
        TEST_ASSERT_TRUE((sticks == 1) || (least < from - 0.97 * WHEEL_TURN));
    }
}

/* Slip alone, at the current of rolling, stops the robot and puts the ground wheel in doubt. */
static void test_without_torque_nothing_is_backed_out(void) {
    for (int8_t direction = -1; direction <= 1; direction += 2) {
        rig_start();
        rig.f_o = 0.09;
        rig.scale = 1.0;
        rig_drive((int16_t)(direction * 3000), TERRAPIN_CONTROL_VOLTAGE);
        rig_run(1500);
        TEST_ASSERT_TRUE(rig.state.slip.valid);
        for (int ms = 0; ms < 1500; ms++) { /* the wheel loses its grip bit by bit; the robot rolls on */
            rig.scale -= 1e-3 / 1.5;
            rig_tick();
        }
        rig_run(400);
        const double stopped = rig.ground;
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_WHEEL));
        rig_until(TERRAPIN_STATE_IDLE, 2000U);
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATION_FAILED, rig.state.supervisor.report);
        TEST_ASSERT_TRUE(fabs(rig.ground - stopped) < 0.01);
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_WHEEL));
    }
}

/* A wheel that stops in a tick is no slip: the limiter does not act, and the wheel is believed when it has agreed again
 * for half a second. */
static void test_a_wheel_that_sticks_is_doubted(void) {
    for (int8_t direction = -1; direction <= 1; direction += 2) {
        rig_start();
        rig_drive((int16_t)(direction * 8000), TERRAPIN_CONTROL_VOLTAGE);
        rig_run(2000);
        const double speed = rig.speed;
        rig.stuck = true;
        rig_run(13);
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_WHEEL));
        TEST_ASSERT_FALSE(rig.state.slip.valid);
        for (int ms = 0; ms < 2000; ms++) {
            rig_tick();
            TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
            TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_WHEEL));
        }
        TEST_ASSERT_TRUE(fabs(rig.speed) > fabs(speed) - 0.01);
        rig.stuck = false;
        rig_run(500);
        TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_WHEEL));
        rig_run(100);
        TEST_ASSERT_EQUAL_HEX32(0U, rig.out.faults);
        TEST_ASSERT_TRUE(rig.state.slip.valid);
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, rig_state());
    }
}

/* A halt ends by the motor alone while the wheel is doubted. */
static void test_a_doubted_wheel_does_not_hold_up_the_halt(void) {
    rig_drive(8000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(2000);
    rig.scale = -1.0; /* it turns the other way, faster and faster */
    rig_run(30);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_WHEEL));
    rig_request(TERRAPIN_REQUEST_IDLE, 0);
    rig.runaway = 1.0;
    rig_until(TERRAPIN_STATE_IDLE, 3000U);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_GROUND_WHEEL));
}

/* Who wants another direction by now, or none, does not want to back out. */
static void test_no_backing_out_against_the_operator(void) {
    for (int16_t setpoint = -3000; setpoint <= 0; setpoint += 3000) {
        rig_start();
        climb(8000);
        rig_until(TERRAPIN_STATE_EXTRICATE, 1000U);
        rig_request(TERRAPIN_REQUEST_RUN, setpoint);
        rig_run(51);
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_EXTRICATION_FAILED, rig.state.supervisor.report);
        TEST_ASSERT_FALSE(rig.out.enable);
    }
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

/* An eighth more than rolling took is borne out; nothing is without rolling before, and rolling again forgets it. */
static void test_what_bears_slip_out(void) {
    for (int32_t direction = -1; direction <= 1; direction += 2) {
        for (int32_t more = 0; more <= 1; more++) {
            terrapin_supervisor *s = &rig.state.supervisor;
            s->rolling_ua = 0;
            rig.state.slip.valid = true;
            rig.state.slip.slip_e4 = 2000;
            rig.state.drive.limiting = false;
            rig.state.estimator.recent_ua = direction * 80000;
            (void)extrication_watch(&rig.state, direction);
            TEST_ASSERT_EQUAL_INT32_MESSAGE(0, s->rolling_ua, "that much slip is no rolling");
            rig.state.drive.limiting = true;
            (void)extrication_watch(&rig.state, direction);
            TEST_ASSERT_FALSE_MESSAGE(s->borne_out, "it never rolled");
            rig.state.drive.limiting = false;
            rig.state.slip.slip_e4 = direction * 1999;
            rig.state.slip.valid = false;
            (void)extrication_watch(&rig.state, direction);
            TEST_ASSERT_EQUAL_INT32(0, s->rolling_ua);
            rig.state.slip.valid = true;
            (void)extrication_watch(&rig.state, direction);
            TEST_ASSERT_EQUAL_INT32(80000 / 64, s->rolling_ua);
            for (int i = 0; i < 2000; i++) {
                (void)extrication_watch(&rig.state, direction);
            }
            TEST_ASSERT_INT32_WITHIN(64, 80000, s->rolling_ua);
            const int32_t edge = s->rolling_ua + (s->rolling_ua / 8);
            rig.state.slip.slip_e4 = 6000;
            rig.state.drive.limiting = true;
            rig.state.estimator.recent_ua = direction * (edge + more);
            (void)extrication_watch(&rig.state, direction);
            TEST_ASSERT_EQUAL(more == 1, s->borne_out);
            rig.state.drive.limiting = false; /* lets go for a moment, and takes less then */
            (void)extrication_watch(&rig.state, direction);
            rig.state.drive.limiting = true;
            rig.state.estimator.recent_ua = 0;
            (void)extrication_watch(&rig.state, direction);
            TEST_ASSERT_EQUAL(more == 1, s->borne_out);
            rig.state.slip.slip_e4 = 0;
            (void)extrication_watch(&rig.state, direction);
            TEST_ASSERT_FALSE(s->borne_out);
        }
    }
}

static void test_extrication_is_bounded_in_time(void) {
    rig_set(TERRAPIN_PARAMETER_EXTRICATE_TIMEOUT, 1000);
    climb(8000);
    rig.traction = 1e-6; /* no grip at all, and held by a wall */
    rig.carriage = 0.0;
    rig_until(TERRAPIN_STATE_EXTRICATE, 300U);
    rig_run(750);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_EXTRICATE, rig_state());
    rig_until(TERRAPIN_STATE_IDLE, 100U);
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
    RUN_TEST(test_backs_out_one_turn_at_most);
    RUN_TEST(test_without_torque_nothing_is_backed_out);
    RUN_TEST(test_a_wheel_that_sticks_is_doubted);
    RUN_TEST(test_a_doubted_wheel_does_not_hold_up_the_halt);
    RUN_TEST(test_no_backing_out_against_the_operator);
    RUN_TEST(test_what_counts_as_having_moved);
    RUN_TEST(test_what_bears_slip_out);
    RUN_TEST(test_extrication_is_bounded_in_time);
    RUN_TEST(test_the_operator_may_end_the_extrication);
    RUN_TEST(test_a_robot_that_never_moved_is_given_its_time);
    RUN_TEST(test_a_change_of_direction_lets_the_limiter_go);
    RUN_TEST(test_a_setpoint_of_nothing_does_not_limit);
    return UNITY_END();
}
