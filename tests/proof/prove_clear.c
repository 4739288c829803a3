/* `clear` of step.c, as a state of words alone: all of them are written, and none beside them; zero is then what every
 * part of the core begins with. */
#include "proof.h"

#include "step.c"

static state_word words[STATE_WORDS];

int main(void) {
    ANYTHING(words);
    clear((terrapin_state *)words);
    const uint32_t i = nondet_word();
    ASSUME(i < (uint32_t)STATE_WORDS);
    PROVE(words[i] == 0U);
    return 0;
}
