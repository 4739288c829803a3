/* C_t against double precision and against the truth of the rig; its gate, its sd, its compensation terms. */
#include <stdio.h>
#include <stdlib.h>

#include "rig.h"

void setUp(void) {
    rig_start();
    srand(11);
}

void tearDown(void) {}

static double uniform(double low, double high) {
    return low + (high - low) * ((double)rand() / (double)RAND_MAX);
}

/* The bound of the project: at most 50 uN m over the currents and speeds that are promised, and the clamp where it
 * clamps. */
static void test_a_million_windows_against_double(void) {
    const terrapin_gains *g = &rig.state.gains;
    const double most_amps = TERRAPIN_PROMISE_CURRENT_MAGNITUDE / 1000.0;
    const double fastest = TERRAPIN_PROMISE_SHELL_SPEED / 1000.0;
    double worst = 0.0;
    int clamped = 0;
    for (int i = 0; i < 1000000; i++) {
        const double amps = uniform(-most_amps, most_amps);
        const double omega = uniform(-fastest, fastest);
        const int32_t sum_q8 = (int32_t)lrint(amps * 1000.0 * 300.0 * 256.0);
        const int32_t counts = (int32_t)lrint(omega * 0.3 * GEAR / WHEEL_TURN * 2048.0);
        const double exact_amps = sum_q8 / 256.0 / 300.0 / 1000.0;
        const double exact_omega = counts / 2048.0 * WHEEL_TURN / GEAR / 0.3;
        const double friction = 0.012 * ((counts > 0) - (counts < 0)) + 1e-3 * exact_omega;
        const double exact = 1e6 * (GEAR * TORQUE_CONST * exact_amps - friction);
        bool saturated = false;
        const int32_t unclamped = estimator_motor_torque(g, sum_q8, 1 << 20) - estimator_friction(g, 12000, counts);
        const int32_t torque = estimator_contact_torque(unclamped, &saturated);
        if (fabs(exact) > 1000050.0) {
            clamped++;
            TEST_ASSERT_EQUAL_INT32(exact > 0.0 ? 1000000 : -1000000, torque);
            TEST_ASSERT_TRUE(saturated);
        } else {
            worst = fmax(worst, fabs(torque - fmax(-1e6, fmin(1e6, exact))));
        }
    }
    printf("greatest error of a million windows: %.3f uN m\n", worst);
    TEST_ASSERT_TRUE_MESSAGE(worst <= 50.0, "fixed point against double");
    TEST_ASSERT_TRUE_MESSAGE(worst >= 0.4, "less than rounding to 1 uN m: the test looks at nothing");
    TEST_ASSERT_TRUE_MESSAGE(worst <= 12.0, "the arithmetic that stands errs by half a bit of a Q.16 gain, 5 uN m");
    TEST_ASSERT_TRUE_MESSAGE(clamped == 0, "2.048 A is 0.91 N m: the full scale is not reached here");
}

static void test_saturates_at_full_scale_with_a_flag(void) {
    bool saturated = false;
    TEST_ASSERT_EQUAL_INT32(1000000, estimator_contact_torque(1000001, &saturated));
    TEST_ASSERT_TRUE(saturated);
    TEST_ASSERT_EQUAL_INT32(-1000000, estimator_contact_torque(-INTEGER_MOST, &saturated));
    TEST_ASSERT_TRUE(saturated);
    TEST_ASSERT_EQUAL_INT32(1000000, estimator_contact_torque(1000000, &saturated));
    TEST_ASSERT_FALSE(saturated);
}

