/* Calibration on the floor, the nearest terrain, the quadratic fit, and what the telemetry says of it all. */
#include "rig.h"

void setUp(void) {
    rig_start();
}

void tearDown(void) {}

static void calibrate(int16_t setpoint) {
    rig_request(TERRAPIN_REQUEST_CALIBRATE, setpoint);
    rig_until(TERRAPIN_STATE_CALIBRATE, 600U);
    rig_until(TERRAPIN_STATE_IDLE, 30000U);
}

static void test_calibration_finds_the_friction(void) {
    for (int direction = 1; direction >= -1; direction -= 2) {
        rig_start();
        rig.coulomb = 0.0141;
        rig.viscous = 1.37e-3;
        rig.offset_codes = 3.4;
        calibrate((int16_t)(direction * 1000));
        TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_CALIBRATED, rig.state.supervisor.report);
        TEST_ASSERT_INT32_WITHIN(150, 14100, rig_get(TERRAPIN_PARAMETER_COULOMB));
        TEST_ASSERT_INT32_WITHIN(1500, 137000, rig_get(TERRAPIN_PARAMETER_VISCOUS));
        TEST_ASSERT_EQUAL_INT32(1, rig_get(TERRAPIN_PARAMETER_CALIBRATED));
        TEST_ASSERT_TRUE(rig.state.calibration.residual_unm < 200);
        TEST_ASSERT_TRUE_MESSAGE(direction * rig.ground > 3.0, "the sign of the setpoint is the direction");
        TEST_ASSERT_TRUE(fabs(rig.omega) < 0.1);

        rig.f_o = 0.092;
        rig_request(TERRAPIN_REQUEST_RUN, 6000);
        rig_run(6000);
        TEST_ASSERT_TRUE(rig.state.estimator.valid);
        TEST_ASSERT_TRUE(fabs(rig.state.estimator.torque_unm - rig_contact_unm()) < 400.0);
        TEST_ASSERT_TRUE(rig.state.estimator.sd_unm < 2000);
    }
}

static void expect_failed_calibration(void) {
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_CALIBRATION_FAILED, rig.state.supervisor.report);
    TEST_ASSERT_EQUAL_INT32(12000, rig_get(TERRAPIN_PARAMETER_COULOMB));
    TEST_ASSERT_EQUAL_INT32(100000, rig_get(TERRAPIN_PARAMETER_VISCOUS));
    TEST_ASSERT_EQUAL_INT32(0, rig_get(TERRAPIN_PARAMETER_CALIBRATED));
    TEST_ASSERT_FALSE(rig.out.enable);
}

static void test_calibration_without_a_steady_state_fails(void) {
    rig.f_o = 0.5; /* it does not move at all */
    calibrate(0);
    expect_failed_calibration();
    TEST_ASSERT_EQUAL_UINT8(0U, rig.state.calibration.step);
}

static void test_calibration_on_another_ground_fails(void) {
    rig.coulomb = 0.05;
    rig.f_s = 6e-4; /* grows with speed: no straight line */
    calibrate(0);
    expect_failed_calibration();
    TEST_ASSERT_TRUE(rig.state.calibration.residual_unm > 2000);
}

static void test_calibration_to_an_impossible_friction_fails(void) {
    rig.viscous = 0.0; /* with the floor said to grow with speed, B comes out negative */
    rig_set(TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_S, 20000);
    calibrate(0);
    expect_failed_calibration();

    rig_start();
    rig_set(TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_O, 200000); /* and with a floor of 0.2, A does */
    calibrate(0);
    expect_failed_calibration();
}

static void test_calibration_with_speeds_too_near_fails(void) {
    rig_set(TERRAPIN_PARAMETER_CALIBRATE_LOW, 5990);
    rig_set(TERRAPIN_PARAMETER_CALIBRATE_STEPS, 2);
    calibrate(0);
    expect_failed_calibration();
}

static void test_calibration_ends_when_the_operator_says_so(void) {
    rig_request(TERRAPIN_REQUEST_CALIBRATE, 0);
    rig_until(TERRAPIN_STATE_CALIBRATE, 600U);
    rig_run(2000);
    rig_request(TERRAPIN_REQUEST_IDLE, 0);
    rig_until(TERRAPIN_STATE_IDLE, 5000U);
    expect_failed_calibration();
}

