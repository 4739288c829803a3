#include "core.h"

/* Of one count of an encoder: its part of a turn, in 1e-5 urad (2e11 pi, to the nearest), and of 2^32. */
enum {
    COUNT_E5_URAD = (628318530718 + (TERRAPIN_ENCODER_COUNTS / 2)) / TERRAPIN_ENCODER_COUNTS,
    COUNT_TURN = 4294967296 / TERRAPIN_ENCODER_COUNTS,
    SPAN_MOST_MV = 200000, /* beyond every supply */
    /* 25 m/s^2 times JUMP_TICKS squared: twice what any ground and a swinging body make of a robot */
    JUMP_E5_UM = 25 * JUMP_TICKS * JUMP_TICKS * 100000
};

_Static_assert(COUNT_E5_URAD < 0x20000000, "encoders of 1,171 counts a turn and more");

static bool consistent(const int32_t *p) {
    return (p[TERRAPIN_PARAMETER_DRIVE_RADIUS] < p[TERRAPIN_PARAMETER_RADIUS]) &&
           (p[TERRAPIN_PARAMETER_SUPPLY_LOW] < p[TERRAPIN_PARAMETER_SUPPLY_HIGH]) &&
           (p[TERRAPIN_PARAMETER_CALIBRATE_LOW] < p[TERRAPIN_PARAMETER_CALIBRATE_HIGH]);
}

void gains_friction(terrapin_state *state) {
    terrapin_gains *g = &state->gains;
    const int64_t samples = (int64_t)g->window_slots * RECORD_MS;
    /* B [1e-8 N m s/rad] * one count [1e-5 urad], at most 3.1e15; then over the window, in Q16 of uN m */
    const int64_t count =
        integer_divide((int64_t)state->parameter[TERRAPIN_PARAMETER_VISCOUS] * g->count_e5_urad, 100000);
    g->speed_gain_q16 = integer_narrow(integer_divide(count * 65536, samples * 100000), 0, INT32_MAX);
}

static bool compensated(const int32_t *p) {
    return (p[TERRAPIN_PARAMETER_COMP_SPEED_SQUARED] != 0) || (p[TERRAPIN_PARAMETER_COMP_VISCOUS] != 0) ||
           (p[TERRAPIN_PARAMETER_COMP_COULOMB] != 0) || (p[TERRAPIN_PARAMETER_COMP_STRIBECK] != 0) ||
           (p[TERRAPIN_PARAMETER_COMP_INERTIA] != 0);
}

/* What every tick multiplies with, so that none divides. */
static void rates_prepare(terrapin_state *state) {
    const int32_t *p = state->parameter;
    const terrapin_gains *g = &state->gains;
    terrapin_rates *r = &state->rates;
    const int32_t radius = p[TERRAPIN_PARAMETER_RADIUS];
    const int32_t grip = 10000 - p[TERRAPIN_PARAMETER_SLIP_LIMIT];
    TERRAPIN_ASSERT((grip >= 1000) && (grip < 10000));
    /* of a count in 1e-5, over so many ms: 100 of them to the second's million */
    const int32_t fast = 100 * p[TERRAPIN_PARAMETER_SLIP_WINDOW];
    const int32_t window = 100 * (int32_t)g->window_slots * RECORD_MS;
    r->motor_speed = integer_gain_of(g->count_e5_urad, 100 * SPEED_TICKS);
    r->motor_fast = integer_gain_of(g->count_e5_urad, fast);
    r->ground_fast = integer_gain_of(g->ground_e5_um, fast);
    r->swing_fast = integer_gain_of(10000, p[TERRAPIN_PARAMETER_SLIP_WINDOW]);
    r->motor_window = integer_gain_of(g->count_e5_urad, window);
    r->ground_window = integer_gain_of(g->ground_e5_um, window);
    r->shell_per_rim = integer_gain_of(1000000000, radius);
    r->emf = integer_wide_of(g->torque_unm_per_a, 1000000);
    r->rim_q32 = integer_factor(radius, 32U, 1000000);
    r->shell_q24 = integer_factor(1000000, 24U, radius);
    r->per_grip_q26 = integer_factor(10000, 26U, grip);
    r->keep_q30 = integer_factor(grip, 30U, 10000);
    r->drop_q32 = integer_factor(p[TERRAPIN_PARAMETER_ARMATURE_RESISTANCE], 32U, 1000000);
    r->rise_q20 = integer_factor(p[TERRAPIN_PARAMETER_ARMATURE_RESISTANCE], 20U, 1000 * TRIM_RISE);
    r->speed_kp_q26 = integer_factor(p[TERRAPIN_PARAMETER_SPEED_KP], 26U, 1000);
    r->speed_ki_q32 = integer_factor(p[TERRAPIN_PARAMETER_SPEED_KI], 32U, 1000000);
    r->slip_kp_q26 = integer_factor(p[TERRAPIN_PARAMETER_SLIP_KP], 26U, 1000);
    r->slip_ki_q32 = integer_factor(p[TERRAPIN_PARAMETER_SLIP_KI], 32U, 1000000);
    r->dead_urad_s = 1000 * p[TERRAPIN_PARAMETER_SLIP_DEAD_BAND];
    r->margin_counts = integer_factor((int64_t)p[TERRAPIN_PARAMETER_EXTRICATE_MARGIN] * 100000000, 0U, g->ground_e5_um);
    r->jump_counts = (JUMP_E5_UM / (uint32_t)g->ground_e5_um) + 2U; /* that rounding to counts makes */
}

