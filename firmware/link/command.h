/* Who may command: what STOP_ALL, COMMAND and COMMAND_SEALED make of the command of a tick. Of use to dispatch.c alone.
 *
 * An IDLE is taken of anybody, with any counter, and nothing takes its place in its tick. STOP_ALL is taken of anybody,
 * too, and is a latched fault: the state is safe until a COMMAND says clear, in a later tick. A controller with a link
 * key takes everything else sealed (seal.h).
 */
#ifndef TERRAPIN_COMMAND_H
#define TERRAPIN_COMMAND_H

#include "dispatch.h"

void command_stop_all(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame, terrapin_inputs *inputs);

/* COMMAND, or a COMMAND_SEALED whose tag was good. */
void command_accept(terrapin_link *link, const terrapin_frame *frame, terrapin_inputs *inputs);

#endif