static void test_gains_over_the_whole_range_of_parameters(void) {
    static const uint16_t index[] = {TERRAPIN_PARAMETER_RADIUS,          TERRAPIN_PARAMETER_DRIVE_RADIUS,
                                     TERRAPIN_PARAMETER_TORQUE_CONSTANT, TERRAPIN_PARAMETER_CURRENT_SCALE,
                                     TERRAPIN_PARAMETER_VISCOUS,         TERRAPIN_PARAMETER_WINDOW,
                                     TERRAPIN_PARAMETER_WEIGHT};
    for (uint32_t corner = 0U; corner < 128U; corner++) {
        for (uint32_t i = 0U; i < 7U; i++) {
            const terrapin_parameter_entry entry = terrapin_parameter((uint16_t)index[i]);
            rig_set(index[i], ((corner >> i) & 1U) != 0U ? entry.maximum : entry.minimum);
        }
        const int32_t *p = rig.state.parameter;
        const terrapin_gains *g = &rig.state.gains;
        const double drive = fmin(p[TERRAPIN_PARAMETER_DRIVE_RADIUS], p[TERRAPIN_PARAMETER_RADIUS]);
        const double ratio = p[TERRAPIN_PARAMETER_RADIUS] / drive;
        const double window = p[TERRAPIN_PARAMETER_WINDOW];
        const double gain = ratio * p[TERRAPIN_PARAMETER_TORQUE_CONSTANT] * p[TERRAPIN_PARAMETER_CURRENT_SCALE] * 1e-6 /
                            window * 65536.0;
        const double count = WHEEL_TURN / 2048.0 / ratio * 1e11;
        const double drag = p[TERRAPIN_PARAMETER_VISCOUS] * 1e-2 * count * 1e-11 / (window * 1e-3) * 65536.0;
        TEST_ASSERT_TRUE(fabs(g->current_gain_q16 - gain) <= 0.51 + gain * 1e-6);
        TEST_ASSERT_TRUE(fabs(g->count_e5_urad - count) <= 1.0);
        TEST_ASSERT_TRUE(fabs(g->speed_gain_q16 - drag) <= 1.0 + drag * 1e-5);
        TEST_ASSERT_EQUAL_UINT32((uint32_t)(window / 10.0), g->window_slots);
        TEST_ASSERT_EQUAL(p[TERRAPIN_PARAMETER_DRIVE_RADIUS] < p[TERRAPIN_PARAMETER_RADIUS],
                          rig.state.gains.consistent);
    }
}

static void test_steady_state_on_four_terrains(void) {
    static const double terrain[4][2] = {{0.092, 0.28e-3}, {0.045, 0.12e-3}, {0.037, 0.15e-3}, {0.028, 0.098e-3}};
    static const uint8_t names[4] = {TERRAPIN_TERRAIN_SAND, TERRAPIN_TERRAIN_DRY_PEAT, TERRAPIN_TERRAIN_RED_TERRAIN,
                                     TERRAPIN_TERRAIN_AGRICULTURAL};
    for (int i = 0; i < 4; i++) {
        for (int16_t millivolt = 2000; millivolt <= 8000; millivolt = (int16_t)(millivolt + 3000)) {
            rig_start();
            rig.f_o = terrain[i][0];
            rig.f_s = terrain[i][1];
            rig_drive(millivolt, TERRAPIN_CONTROL_VOLTAGE);
            uint32_t waited = 0U;
            while (!rig.state.estimator.valid && waited < 6000U) {
                rig_tick();
                waited++;
            }
            TEST_ASSERT_TRUE_MESSAGE(waited <= 4500U, "first valid value after a voltage step");
            for (int ms = 0; ms < 2000; ms++) {
                rig_tick();
                TEST_ASSERT_TRUE_MESSAGE(rig.state.estimator.valid, "stays valid");
                TEST_ASSERT_TRUE_MESSAGE(fabs(rig.state.estimator.torque_unm - rig_contact_unm()) <= 500.0, "0.5 mN m");
            }
            TEST_ASSERT_EQUAL_INT32(names[i], rig.state.ground.terrain);
            TEST_ASSERT_TRUE(fabs(rig.state.estimator.omega_urad_s * 1e-6 - rig.omega) < 3e-3);
        }
    }
}

/* Longer than 16 bits count: eleven minutes of records, one of ticks. A counter that has no end wraps meanwhile. */
static void test_a_long_run_says_the_same_to_its_end(void) {
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    for (uint32_t ms = 0U; ms < 660000U; ms++) {
        rig_tick();
        TEST_ASSERT_TRUE_MESSAGE(rig.state.estimator.valid, "stays valid");
        TEST_ASSERT_TRUE_MESSAGE(fabs(rig.state.estimator.torque_unm - rig_contact_unm()) <= 500.0, "0.5 mN m");
    }
    rig_start();
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    for (uint32_t ms = 0U; ms < 70000U; ms++) {
        rig.in.swing_rate_centirad_s = (int16_t)lrint(100.0 * sin(WHEEL_TURN * ms / 600.0));
        rig_tick();
        TEST_ASSERT_FALSE_MESSAGE((ms > 450U) && rig.state.estimator.valid, "the inner device swings");
    }
}

