/* sense_update from any state, on any codes, those of a broken port with it. */
#include "invariant.h"

static terrapin_state state;
static terrapin_inputs inputs;

/* Counts one of the state's own: how far is shown of lasting_itself. */
static bool lasting(uint16_t *counter, bool cause, int32_t ticks) {
    const uint16_t *first = state.sense.fault_ticks;
    (void)cause;
    PROVE((counter >= first) && (counter < &first[SENSED_FAULTS]));
    PROVE(ticks == ((counter < &first[2]) ? 3 : 20));
    return nondet_bool();
}

#include "sense.c"

int main(void) {
    ANYTHING(state);
    ANYTHING(inputs);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state));
    bool gap = nondet_bool();

    uint16_t counter = (uint16_t)nondet_word();
    const int32_t ticks = nondet_int();
    ASSUME((ticks > 0) && (ticks <= 20) && (counter <= ticks));
    (void)lasting_itself(&counter, nondet_bool(), ticks);
    PROVE(counter <= ticks);

    const uint32_t causes = sense_update(&state, &inputs, &gap);

    PROVE(sense_holds(&state));
    PROVE(state.sense.tick == inputs.tick);
    PROVE((causes & ~TERRAPIN_FAULTS_LATCHED & ~(1U << TERRAPIN_FAULT_MOTOR_ENCODER)) == 0U);
    return 0;
}
