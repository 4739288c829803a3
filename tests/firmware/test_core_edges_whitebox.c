/* Edges of the core's own formulas, where neither a scenario nor a rig comes by: the last value on either side of a
 * bound, the long and the short way of one division, a line that fits exactly. */
#include <stdlib.h>
#include <string.h>

#include "unity.h"

#include "integer.c"
#include "slip.c"
#include "drive.c"
#include "calibration.c"
#include "sense.c"

static terrapin_state state;

void setUp(void) {
    memset(&state, 0, sizeof state);
    srand(5);
}

void tearDown(void) {}

/* ---- what these files ask of others */

terrapin_parameter_entry terrapin_parameter(uint16_t index) {
    (void)index;
    const terrapin_parameter_entry entry = {.minimum = 0, .maximum = 1000000};
    return entry;
}

int32_t ground_floor_unm(const terrapin_state *s, int32_t omega_urad_s) {
    (void)s;
    (void)omega_urad_s;
    return 0;
}

void gains_friction(terrapin_state *s) {
    (void)s;
}

/* ---- slip */

/* 1 - ground / rim in 1e-4, rounded away from 1, in one division of 64 bits. */
static int32_t exact_slip(int64_t ground, int64_t rim) {
    const int64_t way = llabs(ground);
    const int64_t size = ((way * 10000) + (llabs(rim) / 2)) / llabs(rim);
    const int64_t slip = 10000 - (((ground < 0) == (rim < 0)) || (way == 0) ? size : -size);
    return (int32_t)((slip > 40000) ? 40000 : ((slip < -40000) ? -40000 : slip));
}

static void test_slip_is_one_division_however_it_is_done(void) {
    static const int32_t edges[] = {500,     501,      9999,     428998,   428999,   429000,   429001,    500000,
                                    9999999, 20000000, 41999998, 41999999, 42000000, 42000001, 200000000, INTEGER_MOST};
    const uint32_t count = sizeof edges / sizeof edges[0];
    for (uint32_t i = 0U; i < count; i++) {
        for (uint32_t k = 0U; k < count; k++) {
            for (uint32_t signs = 0U; signs < 4U; signs++) {
                const int32_t ground = ((signs & 1U) != 0U) ? -edges[i] : edges[i];
                const int32_t rim = ((signs & 2U) != 0U) ? -edges[k] : edges[k];
                TEST_ASSERT_INT32_WITHIN((edges[k] < 42000000) ? 0 : 1, exact_slip(ground, rim), slip_of(ground, rim));
            }
        }
        TEST_ASSERT_EQUAL_INT32(10000, slip_of(0, edges[i]));
    }
    TEST_ASSERT_EQUAL_INT32(0, slip_of(1, 1)); /* at rest; else the rim has 500 um/s and more */
    for (uint32_t i = 0U; i < 100000U; i++) {
        const int32_t rim = 500 + (int32_t)((uint32_t)rand() % 41999500U);
        const int32_t ground = (int32_t)((uint32_t)rand() % 80000000U) - 40000000;
        TEST_ASSERT_EQUAL_INT32(exact_slip(ground, rim), slip_of(ground, rim));
    }
}

/* Slip of a rim that is at 10 mm/s, measured over 10 ms, the ground's wheel so many counts of 1 um/s ahead. */
static int32_t peak_of(int32_t counts) {
    setUp();
    state.parameter[TERRAPIN_PARAMETER_SLIP_WINDOW] = 10;
    state.estimator.swing_ticks = 100U;
    state.slip.ticks = FAST_TICKS;
    state.rates.jump_counts = UINT32_MAX;
    state.rates.motor_fast = (integer_gain){.factor = 4096, .most = INTEGER_MOST / 4};
    state.rates.ground_fast = state.rates.motor_fast;
    state.rates.rim_q32 = INT32_MAX; /* a half */
    state.rates.dead_urad_s = 1;
    state.sense.motor_count = 20000U;
    state.sense.ground_count = (uint16_t)counts;
    const terrapin_inputs inputs = {0};
    slip_update(&state, &inputs);
    TEST_ASSERT_TRUE(state.slip.valid);
    TEST_ASSERT_EQUAL_INT32(10000 - counts, state.slip.slip_e4);
    return state.slip.peak_e4;
}

/* It spins on the spot at 1; above, it rolls back, which is no peak of slip. */
static void test_the_peak_of_slip_is_one(void) {
    TEST_ASSERT_EQUAL_INT32(9999, peak_of(1));
    TEST_ASSERT_EQUAL_INT32(10000, peak_of(0));
    TEST_ASSERT_EQUAL_INT32(0, peak_of(-1));
}

