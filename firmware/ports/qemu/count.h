/* Instructions of each step and of each frame taken in, counted by SysTick: under `-icount` an instruction takes a
 * fixed virtual time, so that the counts are exact and the same in every run. Without `-icount` they mean nothing.
 *
 * The linker puts __wrap_terrapin_link_step, __wrap_telemetry_emit and __wrap_terrapin_accept in the place of those.
 */
#ifndef TERRAPIN_COUNT_H
#define TERRAPIN_COUNT_H

#include <stdint.h>

#define COUNT_NS_PER_INSTRUCTION 128U /* of -icount shift=7 */
#define COUNT_CLOCK_MHZ          168U /* of the emulated processor */

typedef struct {
    uint32_t steps;
    uint32_t minimum;
    uint32_t median;
    uint32_t maximum;
} count_summary;

/* Start SysTick; counts begin. */
void count_start(void);

/* The whole step, and the step without the encoding of its frames. */
count_summary count_whole(void);
count_summary count_without_telemetry(void);

/* Taking in one frame (terrapin_accept), without the step that it may cause. */
count_summary count_frame(void);

#endif
