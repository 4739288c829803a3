/* The calibration from any state in which supervisor.c asks for it: no sum overflows, no speed is written beyond the
 * table, and what is taken over is within the parameters' ranges. */
#include "invariant.h"

#include "calibration.c"

static terrapin_state state;

terrapin_parameter_entry terrapin_parameter(uint16_t index) {
    terrapin_parameter_entry entry;
    ANYTHING(entry);
    PROVE((index == TERRAPIN_PARAMETER_COULOMB) || (index == TERRAPIN_PARAMETER_VISCOUS));
    entry.minimum = 0;
    entry.maximum = (index == TERRAPIN_PARAMETER_COULOMB) ? 200000 : 10000000;
    return entry;
}

int32_t ground_floor_unm(const terrapin_state *s, int32_t omega_urad_s) {
    (void)s;
    (void)omega_urad_s;
    const int32_t floor = nondet_int();
    ASSUME(within(floor, HELD_OR_LEAST));
    return floor;
}

void gains_friction(terrapin_state *s) {
    PROVE((s->parameter[TERRAPIN_PARAMETER_VISCOUS] >= 0) && (s->parameter[TERRAPIN_PARAMETER_VISCOUS] <= 10000000));
    PROVE((s->parameter[TERRAPIN_PARAMETER_COULOMB] >= 0) && (s->parameter[TERRAPIN_PARAMETER_COULOMB] <= 200000));
}

static bool calibration_holds(const terrapin_state *s) {
    const terrapin_calibration_state *c = &s->calibration;
    const int32_t windows = c->windows;
    return (c->step <= TERRAPIN_LIMIT_CALIBRATE_SPEEDS) && (windows < CALIBRATE_WINDOWS) &&
           (c->omega_sum_urad_s >= 0) && (c->omega_sum_urad_s <= (windows * OMEGA_MAX_URAD_S)) &&
           within(c->torque_sum_unm, windows * TORQUE_MAX_UNM) && (c->fit <= (uint8_t)FIT_FAILED);
}

int main(void) {
    int32_t voltage_mv = nondet_int();
    ANYTHING(state);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state) && calibration_holds(&state));
    ASSUME((state.calibration.fit != FIT_NONE) ||
           ((int32_t)state.calibration.step < state.parameter[TERRAPIN_PARAMETER_CALIBRATE_STEPS]));
    ASSUME((state.calibration.fit != FIT_FAILED) || (state.calibration.step > 0U));
    ASSUME(state.calibration.timer_ms <= 60000U);
    const uint8_t which = nondet_byte();

    if (which == 0U) {
        calibration_start(&state);
    } else {
        (void)calibration_update(&state, &voltage_mv);
        PROVE(within(voltage_mv, 32768)); /* as drive.c may take it */
    }

    PROVE(calibration_holds(&state));
    return 0;
}
