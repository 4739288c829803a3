/* What terrapin_accept shows holds for its commands: the same harness, with defects planted in command.c. */
#include "prove_dispatch.c"