static void test_not_valid_while_the_speed_changes(void) {
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    for (int ms = 0; ms < 2000; ms++) {
        rig_tick();
        TEST_ASSERT_FALSE(rig.state.estimator.valid);
    }
    rig_run(3000);
    TEST_ASSERT_TRUE(rig.state.estimator.valid);
    rig.f_o = 0.092; /* another ground */
    rig_run(80);
    TEST_ASSERT_FALSE(rig.state.estimator.valid);
}

static void test_not_valid_while_the_inner_device_swings(void) {
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    TEST_ASSERT_TRUE(rig.state.estimator.valid);
    for (int ms = 0; ms < 450;
         ms++) { /* the sensor alone says so, and with half the window's period it does not cancel */
        rig.in.swing_rate_centirad_s = (int16_t)lrint(100.0 * sin(WHEEL_TURN * ms / 600.0));
        rig_tick();
    }
    TEST_ASSERT_FALSE(rig.state.estimator.valid);
    rig.in.swing_rate_centirad_s = 0;
    rig_run(1500);
    TEST_ASSERT_TRUE(rig.state.estimator.valid);
    rig.in.swing_valid = false; /* without a sensor the encoder's part of the gate decides alone */
    rig_run(1000);
    TEST_ASSERT_TRUE(rig.state.estimator.valid);
}

static void test_at_rest_nothing_is_valid(void) {
    rig_run(6000);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_STATE_IDLE, rig_state());
    TEST_ASSERT_FALSE(rig.state.estimator.valid);
    TEST_ASSERT_INT32_WITHIN(200, 0, rig.state.estimator.torque_unm);
}

static void test_fresh_windows_share_no_sample(void) {
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    const uint8_t first = rig.state.estimator.index;
    rig_run(3000);
    TEST_ASSERT_EQUAL_UINT8(10, (uint8_t)(rig.state.estimator.index - first));
}

static void test_zero_of_the_current_is_trimmed_with_the_bridge_off(void) {
    rig.offset_codes = -7.3;
    rig_run(400);
    TEST_ASSERT_TRUE(rig.state.sense.trimmed);
    TEST_ASSERT_INT32_WITHIN(40, (int32_t)lrint(-7.3 * 256.0), rig.state.sense.trim_q8_codes);
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    TEST_ASSERT_TRUE(fabs(rig.state.estimator.torque_unm - rig_contact_unm()) < 200.0);

    rig_start();
    rig_set(TERRAPIN_PARAMETER_TRIM_CURRENT, 0);
    rig.offset_codes = -7.3;
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    TEST_ASSERT_FALSE(rig.state.sense.trimmed);
    const double bias = 1e6 * GEAR * TORQUE_CONST * -7.3e-3;
    TEST_ASSERT_TRUE(fabs(rig.state.estimator.torque_unm - rig_contact_unm() - bias) < 300.0);
}

/* A window of the estimator at a given mean speed, current zero: what compensation takes off. */
static double compensated(double omega, double acceleration, uint16_t index, int32_t value, uint16_t with,
                          int32_t other) {
    rig_start();
    rig_set(index, value);
    if (with != index) {
        rig_set(with, other);
    }
    rig.state.estimator.omega_urad_s = (int32_t)lrint(omega * 1e6);
    rig.state.estimator.acceleration_urad_s2 = (int32_t)lrint(acceleration * 1e6);
    const int32_t counts = (int32_t)lrint(omega * 0.3 * GEAR / WHEEL_TURN * 2048.0);
    return compensation_friction(&rig.state, counts) * 1e-6;
}

