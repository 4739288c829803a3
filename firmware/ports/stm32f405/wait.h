/* Waiting for hardware, never for ever; and writing registers where a write is more than a value kept. */
#ifndef TERRAPIN_WAIT_H
#define TERRAPIN_WAIT_H

#include <stdbool.h>
#include <stdint.h>

#ifndef TERRAPIN_SPIN
#define TERRAPIN_SPIN() ((void)0) /* a test's hardware moves here */
#endif
#ifndef TERRAPIN_PUT
#define TERRAPIN_PUT(reg, value) ((reg) = (value)) /* and sees here what is written */
#endif

/* Read a register until the bits of mask are those of value, at most `tries` times; false when that never came.
 * One try is about 8 cycles of the core. */
static inline bool wait_for(const volatile uint32_t *address, uint32_t mask, uint32_t value, uint32_t tries) {
    for (uint32_t i = 0; i < tries; i++) {
        if ((*address & mask) == value) {
            return true;
        }
        TERRAPIN_SPIN();
    }
    return false;
}

#endif