/* Ticks that two measured ground speeds disagree, after one. */
static uint16_t disagreed(int16_t outside_mm_s, int32_t wheel_um_s) {
    setUp();
    state.slip.ground_um_s = wheel_um_s;
    const terrapin_inputs inputs = {.ground_speed_valid = true, .ground_speed_mm_s = outside_mm_s};
    compare_grounds(&state, &inputs);
    return state.slip.disagree_ticks;
}

/* A tenth of the larger one, whichever that is and whichever way both go. */
static void test_two_ground_speeds_may_differ_by_a_tenth_of_the_larger(void) {
    TEST_ASSERT_EQUAL(0, disagreed(110, 99500));
    TEST_ASSERT_EQUAL(0, disagreed(-110, -99500));
    TEST_ASSERT_EQUAL(0, disagreed(99, 110000));
    TEST_ASSERT_EQUAL(0, disagreed(-99, -110000));
    TEST_ASSERT_EQUAL(1, disagreed(112, 99500));
    TEST_ASSERT_EQUAL(1, disagreed(98, 110000));
    TEST_ASSERT_EQUAL(1, disagreed(-98, -110000));
}

/* Counts of the ground wheel at the ends of the two windows, and the ticks that were seen: is it doubted? */
static bool doubted(int32_t change, uint16_t ticks) {
    setUp();
    state.slip.newest = 3U; /* the windows reach over the end of the ring */
    state.slip.ticks = ticks;
    state.rates.jump_counts = 19U;
    state.fast.ground_counts[3] = (uint16_t)(7 + change);
    state.fast.ground_counts[FAST_TICKS - 5] = 5U; /* 8 ticks before */
    state.fast.ground_counts[FAST_TICKS - 13] = 3U;
    doubt(&state);
    return state.slip.doubt_ticks > 0U;
}

static void test_what_jumps(void) {
    for (int32_t sign = -1; sign <= 1; sign += 2) {
        TEST_ASSERT_FALSE(doubted(sign * 19, 17U));
        TEST_ASSERT_TRUE(doubted(sign * 20, 17U));
        TEST_ASSERT_FALSE_MESSAGE(doubted(sign * 20, 16U), "the windows are not filled");
    }
    TEST_ASSERT_TRUE(doubted(32768, 17U));
    TEST_ASSERT_TRUE(doubted(32767, 17U));
}

/* What takes a doubt back: slip is defined, and below half of the limit, for 500 ticks in a row. */
static void test_what_takes_a_doubt_back(void) {
    setUp();
    state.parameter[TERRAPIN_PARAMETER_SLIP_LIMIT] = 5000;
    for (int i = 0; i < 3; i++) {
        state.slip.doubt_ticks = 7U;
        state.slip.moving = i != 0;
        state.slip.slip_e4 = i == 1 ? -2500 : 2499;
        doubt(&state);
        TEST_ASSERT_EQUAL_UINT(i == 2 ? 6U : 500U, state.slip.doubt_ticks);
    }
    state.slip.implausible = true;
    doubt(&state);
    TEST_ASSERT_EQUAL_UINT(500U, state.slip.doubt_ticks);
    state.slip.implausible = false;
    for (int ticks = 1; ticks <= 501; ticks++) {
        doubt(&state);
        TEST_ASSERT_EQUAL_UINT(ticks < 500 ? 500 - ticks : 0, state.slip.doubt_ticks);
    }
}

/* ---- drive */

/* The limiter takes all that it may: down to the bound that the current's limit leaves, in both directions. */
static void test_the_limiter_s_bounds_are_mirrored_backwards(void) {
    static const struct {
        int32_t low, high, wanted, left;
    } cases[] = {{200, 900, 1000, 200}, {-900, -200, -1000, -200}, {-300, 900, 1000, 0},
                 {-900, 300, -1000, 0}, {600, 700, 500, 500},      {-700, -600, -500, -500}};
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        setUp();
        state.drive.limiting = true;
        state.drive.limiter_direction = (cases[i].wanted > 0) ? 1 : -1;
        state.drive.limiter_integral_uv = -INTEGRAL_MAX_UV;
        const bounds within = {.low_mv = cases[i].low, .high_mv = cases[i].high};
        TEST_ASSERT_EQUAL_INT32(cases[i].left, limited(&state, cases[i].wanted, within));
    }
}

