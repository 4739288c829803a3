/* The internal friction C_o = A sgn(omega) + B omega, measured by rolling on the hard floor at several speeds.
 *
 * At steady state (R/r) C_m = C_floor + A + B omega. The floor's own resistance (f_o + f_s omega^2) R W is known by two
 * parameters and subtracted; a straight line through the rest gives A and B.
 */
#include "core.h"

/* What a window is held within, of robots with a full scale up to 2, 8, 33 and 100 N m: no window reaches it. Eight
 * speeds of TORQUE_MAX fit 2^31. */
#if TERRAPIN_LIMIT_TORQUE_FULL_SCALE <= 0x200000
enum { OMEGA_MAX_URAD_S = 0x6000000, TORQUE_MAX_UNM = 0x200000, SLOPE_BITS = 23 };
#elif TERRAPIN_LIMIT_TORQUE_FULL_SCALE <= 0x800000
enum { OMEGA_MAX_URAD_S = 0x6000000, TORQUE_MAX_UNM = 0x800000, SLOPE_BITS = 21 };
#elif TERRAPIN_LIMIT_TORQUE_FULL_SCALE <= 0x2000000
enum { OMEGA_MAX_URAD_S = 0x2800000, TORQUE_MAX_UNM = 0x2000000, SLOPE_BITS = 19 };
#else
enum { OMEGA_MAX_URAD_S = 0xD80000, TORQUE_MAX_UNM = 0x6000000, SLOPE_BITS = 17 };
#endif
_Static_assert((int32_t)TORQUE_MAX_UNM >= TERRAPIN_LIMIT_TORQUE_FULL_SCALE, "held where no motor reaches");
/* 46116860184273: 2^62 / 100000 */
_Static_assert(((((int64_t)32 * (int64_t)OMEGA_MAX_URAD_S) / 1000) * (int64_t)TORQUE_MAX_UNM) < 46116860184273,
               "what fit_viscous divides is within what integer_divide takes");

enum {
    SETTLE_MS = 500,       /* no window counts so soon after a voltage step, whatever the gate says */
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
    c->fit = FIT_NONE;
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
    c->torque_unm[c->step] = integer_clamp(torque - ground_floor_unm(state, omega), -TORQUE_MAX_UNM, TORQUE_MAX_UNM);
    c->step++;
    c->timer_ms = 0U;
    restart_step(c);
}

/* Largest residual of the line [uN m]. */
static int32_t worst(const terrapin_calibration_state *c) {
    TERRAPIN_ASSERT((int32_t)c->step <= TERRAPIN_LIMIT_CALIBRATE_SPEEDS);
    /* uN m of one mrad/s: of each N m of full scale at most 100 */
    const int32_t slope = integer_factor(c->viscous_e8, (uint32_t)SLOPE_BITS, 100000);
    int32_t largest = 0;
    for (uint32_t i = 0U; i < c->step; i++) {
        const int32_t line = c->coulomb_unm + integer_q_held(c->omega_mrad_s[i], slope, (uint32_t)SLOPE_BITS);
        const int32_t off = integer_abs(c->torque_unm[i] - line);
        largest = (off > largest) ? off : largest;
    }
    return largest;
}

/* The sums of the straight line, and from them the two numbers that its slope is the quotient of. */
static bool fit_sums(terrapin_calibration_state *c) {
    const int64_t n = c->step; /* 2..8 */
    TERRAPIN_ASSERT((n >= 2) && (n <= TERRAPIN_LIMIT_CALIBRATE_SPEEDS));
    int32_t w = 0; /* 8 times OMEGA_MAX, and TORQUE_MAX */
    int32_t t = 0;
    int64_t ww = 0;
    int64_t wt = 0;
    for (uint32_t i = 0U; i < c->step; i++) {
        w += c->omega_mrad_s[i];
        t += c->torque_unm[i];
        ww += (int64_t)c->omega_mrad_s[i] * c->omega_mrad_s[i];
        wt += (int64_t)c->omega_mrad_s[i] * c->torque_unm[i];
    }
    c->sum_mrad_s = w;
    c->sum_unm = t;
    c->spread = (n * ww) - ((int64_t)w * w);
    c->common = (n * wt) - ((int64_t)w * t);
    TERRAPIN_ASSERT((c->spread >= 0) && (c->spread < integer_power(40U))); /* 64 times (1e5)^2 */
    return c->spread >= SPREAD_MRAD2;
}