static void test_compensation_terms_against_double(void) {
    for (double w = -25.0; w <= 25.0; w += 1.3) {
        const double sign = w < 0.0 ? -1.0 : 1.0;
        const uint16_t square = TERRAPIN_PARAMETER_COMP_SPEED_SQUARED;
        const uint16_t viscous = TERRAPIN_PARAMETER_COMP_VISCOUS;
        const uint16_t coulomb = TERRAPIN_PARAMETER_COMP_COULOMB;
        const uint16_t stribeck = TERRAPIN_PARAMETER_COMP_STRIBECK;
        const uint16_t inertia = TERRAPIN_PARAMETER_COMP_INERTIA;
        TEST_ASSERT_TRUE(fabs(compensated(w, 0.0, square, 123456, square, 0) - 123456e-9 * w * w * sign) < 2e-5);
        TEST_ASSERT_TRUE(fabs(compensated(w, 0.0, viscous, 54321, viscous, 0) - 54321e-8 * w) < 2e-6);
        TEST_ASSERT_TRUE(fabs(compensated(w, 0.0, coulomb, 7654, coulomb, 0) - 7654e-6 * sign) < 1e-6);
        TEST_ASSERT_TRUE(fabs(compensated(w, 2.0, inertia, 9000, inertia, 0) - 9000e-7 * 2.0) < 1e-6);
        const double sticking = 20000e-6 * exp(-(w / 3.0) * (w / 3.0)) * sign;
        TEST_ASSERT_TRUE(
            fabs(compensated(w, 0.0, stribeck, 20000, TERRAPIN_PARAMETER_COMP_STRIBECK_SPEED, 3000) - sticking) < 1e-5);
    }
    TEST_ASSERT_TRUE(compensated(3.0, 1.0, TERRAPIN_PARAMETER_COMP_VISCOUS, 0, TERRAPIN_PARAMETER_COMP_COULOMB, 0) ==
                     0.0);
}

static void test_imbalance_is_the_mean_over_the_window(void) {
    for (int i = 0; i < 2000; i++) {
        const double amplitude = uniform(-0.05, 0.05);
        const double phase = uniform(-3.1, 3.1);
        const int32_t counts = (int32_t)uniform(-10000.0, 10000.0);
        const uint32_t position = (uint32_t)(int32_t)uniform(-200000.0, 200000.0);
        const int16_t swing = (int16_t)uniform(-700.0, 700.0);
        rig_start();
        rig_set(TERRAPIN_PARAMETER_COMP_IMBALANCE, (int32_t)lrint(amplitude * 1e6));
        rig_set(TERRAPIN_PARAMETER_COMP_IMBALANCE_PHASE, (int32_t)lrint(phase * 1e4));
        rig.state.history[rig.state.estimator.newest].position_counts = position; /* as the window closed */
        rig.state.estimator.swing_valid = i % 2 == 0;
        rig.state.estimator.swing_angle_mrad = swing;
        const double unit = WHEEL_TURN / 2048.0 / GEAR;
        const double end = (int32_t)position * unit - (i % 2 == 0 ? swing * 1e-3 : 0.0) + phase;
        const double way = counts * unit;
        const double mean = fabs(way) < 1e-9 ? sin(end) : (cos(end - way) - cos(end)) / way;
        TEST_ASSERT_TRUE(fabs(compensation_imbalance(&rig.state, counts) * 1e-6 - amplitude * mean) < 5e-5);
    }
}

/* Over a quarter of a turn to either side of the top the mean is 2/pi: to 5e-5, the sine's own 3e-5 at its peak and the
 * quotient's 2e-5. */
static void test_imbalance_over_half_a_turn(void) {
    rig_set(TERRAPIN_PARAMETER_COMP_IMBALANCE, 1000000);
    const uint32_t unit = (uint32_t)rig.state.gains.turn_per_count;
    const int32_t counts = (int32_t)(0x80000000U / unit);
    const double half = counts * (double)unit / 2.0; /* of 2^32 */
    rig.state.history[rig.state.estimator.newest].position_counts = (uint32_t)lrint((0x40000000 + half) / unit);
    const double angle = half / 4294967296.0 * WHEEL_TURN;
    TEST_ASSERT_INT32_WITHIN(32, (int32_t)lrint(1e6 * sin(angle) / angle), compensation_imbalance(&rig.state, counts));
}

/* One term beyond all measure is held where the sum of seven squares still fits. */
static void test_the_sd_of_a_torque_beyond_measure(void) {
    rig_set(TERRAPIN_PARAMETER_SD_COULOMB, 0);
    memset(&rig.state.gains, 0, sizeof rig.state.gains);
    rig.state.gains.gain_q30 = 0x26666666; /* 0.6 */
    for (int32_t sign = -1; sign <= 1; sign += 2) {
        rig.state.estimator.motor_unm = sign * INTEGER_MOST;
        TEST_ASSERT_EQUAL_INT32(500000000, uncertainty_unm(&rig.state));
    }
}

