#include "core.h"

/* Ranges are those of controller.toml; every product below stays under 2^62. */
void gains_prepare(terrapin_state *state) {
    const int32_t *p = state->parameter;
    terrapin_gains *g = &state->gains;
    const int64_t radius = p[TERRAPIN_PARAMETER_RADIUS]; /* 1e4..5e5 um */
    /* A drive wheel larger than the shell is refused by gains_consistent; here it must only not overflow. */
    const int64_t drive = integer_clamp(p[TERRAPIN_PARAMETER_DRIVE_RADIUS], 1, (int32_t)radius);
    const int64_t torque_constant = p[TERRAPIN_PARAMETER_TORQUE_CONSTANT]; /* 1e3..2e6 uN m/A */
    const int64_t slots = p[TERRAPIN_PARAMETER_WINDOW] / SLOT_MS;
    const int64_t samples = slots * SLOT_MS; /* 100..600 */

    /* 2 pi / 2048 rad = 3067.9616 urad = 201061930 / 65536 urad */
    g->count_urad_q16 = (int32_t)integer_divide(201061930 * drive, radius);
    g->ground_um_q16 = (int32_t)integer_divide(201061930 * (int64_t)p[TERRAPIN_PARAMETER_GROUND_WHEEL_RADIUS], 1000000);
    g->turn_per_count = (int32_t)integer_divide(2097152 * drive, radius); /* 2^32 / 2048 r/R */
    g->torque_unm_per_a = (int32_t)integer_divide(radius * torque_constant, drive);
    g->weight_unm = (int32_t)((radius * p[TERRAPIN_PARAMETER_WEIGHT]) / 1000);
    g->window_slots = (uint32_t)slots;

    /* torque of one code in 1e-12 N m, at most 5e5 * 2e6 * 5e3 / 2e3 = 2.5e12; then a window's mean, in Q16 of 1e-6 */
    const int64_t code = integer_divide(radius * torque_constant * p[TERRAPIN_PARAMETER_CURRENT_SCALE], drive);
    g->current_gain_q16 = integer_saturate(integer_divide(code * 65536, samples * 1000000));
    /* B [1e-8 N m s/rad] * speed of one count a window [urad/s, Q16] */
    g->speed_gain_q16 = integer_saturate(
        integer_divide((int64_t)p[TERRAPIN_PARAMETER_VISCOUS] * g->count_urad_q16, samples * 100000));
}

bool gains_consistent(const terrapin_state *state) {
    const int32_t *p = state->parameter;
    return (p[TERRAPIN_PARAMETER_DRIVE_RADIUS] < p[TERRAPIN_PARAMETER_RADIUS]) &&
           (p[TERRAPIN_PARAMETER_SUPPLY_LOW] < p[TERRAPIN_PARAMETER_SUPPLY_HIGH]) &&
           (p[TERRAPIN_PARAMETER_CALIBRATE_LOW] < p[TERRAPIN_PARAMETER_CALIBRATE_HIGH]);
}