void gains_slope(terrapin_state *state) {
    /* 2^24 / 1e4 is 1717987 / 2^10 to 5e-8 */
    state->gains.slope_q24 = integer_q(state->parameter[TERRAPIN_PARAMETER_COMP_SLOPE], 1717987, 10U);
}

/* What a window's results are multiplied with. */
static void window_prepare(terrapin_state *state) {
    const int32_t *p = state->parameter;
    terrapin_gains *g = &state->gains;
    const int32_t slots = (int32_t)g->window_slots;
    const int32_t scale = p[TERRAPIN_PARAMETER_CURRENT_SCALE];
    g->half_urad = integer_gain_of(g->count_e5_urad, 200000);
    g->way_um = integer_gain_of(g->ground_e5_um, 100000);
    g->current_q32 = integer_factor(scale, 32U, slots * RECORD_MS * 2560);
    g->recent_q28 = integer_factor(scale, 28U, RECORD_MS * 256);
    g->voltage_q32 = integer_factor(1, 32U, slots * RECORD_MS);
    /* 1e-5 urad summed over BLOCK_SLOTS records of m ms, over (m n ms)^2: 1e-5 * 1e6 / (m^3 BLOCK_SLOTS n^2) */
    g->acceleration_q19 =
        integer_factor(g->count_e5_urad, 19U, RECORD_MS * RECORD_MS * (RECORD_MS / 10) * BLOCK_SLOTS * slots * slots);
    g->swing_q20 = integer_factor(40960, 20U, RECORD_MS * RECORD_MS * SWING_SLOTS * slots);
    g->weight_q22 = integer_factor(g->weight_unm, 22U, 1000000);
    g->per_weight_q24 = integer_factor(1000000, 24U, g->weight_unm);
    g->inertia_q30 = integer_factor(p[TERRAPIN_PARAMETER_INERTIA], 30U, 1000000);
    g->wheel_q22 = integer_factor(p[TERRAPIN_PARAMETER_RADIUS], 22U, p[TERRAPIN_PARAMETER_DRIVE_RADIUS]);
    gains_slope(state);
    /* a_t [1e-6/K] * 1e-3 K, in Q20 */
    g->heat_q24 = integer_signed_factor(p[TERRAPIN_PARAMETER_COMP_HEATING], 44U, 1000000000);
    g->driving_q20 = integer_factor(p[TERRAPIN_PARAMETER_GEAR_EFFICIENCY], 20U, 1000000);
    g->driven_q20 = integer_factor(1000000, 20U, p[TERRAPIN_PARAMETER_DRIVEN_EFFICIENCY]);
    g->stribeck_q16 = integer_factor(65536, 16U, p[TERRAPIN_PARAMETER_COMP_STRIBECK_SPEED]);
    g->speed_squared_q24 = integer_signed_factor(p[TERRAPIN_PARAMETER_COMP_SPEED_SQUARED], 34U, 1000000000);
    g->comp_viscous_q32 = integer_signed_factor(p[TERRAPIN_PARAMETER_COMP_VISCOUS], 32U, 100000000);
    g->comp_inertia_q30 = integer_signed_factor(p[TERRAPIN_PARAMETER_COMP_INERTIA], 30U, 10000000);
}

