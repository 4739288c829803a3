/* Standard deviation of C_t at steady state: the budget of the sensors' and constants' errors, with what a
 * calibration takes out of it.
 *
 * A calibration measures A + B omega = (R/r) C_m - C_floor with the same current sensor and the same K_t. What is wrong
 * with these by a factor is thereby taken out up to the torque of the floor, and what the floor itself is not known to
 * goes in instead. The terms are independent and add as squares.
 */
#include "core.h"

enum {
    TRIMMED_Q8_CODES = 77, /* 0.3 code: what a trimmed zero may be off by when no noise dithers the converter */
    PPM = 1000000
};

static uint64_t squared(int32_t value) {
    const int64_t held = integer_clamp(value, -500000000, 500000000);
    const int64_t square = held * held;
    return (uint64_t)square;
}

/* Square of the torque of a current [uA]. */
static uint64_t squared_torque(const terrapin_state *state, int32_t current_ua) {
    return squared(integer_scale(current_ua, state->gains.torque_unm_per_a, PPM));
}

/* Relative sd of K_t and of the current's gain, together [1e-6]. */
static int32_t gain_ppm(const int32_t *p) {
    const int32_t heat = integer_scale(p[TERRAPIN_PARAMETER_COMP_HEATING], p[TERRAPIN_PARAMETER_SD_TEMPERATURE], 1000);
    return (int32_t)integer_root(squared(p[TERRAPIN_PARAMETER_SD_TORQUE_CONSTANT]) +
                                 squared(p[TERRAPIN_PARAMETER_SD_CURRENT_GAIN]) + squared(heat)); /* below 6e5 */
}

int32_t uncertainty_unm(const terrapin_state *state) {
    const int32_t *p = state->parameter;
    const terrapin_estimator *e = &state->estimator;
    const int32_t zero_ua = state->sense.trimmed
                                ? integer_scale(p[TERRAPIN_PARAMETER_CURRENT_SCALE], TRIMMED_Q8_CODES, 256)
                                : p[TERRAPIN_PARAMETER_SD_CURRENT_OFFSET];
    const uint64_t samples = (uint64_t)state->gains.window_slots * (uint64_t)SLOT_MS;
    const int32_t noise_unm = integer_scale(p[TERRAPIN_PARAMETER_SD_CURRENT_NOISE], state->gains.torque_unm_per_a, PPM);
    int32_t scaled = e->motor_unm; /* what a wrong gain scales */
    uint64_t variance = squared_torque(state, zero_ua) +
                        squared_torque(state, p[TERRAPIN_PARAMETER_SD_CURRENT_LINEARITY]) +
                        squared(noise_unm / (int32_t)integer_root(samples)) + squared(p[TERRAPIN_PARAMETER_GATE] / 2);
    if (p[TERRAPIN_PARAMETER_CALIBRATED] != 0) {
        scaled = integer_abs(e->torque_unm) - ground_floor_unm(state, e->omega_urad_s);
        variance += squared(integer_scale(p[TERRAPIN_PARAMETER_SD_FLOOR], state->gains.weight_unm, PPM));
    } else {
        const int32_t viscous =
            integer_scale(p[TERRAPIN_PARAMETER_SD_VISCOUS], e->omega_urad_s, 100000000); /* 1e-8 1e-6 */
        variance += squared(p[TERRAPIN_PARAMETER_SD_COULOMB]) + squared(viscous);
    }
    variance += squared(integer_scale(scaled, gain_ppm(p), PPM));
    return (int32_t)integer_root(variance); /* seven squares of at most 2.5e17: below 1.4e9 */
}
