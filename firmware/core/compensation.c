#include "core.h"

enum { REFERENCE_MC = TERRAPIN_REFERENCE_TEMPERATURE * 1000, HEAT_ONE_Q20 = 0x100000, ONE_Q30 = 0x40000000 };

int32_t compensation_heat_q20(const terrapin_state *state) {
    const int32_t above_mc = sense_temperature_mc(state) - REFERENCE_MC; /* below 2^23: the product is below 2^27 */
    const int32_t fall = integer_q(above_mc, state->gains.heat_q24, 24U);
    return integer_clamp(HEAT_ONE_Q20 - fall, HEAT_ONE_Q20 / 4, HEAT_ONE_Q20 * 2);
}

/* a_s exp(-(omega/omega_s)^2) [uN m]; omega_mrad_s >= 0 */
static int32_t stribeck(const terrapin_state *state, int32_t omega_mrad_s) {
    TERRAPIN_ASSERT(omega_mrad_s >= 0);
    const int32_t ratio_q16 = integer_q_held(omega_mrad_s, state->gains.stribeck_q16, 16U);
    const int32_t power = integer_exp(integer_q_held(ratio_q16, ratio_q16, 16U));
    TERRAPIN_ASSERT((power >= 0) && (power <= 65545));
    return integer_q(state->parameter[TERRAPIN_PARAMETER_COMP_STRIBECK], power, 16U);
}

/* sin(h)/h; h as a turn of 2^32 and in urad, which is not negative. */
static int32_t sine_over_angle_q30(uint32_t turn, int32_t urad) {
    int32_t ratio_q30;
    if (urad < 450000) { /* 1 - h^2/6 to 3.5e-4; 2^30 / 6e6 is 183252 / 2^10 */
        const int32_t mrad = urad / 1000;
        ratio_q30 = ONE_Q30 - integer_q(mrad * mrad, 183252, 10U);
    } else { /* in one division of 32 bits: 2^17 sine over 16 urad, and 2^30 / (2^17 32767 16e-6) is 15625.5 */
        const int32_t sine = integer_sine(turn);
        const uint32_t size = ((uint32_t)integer_abs(sine) * 131072U) / ((uint32_t)urad / 16U);
        const uint32_t size_q30 = (size * 15625U) + (size / 2U); /* at most 0.97 */
        ratio_q30 = (sine < 0) ? -(int32_t)size_q30 : (int32_t)size_q30;
    }
    return ratio_q30;
}

/* Mean of m_e sin(angle + phase) over a window at steady speed: m_e sin(middle + phase) sin(h)/h, 2 h the way turned.
 */
static int32_t imbalance(const terrapin_state *state, int32_t counts) {
    const int32_t *p = state->parameter;
    const terrapin_estimator *e = &state->estimator;
    const uint32_t unit = (uint32_t)state->gains.turn_per_count;
    TERRAPIN_ASSERT(unit <= 2097152U);
    const uint32_t size = (uint32_t)integer_abs(counts);
    const uint32_t way = ((size / 2U) * unit) + ((size & 1U) * (unit / 2U)); /* h, 2^32 a turn */
    const uint32_t back = 0U - way;
    const uint32_t ahead = (counts < 0) ? back : way;
    /* the shell's angle is alpha less the swing */
    const uint32_t swing = e->swing_valid ? integer_turn(e->swing_angle_mrad) : 0U;
    const int32_t phase_e4 = p[TERRAPIN_PARAMETER_COMP_IMBALANCE_PHASE]; /* times 68356.5, rounded */
    const uint32_t phase = ((uint32_t)phase_e4 * 68356U) + (uint32_t)integer_ratio(phase_e4, 2);
    const uint32_t middle = (((estimator_record(state, 0U)->position_counts * unit) - ahead) - swing) + phase;
    int32_t mean = integer_of_sine(p[TERRAPIN_PARAMETER_COMP_IMBALANCE], integer_sine(middle));
    const int32_t way_urad = integer_abs(integer_gained(&state->gains.half_urad, counts));
    return integer_q(mean, sine_over_angle_q30(way, way_urad), 30U);
}

int32_t compensation_imbalance(const terrapin_state *state, int32_t counts) {
    return (state->parameter[TERRAPIN_PARAMETER_COMP_IMBALANCE] != 0) ? imbalance(state, counts) : 0;
}

int32_t compensation_friction(const terrapin_state *state, int32_t counts) {
    const int32_t *p = state->parameter;
    const terrapin_gains *g = &state->gains;
    if (!g->compensated) {
        return 0;
    }
    const int32_t omega = state->estimator.omega_urad_s;
    const int32_t size_mrad_s = integer_abs(omega) / 1000; /* below 2^21 */
    TERRAPIN_ASSERT(size_mrad_s < 2097152);
    /* Along the motion; each term is held within 2^30, and 1e9 of each is far more than the full scale of C_t. */
    int64_t along = p[TERRAPIN_PARAMETER_COMP_COULOMB];
    along += stribeck(state, size_mrad_s);
    along += integer_q_held(integer_q_held(size_mrad_s, size_mrad_s, 10U), g->speed_squared_q24, 24U);
    int64_t torque = along * integer_sign(counts);
    torque += integer_q32(omega, g->comp_viscous_q32);
    torque += integer_q(state->estimator.acceleration_urad_s2, g->comp_inertia_q30, 30U);
    return integer_saturate(torque);
}