static void test_heating_scales_the_motor_torque(void) {
    rig_set(TERRAPIN_PARAMETER_COMP_HEATING, 2000); /* 0.2 %/K */
    rig.in.temperature_code = 2300U;                /* 65 degC */
    rig_run(400);
    TEST_ASSERT_INT32_WITHIN(100, 65000, sense_temperature_mc(&rig.state));
    TEST_ASSERT_INT32_WITHIN(100, (int32_t)lrint(0.92 * 1048576.0), compensation_heat_q20(&rig.state));
    rig.state.parameter[TERRAPIN_PARAMETER_COMP_HEATING] = 10000;
    gains_prepare(&rig.state);
    rig.state.sense.temperature_q8_mc = 200000 * 256;
    TEST_ASSERT_EQUAL_INT32(1048576 / 4, compensation_heat_q20(&rig.state));
    rig.state.parameter[TERRAPIN_PARAMETER_COMP_HEATING] = -10000;
    gains_prepare(&rig.state);
    rig.state.sense.temperature_q8_mc = 1000000 * 256;
    TEST_ASSERT_EQUAL_INT32(1048576 * 2, compensation_heat_q20(&rig.state));
}

/* A gear passes on a share of the torque when the motor drives, and takes more than it gives when the load does. */
static void test_a_gear_loses_a_share_of_what_it_passes_on(void) {
    const terrapin_gains *g = &rig.state.gains;
    TEST_ASSERT_EQUAL_INT32(123456789, estimator_geared(g, 123456789, 300)); /* the cylinder's loses nothing */
    TEST_ASSERT_EQUAL_INT32(-123456789, estimator_geared(g, -123456789, 300));
    for (int32_t driving = 100000; driving <= 1000000; driving += 90000) {
        for (int32_t driven = 100000; driven <= 1000000; driven += 225000) {
            rig_set(TERRAPIN_PARAMETER_GEAR_EFFICIENCY, driving);
            rig_set(TERRAPIN_PARAMETER_DRIVEN_EFFICIENCY, driven);
            for (int32_t torque = -30000000; torque <= 30000000; torque += 5999999) {
                const double ahead = torque * ((torque < 0) ? 1e6 / driven : driving * 1e-6);
                const double astern = torque * ((torque < 0) ? driving * 1e-6 : 1e6 / driven);
                TEST_ASSERT_TRUE(fabs(estimator_geared(g, torque, 300) - ahead) <= 1.0 + 2e-5 * fabs(ahead));
                TEST_ASSERT_TRUE(fabs(estimator_geared(g, torque, -300) - astern) <= 1.0 + 2e-5 * fabs(astern));
            }
        }
    }
    rig_set(TERRAPIN_PARAMETER_DRIVEN_EFFICIENCY, 100000);
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST, estimator_geared(g, INTEGER_MOST, -300));
}

/* What the current's own errors make of C_t comes through the gear as well. */
static void test_the_sd_comes_through_the_gear(void) {
    const uint64_t without = rig.state.gains.fixed_variance;
    const int32_t untrimmed = rig.state.gains.untrimmed_unm;
    rig_set(TERRAPIN_PARAMETER_GEAR_EFFICIENCY, 500000);
    TEST_ASSERT_INT32_WITHIN(1, untrimmed / 2, rig.state.gains.untrimmed_unm);
    TEST_ASSERT_TRUE(rig.state.gains.fixed_variance < without);
}

/* What a restart forgets, and that all parameters at once are one. */
static void test_a_restart_fills_its_windows_anew(void) {
    terrapin_estimator *e = &rig.state.estimator;
    for (uint32_t i = 0U; i < 2U; i++) {
        e->slots = 77U;
        e->since_fresh = 9U;
        e->quiet_slots = 9U;
        e->valid = true;
        e->fresh = true;
        e->open = true;
        if (i == 0U) {
            estimator_restart(&rig.state);
        } else {
            TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set_all(&rig.state, NULL));
        }
        TEST_ASSERT_EQUAL(0, e->slots);
        TEST_ASSERT_EQUAL(0, e->since_fresh);
        TEST_ASSERT_EQUAL(0, e->quiet_slots);
        TEST_ASSERT_FALSE(e->valid || e->fresh || e->open);
    }
}

