#include "core.h"

terrapin_parameter_result terrapin_parameter_set(terrapin_state *state, uint16_t index, int32_t value) {
    terrapin_parameter_result result = TERRAPIN_PARAMETER_OK;
    const int32_t number = index;
    if (number >= TERRAPIN_PARAMETER_COUNT) {
        result = TERRAPIN_PARAMETER_UNKNOWN;
    } else {
        const terrapin_parameter_entry *entry = &terrapin_parameters[index];
        const bool locked = state->drive.enable && terrapin_parameter_protected(index);
        if (locked) {
            result = TERRAPIN_PARAMETER_LOCKED;
        } else if ((value < entry->minimum) || (value > entry->maximum)) {
            result = TERRAPIN_PARAMETER_RANGE;
        } else {
            state->parameter[index] = value;
            gains_prepare(state);
            if (number == TERRAPIN_PARAMETER_WINDOW) { /* the only one that the windows under way depend on */
                estimator_restart(state);
            }
        }
    }
    return result;
}

terrapin_parameter_result terrapin_parameter_get(const terrapin_state *state, uint16_t index, int32_t *value) {
    terrapin_parameter_result result = TERRAPIN_PARAMETER_UNKNOWN;
    const int32_t number = index;
    if (number < TERRAPIN_PARAMETER_COUNT) {
        *value = state->parameter[index];
        result = TERRAPIN_PARAMETER_OK;
    }
    return result;
}

bool terrapin_bridge_on(const terrapin_state *state) {
    return state->drive.enable;
}
