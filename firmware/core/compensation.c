#include "core.h"

enum { REFERENCE_MC = TERRAPIN_REFERENCE_TEMPERATURE * 1000, HEAT_ONE_Q20 = 0x100000, ONE_Q30 = 0x40000000 };

int32_t compensation_heat_q20(const terrapin_state *state) {
    /* a_t [1e-6/K] * dT [1e-3 K], in Q20: 2^20 / 1e9 = 1 / 953.674; held within 2^30, a factor of 2.1 */
    const int32_t slope = state->parameter[TERRAPIN_PARAMETER_COMP_HEATING];
    if (slope == 0) {
        return HEAT_ONE_Q20;
    }
    const int32_t fall = integer_scale(slope, sense_temperature_mc(state) - REFERENCE_MC, 1);
    return integer_clamp(HEAT_ONE_Q20 - integer_scale(fall, 1000, 953674), HEAT_ONE_Q20 / 4, HEAT_ONE_Q20 * 2);
}

/* a_s exp(-(omega/omega_s)^2) [uN m]; omega_mrad_s >= 0 */
static int32_t stribeck(const int32_t *p, int32_t omega_mrad_s) {
    TERRAPIN_ASSERT(omega_mrad_s >= 0);
    const int32_t ratio_q16 = integer_scale(omega_mrad_s, 65536, p[TERRAPIN_PARAMETER_COMP_STRIBECK_SPEED]);
    const int32_t power = integer_exp(integer_scale(ratio_q16, ratio_q16, 65536));
    TERRAPIN_ASSERT((power >= 0) && (power <= 65545));
    return integer_scale(p[TERRAPIN_PARAMETER_COMP_STRIBECK], power, 65536);
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
    int32_t mean = integer_scale(p[TERRAPIN_PARAMETER_COMP_IMBALANCE], integer_sine(middle), 32767);
    const int32_t way_urad = integer_abs(integer_scale(counts, state->gains.count_e5_urad, 200000));
    if (way_urad < 450000) { /* sin(h)/h = 1 - h^2/6 to 3.5e-4 */
        const int32_t way_mrad = way_urad / 1000;
        mean -= integer_scale(mean, way_mrad * way_mrad, 6000000);
    } else {
        /* sin(h)/h in Q30, so that a long way loses nothing; 32767 * 32769 is 2^30 to 1e-9 */
        mean = integer_scale(mean, integer_scale(integer_sine(way) * 32769, 1000000, way_urad), ONE_Q30);
    }
    return mean;
}

int32_t compensation_imbalance(const terrapin_state *state, int32_t counts) {
    return (state->parameter[TERRAPIN_PARAMETER_COMP_IMBALANCE] != 0) ? imbalance(state, counts) : 0;
}

int32_t compensation_friction(const terrapin_state *state, int32_t counts) {
    const int32_t *p = state->parameter;
    if (!state->gains.compensated) {
        return 0;
    }
    const int32_t omega = state->estimator.omega_urad_s;
    const int32_t size_mrad_s = integer_abs(omega) / 1000; /* below 2^21 */
    TERRAPIN_ASSERT(size_mrad_s < 2097152);
    /* Along the motion; each term is held within 2^30, and 1e9 of each is far more than the full scale of C_t. */
    int64_t along = p[TERRAPIN_PARAMETER_COMP_COULOMB];
    along += stribeck(p, size_mrad_s);
    /* 1e-9 N m s^2/rad^2 * (1e-3 rad/s)^2 */
    along +=
        integer_scale(p[TERRAPIN_PARAMETER_COMP_SPEED_SQUARED], integer_scale(size_mrad_s, size_mrad_s, 1000), 1000000);
    int64_t torque = along * integer_sign(counts);
    torque += integer_scale(p[TERRAPIN_PARAMETER_COMP_VISCOUS], omega, 100000000); /* 1e-8 * 1e-6 */
    torque += integer_scale(p[TERRAPIN_PARAMETER_COMP_INERTIA], state->estimator.acceleration_urad_s2, 10000000);
    return integer_saturate(torque);
}
