/* compensation.c and uncertainty.c from any state: what the estimator adds, and how much it is sure of. */
#define TO_THE_UNIT
#include "invariant.h"

#include "compensation.c"
#include "uncertainty.c"

static terrapin_state state;

int32_t sense_temperature_mc(const terrapin_state *s) {
    (void)s;
    const int32_t mc = nondet_int();
    ASSUME(within(mc, 4194304)); /* temperature_q8_mc / 256 */
    return mc;
}

int32_t ground_floor_unm(const terrapin_state *s, int32_t omega_urad_s) {
    (void)s;
    PROVE(omega_urad_s > INT32_MIN);
    const int32_t floor = nondet_int();
    ASSUME(within(floor, HELD_OR_LEAST)); /* integer_q_held made it */
    return floor;
}

int main(void) {
    ANYTHING(state);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state));
    ASSUME(state.estimator.slots > 0U); /* schedule.c: a window is open */
    const int32_t counts = state.estimator.counts;
    const uint8_t which = nondet_byte();

    if (which == 0U) {
        PROVE((compensation_heat_q20(&state) >= 0x40000) && (compensation_heat_q20(&state) <= 0x200000));
    } else if (which == 1U) {
        PROVE(within(compensation_friction(&state, counts), INTEGER_MOST));
    } else if (which == 2U) {
        PROVE(within(compensation_imbalance(&state, counts), INTEGER_MOST));
    } else if (which == 3U) {
        PROVE(uncertainty_unm(&state) >= 0);
    } else {
        uncertainty_prepare(&state);
        PROVE(gains_hold(&state));
    }
    return 0;
}
