/* Stuck and the way back, from any state in which supervisor.c asks for it. */
#include "invariant.h"

#include "episode.c"
#include "extrication.c"

static terrapin_state state;
static terrapin_inputs inputs;
static terrapin_demand demand;

int main(void) {
    ANYTHING(state);
    ANYTHING(inputs);
    ANYTHING(demand);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state));
    const int32_t direction = nondet_bool() ? 1 : -1;
    const int32_t now = state.supervisor.state;
    const uint8_t which = nondet_byte();

    if (which == 0U) {
        (void)extrication_watch(&state, direction);
    } else if (which == 1U) {
        ASSUME((now == TERRAPIN_STATE_RUN) || (now == TERRAPIN_STATE_LIMITING)); /* supervisor.c: while it drives */
        extrication_start(&state, &inputs, direction);
        PROVE(state.supervisor.state == TERRAPIN_STATE_STUCK);
        PROVE((state.supervisor.direction == 1) || (state.supervisor.direction == -1));
    } else {
        ASSUME((now == TERRAPIN_STATE_STUCK) || (now == TERRAPIN_STATE_EXTRICATE));
        ASSUME((state.supervisor.direction == 1) || (state.supervisor.direction == -1)); /* extrication_start made it */
        demand.mode = DEMAND_OFF;
        demand.speed_urad_s = 0;
        demand.voltage_mv = 0;
        (void)extrication_update(&state, &inputs, &demand);
        PROVE((demand.mode == DEMAND_VOLTAGE) || (demand.mode == DEMAND_SPEED));
        PROVE((demand.voltage_mv == 0) && within(demand.speed_urad_s, INTEGER_MOST)); /* as drive.c may take it */
    }

    PROVE(supervisor_holds(&state));
    return 0;
}
