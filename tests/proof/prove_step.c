/* step.c, schedule.c and parameters.c around the parts that have proofs of their own: parameters stay within their
 * ranges whoever writes them, a part is called when another has made what it rests on, and a tick with a latched fault
 * leaves the bridge off. `clear` has a proof of its own, and stands here for any state. */
#include "invariant.h"

#include "terrapin_interface.c"

static terrapin_state state;
static terrapin_inputs inputs;
static terrapin_outputs outputs;
static int32_t values[TERRAPIN_PARAMETER_COUNT];

static void clear(terrapin_state *s) {
    PROVE(s == &state);
    s->drive.enable = false;
}

#include "parameters.c"
#include "schedule.c"
#include "step.c"

static bool prepared; /* what follows from the parameters is that of the present ones */

static bool in_range(const int32_t *p) {
    const uint32_t i = nondet_word();
    ASSUME(i < (uint32_t)TERRAPIN_PARAMETER_COUNT);
    const terrapin_parameter_entry entry = terrapin_parameter((uint16_t)i);
    return (p[i] >= entry.minimum) && (p[i] <= entry.maximum);
}

void gains_prepare(terrapin_state *s) {
    PROVE(in_range(s->parameter));
    prepared = true;
}

void gains_slope(terrapin_state *s) {
    PROVE(in_range(s->parameter));
    prepared = true;
}

uint32_t sense_update(terrapin_state *s, const terrapin_inputs *in, bool *gap) {
    s->sense.tick = in->tick;
    *gap = nondet_bool();
    return nondet_word();
}

void slip_restart(terrapin_state *s) {
    (void)s;
}

void estimator_restart(terrapin_state *s) {
    s->estimator.open = false;
    s->estimator.slots = 0U;
}

void estimator_tick(terrapin_state *s, const terrapin_inputs *in) {
    (void)s;
    (void)in;
}

void estimator_close(terrapin_state *s) {
    PROVE((s->sense.tick % (uint32_t)RECORD_MS) == (uint32_t)WINDOW_TICK); /* RECORD_MS apart, as the estimator's proof
                                                                            * has it */
}

void estimator_open(terrapin_state *s, const terrapin_inputs *in) {
    PROVE((in->tick % (uint32_t)RECORD_MS) == (uint32_t)WINDOW_TICK);
    s->estimator.open = nondet_bool();
}

void slip_update(terrapin_state *s, const terrapin_inputs *in) {
    PROVE(s->sense.tick == in->tick);
}

void supervisor_update(terrapin_state *s, const terrapin_inputs *in, uint32_t causes, bool gap, terrapin_demand *d) {
    (void)in;
    (void)causes;
    (void)gap;
    ANYTHING(*d);
    s->supervisor.faults = nondet_word();
    ASSUME(d->mode <= DEMAND_SPEED);
    ASSUME(((s->supervisor.faults & TERRAPIN_FAULTS_LATCHED) == 0U) || (d->mode == DEMAND_OFF)); /* its own proof */
}

void drive_update(terrapin_state *s, const terrapin_demand *d) {
    PROVE(d->mode <= DEMAND_SPEED);
    s->drive.enable = d->mode != DEMAND_OFF; /* its own proof */
    s->drive.duty_q15 = s->drive.enable ? (int16_t)nondet_word() : 0;
}

void telemetry_emit(terrapin_state *s, const terrapin_inputs *in, terrapin_outputs *out) {
    PROVE((s->sense.tick == in->tick) && (out->frame_count == 0U));
    out->frame_count = nondet_bool() ? 1U : 2U; /* its own proof */
}

#define NOTHING(name)                                                                                                  \
    void name(terrapin_state *s) {                                                                                     \
        (void)s;                                                                                                       \
    }
NOTHING(estimator_means)
NOTHING(estimator_acceleration)
NOTHING(estimator_momentum)
NOTHING(estimator_friction_beyond)
NOTHING(estimator_torque)
NOTHING(estimator_deviation)
NOTHING(estimator_gate)
NOTHING(ground_speed)
NOTHING(ground_resistance)
NOTHING(ground_nearest)
NOTHING(ground_fit_work)
NOTHING(calibration_work)

void heading_slot(terrapin_state *s, const terrapin_inputs *in) {
    PROVE(s->sense.tick == in->tick);
}

int main(void) {
    ANYTHING(state);
    ANYTHING(inputs);
    ANYTHING(outputs);
    ANYTHING(values);
    for (uint16_t i = 0U; i < (uint16_t)TERRAPIN_PARAMETER_COUNT; i++) { /* of this build, with its board's ceilings */
        const terrapin_parameter_entry entry = terrapin_parameter(i);
        ASSUME((state.parameter[i] >= entry.minimum) && (state.parameter[i] <= entry.maximum));
    }
    const uint16_t index = (uint16_t)nondet_word();
    const int32_t before = (index < TERRAPIN_PARAMETER_COUNT) ? state.parameter[index] : 0;
    int32_t value = nondet_int();
    const bool on = state.drive.enable;

    switch (nondet_byte()) {
    case 0U:
        terrapin_step(&state, &inputs, &outputs);
        PROVE(outputs.enable || (outputs.duty_q15 == 0));
        PROVE(!outputs.enable || ((outputs.faults & TERRAPIN_FAULTS_LATCHED) == 0U));
        break;
    case 1U:
        if (terrapin_parameter_set(&state, index, value) == TERRAPIN_PARAMETER_OK) {
            PROVE(!on || !terrapin_parameter_protected(index));
        } else {
            PROVE((index >= TERRAPIN_PARAMETER_COUNT) || (state.parameter[index] == before));
        }
        break;
    case 2U:
        (void)terrapin_parameter_get(&state, index, &value);
        break;
    case 3U:
        (void)terrapin_parameter_set_all(&state, nondet_bool() ? values : NULL);
        PROVE(!on || (index >= TERRAPIN_PARAMETER_COUNT) || (state.parameter[index] == before));
        break;
    default:
        (void)terrapin_init_with(&state, nondet_bool() ? values : NULL);
        PROVE(prepared);
        break;
    }

    PROVE(in_range(state.parameter));
    return 0;
}
