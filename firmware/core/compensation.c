#include "core.h"

enum { REFERENCE_MC = 25000, HEAT_ONE_Q20 = 1 << 20 };

int32_t compensation_heat_q20(const terrapin_state *state) {
    /* a_t [1e-6/K] * dT [1e-3 K]: within 1e4 * 2.3e6; in Q20: below 2^55 */
    const int64_t fall = (int64_t)state->parameter[TERRAPIN_PARAMETER_COMP_HEATING] *
                         ((int64_t)sense_temperature_mc(state) - REFERENCE_MC);
    return integer_clamp(HEAT_ONE_Q20 - integer_divide(fall * HEAT_ONE_Q20, 1000000000), HEAT_ONE_Q20 / 4,
                         HEAT_ONE_Q20 * 4);
}

/* a_s exp(-(omega/omega_s)^2) [uN m]; omega_mrad_s >= 0 */
static int64_t stribeck(const int32_t *p, int64_t omega_mrad_s) {
    const int64_t ratio_q16 = (omega_mrad_s * 65536) / p[TERRAPIN_PARAMETER_COMP_STRIBECK_SPEED]; /* at least 10 */
    const int64_t held = integer_clamp(ratio_q16, 0, 8 * 65536); /* exp(-64) is nothing */
    const int64_t power = integer_exp((uint32_t)((held * held) / 65536));
    return integer_shift(p[TERRAPIN_PARAMETER_COMP_STRIBECK] * power, 16U);
}

/* Mean of m_e sin(angle + phase) over a window at steady speed: m_e sin(middle + phase) sin(h)/h, 2 h the way turned. */
static int64_t imbalance(const terrapin_state *state, const terrapin_inputs *inputs, int32_t counts) {
    const int32_t *p = state->parameter;
    const terrapin_gains *g = &state->gains;
    const int32_t half = counts / 2;
    const uint32_t middle = state->sense.motor_position - (uint32_t)half;
    /* the shell's angle is alpha less the swing */
    const uint32_t swing = inputs->swing_valid ? integer_turn(inputs->swing_angle_mrad) : 0U;
    const uint32_t phase = (uint32_t)(((int64_t)p[TERRAPIN_PARAMETER_COMP_IMBALANCE_PHASE] * 683565) / 10);
    const uint32_t turn = (middle * (uint32_t)g->turn_per_count) - swing + phase;
    int64_t mean = integer_shift((int64_t)p[TERRAPIN_PARAMETER_COMP_IMBALANCE] * integer_sine(turn), 15U);
    /* |counts| < 2^20, unit < 2^28 */
    const int64_t way_urad = integer_abs(integer_shift((int64_t)counts * g->count_urad_q16, 17U));
    if (way_urad > 1000) { /* below, sin(h)/h is 1 to 2e-7 */
        const uint32_t way = (uint32_t)(integer_abs(half) & 0xFFFFFF) * (uint32_t)g->turn_per_count;
        mean = (mean * integer_sine(way) * 1000) / ((way_urad * 32767) / 1000);
    }
    return mean;
}

int32_t compensation_torque(const terrapin_state *state, const terrapin_inputs *inputs, int32_t counts) {
    const int32_t *p = state->parameter;
    const int64_t omega_mrad_s = state->estimator.omega_urad_s / 1000; /* within 2.2e6 */
    const int64_t size = integer_abs(omega_mrad_s);
    const int64_t sign = integer_sign(counts);
    int64_t torque = 0;
    /* 1e-9 N m s^2/rad^2 * (1e-3 rad/s)^2: 1e8 * 4.7e12/1000 stays below 2^59 */
    torque += sign * integer_divide(p[TERRAPIN_PARAMETER_COMP_SPEED_SQUARED] * ((size * size) / 1000), 1000000);
    torque += integer_divide((int64_t)p[TERRAPIN_PARAMETER_COMP_VISCOUS] * omega_mrad_s, 100000);
    torque += sign * p[TERRAPIN_PARAMETER_COMP_COULOMB];
    torque += sign * stribeck(p, size);
    torque += integer_divide((int64_t)p[TERRAPIN_PARAMETER_COMP_INERTIA] * state->estimator.acceleration_urad_s2,
                             10000000);
    torque += imbalance(state, inputs, counts);
    return integer_saturate(torque);
}
