/* From what is wanted to the bridge's duty: speed loop, slip limiter, current limit, supply compensation.
 *
 * Both loops are PI on the shell's speed with the motor's back-EMF as feed-forward, so that their integrals hold the
 * load alone. The limiter's reference is the shell speed at which slip is just slip_limit, v / (R (1 - slip_limit)):
 * its loop gain then does not change with speed, as that of a loop on slip itself would. The lower of its voltage and
 * the wanted one reaches the motor; it starts from the voltage that stands (bumpless), and integrates only what can
 * act.
 */
#include "core.h"

enum {
    INTEGRAL_MAX_UV = 20000000,
    SUPPLY_MIN_MV = 1000, /* below this there is no bridge to speak of */
    DUTY_ONE = 32768,
    DUTY_BITS = 15,
    DUTY_MAX = 32767,
    TRIM_FALL = 256 /* the current limit's trim loses 1/256 of itself a tick */
};

typedef struct {
    int32_t low_mv;
    int32_t high_mv;
} bounds;

/* Back-EMF of a shell speed [uV]. */
static int32_t emf_uv(const terrapin_state *state, int32_t speed_urad_s) {
    return integer_widened(&state->rates.emf, speed_urad_s);
}

/* The voltages that keep the current within its limit, by the motor's model and by what the current says. */
static bounds allowed(terrapin_state *state) {
    const int32_t *p = state->parameter;
    terrapin_drive *d = &state->drive;
    const int32_t limit = p[TERRAPIN_PARAMETER_CURRENT_LIMIT];
    const int32_t span = state->gains.span_mv; /* gains.c */
    TERRAPIN_ASSERT((span >= 0) && (span <= 200000));
    const int32_t excess_ma = (integer_abs(state->sense.current_ua) / 1000) - limit;
    if (excess_ma > 0) {
        const int32_t rise = integer_q(excess_ma, state->rates.rise_q20, 20U); /* 21 A: below 2^17 */
        d->trim_mv = integer_clamp(d->trim_mv + rise + 1, 0, span);
    } else if (d->trim_mv > 0) {
        d->trim_mv -= (d->trim_mv + TRIM_FALL - 1) / TRIM_FALL;
    } else {
        /* nothing is taken off */
    }
    TERRAPIN_ASSERT((d->trim_mv >= 0) && (d->trim_mv <= span));
    const int32_t emf_mv = state->slip.emf_uv / 1000;
    const int32_t reach = span - d->trim_mv;
    const int32_t most = p[TERRAPIN_PARAMETER_VOLTAGE_LIMIT];
    const bounds result = {
        .low_mv = integer_clamp(emf_mv - reach, -most, most),
        .high_mv = integer_clamp(emf_mv + reach, -most, most),
    };
    TERRAPIN_ASSERT(result.low_mv <= result.high_mv);
    return result;
}

static int32_t hold_integral(int32_t value_uv) {
    return integer_clamp(value_uv, -INTEGRAL_MAX_UV, INTEGRAL_MAX_UV);
}

/* One tick of a PI loop [mV]. kp, ki [uV of one urad/s], speeds [urad/s]; the integral is held where it cannot act. */
static int32_t loop(int32_t feed_uv, int32_t error_urad_s, int32_t kp_q26, int32_t ki_q32, bounds within,
                    int32_t *integral_uv) {
    TERRAPIN_ASSERT(within.low_mv <= within.high_mv);
    TERRAPIN_ASSERT((*integral_uv <= INTEGRAL_MAX_UV) && (*integral_uv >= -INTEGRAL_MAX_UV));
    const int32_t sum_uv = integer_hold(integer_q_held(error_urad_s, kp_q26, 26U) + feed_uv);
    const int32_t wanted_mv = integer_hold(sum_uv + *integral_uv) / 1000;
    const int32_t held_mv = integer_clamp(wanted_mv, within.low_mv, within.high_mv);
    const bool winds_up =
        ((wanted_mv > held_mv) && (error_urad_s > 0)) || ((wanted_mv < held_mv) && (error_urad_s < 0));
    if (!winds_up) {
        *integral_uv = hold_integral(*integral_uv + integer_q32(error_urad_s, ki_q32));
    }
    return held_mv;
}

static int32_t hold_speed(terrapin_state *state, const terrapin_demand *demand, bounds within) {
    terrapin_drive *d = &state->drive;
    TERRAPIN_ASSERT(demand->mode == DEMAND_SPEED);
    const int32_t change = demand->speed_urad_s - d->reference_urad_s;
    const int32_t ramp = state->parameter[TERRAPIN_PARAMETER_SPEED_RAMP]; /* 1e-3 rad/s^2 is 1 urad/s a tick */
    d->reference_urad_s += integer_clamp(change, -ramp, ramp);
    return loop(emf_uv(state, d->reference_urad_s), d->reference_urad_s - state->slip.wheel_urad_s,
                state->rates.speed_kp_q26, state->rates.speed_ki_q32, within, &d->speed_integral_uv);
}

/* Shell speed at which slip is slip_limit, but never less than the dead band, so that a robot at rest can start. */
static int32_t limiter_reference(const terrapin_state *state, int32_t direction) {
    TERRAPIN_ASSERT((direction == 1) || (direction == -1));
    const int32_t rolling = integer_q_held(direction * state->slip.ground_um_s, state->rates.shell_q24, 24U);
    const int32_t reference = integer_q_held(rolling, state->rates.per_grip_q26, 26U);
    return integer_clamp(reference, state->rates.dead_urad_s, INTEGER_MOST);
}

