/* slip_update from any state: what it divides by, and that the speeds and the slip stay within their ranges. */
#define estimator_record record_itself /* prove_estimator.c has that one */
#include "invariant.h"
#undef estimator_record

static terrapin_state state;
static terrapin_inputs inputs;
static terrapin_slot_record records[2];

static const terrapin_slot_record *estimator_record(const terrapin_state *s, uint32_t slots) {
    PROVE((slots <= s->estimator.slots) && (slots < (uint32_t)HISTORY_SLOTS));
    return &records[(slots == 0U) ? 0 : 1];
}

/* ---- two functions of slip.c by their contracts; main shows that they keep to them */

static int32_t counted(const uint16_t *counts, uint8_t newest, uint32_t ticks) {
    PROVE((counts == state.fast.motor_counts) || (counts == state.fast.ground_counts));
    PROVE((newest < (uint8_t)FAST_TICKS) && (ticks < (uint32_t)FAST_TICKS));
    const int32_t result = nondet_int();
    ASSUME((result >= -32768) && (result <= 32767));
    return result;
}

static bool speeds_divide(int32_t ground_um_s, int32_t rim_um_s) {
    return within(ground_um_s, INTEGER_MOST) && within(rim_um_s, HELD_OR_LEAST) &&
           ((rim_um_s >= 256) || (rim_um_s <= -256) || ((rim_um_s == 1) && (ground_um_s == 1)));
}

static int32_t slip_of(int32_t ground_um_s, int32_t rim_um_s) {
    PROVE(speeds_divide(ground_um_s, rim_um_s));
    const int32_t result = nondet_int();
    ASSUME(within(result, 40000) && ((rim_um_s != 1) || (result == 0)));
    return result;
}

#include "slip.c"

int main(void) {
    ANYTHING(state);
    ANYTHING(inputs);
    ANYTHING(records);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state));

    static uint16_t counts[FAST_TICKS];
    ANYTHING(counts);
    const uint8_t newest = nondet_byte();
    const uint32_t ticks = nondet_word();
    const int32_t ground = nondet_int();
    const int32_t rim = nondet_int();

    switch (nondet_byte()) {
    case 0U:
        slip_restart(&state);
        break;
    case 1U:
        ASSUME((newest < (uint8_t)FAST_TICKS) && (ticks < (uint32_t)FAST_TICKS));
        PROVE((counted_itself(counts, newest, ticks) >= -32768) && (counted_itself(counts, newest, ticks) <= 32767));
        break;
    case 2U:
        ASSUME(speeds_divide(ground, rim));
        PROVE(within(slip_of_itself(ground, rim), 40000));
        PROVE(slip_of_itself(1, 1) == 0);
        break;
    default:
        slip_update(&state, &inputs);
        break;
    }

    PROVE(slip_holds(&state));
    return 0;
}