static void test_below_one_volt_there_is_no_duty(void) {
    for (int32_t mv = 998; mv <= 1002; mv++) {
        state.sense.supply_q8_mv = 256 * mv;
        modulate(&state, 500);
        TEST_ASSERT_EQUAL(mv >= 1000, state.drive.duty_q15 != 0);
    }
}

static void test_one_milliampere_too_much_is_taken_off(void) {
    state.gains.span_mv = 100000;
    state.parameter[TERRAPIN_PARAMETER_CURRENT_LIMIT] = 1000;
    state.parameter[TERRAPIN_PARAMETER_VOLTAGE_LIMIT] = 12000;
    state.sense.current_ua = 1000999; /* 1000 mA */
    (void)allowed(&state);
    TEST_ASSERT_EQUAL_INT32(0, state.drive.trim_mv);
    state.sense.current_ua = -1001000;
    (void)allowed(&state);
    TEST_ASSERT_EQUAL_INT32(1, state.drive.trim_mv);
}

/* ---- calibration */

static void test_a_calibration_begins_with_nothing_of_the_last(void) {
    terrapin_calibration_state *c = &state.calibration;
    memset(c, 0x11, sizeof *c);
    state.estimator.index = 42U;
    calibration_start(&state);
    TEST_ASSERT_EQUAL(0, c->step);
    TEST_ASSERT_EQUAL(0, c->timer_ms);
    TEST_ASSERT_EQUAL(0, c->windows);
    TEST_ASSERT_EQUAL_INT64(0, c->omega_sum_urad_s);
    TEST_ASSERT_EQUAL_INT64(0, c->torque_sum_unm);
    TEST_ASSERT_EQUAL_UINT32(42U, c->seen); /* a window from before is no window of its first speed */
    TEST_ASSERT_EQUAL(FIT_NONE, c->fit);
}

/* 3000 uN m + 200e-8 N m s/rad: points on the line, at speeds of which the fit is exact. */
static void exact_line(uint32_t points) {
    terrapin_calibration_state *c = &state.calibration;
    c->step = (uint8_t)points;
    for (uint32_t i = 0U; i < points; i++) {
        c->omega_mrad_s[i] = 10000 * (int32_t)(i + 1U);
        c->torque_unm[i] = 3000 + (20 * (int32_t)(i + 1U)); /* 2e-6 N m s/rad */
    }
}

static void test_the_sums_of_a_line(void) {
    terrapin_calibration_state *c = &state.calibration;
    for (uint32_t points = 2U; points <= (uint32_t)TERRAPIN_LIMIT_CALIBRATE_SPEEDS; points++) {
        exact_line(points);
        TEST_ASSERT_TRUE(fit_sums(c));
        int64_t spread = 0;
        int64_t common = 0;
        for (uint32_t i = 0U; i < points; i++) { /* the same by pairs: sum of (a - b)^2 */
            for (uint32_t k = i + 1U; k < points; k++) {
                const int64_t dw = c->omega_mrad_s[i] - c->omega_mrad_s[k];
                spread += dw * dw;
                common += dw * (c->torque_unm[i] - c->torque_unm[k]);
            }
        }
        TEST_ASSERT_EQUAL_INT64(spread, c->spread);
        TEST_ASSERT_EQUAL_INT64(common, c->common);
        TEST_ASSERT_TRUE(fit_viscous(c));
        TEST_ASSERT_EQUAL_INT32(200, c->viscous_e8);
        TEST_ASSERT_TRUE(fit_coulomb(c));
        TEST_ASSERT_EQUAL_INT32(3000, c->coulomb_unm);
        TEST_ASSERT_EQUAL_INT32(0, worst(c));
    }
}

/* The largest residual may be the tolerance, and no more. */
static void test_the_tolerance_of_a_fit(void) {
    for (int32_t off = 5; off < 8; off++) {
        setUp();
        terrapin_calibration_state *c = &state.calibration;
        exact_line(4U);
        c->viscous_e8 = 200;
        c->coulomb_unm = 3000;
        c->torque_unm[2] -= off;
        c->fit = FIT_RESIDUAL;
        state.supervisor.state = TERRAPIN_STATE_CALIBRATE;
        state.parameter[TERRAPIN_PARAMETER_CALIBRATE_TOLERANCE] = 6;
        calibration_work(&state);
        TEST_ASSERT_EQUAL_INT32(off, c->residual_unm);
        TEST_ASSERT_EQUAL(off > 6, c->fit == FIT_FAILED);
    }
}