static void test_calibration_waits_for_rest(void) {
    rig_request(TERRAPIN_REQUEST_CALIBRATE, 0);
    for (int ms = 0; ms < 2000; ms++) {
        rig.omega = 2.0; /* still rolling */
        rig_tick();
        TEST_ASSERT_NOT_EQUAL(TERRAPIN_STATE_CALIBRATE, rig_state());
    }
    rig.omega = 0.0;
    rig_until(TERRAPIN_STATE_CALIBRATE, 400U);
}

static void test_names_the_terrain_or_none(void) {
    static const double level[] = {0.092, 0.045, 0.028, 0.010};
    static const uint8_t name[] = {TERRAPIN_TERRAIN_SAND, TERRAPIN_TERRAIN_DRY_PEAT, TERRAPIN_TERRAIN_AGRICULTURAL,
                                   TERRAPIN_TERRAIN_HARD_FLOOR};
    for (size_t i = 0; i < sizeof level / sizeof level[0]; i++) {
        rig_start();
        rig.f_o = level[i];
        rig_drive((int16_t)(i == 0 ? 3000 : 2000), TERRAPIN_CONTROL_VOLTAGE);
        rig_run(6000);
        TEST_ASSERT_EQUAL_INT32(name[i], rig.state.ground.terrain);
        TEST_ASSERT_TRUE(rig.state.ground.margin_q3 > 8);
        TEST_ASSERT_INT32_WITHIN(1000, (int32_t)(1e6 * level[i]), rig.state.ground.f_r_ppm);
    }
    rig_start();
    rig.f_o = 0.2;
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(6000);
    TEST_ASSERT_TRUE(rig.state.estimator.valid);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_UNKNOWN, rig.state.ground.terrain);
}

static void test_fit_learns_f_o_and_f_s(void) {
    rig.f_o = 0.092;
    rig.f_s = 0.28e-3;
    rig_drive(4000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(6000);
    const int32_t sd_at_one_speed = rig.state.ground.f_s_sd_e7;
    TEST_ASSERT_TRUE(sd_at_one_speed > 4000);
    for (int16_t millivolt = 5000; millivolt <= 8000; millivolt = (int16_t)(millivolt + 1000)) {
        rig_request(TERRAPIN_REQUEST_RUN, millivolt);
        rig_run(8000);
    }
    TEST_ASSERT_INT32_WITHIN(60, 9200, rig.state.ground.f_o_10ppm);
    TEST_ASSERT_INT32_WITHIN(60, 2800, rig.state.ground.f_s_e7);
    TEST_ASSERT_TRUE(rig.state.ground.f_s_sd_e7 < sd_at_one_speed / 10);
    rig.f_o = 0.045; /* another terrain: the fit begins anew */
    rig.f_s = 0.12e-3;
    rig_run(6000);
    TEST_ASSERT_TRUE(rig.state.ground.windows < 12U);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_DRY_PEAT, rig.state.ground.fitted_terrain);
}

static void test_fit_counts_to_its_end_and_stays_bounded(void) {
    rig.f_o = 0.092;
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(50000);
    TEST_ASSERT_EQUAL_UINT8(127U, rig.state.ground.windows);
    TEST_ASSERT_TRUE(rig.state.ground.weight_q8 <= 64 * 256);
    TEST_ASSERT_TRUE(rig.state.ground.f_o_sd_ppm > 0);
    TEST_ASSERT_INT32_WITHIN(100, 9200, rig.state.ground.f_o_10ppm);
}

/* FIT is made in the ticks after a fresh window. Ticks that are missed there take nothing from it: what is left to do
 * is done in the next cycle. */
