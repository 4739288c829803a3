#include "core.h"

/* Exactly so where 64-bit numbers are aligned to 8 bytes, as on Cortex-M4 and 64-bit hosts. */
_Static_assert(sizeof(terrapin_state) <= TERRAPIN_STATE_BYTES, "a state fits TERRAPIN_STATE_BYTES");
typedef struct {
    uint8_t narrow;
    int64_t wide;
} alignment_probe; /* 16 bytes where 64-bit numbers are aligned to 8 */
_Static_assert(((sizeof(terrapin_state) + 8U) > TERRAPIN_STATE_BYTES) || (sizeof(alignment_probe) < 16U),
               "which is not more than it takes");
_Static_assert((TERRAPIN_STATE_BYTES % 8U) == 0U, "whole words of 8 bytes");

typedef uint32_t __attribute__((may_alias)) state_word;
enum { STATE_WORDS = sizeof(terrapin_state) / sizeof(state_word) };
_Static_assert((sizeof(terrapin_state) % sizeof(state_word)) == 0U, "a state is whole words");

size_t terrapin_state_size(void) {
    return sizeof(terrapin_state);
}

INTEGER_INLINE void clear_four(volatile state_word *word) {
    word[0] = 0U;
    word[1] = 0U;
    word[2] = 0U;
    word[3] = 0U;
}

/* All bytes zero is zero, false and the first state. By eight words, in a twelfth of what single bytes take: a host can
 * ask for a reset in any tick. volatile, or the compiler links a memset for this one use. */
static void clear(terrapin_state *state) {
    /* cppcheck-suppress misra-c2012-11.3 ; a word may alias anything, and the state is aligned as one */
    volatile state_word *word = (volatile state_word *)state;
    const uint32_t last = (uint32_t)STATE_WORDS - 8U;
    for (uint32_t i = 0U; i < last; i += 8U) {
        clear_four(&word[i]);
        clear_four(&word[i + 4U]);
    }
    clear_four(&word[last]); /* some of them again where they are no multiple of eight */
    clear_four(&word[last + 4U]);
}

terrapin_parameter_result terrapin_init_with(terrapin_state *state, const int32_t *values) {
    TERRAPIN_ASSERT(state != NULL);
    clear(state);
    const terrapin_parameter_result result = terrapin_parameter_set_all(state, values); /* the bridge is off */
    if (result != TERRAPIN_PARAMETER_OK) {
        (void)terrapin_parameter_set_all(state, NULL);
    }
    return result;
}

void terrapin_init(terrapin_state *state) {
    (void)terrapin_init_with(state, NULL);
}

void terrapin_step_drive(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs) {
    TERRAPIN_ASSERT((state != NULL) && (inputs != NULL) && (outputs != NULL));
    bool gap = false;
    const uint32_t causes = sense_update(state, inputs, &gap);
    if (gap) {
        slip_restart(state);
    }
    if (gap || (inputs->tick == 0U)) { /* 2^32 ticks are no whole number of slots */
        estimator_restart(state);
    }
    schedule_sense(state, inputs);
    slip_update(state, inputs);

    terrapin_demand demand;
    supervisor_update(state, inputs, causes, gap, &demand);
    drive_update(state, &demand);

    outputs->duty_q15 = state->drive.duty_q15;
    outputs->enable = state->drive.enable;
    outputs->faults = state->supervisor.faults;
    outputs->frame_count = 0U;
    TERRAPIN_ASSERT(outputs->enable || (outputs->duty_q15 == 0));
    TERRAPIN_ASSERT(!outputs->enable || ((outputs->faults & TERRAPIN_FAULTS_LATCHED) == 0U));
}

void terrapin_step_think(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs) {
    TERRAPIN_ASSERT((state != NULL) && (inputs != NULL) && (outputs != NULL));
    TERRAPIN_ASSERT(inputs->tick == state->sense.tick);
    schedule_work(state, inputs);
    telemetry_emit(state, inputs, outputs);
    TERRAPIN_ASSERT((outputs->frame_count >= 1U) && (outputs->frame_count <= (uint8_t)TERRAPIN_MAX_FRAMES));
}

void terrapin_step(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs) {
    terrapin_step_drive(state, inputs, outputs);
    terrapin_step_think(state, inputs, outputs);
}