/* Ranges are those of controller.toml; every product below stays under 2^62. */
void gains_prepare(terrapin_state *state) {
    const int32_t *p = state->parameter;
    terrapin_gains *g = &state->gains;
    const int32_t radius = p[TERRAPIN_PARAMETER_RADIUS]; /* 1e4..5e5 um */
    /* A drive wheel larger than the shell is refused by gains_consistent; here it must only not overflow. */
    const int32_t drive = integer_clamp(p[TERRAPIN_PARAMETER_DRIVE_RADIUS], 1, radius);
    const int32_t torque_constant = p[TERRAPIN_PARAMETER_TORQUE_CONSTANT]; /* 1e3..2e6 uN m/A */
    const int64_t slots = p[TERRAPIN_PARAMETER_WINDOW] / RECORD_MS;
    const int64_t samples = slots * RECORD_MS; /* 100..600 times the records' interval */

    g->count_e5_urad = integer_scale(COUNT_E5_URAD, drive, radius);
    g->ground_e5_um = integer_scale(COUNT_E5_URAD, p[TERRAPIN_PARAMETER_GROUND_WHEEL_RADIUS], 1000000);
    g->turn_per_count = integer_scale(COUNT_TURN, drive, radius);
    g->torque_unm_per_a = integer_scale(radius, torque_constant, drive);
    g->weight_unm = integer_scale(radius, p[TERRAPIN_PARAMETER_WEIGHT], 1000);
    g->window_slots = (uint32_t)slots;
    TERRAPIN_ASSERT((g->count_e5_urad > 0) && (g->count_e5_urad < 0x20000000));
    TERRAPIN_ASSERT((g->ground_e5_um > 0) && (g->ground_e5_um < 0x4000000));
    TERRAPIN_ASSERT((g->turn_per_count >= 0) && (g->turn_per_count <= 0x200000));
    TERRAPIN_ASSERT((g->torque_unm_per_a > 0) && (g->torque_unm_per_a <= 500000000));
    TERRAPIN_ASSERT((g->weight_unm >= 10000) && (g->weight_unm <= 250000000));
    TERRAPIN_ASSERT((g->window_slots >= 10U) && (g->window_slots <= (uint32_t)WINDOW_MAX_SLOTS));

    rates_prepare(state);
    window_prepare(state);

    /* torque of one code in 1e-12 N m, at most 5e5 * 2e6 * 5e3 / 2e3 = 2.5e12; then a window's mean, in Q16 of 1e-6 */
    const int64_t code = integer_divide((int64_t)radius * torque_constant * p[TERRAPIN_PARAMETER_CURRENT_SCALE], drive);
    g->current_gain_q16 = integer_narrow(integer_divide(code * 65536, samples * 1000000), 0, INT32_MAX);
    gains_friction(state);

    g->span_mv = integer_clamp(
        integer_scale(p[TERRAPIN_PARAMETER_ARMATURE_RESISTANCE], p[TERRAPIN_PARAMETER_CURRENT_LIMIT], 1000), 0,
        SPAN_MOST_MV);
    g->consistent = consistent(p);
    g->zero_q8 = p[TERRAPIN_PARAMETER_CURRENT_ZERO_CODE] +
                 integer_scale(p[TERRAPIN_PARAMETER_COMP_CURRENT_OFFSET], 256, p[TERRAPIN_PARAMETER_CURRENT_SCALE]);
    g->compensated = compensated(p);
    uncertainty_prepare(state);
}