static void test_a_gap_does_not_interrupt_the_fit(void) {
    terrapin_frame whole[3];
    for (uint32_t missed = 0U; missed < 3U; missed++) { /* of the ticks 2, 3 and 4 of the slot */
        rig_start();
        calibrate(1000);
        rig.f_o = 0.092;
        rig_drive(6000, TERRAPIN_CONTROL_VOLTAGE);
        rig_run(6000);
        uint32_t waited = 0U;
        do {
            rig_tick();
            waited++;
        } while (!(rig.state.estimator.fresh && (rig.in.tick % 10U) == 1U) && (waited < 2000U));
        TEST_ASSERT_EQUAL_MESSAGE(FIT_STEPS, rig.state.ground.todo, "a fresh window");
        rig_run(2U - missed);
        rig.in.tick += missed;
        rig_run(12U);
        TEST_ASSERT_EQUAL(5U, rig.in.tick % 10U);
        TEST_ASSERT_EQUAL(0U, rig.state.ground.todo);
        TEST_ASSERT_TRUE(rig.state.ground.windows > 2U);
        whole[missed] = rig.last[5];
        TEST_ASSERT_EQUAL_MEMORY(&whole[0], &whole[missed], sizeof whole[0]);
    }
}

/* What the schedule does with a window's C_t once it is known. */
static void tell_ground(void) {
    rig.state.estimator.open = true;
    ground_speed(&rig.state);
    ground_resistance(&rig.state);
    ground_nearest(&rig.state);
    TEST_ASSERT_FALSE(rig.state.estimator.open);
}

static void test_slope_stays_in_torque_and_leaves_f_r(void) {
    rig_run(400);
    rig_set(TERRAPIN_PARAMETER_COMP_SLOPE, 10000);
    rig.state.estimator.torque_unm = 300000;
    rig.state.estimator.sd_unm = 1500;
    rig.state.estimator.omega_urad_s = 5000000;
    rig.state.estimator.pitch_valid = true;
    for (int16_t mrad = -300; mrad <= 300; mrad = (int16_t)(mrad + 50)) {
        rig.state.estimator.pitch_mrad = mrad;
        tell_ground();
        const double load = RADIUS * WEIGHT;
        const double f_r = (0.3 - load * sin(mrad * 1e-3)) / (load * cos(mrad * 1e-3));
        TEST_ASSERT_TRUE(fabs(rig.state.ground.f_r_ppm * 1e-6 - f_r) < 4e-4);
        TEST_ASSERT_EQUAL_INT32(300000, rig.state.estimator.torque_unm);
    }
    rig.state.estimator.pitch_mrad = 1571; /* upright: nothing to divide by, nothing breaks */
    tell_ground();
    rig.state.estimator.omega_urad_s = -5000000; /* f_r is that of the motion's direction */
    rig.state.estimator.pitch_valid = false;
    tell_ground();
    TEST_ASSERT_TRUE(rig.state.ground.f_r_ppm < 0);
}

/* The curves' speed, squared and held at 200 rad/s: to 0.005 rad^2/s^2, its unit's half, and two roundings to 1e-6;
 * 2^20 / 1e5 is good to 3.4e-7. */
static void test_curves_follow_the_speed(void) {
    rig_run(400);
    rig.state.gains.weight_q22 = 1 << 22; /* the floor's torque is its f_r */
    rig.state.parameter[TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_O] = 20000;
    rig.state.parameter[TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_S] = 1000000;
    for (int32_t mrad_s = 0; mrad_s <= 300000; mrad_s += 973) {
        const double omega = fmin(mrad_s * 1e-3, 200.0);
        const int32_t floor = ground_floor_unm(&rig.state, mrad_s * 1000);
        const double curve = 1000.0 * omega * omega;
        TEST_ASSERT_TRUE(fabs(floor - (20000.0 + curve)) <= 5.0 + (3.4e-7 * curve) + 2.0);
        TEST_ASSERT_EQUAL_INT32(floor, ground_floor_unm(&rig.state, -mrad_s * 1000));
    }
    rig.state.parameter[TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_O] = 0;
    rig.state.parameter[TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_S] = 10000000; /* 100e-6 a unit of the square */
    TEST_ASSERT_EQUAL_INT32(400000134, ground_floor_unm(&rig.state, INTEGER_MOST));
}