/* Both parts of the momentum at the end of their range: the most that it is held at, and no small or negative one. */
static void test_the_momentum_is_held(void) {
    terrapin_estimator *e = &rig.state.estimator;
    rig_set(TERRAPIN_PARAMETER_INERTIA, 1000000);
    rig_set(TERRAPIN_PARAMETER_INERTIA_SHELL, 1000000);
    e->open = true;
    e->ready = true;
    e->slots = (uint16_t)HISTORY_SLOTS;
    e->swing_ticks = 2000U;
    e->acceleration_urad_s2 = INTEGER_LEAST;
    rig.state.history[e->newest].swing_sum_centirad_s = 0x80000001U; /* as far back as a sum goes */
    estimator_momentum(&rig.state);
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST, e->momentum_unm);
}

/* Fewer than 20 counts a window are no rolling. */
static void test_the_gate_is_shut_at_rest(void) {
    terrapin_estimator *e = &rig.state.estimator;
    for (int32_t counts = -20; counts <= 20; counts++) {
        e->open = true;
        e->ready = true;
        e->full = true;
        e->counts = counts;
        e->quiet_slots = 20U;
        estimator_gate(&rig.state);
        TEST_ASSERT_EQUAL(abs(counts) == 20, e->valid);
    }
}

/* The gate is open below its bound, and shut at it; the ripple's mean follows by a 64th. */
static void test_the_gate_is_shut_at_its_bound(void) {
    terrapin_estimator *e = &rig.state.estimator;
    const int32_t gate = rig_get(TERRAPIN_PARAMETER_GATE);
    for (int32_t momentum = gate - 1; momentum <= gate; momentum++) {
        e->open = true;
        e->ready = true;
        e->full = true;
        e->saturated = false;
        e->counts = 1000;
        e->quiet_slots = 20U;
        e->ripple_unm = 0;
        e->current_10ua = 0;
        e->recent_ua = 2000;
        e->momentum_unm = momentum;
        estimator_gate(&rig.state);
        TEST_ASSERT_EQUAL(momentum < gate, e->valid);
    }
    e->open = true;
    e->ripple_unm = 0;
    e->recent_ua = 1000000;
    estimator_gate(&rig.state);
    TEST_ASSERT_FALSE(e->valid);
    TEST_ASSERT_INT32_WITHIN(3, (int32_t)(1e6 * GEAR * TORQUE_CONST / 64.0), e->ripple_unm);
}

/* Gains against double precision: what is a table's or a window's factor is right to its last digits. */
static void test_gains_to_their_last_digits(void) {
    rig_set(TERRAPIN_PARAMETER_COMP_SLOPE, 100000);
    TEST_ASSERT_TRUE(fabs(rig.state.gains.slope_q24 - 10.0 * 16777216.0) <= 20.0);
    rig_set(TERRAPIN_PARAMETER_COMP_CURRENT_OFFSET, 100000);
    const double offset = 256.0 * 100000.0 / rig_get(TERRAPIN_PARAMETER_CURRENT_SCALE);
    TEST_ASSERT_EQUAL_INT32(rig_get(TERRAPIN_PARAMETER_CURRENT_ZERO_CODE) + (int32_t)lround(offset),
                            rig.state.gains.zero_q8);
    const double half = 4096.0 * rig.state.gains.count_e5_urad / 200000.0;
    TEST_ASSERT_TRUE(fabs(rig.state.gains.half_urad.factor - half) <= 1.0);
    const double way = 4096.0 * rig.state.gains.ground_e5_um / 100000.0;
    TEST_ASSERT_TRUE(fabs(rig.state.gains.way_um.factor - way) <= 1.0);
}

/* Friction that bearings and a Stribeck curve add is taken off in the slot in which a window is open. */
static void test_friction_beyond_the_line_is_taken(void) {
    rig_set(TERRAPIN_PARAMETER_COMP_STRIBECK, 20000);
    rig.state.estimator.open = true;
    rig.state.estimator.ready = true;
    rig.state.estimator.counts = 40;
    rig.state.estimator.beyond_unm = 0;
    const int32_t friction = compensation_friction(&rig.state, 40);
    TEST_ASSERT_NOT_EQUAL(0, friction);
    estimator_friction_beyond(&rig.state);
    TEST_ASSERT_EQUAL_INT32(friction, rig.state.estimator.beyond_unm);
}

static void test_friction_beyond_the_line_is_taken_in_every_window(void) {
    rig_set(TERRAPIN_PARAMETER_COMP_COULOMB, 2000);
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(2000);
    TEST_ASSERT_TRUE(rig.state.estimator.counts > 100);
    TEST_ASSERT_EQUAL_INT32(2000, rig.state.estimator.beyond_unm);
}