/* A window of a speed or a torque that no motor has counts as the most of each, so that three of them fit their sums.
 */
static void test_a_window_of_a_calibration_is_held(void) {
    terrapin_calibration_state *c = &state.calibration;
    static const struct {
        int32_t setpoint, omega_urad_s, torque_unm, omega, torque;
    } cases[] = {
        {1000, 5000000, 3000, 5000000, 3000},
        {-1000, -5000000, -3000, 5000000, 3000}, /* backwards */
        {1000, 5000000, -3000, 5000000, -3000},
        {1000, -5000000, 3000, 0, 3000}, /* it still turns the other way */
        {1000, OMEGA_MAX_URAD_S + 1, TORQUE_MAX_UNM + 1, OMEGA_MAX_URAD_S, TORQUE_MAX_UNM},
        {1000, OMEGA_MAX_URAD_S, TORQUE_MAX_UNM, OMEGA_MAX_URAD_S, TORQUE_MAX_UNM},
        {1000, 0, -TORQUE_MAX_UNM - 1, 0, -TORQUE_MAX_UNM},
    };
    for (size_t i = 0U; i < (sizeof cases / sizeof cases[0]); i++) {
        setUp();
        state.supervisor.setpoint = cases[i].setpoint;
        state.estimator.omega_urad_s = cases[i].omega_urad_s;
        state.estimator.motor_unm = cases[i].torque_unm;
        state.estimator.index = 5U;
        c->seen = 4U;
        c->timer_ms = 500U;
        TEST_ASSERT_FALSE(take_window(&state)); /* while it settles none counts */
        TEST_ASSERT_EQUAL(0, c->windows);
        c->timer_ms = 501U;
        TEST_ASSERT_FALSE_MESSAGE(take_window(&state), "the same window again");
        TEST_ASSERT_EQUAL(0, c->windows);
        c->seen = 4U;
        (void)take_window(&state);
        TEST_ASSERT_EQUAL(1, c->windows);
        TEST_ASSERT_EQUAL_INT32(cases[i].omega, c->omega_sum_urad_s);
        TEST_ASSERT_EQUAL_INT32(cases[i].torque, c->torque_sum_unm);
    }
}

/* Nor is a speed's torque without the floor's, however heavy the robot: eight of them fit the sum. */
static void test_a_speed_of_a_calibration_is_held(void) {
    terrapin_calibration_state *c = &state.calibration;
    state.parameter[TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_O] = 1000000;
    state.gains.weight_q22 = INT32_MAX; /* 512 N m */
    for (c->step = 0U; (int32_t)c->step < TERRAPIN_LIMIT_CALIBRATE_SPEEDS;) {
        c->windows = (uint8_t)CALIBRATE_WINDOWS;
        c->torque_sum_unm = -CALIBRATE_WINDOWS * TORQUE_MAX_UNM;
        c->timer_ms = 77U;
        close_step(&state);
        TEST_ASSERT_EQUAL_UINT32(0U, c->timer_ms);
        TEST_ASSERT_EQUAL_INT32(-TORQUE_MAX_UNM, c->torque_unm[c->step - 1U]);
    }
    TEST_ASSERT_FALSE(fit_sums(c)); /* no two speeds */
    TEST_ASSERT_EQUAL_INT32(-TERRAPIN_LIMIT_CALIBRATE_SPEEDS * TORQUE_MAX_UNM, c->sum_unm);
}

/* What is found may be either end of the parameter's range, and is kept as it is; beyond it fails. */
static void test_the_ends_of_a_fit(void) {
    terrapin_calibration_state *c = &state.calibration;
    static const struct {
        int32_t viscous_e8, coulomb_unm;
        bool good;
    } cases[] = {{-1, -1, false}, {0, 0, true}, {1000000, 1000000, true}, {1000001, 1000001, false}};
    for (size_t i = 0U; i < (sizeof cases / sizeof cases[0]); i++) {
        setUp();
        c->step = 2U;
        c->spread = 100000;
        c->common = cases[i].viscous_e8;
        TEST_ASSERT_EQUAL(cases[i].good, fit_viscous(c));
        TEST_ASSERT_EQUAL_INT32(cases[i].good ? cases[i].viscous_e8 : 0, c->viscous_e8);
        c->viscous_e8 = 0;
        c->sum_unm = 2 * cases[i].coulomb_unm;
        TEST_ASSERT_EQUAL(cases[i].good, fit_coulomb(c));
        TEST_ASSERT_EQUAL_INT32(cases[i].good ? cases[i].coulomb_unm : 0, c->coulomb_unm);
    }
}

