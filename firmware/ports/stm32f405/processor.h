/* A Cortex-M4 itself: what an image asks of it once it runs. */
#ifndef TERRAPIN_PROCESSOR_H
#define TERRAPIN_PROCESSOR_H

#include <stdbool.h>
#include <stdint.h>

#define STACK_PATTERN     0x5AFE57ACU /* what the start fills it with */
#define STACK_GUARD_BYTES 32U         /* at its end, that belong to nobody: touching them is a fault */

/* Read a word that may not be there; false when the bus refused (then *value stays). */
bool probe_read(uint32_t address, uint32_t *value);

/* For the handler of faults: true when a probe caused this one, which then goes on behind the instruction that failed.
 * `frame` is what the processor stacked, `status` its fault status register. */
bool probe_failed(uint32_t *frame, uint32_t status);

/* Bytes of stack that were ever used; up to the linker script's STACK_SIZE. */
uint32_t stack_used(void);

/* Reset the chip. */
_Noreturn void system_reset(void);

/* Leave for another image, whose vectors stand at `address`: interrupts off, its stack, its reset. */
_Noreturn void start_image(uint32_t address);

#endif