/* Only what is given decides: no friction in the way, f_r is C_t in the weight's units. */
static void test_f_r_is_held(void) {
    rig_run(400);
    rig.state.estimator.pitch_valid = false;
    rig.state.estimator.torque_unm = 2000000;
    rig.state.estimator.sd_unm = 2000000;
    rig.state.gains.per_weight_q24 = 1 << 24;
    tell_ground();
    TEST_ASSERT_EQUAL_INT32(1048576, rig.state.ground.f_r_ppm);
    TEST_ASSERT_EQUAL_INT32(1048576, rig.state.ground.f_r_sd_ppm);
    rig.state.estimator.torque_unm = -2000000;
    rig.state.estimator.sd_unm = 0;
    tell_ground();
    TEST_ASSERT_EQUAL_INT32(-1048576, rig.state.ground.f_r_ppm);
    TEST_ASSERT_EQUAL_INT32(1, rig.state.ground.f_r_sd_ppm);
}

/* Curves 0.1 apart; sd 8000e-6, an eighth of it 1000e-6. */
static void near_curves(int32_t f_r_ppm) {
    static const uint16_t first[TERRAINS] = {
        TERRAPIN_PARAMETER_TERRAIN_SAND_F_O, TERRAPIN_PARAMETER_TERRAIN_DRY_PEAT_F_O,
        TERRAPIN_PARAMETER_TERRAIN_RED_TERRAIN_F_O, TERRAPIN_PARAMETER_TERRAIN_AGRICULTURAL_F_O,
        TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_O};
    for (int32_t i = 0; i < TERRAINS; i++) {
        rig.state.parameter[first[i]] = 500000 - (100000 * i);
    }
    rig.state.parameter[TERRAPIN_PARAMETER_SD_TERRAIN] = 0;
    rig.state.ground.f_r_ppm = f_r_ppm;
    rig.state.ground.f_r_sd_ppm = 8000;
    rig.state.estimator.open = true;
    ground_nearest(&rig.state);
}

static int32_t square_at(int32_t urad_s) {
    rig.state.estimator.omega_urad_s = urad_s;
    ground_speed(&rig.state);
    return rig.state.ground.square_q25;
}

static void test_the_speed_of_the_curves_ends_at_200_rad_s(void) {
    const int32_t most = square_at(200000000);
    TEST_ASSERT_INT32_WITHIN(most / 2000000, 40.0 * (1 << 25), most);
    TEST_ASSERT_EQUAL_INT32_MESSAGE(most, square_at(-300000000), "no more beyond");
    TEST_ASSERT_LESS_THAN_INT32_MESSAGE(most, square_at(199990000), "and no sooner");
}

/* 1e9 / radius in Q12, to the next above. */
static void test_the_rim_of_a_radius(void) {
    rig_set(TERRAPIN_PARAMETER_DRIVE_RADIUS, 10000);
    rig_set(TERRAPIN_PARAMETER_RADIUS, 20002);
    TEST_ASSERT_EQUAL_INT32(204779523, rig.state.rates.shell_per_rim.factor);
    rig_set(TERRAPIN_PARAMETER_RADIUS, 20000);
    TEST_ASSERT_EQUAL_INT32(204800000, rig.state.rates.shell_per_rim.factor);
}

