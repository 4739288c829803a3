/* The seal is proved with the dispatcher. */
#include "prove_dispatch.c"
