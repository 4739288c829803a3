/* supervisor_update from any state, with anything from what it calls: when the bridge is off, whatever happened before.
 *
 * Assumed, and asserted where it is made: the two speeds are above INT32_MIN (slip.c holds them), the phase is one of
 * the three (episode_enter asserts it). What it calls may answer anything and leaves the supervisor's state alone, but
 * for extrication_start, which may enter "stuck" alone (extrication.c).
 */
#include "proof.h"

#include "episode.c"
#include "integer.c"
#include "supervisor.c"

static terrapin_state state;
static terrapin_inputs inputs;
static terrapin_demand demand;

void calibration_start(terrapin_state *s) {
    (void)s;
}

calibration_result calibration_update(terrapin_state *s, int32_t *voltage_mv) {
    (void)s;
    *voltage_mv = nondet_int();
    return (calibration_result)(nondet_byte() % 3U);
}

bool extrication_watch(terrapin_state *s, int32_t direction) {
    (void)s;
    PROVE((direction == 1) || (direction == -1));
    return nondet_bool();
}

void extrication_start(terrapin_state *s, const terrapin_inputs *in, int32_t direction) {
    (void)in;
    PROVE((direction == 1) || (direction == -1));
    episode_enter(s, TERRAPIN_STATE_STUCK, PHASE_FIRST);
}

bool extrication_update(terrapin_state *s, const terrapin_inputs *in, terrapin_demand *d) {
    (void)s;
    (void)in;
    PROVE(d->mode == DEMAND_OFF);
    ANYTHING(*d);
    return nondet_bool();
}

int main(void) {
    ANYTHING(state);
    ANYTHING(inputs);
    ANYTHING(demand);
    ASSUME((state.slip.wheel_urad_s > INT32_MIN) && (state.slip.ground_um_s > INT32_MIN));
    ASSUME((state.supervisor.phase >= PHASE_FIRST) && (state.supervisor.phase <= PHASE_HALT));
    ASSUME(state.rates.shell_per_rim.most >= 0);
    /* listen asserts both again */
    ASSUME((state.supervisor.hold_ms > 0U) || !state.supervisor.refused);
    ASSUME((state.supervisor.request_taken != TERRAPIN_REQUEST_CLEAR) ||
           ((state.supervisor.request == TERRAPIN_REQUEST_CLEAR) && (state.supervisor.hold_ms > 0U)));
    const uint32_t causes = nondet_word();
    const bool gap = nondet_bool();
    const bool known =
        (state.supervisor.state >= TERRAPIN_STATE_BOOT) && (state.supervisor.state <= TERRAPIN_STATE_SAFE);
    const bool drives = driving(state.supervisor.state);
    const uint32_t kept = state.supervisor.faults & TERRAPIN_FAULTS_LATCHED;
    const bool cleared = state.supervisor.request_taken == TERRAPIN_REQUEST_CLEAR;
    const bool starts =
        (inputs.command.request == TERRAPIN_REQUEST_RUN) || (inputs.command.request == TERRAPIN_REQUEST_CALIBRATE);

    supervisor_update(&state, &inputs, causes, gap, &demand);

    const bool latched = (state.supervisor.faults & TERRAPIN_FAULTS_LATCHED) != 0U;
    const bool clear = inputs.command_fresh && (inputs.command.request == TERRAPIN_REQUEST_CLEAR);
    const bool off = demand.mode == DEMAND_OFF;
    const bool safe = state.supervisor.state == TERRAPIN_STATE_SAFE;
    const uint32_t age = state.sense.tick - state.supervisor.command_tick;
    const bool late = age > (uint32_t)state.parameter[TERRAPIN_PARAMETER_COMMAND_TIMEOUT];
    PROVE(!latched || (off && safe));                                   /* a latched fault: off */
    PROVE(((causes & TERRAPIN_FAULTS_LATCHED) == 0U) || (off && safe)); /* in the tick of its cause */
    PROVE(!inputs.estop || (off && safe));                              /* the e-stop in its tick, in any state */
    PROVE(clear || ((kept & ~state.supervisor.faults) == 0U));          /* only clear takes one away */
    PROVE(!(drives && late) || off);                                    /* a late command: off */
    PROVE(known || off);                                                /* a state that does not exist: off */
    /* after a clear RUN and CALIBRATE start nothing, and it stays so; nor does the clear itself */
    PROVE(!cleared || drives || !(starts || !inputs.command_fresh) || (off && !driving(state.supervisor.state)));
    PROVE(!cleared || !(starts || !inputs.command_fresh) || (state.supervisor.request_taken == TERRAPIN_REQUEST_CLEAR));
    PROVE(!clear || drives || (off && (state.supervisor.request_taken == TERRAPIN_REQUEST_CLEAR)));
    PROVE(off || driving(state.supervisor.state) || (state.supervisor.state == TERRAPIN_STATE_IDLE));
    PROVE(state.supervisor.phase <= PHASE_HALT);
    return 0;
}