static void test_distances_are_told_in_eighths_of_sd(void) {
    rig_run(400);
    rig.state.estimator.omega_urad_s = 0;
    ground_speed(&rig.state);
    near_curves(300000);
    TEST_ASSERT_EQUAL_INT32(3, rig.state.ground.terrain);
    TEST_ASSERT_EQUAL_INT32(100, rig.state.ground.margin_q3);
    near_curves(349000); /* one eighth nearer to this than to that */
    TEST_ASSERT_EQUAL_INT32(3, rig.state.ground.terrain);
    TEST_ASSERT_EQUAL_INT32(2, rig.state.ground.margin_q3);
    near_curves(349500);
    TEST_ASSERT_EQUAL_INT32(3, rig.state.ground.terrain);
    TEST_ASSERT_EQUAL_INT32(1, rig.state.ground.margin_q3);
    near_curves(349501); /* as near, rounded: the first */
    TEST_ASSERT_EQUAL_INT32(2, rig.state.ground.terrain);
    TEST_ASSERT_EQUAL_INT32(0, rig.state.ground.margin_q3);
    rig.state.parameter[TERRAPIN_PARAMETER_TERRAIN_SAND_F_O] = 500003; /* 2.4 and 1.6 eighths of 10e-6, both 2 */
    rig.state.parameter[TERRAPIN_PARAMETER_TERRAIN_DRY_PEAT_F_O] = 500002;
    rig.state.ground.f_r_ppm = 500000;
    rig.state.ground.f_r_sd_ppm = 10;
    rig.state.estimator.open = true;
    ground_nearest(&rig.state);
    TEST_ASSERT_EQUAL_INT32(1, rig.state.ground.terrain);
    near_curves(564499); /* 64 eighths */
    TEST_ASSERT_EQUAL_INT32(1, rig.state.ground.terrain);
    near_curves(564500); /* 65 */
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_UNKNOWN, rig.state.ground.terrain);
    rig.state.ground.square_q25 = INT32_MAX / 4; /* 16 rad^2/s^2 * 1000: the curve with a slope is far away */
    rig.state.parameter[TERRAPIN_PARAMETER_TERRAIN_SAND_F_S] = 10000000;
    near_curves(100000);
    TEST_ASSERT_EQUAL_INT32(5, rig.state.ground.terrain);
}

static void test_the_margin_and_the_fits_speed_are_held(void) {
    rig_run(400);
    rig.state.estimator.omega_urad_s = 0;
    ground_speed(&rig.state);
    near_curves(500000);
    rig.state.ground.f_r_sd_ppm = 1000; /* the next is 800 eighths away */
    rig.state.estimator.open = true;
    ground_nearest(&rig.state);
    TEST_ASSERT_EQUAL_INT32(255, rig.state.ground.margin_q3);

    rig.state.estimator.omega_urad_s = 100000000;
    rig.state.ground.fitted_terrain = rig.state.ground.terrain + 1; /* the fit begins */
    rig.state.ground.todo = FIT_STEPS;
    ground_fit_work(&rig.state);
    TEST_ASSERT_EQUAL_INT32(131072 * 256, rig.state.ground.x_q8);
}

static void test_one_message_a_slot_and_an_empty_one(void) {
    static const uint16_t id[10] = {
        TERRAPIN_ID_STATUS, TERRAPIN_ID_GROUND, TERRAPIN_ID_MOTION,      TERRAPIN_ID_ELECTRICAL, TERRAPIN_ID_WINDOW,
        TERRAPIN_ID_FIT,    TERRAPIN_ID_REPORT, TERRAPIN_ID_CALIBRATION, TERRAPIN_ID_ATTITUDE,   0U};
    uint8_t last = TERRAPIN_E2E_NO_COUNTER;
    for (int ms = 0; ms < 100; ms++) {
        rig_tick();
        const uint32_t slot = rig.in.tick % 10U;
        TEST_ASSERT_EQUAL_UINT8(slot == 9U ? 1U : 2U, rig.out.frame_count);
        TEST_ASSERT_EQUAL(TERRAPIN_E2E_OK, terrapin_e2e_check(&rig.out.frames[0], &last));
        if (slot != 9U) {
            TEST_ASSERT_EQUAL_HEX16(id[slot], rig.out.frames[1].id);
        }
        terrapin_actuate_t actuate;
        TEST_ASSERT_TRUE(terrapin_decode_actuate(&rig.out.frames[0], &actuate));
        TEST_ASSERT_EQUAL_INT32((int32_t)(rig.in.tick & 0xFFFFU), actuate.tick);
    }
}

static void head(uint16_t turn, bool valid, uint32_t counts) {
    rig.in.heading_turn = turn;
    rig.in.heading_valid = valid;
    rig.state.sense.ground_position += counts;
    heading_slot(&rig.state, &rig.in);
}

