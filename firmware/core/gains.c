#include "core.h"

/* Of one count of an encoder: its part of a turn, in 1e-5 urad (2e11 pi, to the nearest), and of 2^32. */
enum {
    COUNT_E5_URAD = (628318530718 + (TERRAPIN_ENCODER_COUNTS / 2)) / TERRAPIN_ENCODER_COUNTS,
    COUNT_TURN = 4294967296 / TERRAPIN_ENCODER_COUNTS
};

_Static_assert(COUNT_E5_URAD < 0x20000000, "encoders of 1,171 counts a turn and more");

static bool consistent(const int32_t *p) {
    return (p[TERRAPIN_PARAMETER_DRIVE_RADIUS] < p[TERRAPIN_PARAMETER_RADIUS]) &&
           (p[TERRAPIN_PARAMETER_SUPPLY_LOW] < p[TERRAPIN_PARAMETER_SUPPLY_HIGH]) &&
           (p[TERRAPIN_PARAMETER_CALIBRATE_LOW] < p[TERRAPIN_PARAMETER_CALIBRATE_HIGH]);
}

void gains_friction(terrapin_state *state) {
    terrapin_gains *g = &state->gains;
    const int64_t samples = (int64_t)g->window_slots * SLOT_MS;
    /* B [1e-8 N m s/rad] * one count [1e-5 urad], at most 3.1e15; then over the window, in Q16 of uN m */
    const int64_t count =
        integer_divide((int64_t)state->parameter[TERRAPIN_PARAMETER_VISCOUS] * g->count_e5_urad, 100000);
    g->speed_gain_q16 = (int32_t)integer_divide(count * 65536, samples * 100000);
}

static bool compensated(const int32_t *p) {
    return (p[TERRAPIN_PARAMETER_COMP_SPEED_SQUARED] != 0) || (p[TERRAPIN_PARAMETER_COMP_VISCOUS] != 0) ||
           (p[TERRAPIN_PARAMETER_COMP_COULOMB] != 0) || (p[TERRAPIN_PARAMETER_COMP_STRIBECK] != 0) ||
           (p[TERRAPIN_PARAMETER_COMP_INERTIA] != 0);
}

/* Ranges are those of controller.toml; every product below stays under 2^62. */
void gains_prepare(terrapin_state *state) {
    const int32_t *p = state->parameter;
    terrapin_gains *g = &state->gains;
    const int32_t radius = p[TERRAPIN_PARAMETER_RADIUS]; /* 1e4..5e5 um */
    /* A drive wheel larger than the shell is refused by gains_consistent; here it must only not overflow. */
    const int32_t drive = integer_clamp(p[TERRAPIN_PARAMETER_DRIVE_RADIUS], 1, radius);
    const int32_t torque_constant = p[TERRAPIN_PARAMETER_TORQUE_CONSTANT]; /* 1e3..2e6 uN m/A */
    const int64_t slots = p[TERRAPIN_PARAMETER_WINDOW] / SLOT_MS;
    const int64_t samples = slots * SLOT_MS; /* 100..600 */

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

    const int32_t fast = 100 * p[TERRAPIN_PARAMETER_SLIP_WINDOW]; /* 1e-5 in ms: 100 of them to the second's million */
    integer_split(&state->rates.motor_speed, g->count_e5_urad, 100 * SPEED_TICKS);
    integer_split(&state->rates.motor_window, g->count_e5_urad, 100 * (int32_t)samples);
    integer_split(&state->rates.motor_fast, g->count_e5_urad, fast);
    integer_split(&state->rates.ground_fast, g->ground_e5_um, fast);
    integer_split(&state->rates.shell_per_rim, 1000000000, radius);

    /* torque of one code in 1e-12 N m, at most 5e5 * 2e6 * 5e3 / 2e3 = 2.5e12; then a window's mean, in Q16 of 1e-6 */
    const int64_t code = integer_divide((int64_t)radius * torque_constant * p[TERRAPIN_PARAMETER_CURRENT_SCALE], drive);
    g->current_gain_q16 = integer_narrow(integer_divide(code * 65536, samples * 1000000), 0, INT32_MAX);
    gains_friction(state);

    g->span_mv = integer_scale(p[TERRAPIN_PARAMETER_ARMATURE_RESISTANCE], p[TERRAPIN_PARAMETER_CURRENT_LIMIT], 1000);
    g->consistent = consistent(p);
    g->zero_q8 = p[TERRAPIN_PARAMETER_CURRENT_ZERO_CODE] +
                 integer_scale(p[TERRAPIN_PARAMETER_COMP_CURRENT_OFFSET], 256, p[TERRAPIN_PARAMETER_CURRENT_SCALE]);
    g->compensated = compensated(p);
    uncertainty_prepare(state);
}
