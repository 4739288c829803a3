#include "count.h"

#include "core.h"
#include "dispatch.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010U)
#define SYSTICK_RELOAD  (*(volatile uint32_t *)0xE000E014U)
#define SYSTICK_VALUE   (*(volatile uint32_t *)0xE000E018U)
#define SYSTICK_TOP     0x00FFFFFFU
#define SYSTICK_ON      0x5U /* counting, on the processor's clock, no interrupt */

#define BINS  4096U /* counts from BINS * WIDTH on share the last */
#define WIDTH 16U   /* instructions that share a bin: the median is known to that */

typedef struct {
    uint32_t bin[BINS];
    uint32_t steps;
    uint32_t minimum;
    uint32_t maximum;
} histogram;

static histogram whole;
static histogram bare;
static histogram frame_taken;
static uint32_t telemetry; /* SysTick's counts within telemetry_emit in this step */

void __real_terrapin_link_step(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs);
void __real_telemetry_emit(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);
void __wrap_terrapin_link_step(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs);
terrapin_accept_result __real_terrapin_accept(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                              terrapin_inputs *inputs, terrapin_frame *reply);
terrapin_accept_result __wrap_terrapin_accept(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                              terrapin_inputs *inputs, terrapin_frame *reply);
void __wrap_telemetry_emit(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);

void count_start(void) {
    SYSTICK_RELOAD = SYSTICK_TOP;
    SYSTICK_VALUE = 0U;
    SYSTICK_CONTROL = SYSTICK_ON;
}

/* SysTick counts down. */
static uint32_t elapsed(uint32_t before, uint32_t after) {
    return (before - after) & SYSTICK_TOP;
}

/* Instructions, rounded: 168 counts a microsecond, 0.128 us an instruction. */
static uint32_t instructions(uint32_t counts) {
    const uint32_t per_thousand = (COUNT_CLOCK_MHZ * COUNT_NS_PER_INSTRUCTION);
    return ((counts * 1000U) + (per_thousand / 2U)) / per_thousand;
}

static void add(histogram *h, uint32_t count) {
    const uint32_t bin = count / WIDTH;
    h->bin[(bin < BINS) ? bin : (BINS - 1U)]++;
    h->minimum = ((h->steps == 0U) || (count < h->minimum)) ? count : h->minimum;
    h->maximum = (count > h->maximum) ? count : h->maximum;
    h->steps++;
}

static count_summary summary(const histogram *h) {
    uint32_t seen = 0;
    uint32_t median = 0;
    while ((median < (BINS - 1U)) && ((seen + h->bin[median]) <= (h->steps / 2U))) {
        seen += h->bin[median];
        median++;
    }
    return (count_summary){h->steps, h->minimum, (median * WIDTH) + (WIDTH / 2U), h->maximum};
}

/* Each adds the few instructions of its own two readings: counts are high by those. */
void __wrap_telemetry_emit(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs) {
    const uint32_t before = SYSTICK_VALUE;
    __real_telemetry_emit(state, inputs, outputs);
    telemetry += elapsed(before, SYSTICK_VALUE);
}

void __wrap_terrapin_link_step(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs) {
    telemetry = 0U;
    const uint32_t before = SYSTICK_VALUE;
    __real_terrapin_link_step(state, inputs, outputs);
    const uint32_t counts = elapsed(before, SYSTICK_VALUE);
    add(&whole, instructions(counts));
    add(&bare, instructions(counts - telemetry));
}

terrapin_accept_result __wrap_terrapin_accept(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                              terrapin_inputs *inputs, terrapin_frame *reply) {
    const uint32_t before = SYSTICK_VALUE;
    const terrapin_accept_result result = __real_terrapin_accept(link, state, frame, inputs, reply);
    add(&frame_taken, instructions(elapsed(before, SYSTICK_VALUE)));
    return result;
}

count_summary count_frame(void) {
    return summary(&frame_taken);
}

count_summary count_whole(void) {
    return summary(&whole);
}

count_summary count_without_telemetry(void) {
    return summary(&bare);
}