/* A quarter of a circle to the left, through the wrap of the turn; then unknown, then held at its ends. */
static void test_path_is_the_way_along_the_heading(void) {
    const double count_um = rig.state.gains.ground_e5_um * 1e-5;
    head(0xF000, true, 12345U); /* the first look moves nothing */
    TEST_ASSERT_EQUAL_INT32(0, rig.state.heading.x_um);
    for (uint32_t i = 1; i <= 256U; i++) {
        head((uint16_t)(0xF000U + (i * 64U)), true, 50U);
    }
    const double radius = 256.0 * 50.0 * count_um / (3.14159265358979 / 2.0);
    const double from = -3.14159265358979 / 8.0;
    const double to = from + (3.14159265358979 / 2.0);
    TEST_ASSERT_TRUE(fabs(rig.state.heading.x_um - (radius * (sin(to) - sin(from)))) < 300.0);
    TEST_ASSERT_TRUE(fabs(rig.state.heading.y_um - (radius * (cos(from) - cos(to)))) < 300.0);
    const int32_t x_um = rig.state.heading.x_um;
    head(0, false, 1000U);
    head(0, true, 1000U);
    TEST_ASSERT_EQUAL_INT32(x_um, rig.state.heading.x_um);
    head(0, true, (uint32_t)-100);
    TEST_ASSERT_TRUE(fabs(x_um - rig.state.heading.x_um - (100.0 * count_um)) < 2.0);
    for (int i = 0; i < 64; i++) {
        head(0x8000, true, 0x7FFFFFU);
    }
    TEST_ASSERT_EQUAL_INT32(-520000000, rig.state.heading.x_um);
}

static void test_heading_takes_the_empty_slot(void) {
    rig.in.heading_valid = true;
    rig.in.heading_turn = 0x4000;
    bool seen = false;
    for (int ms = 0; ms < 30; ms++) {
        rig_tick();
        if (rig.in.tick % 10U == 9U) {
            terrapin_heading_t message;
            TEST_ASSERT_EQUAL_UINT8(2U, rig.out.frame_count);
            TEST_ASSERT_TRUE(terrapin_decode_heading(&rig.out.frames[1], &message));
            TEST_ASSERT_EQUAL_INT32(0x4000, message.heading);
            seen = true;
        }
    }
    TEST_ASSERT_TRUE(seen);
}

static void test_telemetry_says_what_the_state_holds(void) {
    rig.f_o = 0.092;
    rig.f_s = 0.28e-3;
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(6000);
    while (rig.in.tick % 10U != 4U) { /* told, and the next window is not begun */
        rig_tick();
    }
    const terrapin_estimator *e = &rig.state.estimator;
    terrapin_status_t status;
    terrapin_ground_t ground;
    terrapin_motion_t motion;
    terrapin_electrical_t electrical;
    terrapin_window_t window;
    terrapin_fit_t fit;
    TEST_ASSERT_TRUE(terrapin_decode_status(&rig.last[0], &status));
    TEST_ASSERT_TRUE(terrapin_decode_ground(&rig.last[1], &ground));
    TEST_ASSERT_TRUE(terrapin_decode_motion(&rig.last[2], &motion));
    TEST_ASSERT_TRUE(terrapin_decode_electrical(&rig.last[3], &electrical));
    TEST_ASSERT_TRUE(terrapin_decode_window(&rig.last[4], &window));
    TEST_ASSERT_TRUE(terrapin_decode_fit(&rig.last[5], &fit));
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_RUN, status.state);
    TEST_ASSERT_EQUAL_INT32(1, status.trimmed);
    TEST_ASSERT_EQUAL_INT32(0, status.saturated);
    TEST_ASSERT_EQUAL_INT32(e->torque_unm, ground.torque);
    TEST_ASSERT_EQUAL_INT32(1, ground.valid);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_SAND, ground.terrain);
    TEST_ASSERT_INT32_WITHIN(2, (int32_t)lrint(1e3 * rig.omega), motion.shell_speed);
    TEST_ASSERT_INT32_WITHIN(40, (int32_t)lrint(200.0 * GEAR * rig.omega), motion.motor_speed);
    TEST_ASSERT_INT32_WITHIN(40, (int32_t)lrint(1e4 * rig.speed), motion.ground_speed);
    TEST_ASSERT_INT32_WITHIN(10, (int32_t)lrint(1e4 * rig.current), electrical.current);
    TEST_ASSERT_EQUAL_INT32(12000, electrical.supply);
    TEST_ASSERT_EQUAL_INT32(1250, electrical.temperature);
    TEST_ASSERT_INT32_WITHIN(2, 5000, electrical.voltage);
    TEST_ASSERT_INT32_WITHIN(20, (int32_t)lrint(1e5 * rig.current), window.current);
    TEST_ASSERT_INT32_WITHIN(30, (int32_t)lrint(1e4 * rig.omega), window.omega);
    TEST_ASSERT_INT32_WITHIN(2, 5000, window.voltage);
    TEST_ASSERT_EQUAL_INT32(1, window.valid);
    TEST_ASSERT_TRUE(fit.windows > 0);
    /* A row of a case closes the balance: (R/r) K_t I - A - B w = C_t */
    const double balance = GEAR * TORQUE_CONST * window.current * 1e-5 - 0.012 - 1e-3 * window.omega * 1e-4;
    TEST_ASSERT_TRUE(fabs(balance - ground.torque * 1e-6) < 1e-5);
}

