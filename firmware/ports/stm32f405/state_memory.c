#include "state_memory.h"

#include "state.h"

terrapin_state *state_memory(void) {
    static terrapin_state memory;
    return &memory;
}
