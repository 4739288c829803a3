/* telemetry_emit from any state: two frames at most, of eight bytes each, with every scaling of controller.toml. */
#include "invariant.h"

#include "telemetry.c"
#include "terrapin_interface.c"

static terrapin_state state;
static terrapin_inputs inputs;
static terrapin_outputs outputs;

int32_t sense_supply_mv(const terrapin_state *s) {
    return integer_right(s->sense.supply_q8_mv, 8U);
}

int32_t sense_temperature_mc(const terrapin_state *s) {
    return integer_right(s->sense.temperature_q8_mc, 8U);
}

bool supervisor_ready(const terrapin_state *s) {
    (void)s;
    return nondet_bool();
}

int main(void) {
    ANYTHING(state);
    ANYTHING(inputs);
    ANYTHING(outputs);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state));
    ASSUME(state.counter <= (uint8_t)TERRAPIN_E2E_COUNTER_MAX);

    telemetry_emit(&state, &inputs, &outputs);

    PROVE((outputs.frame_count >= 1U) && (outputs.frame_count <= (uint8_t)TERRAPIN_MAX_FRAMES));
    PROVE((outputs.frames[0].length <= 8U) && (outputs.frames[1].length <= 8U));
    PROVE(state.counter <= (uint8_t)TERRAPIN_E2E_COUNTER_MAX);
    return 0;
}