static void test_current_offset_comes_off(void) {
    rig_set(TERRAPIN_PARAMETER_COMP_CURRENT_OFFSET, 12345);
    rig_set(TERRAPIN_PARAMETER_TRIM_CURRENT, 0);
    rig.offset_codes = 12.345;
    rig_drive(5000, TERRAPIN_CONTROL_VOLTAGE);
    rig_run(5000);
    TEST_ASSERT_TRUE(fabs(rig.state.estimator.torque_unm - rig_contact_unm()) < 300.0);
}

/* The sensors' budget at 40 mN m of motor torque on the drive wheel. */
static void test_sd_is_the_budget(void) {
    rig_run(400);
    terrapin_estimator *e = &rig.state.estimator;
    e->motor_unm = 200000;
    e->omega_urad_s = 7000000;
    e->torque_unm = 181000;
    const double gain = 0.2 * sqrt(0.004 * 0.004 + 0.005 * 0.005);
    const double line = 1e-3 * GEAR * TORQUE_CONST;
    const double zero = 77.0 / 256.0 * 1e-3 * GEAR * TORQUE_CONST;
    const double noise = 3e-3 * GEAR * TORQUE_CONST / 17.0;
    const double before = sqrt(gain * gain + line * line + zero * zero + noise * noise + 0.2e-3 * 0.2e-3 +
                               1.2e-3 * 1.2e-3 + 1.4e-3 * 1.4e-3);
    TEST_ASSERT_TRUE(fabs(uncertainty_unm(&rig.state) * 1e-6 - before) < 5e-6);

    rig_set(TERRAPIN_PARAMETER_CALIBRATED, 1);
    const double floor = 0.0005 * RADIUS * WEIGHT;
    const double share = (0.181 - 0.010 * RADIUS * WEIGHT) * sqrt(0.004 * 0.004 + 0.005 * 0.005);
    const double after =
        sqrt(share * share + line * line + zero * zero + noise * noise + 0.2e-3 * 0.2e-3 + floor * floor);
    TEST_ASSERT_TRUE(fabs(uncertainty_unm(&rig.state) * 1e-6 - after) < 5e-6);

    rig.state.sense.trimmed = false;
    TEST_ASSERT_TRUE(uncertainty_unm(&rig.state) * 1e-6 > after + 1e-4);
    rig_set(TERRAPIN_PARAMETER_COMP_HEATING, 5000); /* 2 K of it are 1 % more */
    TEST_ASSERT_TRUE(uncertainty_unm(&rig.state) * 1e-6 > after + 4e-4);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_million_windows_against_double);
    RUN_TEST(test_saturates_at_full_scale_with_a_flag);
    RUN_TEST(test_gains_over_the_whole_range_of_parameters);
    RUN_TEST(test_steady_state_on_four_terrains);
    RUN_TEST(test_a_long_run_says_the_same_to_its_end);
    RUN_TEST(test_not_valid_while_the_speed_changes);
    RUN_TEST(test_not_valid_while_the_inner_device_swings);
    RUN_TEST(test_at_rest_nothing_is_valid);
    RUN_TEST(test_fresh_windows_share_no_sample);
    RUN_TEST(test_zero_of_the_current_is_trimmed_with_the_bridge_off);
    RUN_TEST(test_compensation_terms_against_double);
    RUN_TEST(test_imbalance_is_the_mean_over_the_window);
    RUN_TEST(test_imbalance_over_half_a_turn);
    RUN_TEST(test_the_sd_of_a_torque_beyond_measure);
    RUN_TEST(test_heating_scales_the_motor_torque);
    RUN_TEST(test_a_gear_loses_a_share_of_what_it_passes_on);
    RUN_TEST(test_the_sd_comes_through_the_gear);
    RUN_TEST(test_a_restart_fills_its_windows_anew);
    RUN_TEST(test_the_momentum_is_held);
    RUN_TEST(test_the_gate_is_shut_at_rest);
    RUN_TEST(test_the_gate_is_shut_at_its_bound);
    RUN_TEST(test_gains_to_their_last_digits);
    RUN_TEST(test_friction_beyond_the_line_is_taken);
    RUN_TEST(test_friction_beyond_the_line_is_taken_in_every_window);
    RUN_TEST(test_current_offset_comes_off);
    RUN_TEST(test_sd_is_the_budget);
    return UNITY_END();
}
