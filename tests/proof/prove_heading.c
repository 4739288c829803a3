/* heading_slot from any state: the path stays within its range, whatever the ground wheel and the heading say. */
#include "invariant.h"

#include "heading.c"

static terrapin_state state;
static terrapin_inputs inputs;

int main(void) {
    ANYTHING(state);
    ANYTHING(inputs);
    ASSUME(state_holds(&state));

    heading_slot(&state, &inputs);

    PROVE(heading_holds(&state));
    return 0;
}
