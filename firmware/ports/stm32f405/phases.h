/* How long the phases of a tick take: the longest of each since it was last asked, in quarters of a microsecond. */
#ifndef TERRAPIN_PHASES_H
#define TERRAPIN_PHASES_H

#include <stdint.h>

typedef enum { PHASE_RECEIVE, PHASE_SENSE, PHASE_STEP, PHASE_SEND, PHASE_LATE, PHASE_COUNT } phase;

typedef struct {
    uint32_t core_mhz;
    uint32_t longest[PHASE_COUNT]; /* cycles */
} phases;

void phases_open(phases *p, uint32_t core_hz);
/* A phase took this many cycles (a difference of the cycle counter, which wraps). */
void phases_note(phases *p, phase which, uint32_t cycles);
/* Periods that went by since *base, which moves on by as many: 1, unless the processor stood still (an erase of the
 * flash) and missed interrupts of its tick. now and *base count cycles, from before the first period began; where
 * nothing counts them, 1 each time. */
uint32_t phases_periods(uint32_t *base, uint32_t now, uint32_t period);
/* The longest since the last call, in 0.25 us, rounded up. */
int32_t phases_take_250ns(phases *p, phase which);

#endif
