/* C_t = (R/r) C_m - C_o over a window of one swing period, valid at steady state only.
 *
 * A window's mean of this equation errs by exactly (P(t) - P(t - T_w)) / T_w, P the angular momentum of shell and inner
 * device: the energies of Reina et al. (2006), Eqs. 3 to 6, depend on the difference of the two angles alone. The gate
 * bounds that by J times the mean acceleration, seen by the encoder, plus the part that a swing sensor sees. Sums run
 * for ever and wrap; windows are differences of their records, RECORD_MS apart.
 */
#include "core.h"

enum { COUNTS_MOST = WINDOW_MAX_SLOTS * RECORD_MS * 32768 }; /* sixteen bits a tick, over the longest window */

enum {
    QUIET_SLOTS = 20,   /* the gate must hold this long: a transient passes through zero faster */
    MOVING_COUNTS = 20, /* fewer counts a window are no rolling: the friction's sign would be a guess */
    SWING_TICKS_MAX = 200 * RECORD_MS,
    CURRENT_MAX_10UA = 10000000, /* 100 A: more than any code at any current_scale */
    CURRENT_STEP_UNM = 1500 * (TERRAPIN_LIMIT_TORQUE_FULL_SCALE / 1000000), /* 1.5e-3 of the full scale: the last
                                                                             * record's torque may differ by this from
                                                                             * the window's, and by */
    RIPPLE_TIMES = 5,           /* five times its own mean deviation, four sd, else the ground has changed */
    RIPPLE_MAX_UNM = 214748064, /* above, the step is never so large: it is held within 2^30 */
    RIPPLE_SLOTS = 64
};

void estimator_restart(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator; /* the sums run on: only their differences mean something */
    e->open = false;
    e->slots = 0U;
    e->swing_ticks = 0U;
    e->quiet_slots = 0U;
    e->since_fresh = 0U;
    e->valid = false;
    e->fresh = false;
}