static bool fit_viscous(terrapin_calibration_state *c) {
    /* uN m a mrad/s to 1e-8 N m s/rad: times 1e5; of n numbers each from 0 to W and -T to T it is at most n^2/2 W T */
    const int64_t viscous = integer_divide(c->common * 100000, c->spread);
    const terrapin_parameter_entry range = terrapin_parameter(TERRAPIN_PARAMETER_VISCOUS);
    const bool good = (viscous >= range.minimum) && (viscous <= range.maximum);
    if (good) {
        c->viscous_e8 = (int32_t)viscous;
    }
    return good;
}

static bool fit_coulomb(terrapin_calibration_state *c) {
    const int64_t numerator = ((int64_t)c->sum_unm * 100000) - ((int64_t)c->viscous_e8 * c->sum_mrad_s);
    const int64_t coulomb = integer_divide(numerator, (int64_t)c->step * 100000);
    const terrapin_parameter_entry range = terrapin_parameter(TERRAPIN_PARAMETER_COULOMB);
    const bool good = (coulomb >= range.minimum) && (coulomb <= range.maximum);
    if (good) {
        c->coulomb_unm = (int32_t)coulomb;
    }
    return good;
}

static void fit_take(terrapin_state *state) {
    state->parameter[TERRAPIN_PARAMETER_VISCOUS] = state->calibration.viscous_e8;
    state->parameter[TERRAPIN_PARAMETER_COULOMB] = state->calibration.coulomb_unm;
    state->parameter[TERRAPIN_PARAMETER_CALIBRATED] = 1;
    gains_friction(state);
}

void calibration_work(terrapin_state *state) {
    terrapin_calibration_state *c = &state->calibration;
    const terrapin_supervisor *s = &state->supervisor;
    if ((s->state != TERRAPIN_STATE_CALIBRATE) || (s->phase == PHASE_HALT)) {
        return; /* given up meanwhile */
    }
    bool good = true;
    switch (c->fit) {
    case FIT_SUMS:
        good = fit_sums(c);
        break;
    case FIT_VISCOUS:
        good = fit_viscous(c);
        break;
    case FIT_COULOMB:
        good = fit_coulomb(c);
        break;
    case FIT_RESIDUAL:
        c->residual_unm = worst(c);
        good = c->residual_unm <= state->parameter[TERRAPIN_PARAMETER_CALIBRATE_TOLERANCE];
        break;
    case FIT_TAKE:
        fit_take(state);
        break;
    default: /* nothing is to be fitted, or no more */
        return;
    }
    if (good) {
        c->fit++;
    } else {
        c->residual_unm = (c->fit == FIT_RESIDUAL) ? c->residual_unm : 0;
        c->fit = FIT_FAILED;
    }
}

/* Takes a disjoint window in that has come since the last tick; true when that was the last of this speed. */
static bool take_window(terrapin_state *state) {
    terrapin_calibration_state *c = &state->calibration;
    const terrapin_estimator *e = &state->estimator;
    TERRAPIN_ASSERT(c->windows < (uint8_t)CALIBRATE_WINDOWS);
    const bool taken = c->seen == e->index;
    c->seen = e->index;
    if (!taken && (c->timer_ms > SETTLE_MS)) {
        c->omega_sum_urad_s += integer_clamp(direction(state) * e->omega_urad_s, 0, OMEGA_MAX_URAD_S);
        c->torque_sum_unm += integer_clamp(direction(state) * e->motor_unm, -TORQUE_MAX_UNM, TORQUE_MAX_UNM);
        c->windows++;
    }
    return c->windows == CALIBRATE_WINDOWS;
}

calibration_result calibration_update(terrapin_state *state, int32_t *voltage_mv) {
    terrapin_calibration_state *c = &state->calibration;
    calibration_result result = CALIBRATION_BUSY;
    *voltage_mv = 0;
    c->timer_ms++;
    if (c->fit == FIT_DONE) {
        result = CALIBRATION_DONE;
    } else if (c->fit == FIT_FAILED) {
        result = CALIBRATION_FAILED;
        c->step--; /* the last speed is not told as measured */
    } else if (c->fit != FIT_NONE) {
        /* comes to rest meanwhile */
    } else if (take_window(state)) {
        close_step(state);
        if (c->step == (uint32_t)state->parameter[TERRAPIN_PARAMETER_CALIBRATE_STEPS]) {
            c->fit = FIT_SUMS;
        } else {
            *voltage_mv = voltage(state);
        }
    } else if (c->timer_ms > (uint32_t)state->parameter[TERRAPIN_PARAMETER_CALIBRATE_TIMEOUT]) {
        result = CALIBRATION_FAILED;
    } else {
        *voltage_mv = voltage(state);
    }
    return result;
}