/* Two speeds 1 rad/s apart are enough, and a little less is not. */
static void test_speeds_that_are_just_apart(void) {
    terrapin_calibration_state *c = &state.calibration;
    c->step = 2U;
    c->omega_mrad_s[1] = 1000;
    TEST_ASSERT_TRUE(fit_sums(c));
    TEST_ASSERT_EQUAL_INT64(1000000, c->spread);
    c->omega_mrad_s[1] = 999;
    TEST_ASSERT_FALSE(fit_sums(c));
}

/* The first speed counts as the others; the steepest line at the highest speed is exact. */
static void test_the_residual_of_each_speed(void) {
    terrapin_calibration_state *c = &state.calibration;
    c->step = 2U;
    c->viscous_e8 = 10000000;
    c->omega_mrad_s[1] = 100000;
    c->torque_unm[1] = 10000000;
    TEST_ASSERT_EQUAL_INT32(0, worst(c));
    c->torque_unm[0] = 9;
    TEST_ASSERT_EQUAL_INT32(9, worst(c));
}

/* A fit that fails before its residuals are known says none: not that of a calibration before. */
static void test_a_fit_that_fails_early_tells_no_residual(void) {
    terrapin_calibration_state *c = &state.calibration;
    exact_line(2U);
    c->omega_mrad_s[1] = c->omega_mrad_s[0]; /* no line through one speed */
    c->residual_unm = 777;
    c->fit = FIT_SUMS;
    state.supervisor.state = TERRAPIN_STATE_CALIBRATE;
    calibration_work(&state);
    TEST_ASSERT_EQUAL(FIT_FAILED, c->fit);
    TEST_ASSERT_EQUAL_INT32(0, c->residual_unm);
}

/* ---- sense */

/* 16 codes either way are an offset, and a 256th more is a defect. */
static void test_how_far_a_zero_may_be_off(void) {
    for (int32_t sign = -1; sign <= 1; sign += 2) {
        for (int32_t more = 0; more < 2; more++) {
            setUp();
            const int32_t mean_q8 = 2048 * 256;
            state.sense.off_ticks = 1000U;
            state.sense.current_code = 2048;
            state.sense.trim_count = (uint16_t)(TRIM_TICKS - 1);
            state.sense.trim_sum_codes = 2048U * (uint32_t)(TRIM_TICKS - 1);
            state.parameter[TERRAPIN_PARAMETER_CURRENT_ZERO_CODE] = mean_q8 - (sign * ((16 * 256) + more));
            state.parameter[TERRAPIN_PARAMETER_TRIM_CURRENT] = 1;
            TEST_ASSERT_EQUAL(more == 0, trim(&state));
            TEST_ASSERT_EQUAL_INT32((more == 0) ? (sign * 16 * 256) : 0, state.sense.trim_q8_codes);
        }
    }
}

/* A code that no converter of twelve bits makes: the temperature is held where its filter still fits. */
static void test_a_temperature_beyond_all_is_held(void) {
    const terrapin_inputs inputs = {.temperature_code = UINT16_MAX};
    state.parameter[TERRAPIN_PARAMETER_TEMPERATURE_SCALE] = 500;
    for (uint32_t i = 0U; i < 50U; i++) {
        read_slow(&state, &inputs);
        TEST_ASSERT_EQUAL_INT32(4194303, sense_temperature_mc(&state));
    }
    state.parameter[TERRAPIN_PARAMETER_TEMPERATURE_ZERO] = -100000; /* of no sample: not known yet */
    const terrapin_inputs none = {.temperature_code = 0U};
    read_slow(&state, &none);
    TEST_ASSERT_EQUAL_INT32(TERRAPIN_REFERENCE_TEMPERATURE * 1000, sense_temperature_mc(&state));
}

/* Without a speed nothing bears the encoder out: while the bridge is on, that counts as disagreement. */
static void test_the_encoder_is_judged_with_a_speed(void) {
    for (uint32_t more = 0U; more < 2U; more++) {
        for (uint32_t on = 0U; on < 2U; on++) {
            setUp();
            state.drive.enable = on != 0U;
            state.slip.ticks = (uint16_t)(SPEED_TICKS + more); /* at rest, at 0 V: they agree */
            (void)encoder_lies(&state);
            TEST_ASSERT_EQUAL_UINT(((on != 0U) && (more == 0U)) ? 4U : 0U, state.sense.encoder_quarters);
        }
    }
}