void estimator_tick(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_estimator *e = &state->estimator;
    const int32_t swing_rate = inputs->swing_rate_centirad_s;
    e->sum.current_sum_codes += (uint32_t)state->sense.current_code;
    e->sum.position_sum_counts += state->sense.motor_position;
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

int32_t estimator_motor_torque(const terrapin_gains *gains, int32_t current_q8, int32_t heat_q20) {
    TERRAPIN_ASSERT(integer_abs(current_q8) <= INTEGER_MOST);
    TERRAPIN_ASSERT((heat_q20 >= 0x40000) && (heat_q20 <= 0x200000));
    return integer_q_held(integer_q_held(current_q8, gains->current_gain_q16, 24U), heat_q20, 20U);
}

int32_t estimator_geared(const terrapin_gains *gains, int32_t torque_unm, int32_t counts) {
    const bool driving = (torque_unm < 0) == (counts < 0);
    return integer_q_held(torque_unm, driving ? gains->driving_q20 : gains->driven_q20, 20U);
}

int32_t estimator_friction(const terrapin_gains *gains, int32_t coulomb_unm, int32_t counts) {
    TERRAPIN_ASSERT(integer_abs(coulomb_unm) < 0x20000000);
    return (coulomb_unm * integer_sign(counts)) + integer_q_held(counts, gains->speed_gain_q16, 16U);
}

int32_t estimator_contact_torque(int32_t torque_unm, bool *saturated) {
    const int32_t held = integer_clamp(torque_unm, -TERRAPIN_LIMIT_TORQUE_FULL_SCALE, TERRAPIN_LIMIT_TORQUE_FULL_SCALE);
    *saturated = held != torque_unm;
    return held;
}

/* Sum of the positions over the block that ended `slots` ago. */
static uint32_t block(const terrapin_state *state, uint32_t slots) {
    return estimator_record(state, slots)->position_sum_counts -
           estimator_record(state, slots + (uint32_t)BLOCK_SLOTS)->position_sum_counts;
}

/* Swing rates summed over the SWING_SLOTS that ended `slots` ago. */
static uint32_t swung(const terrapin_state *state, uint32_t slots) {
    return estimator_record(state, slots)->swing_sum_centirad_s -
           estimator_record(state, slots + (uint32_t)SWING_SLOTS)->swing_sum_centirad_s;
}

/* Second difference of the position, averaged over a block so that the encoder's steps vanish [urad/s^2]. */
static int32_t acceleration(const terrapin_state *state) {
    TERRAPIN_ASSERT(state->estimator.full);
    const uint32_t n = state->gains.window_slots;
    TERRAPIN_ASSERT((n >= 10U) && (n <= (uint32_t)WINDOW_MAX_SLOTS));
    const uint32_t blocks = block(state, 0U) - (2U * block(state, n)) + block(state, 2U * n);
    /* Each block is a sum modulo 2^32; so is the difference, which is small: 100 * 600 * 200 counts at the very most.
     */
    const int32_t counts = integer_difference(blocks, 0U);
    return integer_q_held(counts, state->gains.acceleration_q19, 19U);
}

/* What the swing takes from the angular momentum between the window's ends, over the window [uN m], as a magnitude. */
static int32_t swing_momentum(const terrapin_state *state) {
    const terrapin_estimator *e = &state->estimator;
    const uint32_t n = state->gains.window_slots;
    int32_t torque = 0;
    if (e->swing_ticks >= ((n + (uint32_t)SWING_SLOTS) * (uint32_t)RECORD_MS)) {
        const int32_t cosine = integer_cosine(integer_turn(e->swing_angle_mrad));
        const int32_t inertia = state->parameter[TERRAPIN_PARAMETER_INERTIA_SHELL] -
                                integer_of_sine(state->parameter[TERRAPIN_PARAMETER_INERTIA_SWING], cosine);
        /* 1e-6 kg m^2 * 0.01 rad/s, sums over 10 SWING_SLOTS ms, in a window of 10 n ms, where a record is 10 ms */
        const int32_t inertia_q12 = integer_q(inertia, state->gains.swing_q20, 20U);
        const int32_t rates = integer_difference(swung(state, 0U), swung(state, n));
        torque = integer_abs(integer_q_held(rates, inertia_q12, 12U));
    }
    return torque;
}

/* A window is open, and the history holds one. */
static bool at_work(const terrapin_state *state) {
    return state->estimator.open && state->estimator.ready;
}

void estimator_acceleration(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    if (at_work(state)) {
        e->acceleration_urad_s2 = e->full ? acceleration(state) : 0;
    }
}

void estimator_momentum(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    if (at_work(state)) {
        const int32_t inertial = integer_q(e->acceleration_urad_s2, state->gains.inertia_q30, 30U);
        const uint32_t sum = (uint32_t)integer_abs(inertial) + (uint32_t)swing_momentum(state); /* 2^30 each at most */
        e->momentum_unm = (sum < (uint32_t)INTEGER_MOST) ? (int32_t)sum : INTEGER_MOST;
    }
}

void estimator_close(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    e->newest = (uint16_t)((e->newest < (HISTORY_SLOTS - 1)) ? (e->newest + 1U) : 0U);
    terrapin_slot_record *now = &state->history[e->newest];
    *now = e->sum;
    now->position_counts = state->sense.motor_position;
    now->ground_counts = state->sense.ground_position;
    if (e->slots < HISTORY_SLOTS) {
        e->slots++;
    }
}

void estimator_open(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_estimator *e = &state->estimator;
    const uint32_t n = state->gains.window_slots;
    e->open = true;
    e->ready = e->slots > n;
    e->full = e->slots > ((2U * n) + (uint32_t)BLOCK_SLOTS);
    e->swing_valid = inputs->swing_valid;
    e->swing_angle_mrad = inputs->swing_angle_mrad;
    e->pitch_valid = inputs->pitch_valid;
    e->pitch_mrad = inputs->pitch_mrad;
}

void estimator_means(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    if (at_work(state)) {
        const terrapin_gains *g = &state->gains;
        const uint32_t n = g->window_slots;
        const terrapin_slot_record *now = estimator_record(state, 0U);
        const terrapin_slot_record *then = estimator_record(state, n);
        const terrapin_slot_record *last = estimator_record(state, 1U);
        const int32_t ticks = (int32_t)n * RECORD_MS;
        const int32_t zero_q8 = g->zero_q8 + state->sense.trim_q8_codes;
        e->counts = integer_difference(now->position_counts, then->position_counts);
        TERRAPIN_ASSERT((e->counts <= COUNTS_MOST) && (e->counts >= -COUNTS_MOST));
        /* held within 2^30: 1.7 times what any 12-bit code makes */
        const uint32_t sum_codes = now->current_sum_codes - then->current_sum_codes;
        e->current_q8 = integer_saturate(((int64_t)sum_codes * 256) - ((int64_t)zero_q8 * ticks));
        const uint32_t recent_codes = now->current_sum_codes - last->current_sum_codes;
        TERRAPIN_ASSERT(recent_codes <= ((uint32_t)RECORD_MS * UINT16_MAX));
        /* at most 80 codes of 16 bits, 80 times a zero: below 2^31 */
        const int32_t recent_q8 = ((int32_t)recent_codes * 256) - (zero_q8 * RECORD_MS);
        e->current_10ua =
            integer_clamp(integer_q32(e->current_q8, g->current_q32), -CURRENT_MAX_10UA, CURRENT_MAX_10UA);
        e->recent_ua = integer_q_held(recent_q8, g->recent_q28, 28U);
        e->voltage_mv = integer_q32(integer_difference(now->voltage_sum_mv, then->voltage_sum_mv), g->voltage_q32);
        e->omega_urad_s = integer_gained(&state->rates.motor_window, e->counts);
    }
}

void estimator_friction_beyond(terrapin_state *state) {
    if (at_work(state)) {
        state->estimator.beyond_unm = compensation_friction(state, state->estimator.counts);
    }
}

void estimator_torque(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    if (at_work(state)) {
        const int32_t drawn = estimator_motor_torque(&state->gains, e->current_q8, compensation_heat_q20(state));
        const int32_t beyond = integer_hold(e->beyond_unm + compensation_imbalance(state, e->counts));
        e->motor_unm = integer_hold(estimator_geared(&state->gains, drawn, e->counts) - beyond);
        e->friction_unm = estimator_friction(&state->gains, state->parameter[TERRAPIN_PARAMETER_COULOMB], e->counts);
        e->torque_unm =
            estimator_contact_torque(integer_saturate((int64_t)e->motor_unm - e->friction_unm), &e->saturated);
    }
}

/* True when the gate has been met for long enough. */
static bool quiet(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    const int32_t step_ua = e->recent_ua - (e->current_10ua * 10);
    const int32_t step_unm = integer_abs(integer_widened(&state->rates.emf, step_ua));
    const int32_t ripple = integer_clamp(e->ripple_unm, 0, RIPPLE_MAX_UNM);
    const bool step = step_unm >= (CURRENT_STEP_UNM + (RIPPLE_TIMES * ripple));
    e->ripple_unm += integer_ratio(step_unm - e->ripple_unm, RIPPLE_SLOTS);
    const bool still = integer_abs(e->counts) < MOVING_COUNTS;
    if (still || step || (e->momentum_unm >= state->parameter[TERRAPIN_PARAMETER_GATE])) {
        e->quiet_slots = 0U;
    } else if (e->quiet_slots < QUIET_SLOTS) {
        e->quiet_slots++;
    } else {
        /* long enough */
    }
    return e->quiet_slots >= QUIET_SLOTS;
}

void estimator_gate(terrapin_state *state) {
    terrapin_estimator *e = &state->estimator;
    if (!e->open) {
        return;
    }
    e->valid = e->ready && quiet(state) && e->full && !e->saturated;
    if (e->since_fresh < state->gains.window_slots) {
        e->since_fresh++;
    }
    e->fresh = e->valid && (e->since_fresh >= state->gains.window_slots);
    if (e->fresh) {
        e->since_fresh = 0U;
        e->index++;
    }
}

void estimator_deviation(terrapin_state *state) {
    if (at_work(state)) {
        state->estimator.sd_unm = uncertainty_unm(state);
    }
}
