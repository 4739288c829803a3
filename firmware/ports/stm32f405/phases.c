#include "phases.h"

void phases_open(phases *p, uint32_t core_hz) {
    *p = (phases){.core_mhz = (core_hz < 1000000U) ? 1U : (core_hz / 1000000U)};
}

void phases_note(phases *p, phase which, uint32_t cycles) {
    if (cycles > p->longest[which]) {
        p->longest[which] = cycles;
    }
}

int32_t phases_take_250ns(phases *p, phase which) {
    const uint64_t quarters = (((uint64_t)p->longest[which] * 4U) + p->core_mhz - 1U) / p->core_mhz;
    p->longest[which] = 0U;
    return (quarters > (uint64_t)INT32_MAX) ? INT32_MAX : (int32_t)quarters;
}

uint32_t phases_periods(uint32_t *base, uint32_t now, uint32_t period) {
    const uint32_t periods = (now - *base) / period;
    *base += periods * period;
    return (periods > 0U) ? periods : 1U;
}
