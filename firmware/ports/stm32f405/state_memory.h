/* The controller's memory. A file of its own: its size is known to the core's private header alone, which nobody else
 * includes. */
#ifndef TERRAPIN_STATE_MEMORY_H
#define TERRAPIN_STATE_MEMORY_H

#include "terrapin.h"

terrapin_state *state_memory(void);

#endif