static void test_attitude_and_report(void) {
    rig.in.pitch_valid = true;
    rig.in.pitch_mrad = -123;
    rig.in.swing_angle_mrad = 321;
    rig_run(400);
    episode_report(&rig.state, TERRAPIN_REPORT_STOPPED, -77);
    rig_run(20);
    terrapin_attitude_t attitude;
    terrapin_report_t report;
    TEST_ASSERT_TRUE(terrapin_decode_attitude(&rig.last[8], &attitude));
    TEST_ASSERT_TRUE(terrapin_decode_report(&rig.last[6], &report));
    TEST_ASSERT_EQUAL_INT32(-123, attitude.pitch);
    TEST_ASSERT_EQUAL_INT32(321, attitude.swing_angle);
    TEST_ASSERT_INT32_WITHIN(3, 65536 - (int32_t)lrint(0.321 / WHEEL_TURN * 65536.0), attitude.angle);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REPORT_STOPPED, report.report);
    TEST_ASSERT_EQUAL_INT32(1, report.number);
    TEST_ASSERT_EQUAL_INT32(-77, report.distance);
}

static void test_saturation_raises_its_flag_and_goes_with_its_cause(void) {
    rig_run(300);
    rig.in.swing_angle_mrad = 5000; /* more than its signal carries */
    rig_run(20);
    TEST_ASSERT_TRUE(rig_fault(TERRAPIN_FAULT_SATURATED));
    TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_STATE_IDLE, rig_state(), "a flag only");
    rig.in.swing_angle_mrad = 0;
    rig_run(20);
    TEST_ASSERT_FALSE(rig_fault(TERRAPIN_FAULT_SATURATED));
}

/* f_r = 0.1 with an sd of 80e-6 between curves that are so far from it, on a table without speed. */
static int32_t terrain_at(int32_t sand_ppm, int32_t floor_ppm) {
    rig_start();
    for (uint16_t i = 0U; i < TERRAINS; i++) {
        rig_set((uint16_t)(TERRAPIN_PARAMETER_TERRAIN_SAND_F_O + (2 * i)), 900000);
        rig_set((uint16_t)(TERRAPIN_PARAMETER_TERRAIN_SAND_F_S + (2 * i)), 0);
    }
    rig_set(TERRAPIN_PARAMETER_TERRAIN_SAND_F_O, 100000 + sand_ppm);
    rig_set(TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_O, 100000 + floor_ppm);
    rig_set(TERRAPIN_PARAMETER_SD_TERRAIN, 0);
    rig.state.ground.f_r_ppm = 100000;
    rig.state.ground.f_r_sd_ppm = 80;
    rig.state.estimator.open = true;
    ground_nearest(&rig.state);
    return rig.state.ground.terrain;
}

/* A curve is nearer when it is by an eighth of the sd, ten here, to the nearest; else the first of the table is told.
 */
