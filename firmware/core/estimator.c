/* C_t = (R/r) C_m - C_o over a window of one swing period, valid at steady state only.
 *
 * A window's mean of this equation errs by exactly (P(t) - P(t - T_w)) / T_w, P the angular momentum of shell and inner
 * device (cmr.md, A2). The gate bounds that by J times the mean acceleration, seen by the encoder, plus the part that a
 * swing sensor sees. Sums run for ever and wrap; windows are differences of their records, ten milliseconds apart.
 */
#include "core.h"

enum {
    QUIET_SLOTS = 20,          /* the gate must hold this long: a transient passes through zero faster */
    MOVING_COUNTS = 20,        /* fewer counts a window are no rolling: the friction's sign would be a guess */
    SWING_TICKS_MAX = 2000,
    CURRENT_STEP_UNM = 1500    /* the last slot's torque may differ by this from the window's: the ground changed */
};

void estimator_restart(terrapin_state *state) {
    static const terrapin_record nothing = {0};
    terrapin_estimator *e = &state->estimator;
    e->sum = nothing;
    e->sum.position_counts = state->sense.motor_position;
    e->sum.ground_counts = state->sense.ground_position;
    e->slots = 0U;
    e->swing_ticks = 0U;
    e->quiet_slots = 0U;
    e->since_fresh = 0U;
    e->valid = false;
    e->fresh = false;
}

const terrapin_record *estimator_record(const terrapin_estimator *estimator, uint32_t slots) {
    const uint32_t newest = estimator->newest;
    return &estimator->history[(newest >= slots) ? (newest - slots) : ((newest + (uint32_t)HISTORY_SLOTS) - slots)];
}

void estimator_tick(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_estimator *e = &state->estimator;
    const int32_t swing_rate = inputs->swing_rate_centirad_s;
    e->sum.current_sum_codes += (uint32_t)state->sense.current_code;
    e->sum.position_counts = state->sense.motor_position;
    e->sum.position_sum_counts += state->sense.motor_position;
    e->sum.ground_counts = state->sense.ground_position;
    e->sum.swing_sum_centirad_s += (uint32_t)swing_rate;
    e->sum.voltage_sum_mv += (uint32_t)state->drive.applied_mv;
    if (!inputs->swing_valid) {
        e->swing_ticks = 0U;
    } else if (e->swing_ticks < SWING_TICKS_MAX) {
        e->swing_ticks++;
    } else {
        /* long enough */
    }
}

int64_t estimator_motor_torque(const terrapin_gains *gains, int64_t current_q8, int32_t heat_q20) {
    /* gain < 2^31, |current_q8| < 2^32: below 2^63; the result, below 2^39, times 4 in Q20 stays below 2^61 */
    const int64_t torque = integer_shift(gains->current_gain_q16 * current_q8, 24U);
    return integer_shift(torque * heat_q20, 20U);
}

int64_t estimator_friction(const terrapin_gains *gains, int32_t coulomb_unm, int32_t counts) {
    const int64_t viscous = integer_shift((int64_t)gains->speed_gain_q16 * counts, 16U);
    return ((int64_t)coulomb_unm * integer_sign(counts)) + viscous;
}

int32_t estimator_contact_torque(int64_t torque_unm, bool *saturated) {
    const int32_t held = integer_clamp(torque_unm, -TERRAPIN_LIMIT_TORQUE_FULL_SCALE, TERRAPIN_LIMIT_TORQUE_FULL_SCALE);
    *saturated = held != torque_unm;
    return held;
}

/* Second difference of the position, averaged over a block so that the encoder's steps vanish [urad/s^2]. */
static int32_t acceleration(const terrapin_state *state) {
    const terrapin_estimator *e = &state->estimator;
    const uint32_t n = state->gains.window_slots;
    int64_t blocks = 0;
    static const int8_t weight[3] = {1, -2, 1};
    for (uint32_t i = 0U; i < 3U; i++) {
        const uint32_t later = estimator_record(e, i * n)->position_sum_counts;
        const uint32_t earlier = estimator_record(e, (i * n) + (uint32_t)BLOCK_SLOTS)->position_sum_counts;
        blocks += weight[i] * (int64_t)(later - earlier);
    }
    /* Each block is a sum modulo 2^32; so is the difference, which is small: 100 * 600 * 200 counts at the very most. */
    const int64_t counts = integer_difference((uint32_t)blocks, 0U);
    const int64_t ticks = (int64_t)n * SLOT_MS;
    const int64_t block_ticks = (int64_t)BLOCK_SLOTS * SLOT_MS;
    const int64_t scaled = (counts * state->gains.count_urad_q16) / ((block_ticks * ticks * ticks) / 1000);
    return integer_saturate(integer_shift(scaled * 1000, 16U)); /* below 2^59 / 1000 * 1000 */
}

/* What the swing takes from the angular momentum between the window's ends, over the window [uN m], as a magnitude. */
static int64_t swing_momentum(const terrapin_state *state, const terrapin_inputs *inputs) {
    const terrapin_estimator *e = &state->estimator;
    const uint32_t n = state->gains.window_slots;
    int64_t torque = 0;
    if (e->swing_ticks >= ((n + (uint32_t)BLOCK_SLOTS) * (uint32_t)SLOT_MS)) {
        const int64_t now = integer_difference(estimator_record(e, 0U)->swing_sum_centirad_s,
                                               estimator_record(e, BLOCK_SLOTS)->swing_sum_centirad_s);
        const int64_t then = integer_difference(estimator_record(e, n)->swing_sum_centirad_s,
                                                estimator_record(e, n + (uint32_t)BLOCK_SLOTS)->swing_sum_centirad_s);
        const int64_t cosine = integer_cosine(integer_turn(inputs->swing_angle_mrad));
        const int64_t inertia = state->parameter[TERRAPIN_PARAMETER_INERTIA_SHELL] -
                                integer_shift(state->parameter[TERRAPIN_PARAMETER_INERTIA_SWING] * cosine, 15U);
        /* 1e-6 kg m^2 * 0.01 rad/s, sums over 10 BLOCK_SLOTS ms, in a window of 10 n ms */
        torque = integer_abs((inertia * (now - then)) / (SLOT_MS * BLOCK_SLOTS * (int64_t)n));
    }
    return torque;
}

