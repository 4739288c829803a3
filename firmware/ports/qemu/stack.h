/* How much of the stack was ever used: painted at the start, read at the end. */
#ifndef TERRAPIN_STACK_H
#define TERRAPIN_STACK_H

#include <stdint.h>

/* Fill what lies below the present frame with a pattern. */
void stack_paint(void);

/* Bytes from the deepest place that was written to the stack's top. */
uint32_t stack_used(void);

#endif
