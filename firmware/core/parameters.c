#include "core.h"

terrapin_parameter_result terrapin_parameter_set(terrapin_state *state, uint16_t index, int32_t value) {
    TERRAPIN_ASSERT(state != NULL);
    terrapin_parameter_result result = TERRAPIN_PARAMETER_OK;
    const int32_t number = index;
    if (number >= TERRAPIN_PARAMETER_COUNT) {
        result = TERRAPIN_PARAMETER_UNKNOWN;
    } else {
        const terrapin_parameter_entry entry = terrapin_parameter(index);
        TERRAPIN_ASSERT((entry.minimum <= entry.default_value) && (entry.default_value <= entry.maximum));
        const bool locked = state->drive.enable && terrapin_parameter_protected(index);
        if (locked) {
            result = TERRAPIN_PARAMETER_LOCKED;
        } else if ((value < entry.minimum) || (value > entry.maximum)) {
            result = TERRAPIN_PARAMETER_RANGE;
        } else {
            state->parameter[index] = value;
            if (terrapin_parameter_protected(index)) {
                gains_prepare(state);
            } else if (number ==
                       TERRAPIN_PARAMETER_COMP_SLOPE) { /* a flood of writes while it drives must cost little */
                gains_slope(state);
            } else {
                /* the table of terrains is read as it stands */
            }
            if (number == TERRAPIN_PARAMETER_WINDOW) { /* the only one that the windows under way depend on */
                estimator_restart(state);
            }
        }
    }
    return result;
}

terrapin_parameter_result terrapin_parameter_get(const terrapin_state *state, uint16_t index, int32_t *value) {
    TERRAPIN_ASSERT((state != NULL) && (value != NULL));
    terrapin_parameter_result result = TERRAPIN_PARAMETER_UNKNOWN;
    const int32_t number = index;
    if (number < TERRAPIN_PARAMETER_COUNT) {
        *value = state->parameter[index];
        result = TERRAPIN_PARAMETER_OK;
    }
    return result;
}

const int32_t *terrapin_parameter_values(const terrapin_state *state) {
    TERRAPIN_ASSERT(state != NULL);
    return state->parameter;
}

terrapin_parameter_result terrapin_parameter_set_all(terrapin_state *state, const int32_t *values) {
    TERRAPIN_ASSERT(state != NULL);
    terrapin_parameter_result result = state->drive.enable ? TERRAPIN_PARAMETER_LOCKED : TERRAPIN_PARAMETER_OK;
    if ((values != NULL) && !terrapin_parameters_in_range(values)) {
        result = TERRAPIN_PARAMETER_RANGE;
    }
    if (result == TERRAPIN_PARAMETER_OK) {
        if (values == NULL) {
            terrapin_parameter_defaults(state->parameter);
        }
        for (int32_t i = 0; (values != NULL) && (i < TERRAPIN_PARAMETER_COUNT); i++) {
            state->parameter[i] = values[i];
        }
        gains_prepare(state);
        estimator_restart(state);
    }
    return result;
}

bool terrapin_bridge_on(const terrapin_state *state) {
    TERRAPIN_ASSERT(state != NULL);
    return state->drive.enable;
}