static bool gate(terrapin_state *state, const terrapin_inputs *inputs, int32_t counts) {
    terrapin_estimator *e = &state->estimator;
    const int64_t inertial = integer_abs((int64_t)state->parameter[TERRAPIN_PARAMETER_INERTIA] * e->acceleration_urad_s2);
    e->momentum_unm = integer_saturate((inertial / 1000000) + swing_momentum(state, inputs));
    const int64_t step_ua = (int64_t)e->recent_ua - ((int64_t)e->current_10ua * 10);
    const int64_t step_unm = integer_abs((step_ua * state->gains.torque_unm_per_a) / 1000000);
    const bool still = integer_abs(counts) < MOVING_COUNTS;
    if (still || (e->momentum_unm >= state->parameter[TERRAPIN_PARAMETER_GATE]) || (step_unm >= CURRENT_STEP_UNM)) {
        e->quiet_slots = 0U;
    } else if (e->quiet_slots < QUIET_SLOTS) {
        e->quiet_slots++;
    } else {
        /* long enough */
    }
    return e->quiet_slots >= QUIET_SLOTS;
}

/* Means over the window of `n` slots that ends now; the codes' sum less their zero in 1/256 code. */
static int64_t window_means(terrapin_state *state, uint32_t n, int32_t counts) {
    terrapin_estimator *e = &state->estimator;
    const terrapin_record *now = estimator_record(e, 0U);
    const terrapin_record *then = estimator_record(e, n);
    const terrapin_record *last = estimator_record(e, 1U);
    const int64_t ticks = (int64_t)n * SLOT_MS;
    const int64_t scale = state->parameter[TERRAPIN_PARAMETER_CURRENT_SCALE];
    const int64_t zero_q8 = (int64_t)state->parameter[TERRAPIN_PARAMETER_CURRENT_ZERO_CODE] +
                            state->sense.trim_q8_codes +
                            integer_divide((int64_t)state->parameter[TERRAPIN_PARAMETER_COMP_CURRENT_OFFSET] * 256, scale);
    /* at most 600 * (65535 * 256 + 2.6e6 * 1) and the offset's 600 * 2.6e6: below 2^34 for any code, below 2^32 for real */
    const int64_t sum_q8 = ((int64_t)(now->current_sum_codes - then->current_sum_codes) * 256) - (zero_q8 * ticks);
    const int64_t recent_q8 = ((int64_t)(now->current_sum_codes - last->current_sum_codes) * 256) - (zero_q8 * SLOT_MS);
    e->current_10ua = integer_saturate(integer_divide(sum_q8 * scale, ticks * 2560));
    e->recent_ua = integer_saturate(integer_divide(recent_q8 * scale, (int64_t)SLOT_MS * 256));
    e->voltage_mv = integer_difference(now->voltage_sum_mv, then->voltage_sum_mv) / (int32_t)ticks;
    e->omega_urad_s = integer_saturate(integer_shift((counts * (int64_t)state->gains.count_urad_q16 * 1000) / ticks, 16U));
    return integer_clamp(sum_q8, INT32_MIN, INT32_MAX);
}

static void mark_fresh(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    if (e->since_fresh < state->gains.window_slots) {
        e->since_fresh++;
    }
    e->fresh = e->valid && (e->since_fresh >= state->gains.window_slots);
    if (e->fresh) {
        e->since_fresh = 0U;
        e->index++;
    }
}

void estimator_slot(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_estimator *e = &state->estimator;
    const uint32_t n = state->gains.window_slots;
    e->newest = (uint16_t)((e->newest + 1U) % (uint32_t)HISTORY_SLOTS);
    e->history[e->newest] = e->sum;
    if (e->slots < HISTORY_SLOTS) {
        e->slots++;
    }
    e->valid = false;
    if (e->slots > n) {
        const int32_t counts = integer_clamp(
            integer_difference(estimator_record(e, 0U)->position_counts, estimator_record(e, n)->position_counts),
            -0xFFFFF, 0xFFFFF);
        const int64_t current_q8 = window_means(state, n, counts);
        const bool full = e->slots > ((2U * n) + (uint32_t)BLOCK_SLOTS);
        e->acceleration_urad_s2 = full ? acceleration(state) : 0;
        const int64_t motor = estimator_motor_torque(&state->gains, current_q8, compensation_heat_q20(state)) -
                              compensation_torque(state, inputs, counts);
        const int64_t friction = estimator_friction(&state->gains, state->parameter[TERRAPIN_PARAMETER_COULOMB], counts);
        e->motor_unm = integer_saturate(motor);
        e->friction_unm = integer_saturate(friction);
        e->torque_unm = estimator_contact_torque(motor - friction, &e->saturated);
        e->valid = gate(state, inputs, counts) && full && !e->saturated;
        e->sd_unm = uncertainty_unm(state);
    }
    mark_fresh(state);
}
