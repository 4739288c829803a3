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
/* The longest since the last call, in 0.25 us, rounded up and at most 4095. */
uint32_t phases_take(phases *p, phase which);

#endif