/* ---- the encoder against the motor's equation */

static void test_the_encoder_may_be_off_by_its_tolerance(void) {
    for (int32_t off = 999; off <= 1002; off++) {
        for (int32_t sign = -1; sign <= 1; sign += 2) {
            setUp();
            state.drive.enable = true;
            state.slip.ticks = SPEED_TICKS + 1U;
            state.slip.emf_uv = 5000999; /* 5000 mV */
            state.drive.applied_mv = 5000 + (sign * off);
            state.parameter[TERRAPIN_PARAMETER_ENCODER_TOLERANCE] = 1000;
            (void)encoder_lies(&state);
            TEST_ASSERT_EQUAL(off > 1000, state.sense.encoder_quarters > 0U);
        }
    }
}

/* 200 ticks in a row are too many, and so is a loose contact that is off for half of the time. */
static void test_an_encoder_that_is_off_now_and_then(void) {
    for (uint32_t period = 1U; period <= 6U; period++) {
        uint32_t ticks = 0U;
        bool lies = false;
        setUp();
        state.drive.enable = true;
        state.slip.ticks = SPEED_TICKS + 1U;
        state.parameter[TERRAPIN_PARAMETER_ENCODER_TOLERANCE] = 1000;
        while (!lies && (ticks < 5000U)) {
            state.drive.applied_mv = ((ticks % period) == 0U) ? 1001 : 1000;
            lies = encoder_lies(&state);
            ticks++;
        }
        /* of `period` ticks one counts four quarters, and the others take one back each: 796 before the last of 800 */
        const uint32_t gain = 5U - ((period < 5U) ? period : 5U);
        TEST_ASSERT_EQUAL_UINT32((gain > 0U) ? (period * ((796U + gain - 1U) / gain)) + 1U : 5000U, ticks);
        state.drive.applied_mv = 1000;
        TEST_ASSERT_FALSE(encoder_lies(&state));
    }
    state.sense.encoder_quarters = 0U;
    state.drive.applied_mv = 0;
    TEST_ASSERT_FALSE(encoder_lies(&state));
    TEST_ASSERT_EQUAL_UINT(0U, state.sense.encoder_quarters);
}

/* ---- gains: how far a count may go is told to the nearest, less one */

static void test_the_most_that_a_gain_takes(void) {
    for (int32_t i = 0; i < 2000; i++) {
        const int32_t value = 29000 + (57 * i);
        const integer_gain gain = integer_gain_of(value, 4096 * 7);
        const int64_t above = (int64_t)gain.factor + 1;
        TEST_ASSERT_TRUE(gain.most < INTEGER_MOST);
        const int64_t off = (((int64_t)gain.most + 1) * above) - ((int64_t)INTEGER_MOST * 4096);
        TEST_ASSERT_TRUE((2 * off <= above) && (-2 * off <= above));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_slip_is_one_division_however_it_is_done);
    RUN_TEST(test_what_jumps);
    RUN_TEST(test_what_takes_a_doubt_back);
    RUN_TEST(test_the_peak_of_slip_is_one);
    RUN_TEST(test_two_ground_speeds_may_differ_by_a_tenth_of_the_larger);
    RUN_TEST(test_the_limiter_s_bounds_are_mirrored_backwards);
    RUN_TEST(test_below_one_volt_there_is_no_duty);
    RUN_TEST(test_one_milliampere_too_much_is_taken_off);
    RUN_TEST(test_a_calibration_begins_with_nothing_of_the_last);
    RUN_TEST(test_a_window_of_a_calibration_is_held);
    RUN_TEST(test_a_speed_of_a_calibration_is_held);
    RUN_TEST(test_the_ends_of_a_fit);
    RUN_TEST(test_speeds_that_are_just_apart);
    RUN_TEST(test_the_residual_of_each_speed);
    RUN_TEST(test_the_sums_of_a_line);
    RUN_TEST(test_the_tolerance_of_a_fit);
    RUN_TEST(test_a_fit_that_fails_early_tells_no_residual);
    RUN_TEST(test_how_far_a_zero_may_be_off);
    RUN_TEST(test_a_temperature_beyond_all_is_held);
    RUN_TEST(test_the_encoder_is_judged_with_a_speed);
    RUN_TEST(test_an_encoder_that_is_off_now_and_then);
    RUN_TEST(test_the_encoder_may_be_off_by_its_tolerance);
    RUN_TEST(test_the_most_that_a_gain_takes);
    return UNITY_END();
}
