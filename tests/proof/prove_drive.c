/* drive_update from any state, on any demand: the bridge is off when it shall be, else its duty is a number of 16 bits
 * and its voltage within the supply; the integrals stay bounded. Assumed of the demand: what supervisor.c makes it of.
 */
#include "invariant.h"

#include "drive.c"

static terrapin_state state;
static terrapin_demand demand;

int32_t sense_supply_mv(const terrapin_state *s) {
    PROVE(s->sense.supply_q8_mv >= 0);
    return integer_right(s->sense.supply_q8_mv, 8U);
}

int main(void) {
    ANYTHING(state);
    ANYTHING(demand);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state));
    ASSUME(demand.mode <= DEMAND_SPEED);
    ASSUME(within(demand.voltage_mv, 32768) && within(demand.speed_urad_s, INTEGER_MOST));

    drive_update(&state, &demand);

    PROVE(drive_holds(&state));
    PROVE((demand.mode != DEMAND_OFF) || (!state.drive.enable && (state.drive.duty_q15 == 0)));
    return 0;
}
