/* The internal friction C_o = A sgn(omega) + B omega, measured by rolling on the hard floor at several speeds.
 *
 * At steady state (R/r) C_m = C_floor + A + B omega. The floor's own resistance (f_o + f_s omega^2) R W is known by two
 * parameters and subtracted; a straight line through the rest gives A and B.
 */
#include "core.h"

enum {
    SETTLE_MS = 500,              /* no window counts so soon after a voltage step, whatever the gate says */
    OMEGA_MAX_URAD_S = 100000000, /* three windows of it fit 2^30 */
    TORQUE_MAX_UNM = 2000000,
    SPREAD_MRAD2 = 1000000 /* n^2 times the variance of the speeds; less than 1 rad/s apart says nothing of B */
};

static void restart_step(terrapin_calibration_state *c) {
    c->windows = 0U;
    c->omega_sum_urad_s = 0;
    c->torque_sum_unm = 0;
}

void calibration_start(terrapin_state *state) {
    terrapin_calibration_state *c = &state->calibration;
    c->step = 0U;
    c->timer_ms = 0U;
    c->seen = state->estimator.index;
    restart_step(c);
}

static int32_t direction(const terrapin_state *state) {
    return integer_direction(state->supervisor.setpoint);
}

static int32_t voltage(const terrapin_state *state) {
    const int32_t *p = state->parameter;
    TERRAPIN_ASSERT((int32_t)state->calibration.step < p[TERRAPIN_PARAMETER_CALIBRATE_STEPS]);
    const int32_t low = p[TERRAPIN_PARAMETER_CALIBRATE_LOW];
    const int32_t span = p[TERRAPIN_PARAMETER_CALIBRATE_HIGH] - low;
    const int32_t last = p[TERRAPIN_PARAMETER_CALIBRATE_STEPS] - 1; /* at least 1 */
    TERRAPIN_ASSERT(last >= 1);
    return direction(state) * (low + ((span * (int32_t)state->calibration.step) / last));
}

static void close_step(terrapin_state *state) {
    terrapin_calibration_state *c = &state->calibration;
    TERRAPIN_ASSERT(c->windows == (uint8_t)CALIBRATE_WINDOWS);
    TERRAPIN_ASSERT((int32_t)c->step < TERRAPIN_LIMIT_CALIBRATE_SPEEDS);
    const int32_t omega = c->omega_sum_urad_s / CALIBRATE_WINDOWS;
    const int32_t torque = c->torque_sum_unm / CALIBRATE_WINDOWS;
    c->omega_mrad_s[c->step] = omega / 1000;
    c->torque_unm[c->step] = torque - ground_floor_unm(state, omega);
    c->step++;
    c->timer_ms = 0U;
    restart_step(c);
}

/* Largest residual of the line [uN m]. */
static int32_t worst(const terrapin_calibration_state *c, int32_t coulomb_unm, int32_t viscous_e8) {
    TERRAPIN_ASSERT((int32_t)c->step <= TERRAPIN_LIMIT_CALIBRATE_SPEEDS);
    int32_t largest = 0;
    for (uint32_t i = 0U; i < c->step; i++) {
        const int32_t line = coulomb_unm + integer_scale(viscous_e8, c->omega_mrad_s[i], 100000);
        const int32_t off = integer_abs(c->torque_unm[i] - line);
        largest = (off > largest) ? off : largest;
    }
    return largest;
}

static bool fit(terrapin_state *state) {
    terrapin_calibration_state *c = &state->calibration;
    const int64_t n = c->step; /* 2..8 */
    TERRAPIN_ASSERT((n >= 2) && (n <= TERRAPIN_LIMIT_CALIBRATE_SPEEDS));
    int64_t w = 0;
    int64_t ww = 0;
    int64_t t = 0;
    int64_t wt = 0;
    for (uint32_t i = 0U; i < c->step; i++) {
        w += c->omega_mrad_s[i];
        ww += (int64_t)c->omega_mrad_s[i] * c->omega_mrad_s[i];
        t += c->torque_unm[i];
        wt += (int64_t)c->omega_mrad_s[i] * c->torque_unm[i];
    }
    const int64_t spread = (n * ww) - (w * w);
    TERRAPIN_ASSERT(spread >= 0);
    bool good = spread >= SPREAD_MRAD2;
    if (good) {
        /* uN m a mrad/s to 1e-8 N m s/rad: times 1e5; |n wt| is at most 64 * 1e5 * 2e6, below 2^44 */
        const int64_t viscous = integer_divide(((n * wt) - (w * t)) * 100000, spread);
        const terrapin_parameter_entry b = terrapin_parameter(TERRAPIN_PARAMETER_VISCOUS);
        const terrapin_parameter_entry a = terrapin_parameter(TERRAPIN_PARAMETER_COULOMB);
        good = (viscous >= b.minimum) && (viscous <= b.maximum);
        const int64_t coulomb = good ? integer_divide((t * 100000) - (viscous * w), n * 100000) : 0;
        good = good && (coulomb >= a.minimum) && (coulomb <= a.maximum);
        c->residual_unm = good ? worst(c, (int32_t)coulomb, (int32_t)viscous) : 0;
        good = good && (c->residual_unm <= state->parameter[TERRAPIN_PARAMETER_CALIBRATE_TOLERANCE]);
        if (good) {
            state->parameter[TERRAPIN_PARAMETER_VISCOUS] = (int32_t)viscous;
            state->parameter[TERRAPIN_PARAMETER_COULOMB] = (int32_t)coulomb;
            state->parameter[TERRAPIN_PARAMETER_CALIBRATED] = 1;
            gains_friction(state);
        }
    }
    return good;
}

calibration_result calibration_update(terrapin_state *state, int32_t *voltage_mv) {
    terrapin_calibration_state *c = &state->calibration;
    const terrapin_estimator *e = &state->estimator;
    calibration_result result = CALIBRATION_BUSY;
    TERRAPIN_ASSERT((int32_t)c->step < state->parameter[TERRAPIN_PARAMETER_CALIBRATE_STEPS]);
    TERRAPIN_ASSERT(c->windows < (uint8_t)CALIBRATE_WINDOWS);
    const bool taken = c->seen == e->index;
    c->seen = e->index;
    c->timer_ms++;
    if (!taken && (c->timer_ms > SETTLE_MS)) {
        c->omega_sum_urad_s += integer_clamp(direction(state) * e->omega_urad_s, 0, OMEGA_MAX_URAD_S);
        c->torque_sum_unm += integer_clamp(direction(state) * e->motor_unm, -TORQUE_MAX_UNM, TORQUE_MAX_UNM);
        c->windows++;
    }
    if (c->windows == CALIBRATE_WINDOWS) {
        close_step(state);
    } else if (c->timer_ms > (uint32_t)state->parameter[TERRAPIN_PARAMETER_CALIBRATE_TIMEOUT]) {
        result = CALIBRATION_FAILED;
    } else {
        /* go on */
    }
    if (c->step == (uint32_t)state->parameter[TERRAPIN_PARAMETER_CALIBRATE_STEPS]) {
        result = fit(state) ? CALIBRATION_DONE : CALIBRATION_FAILED;
        c->step = (uint8_t)(c->step - ((result == CALIBRATION_DONE) ? 0U : 1U));
        *voltage_mv = 0;
    } else {
        *voltage_mv = voltage(state);
    }
    return result;
}