/* wanted_mv, or less where slip would pass its limit; in the direction of wanted_mv, positive here. */
static int32_t limit_slip(terrapin_state *state, int32_t wanted_mv, bounds within, int32_t direction) {
    TERRAPIN_ASSERT(wanted_mv > 0);
    const int32_t *p = state->parameter;
    terrapin_drive *d = &state->drive;
    const int32_t limit = p[TERRAPIN_PARAMETER_SLIP_LIMIT];
    const int32_t speed = direction * state->slip.shell_urad_s;
    const bool passed = (speed > 0) && (state->slip.slip_e4 >= limit);
    int32_t voltage = wanted_mv;
    if (d->limiting || passed) {
        const int32_t reference = limiter_reference(state, direction);
        const int32_t error = reference - speed;
        const int32_t feed_uv = emf_uv(state, reference);
        const bounds span = {.low_mv = integer_clamp(within.low_mv, 0, wanted_mv), .high_mv = wanted_mv};
        if (!d->limiting) {
            const int32_t standing_uv = direction * d->applied_mv * 1000; /* as was wanted: 16 V */
            const int64_t load_uv =
                (int64_t)standing_uv - feed_uv - integer_q_held(error, state->rates.slip_kp_q26, 26U);
            d->limiter_integral_uv = integer_narrow(load_uv, -INTEGRAL_MAX_UV, INTEGRAL_MAX_UV);
        }
        voltage =
            loop(feed_uv, error, state->rates.slip_kp_q26, state->rates.slip_ki_q32, span, &d->limiter_integral_uv);
        d->limiting = (voltage < wanted_mv) || (state->slip.slip_e4 >= (limit - p[TERRAPIN_PARAMETER_SLIP_HYSTERESIS]));
    }
    TERRAPIN_ASSERT((voltage >= 0) && (voltage <= wanted_mv));
    return voltage;
}

static int32_t limited(terrapin_state *state, int32_t wanted_mv, bounds within) {
    terrapin_drive *d = &state->drive;
    TERRAPIN_ASSERT((d->limiter_direction >= -1) && (d->limiter_direction <= 1));
    const int32_t direction = integer_sign(wanted_mv);
    int32_t voltage = wanted_mv;
    if (direction != d->limiter_direction) { /* what was learnt in the other direction does not hold in this one */
        d->limiting = false;
        d->limiter_direction = direction;
    }
    if (direction > 0) {
        voltage = limit_slip(state, wanted_mv, within, 1);
    } else if (direction < 0) {
        const bounds mirrored = {.low_mv = -within.high_mv, .high_mv = -within.low_mv};
        voltage = -limit_slip(state, -wanted_mv, mirrored, -1);
    } else {
        /* nothing is wanted */
    }
    return voltage;
}

static void switch_off(terrapin_drive *d) {
    d->enable = false;
    d->duty_q15 = 0;
    d->applied_mv = 0;
    d->limiting = false;
    d->current_limiting = false;
    d->speed_integral_uv = 0;
    d->trim_mv = 0;
}

static void modulate(terrapin_state *state, int32_t voltage_mv) {
    terrapin_drive *d = &state->drive;
    const int32_t supply = sense_supply_mv(state);
    TERRAPIN_ASSERT(supply >= 0);
    TERRAPIN_ASSERT((voltage_mv <= INT16_MAX) && (voltage_mv >= INT16_MIN));
    const int32_t duty = (supply >= SUPPLY_MIN_MV) ? integer_ratio(voltage_mv * DUTY_ONE, supply) : 0; /* 16 V */
    d->enable = true;
    d->duty_q15 = (int16_t)integer_clamp(duty, -DUTY_MAX, DUTY_MAX);
    d->applied_mv = integer_q(d->duty_q15, supply, DUTY_BITS);
    TERRAPIN_ASSERT(integer_abs(d->applied_mv) <= supply);
}

void drive_update(terrapin_state *state, const terrapin_demand *demand) {
    terrapin_drive *d = &state->drive;
    TERRAPIN_ASSERT(demand->mode <= DEMAND_SPEED);
    if (demand->mode == DEMAND_OFF) {
        switch_off(d);
        d->reference_urad_s = state->slip.wheel_urad_s;
    } else {
        const bounds within = allowed(state);
        const bool speed = demand->mode == DEMAND_SPEED;
        const int32_t wanted = speed ? hold_speed(state, demand, within) : demand->voltage_mv;
        int32_t voltage = wanted;
        if (demand->limiter) {
            voltage = limited(state, wanted, within);
        } else {
            d->limiting = false;
        }
        const int32_t held = integer_clamp(voltage, within.low_mv, within.high_mv);
        if (!speed || (voltage != wanted)) {
            /* something else sets the output: the speed loop follows it, and takes over without a step */
            d->reference_urad_s = state->slip.wheel_urad_s;
            d->speed_integral_uv = hold_integral((held * 1000) - state->slip.emf_uv); /* 16 V and 2^30 */
        }
        d->current_limiting = (held != voltage) || (d->trim_mv > 0);
        modulate(state, held);
    }
    TERRAPIN_ASSERT(d->enable == (demand->mode != DEMAND_OFF));
    TERRAPIN_ASSERT(d->enable || (d->duty_q15 == 0));
}
