/* The estimator from any state: sums and records stay in their places, and no part of a window's work overflows.
 *
 * Assumed, and asserted in estimator.c: records that are n apart differ by what n intervals of 16 bits a tick can make.
 * Assumed, and shown to stay so: the swing has not been measured for longer than the history is.
 */
#define estimator_record record_itself
#include "invariant.h"
#undef estimator_record

static struct {
    terrapin_slot_record now, last, then, other; /* of the history: whatever they hold */
} records;

static const terrapin_slot_record *estimator_record(const terrapin_state *s, uint32_t slots) {
    PROVE((slots <= s->estimator.slots) && (slots < (uint32_t)HISTORY_SLOTS));
    const terrapin_slot_record *old = (slots == s->gains.window_slots) ? &records.then : &records.other;
    return (slots == 0U) ? &records.now : ((slots == 1U) ? &records.last : old);
}

#include "estimator.c"

static terrapin_state state;
static terrapin_inputs inputs;

int32_t compensation_heat_q20(const terrapin_state *s) {
    (void)s;
    const int32_t heat = nondet_int();
    ASSUME((heat >= 0x40000) && (heat <= 0x200000));
    return heat;
}

static int32_t held(void) {
    const int32_t torque = nondet_int();
    ASSUME(within(torque, INTEGER_MOST));
    return torque;
}

int32_t compensation_friction(const terrapin_state *s, int32_t counts) {
    PROVE(counts == s->estimator.counts);
    return held();
}

int32_t compensation_imbalance(const terrapin_state *s, int32_t counts) {
    PROVE((counts == s->estimator.counts) && (s->estimator.slots > 0U));
    return held();
}

int32_t uncertainty_unm(const terrapin_state *s) {
    PROVE(s->estimator.slots > 0U);
    const int32_t sd = nondet_int();
    ASSUME(sd >= 0);
    return sd;
}

/* Records are RECORD_MS apart, and so many ticks have gone since the last. */
static bool swing_holds(uint32_t since) {
    const terrapin_estimator *e = &state.estimator;
    return (e->swing_ticks <= (uint32_t)SWING_TICKS_MAX) &&
           ((e->slots == (uint16_t)HISTORY_SLOTS) || (e->swing_ticks <= (((uint32_t)e->slots * RECORD_MS) + since)));
}

int main(void) {
    ANYTHING(state);
    ANYTHING(records);
    ANYTHING(inputs);
    PARAMETERS_HOLD(state);
    const uint32_t since = nondet_word();
    ASSUME(state_holds(&state) && (since < (uint32_t)RECORD_MS) && swing_holds(since));
    uint32_t next = since;
    const uint32_t back = nondet_word();

    switch (nondet_byte()) {
    case 0U:
        estimator_restart(&state);
        break;
    case 1U:
        estimator_tick(&state, &inputs);
        next++;
        if (next == (uint32_t)RECORD_MS) { /* schedule.c */
            estimator_close(&state);
            next = 0U;
        }
        break;
    case 2U:
        estimator_open(&state, &inputs);
        break;
    case 3U:
        ASSUME(state.estimator.open && state.estimator.ready);
        ASSUME(within(integer_difference(records.now.position_counts, records.then.position_counts), COUNTS_MOST));
        ASSUME((records.now.current_sum_codes - records.last.current_sum_codes) <= ((uint32_t)RECORD_MS * UINT16_MAX));
        estimator_means(&state);
        break;
    case 4U:
        estimator_acceleration(&state);
        break;
    case 5U:
        estimator_momentum(&state);
        break;
    case 6U:
        estimator_friction_beyond(&state);
        break;
    case 7U:
        estimator_torque(&state);
        break;
    case 8U:
        estimator_deviation(&state);
        break;
    case 9U:
        ASSUME(back <= state.estimator.slots);
        ASSUME(back < (uint32_t)HISTORY_SLOTS);
        PROVE(record_itself(&state, back) <= &state.history[HISTORY_SLOTS - 1]);
        break;
    default:
        estimator_gate(&state);
        break;
    }

    PROVE(estimator_holds(&state));
    PROVE(swing_holds(next));
    return 0;
}