static void test_the_nearest_terrain_to_an_eighth(void) {
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_SAND, terrain_at(14, 5));
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_HARD_FLOOR, terrain_at(15, 5));
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_SAND, terrain_at(-14, 14));
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_HARD_FLOOR, terrain_at(-15, 14));
    TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_TERRAIN_SAND, terrain_at(644, 90000), "8 sd, rounded");
    TEST_ASSERT_EQUAL_INT32_MESSAGE(TERRAPIN_TERRAIN_UNKNOWN, terrain_at(645, 90000), "an eighth more");
}

/* Off by more than 268 at an sd of 1e-6, the least there is: far from all, and not so far that it comes round to near.
 */
static void test_what_is_far_from_every_curve(void) {
    (void)terrain_at(0, 0);
    for (uint16_t i = 0U; i < TERRAINS; i++) {
        rig_set((uint16_t)(TERRAPIN_PARAMETER_TERRAIN_SAND_F_S + (2 * i)), 10000000);
    }
    rig.state.ground.f_r_sd_ppm = 1;
    rig.state.estimator.omega_urad_s = 250000000;
    rig.state.estimator.open = true;
    ground_speed(&rig.state);
    ground_nearest(&rig.state);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_TERRAIN_UNKNOWN, rig.state.ground.terrain);
    TEST_ASSERT_EQUAL_INT32(0, rig.state.ground.margin_q3);
}

/* f_r is held at 2^20 ppm either way, and a window at rest says x = 0. */
static void test_the_ends_of_the_fit(void) {
    rig_set(TERRAPIN_PARAMETER_WEIGHT, 1000);
    for (int32_t sign = -1; sign <= 1; sign += 2) {
        rig.state.estimator.torque_unm = sign * TERRAPIN_LIMIT_TORQUE_FULL_SCALE;
        rig.state.estimator.omega_urad_s = 1000;
        rig.state.estimator.open = true;
        ground_resistance(&rig.state);
        TEST_ASSERT_EQUAL_INT32(sign * 1048576, rig.state.ground.f_r_ppm);
    }
    rig.state.estimator.fresh = true;
    ground_nearest(&rig.state);
    while (rig.state.ground.todo > 0U) {
        ground_fit_work(&rig.state);
    }
    TEST_ASSERT_EQUAL_UINT8(1U, rig.state.ground.windows);
    TEST_ASSERT_EQUAL_INT32(0, rig.state.ground.x_q8);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_calibration_finds_the_friction);
    RUN_TEST(test_calibration_without_a_steady_state_fails);
    RUN_TEST(test_calibration_on_another_ground_fails);
    RUN_TEST(test_calibration_to_an_impossible_friction_fails);
    RUN_TEST(test_calibration_with_speeds_too_near_fails);
    RUN_TEST(test_calibration_ends_when_the_operator_says_so);
    RUN_TEST(test_calibration_waits_for_rest);
    RUN_TEST(test_names_the_terrain_or_none);
    RUN_TEST(test_fit_learns_f_o_and_f_s);
    RUN_TEST(test_fit_counts_to_its_end_and_stays_bounded);
    RUN_TEST(test_a_gap_does_not_interrupt_the_fit);
    RUN_TEST(test_slope_stays_in_torque_and_leaves_f_r);
    RUN_TEST(test_curves_follow_the_speed);
    RUN_TEST(test_f_r_is_held);
    RUN_TEST(test_the_speed_of_the_curves_ends_at_200_rad_s);
    RUN_TEST(test_the_rim_of_a_radius);
    RUN_TEST(test_distances_are_told_in_eighths_of_sd);
    RUN_TEST(test_the_margin_and_the_fits_speed_are_held);
    RUN_TEST(test_one_message_a_slot_and_an_empty_one);
    RUN_TEST(test_path_is_the_way_along_the_heading);
    RUN_TEST(test_heading_takes_the_empty_slot);
    RUN_TEST(test_telemetry_says_what_the_state_holds);
    RUN_TEST(test_attitude_and_report);
    RUN_TEST(test_saturation_raises_its_flag_and_goes_with_its_cause);
    RUN_TEST(test_the_nearest_terrain_to_an_eighth);
    RUN_TEST(test_what_is_far_from_every_curve);
    RUN_TEST(test_the_ends_of_the_fit);
    return UNITY_END();
}
