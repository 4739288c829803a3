/* Standard deviation of C_t at steady state: the budget of the sensors' and constants' errors, with what a
 * calibration takes out of it.
 *
 * A calibration measures A + B omega = (R/r) C_m - C_floor with the same current sensor and the same K_t. What is wrong
 * with these by a factor is thereby taken out up to the torque of the floor, and what the floor itself is not known to
 * goes in instead. The terms are independent and add as squares.
 */
#include "core.h"

enum {
    TRIMMED_Q8_CODES = 77 /* 0.3 code: what a trimmed zero may be off by when no noise dithers the converter */
};

static uint64_t squared(int32_t value) {
    const int32_t held = integer_clamp(value, -500000000, 500000000);
    const int64_t square = (int64_t)held * held;
    return (uint64_t)square;
}

void uncertainty_prepare(terrapin_state *state) {
    const int32_t *p = state->parameter;
    terrapin_gains *g = &state->gains;
    TERRAPIN_ASSERT((g->torque_unm_per_a > 0) && (g->window_slots > 0U));
    const int32_t torque_unm_per_a = integer_scale(g->torque_unm_per_a, p[TERRAPIN_PARAMETER_GEAR_EFFICIENCY], 1000000);
    const integer_wide passed = integer_wide_of(torque_unm_per_a, 1000000);
    const integer_wide *torque = &passed; /* uN m of one uA, behind the gear */
    const int32_t noise_unm = integer_widened(torque, p[TERRAPIN_PARAMETER_SD_CURRENT_NOISE]);
    const int32_t heat = integer_scale(p[TERRAPIN_PARAMETER_COMP_HEATING], p[TERRAPIN_PARAMETER_SD_TEMPERATURE], 1000);
    g->fixed_variance = squared(integer_widened(torque, p[TERRAPIN_PARAMETER_SD_CURRENT_LINEARITY])) +
                        squared(noise_unm / (int32_t)integer_root((uint64_t)g->window_slots * (uint64_t)RECORD_MS)) +
                        squared(p[TERRAPIN_PARAMETER_GATE] / 2);
    g->trimmed_unm = integer_widened(torque, integer_q(p[TERRAPIN_PARAMETER_CURRENT_SCALE], TRIMMED_Q8_CODES, 8U));
    g->untrimmed_unm = integer_widened(torque, p[TERRAPIN_PARAMETER_SD_CURRENT_OFFSET]);
    g->floor_unm = integer_q_held(p[TERRAPIN_PARAMETER_SD_FLOOR], g->weight_q22, 22U);
    const uint32_t gain_ppm =
        integer_root(squared(p[TERRAPIN_PARAMETER_SD_TORQUE_CONSTANT]) +
                     squared(p[TERRAPIN_PARAMETER_SD_CURRENT_GAIN]) + squared(heat)); /* below 6e5 */
    TERRAPIN_ASSERT(gain_ppm < 600000U);
    g->sd_viscous_q32 = integer_factor(p[TERRAPIN_PARAMETER_SD_VISCOUS], 32U, 100000000); /* 1e-8 1e-6 over 1e-6 */
    g->gain_q30 = integer_factor((int64_t)gain_ppm, 30U, 1000000);
}

int32_t uncertainty_unm(const terrapin_state *state) {
    const int32_t *p = state->parameter;
    const terrapin_gains *g = &state->gains;
    const terrapin_estimator *e = &state->estimator;
    int32_t scaled = e->motor_unm; /* what a wrong gain scales */
    int32_t own = p[TERRAPIN_PARAMETER_SD_COULOMB];
    int32_t viscous = 0;
    if (p[TERRAPIN_PARAMETER_CALIBRATED] != 0) {
        scaled = integer_abs(e->torque_unm) - ground_floor_unm(state, e->omega_urad_s);
        own = g->floor_unm;
    } else {
        viscous = integer_q32(e->omega_urad_s, g->sd_viscous_q32);
    }
    const uint64_t variance = g->fixed_variance + squared(state->sense.trimmed ? g->trimmed_unm : g->untrimmed_unm) +
                              squared(own) + squared(viscous) + squared(integer_q(scaled, g->gain_q30, 30U));
    TERRAPIN_ASSERT(variance < 1960000000000000000U);
    return (int32_t)integer_root(variance); /* seven squares of at most 2.5e17: below 1.4e9 */
}
