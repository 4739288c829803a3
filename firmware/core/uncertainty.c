/* Standard deviation of C_t at steady state: the budget of cmr.md A4, with what a calibration takes out of it.
 *
 * A calibration measures A + B omega = (R/r) C_m - C_floor with the same current sensor and the same K_t. What is wrong
 * with these by a factor is thereby taken out up to the torque of the floor, and what the floor itself is not known to
 * goes in instead. The terms are independent and add as squares.
 */
#include "core.h"

enum {
    TRIMMED_Q8_CODES = 77,    /* 0.3 code: what a trimmed zero may be off by when no noise dithers the converter */
    PPM = 1000000
};

static uint64_t squared(int64_t value) {
    const int64_t held = integer_clamp(value, -500000000, 500000000);
    return (uint64_t)(held * held);
}

/* torque [uN m] of a current [uA]; torque_unm_per_a at most 5e8, |current| at most 2^31 */
static int64_t torque_of(const terrapin_state *state, int64_t current_ua) {
    return (current_ua * state->gains.torque_unm_per_a) / PPM;
}

/* Relative sd of K_t and of the current's gain, together [1e-6]. */
static int64_t gain_ppm(const int32_t *p) {
    const int64_t heat = ((int64_t)p[TERRAPIN_PARAMETER_COMP_HEATING] * p[TERRAPIN_PARAMETER_SD_TEMPERATURE]) / 1000;
    return integer_root(squared(p[TERRAPIN_PARAMETER_SD_TORQUE_CONSTANT]) + squared(p[TERRAPIN_PARAMETER_SD_CURRENT_GAIN]) +
                        squared(heat));
}

int32_t uncertainty_unm(const terrapin_state *state) {
    const int32_t *p = state->parameter;
    const terrapin_estimator *e = &state->estimator;
    const bool calibrated = p[TERRAPIN_PARAMETER_CALIBRATED] != 0;
    const int64_t samples = (int64_t)state->gains.window_slots * SLOT_MS;
    const int64_t zero_ua = state->sense.trimmed ? ((p[TERRAPIN_PARAMETER_CURRENT_SCALE] * (int64_t)TRIMMED_Q8_CODES) / 256)
                                                 : p[TERRAPIN_PARAMETER_SD_CURRENT_OFFSET];
    int64_t scaled = e->motor_unm; /* what a wrong gain scales */
    uint64_t variance = squared(torque_of(state, zero_ua)) +
                        squared(torque_of(state, p[TERRAPIN_PARAMETER_SD_CURRENT_LINEARITY])) +
                        (squared(torque_of(state, p[TERRAPIN_PARAMETER_SD_CURRENT_NOISE])) / (uint64_t)samples) +
                        squared(p[TERRAPIN_PARAMETER_GATE] / 2);
    if (calibrated) {
        const int64_t floor_ppm = ground_curve_ppm(state, TERRAPIN_TERRAIN_HARD_FLOOR, e->omega_urad_s);
        const int64_t floor_unm = (floor_ppm * state->gains.weight_unm) / PPM;
        scaled = integer_abs((int64_t)e->motor_unm - e->friction_unm) - floor_unm;
        variance += squared(((int64_t)p[TERRAPIN_PARAMETER_SD_FLOOR] * state->gains.weight_unm) / PPM);
    } else {
        /* 1e-8 N m s/rad * 1e-6 rad/s */
        const int64_t viscous = ((int64_t)p[TERRAPIN_PARAMETER_SD_VISCOUS] * e->omega_urad_s) / 100000000;
        variance += squared(p[TERRAPIN_PARAMETER_SD_COULOMB]) + squared(viscous);
    }
    variance += squared((scaled * gain_ppm(p)) / PPM);
    return (int32_t)integer_root(variance); /* seven squares of at most 2.5e17: below 1.4e9 */
}
