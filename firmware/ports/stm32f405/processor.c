#include "processor.h"

#include "instructions.h"
#include "registers.h"
#include "wait.h"

extern uint32_t image_stack[], image_stack_end[];

/* An address that a probe may read in vain; set while it does. */
static volatile bool probing;
static volatile bool probe_refused;

_Noreturn void system_reset(void) {
    interrupts_off();
    writes_end();
    TERRAPIN_PUT(SCB->AIRCR, SCB_AIRCR_RESET);
    for (;;) {
    }
}

bool probe_failed(uint32_t *frame, uint32_t status) {
    const bool probes = probing && ((status & SCB_CFSR_PRECISE) != 0U);
    if (probes) {
        SCB->CFSR = status; /* cleared by writing ones */
        probe_refused = true;
        frame[6] += 2U;
    }
    return probes;
}

bool probe_read(uint32_t address, uint32_t *value) {
    probe_refused = false;
    probing = true;
    const uint32_t found = read_narrow(address);
    probing = false;
    if (probe_refused) {
        return false;
    }
    *value = found;
    return true;
}

uint32_t stack_used(void) {
    const uint32_t *word = &image_stack[STACK_GUARD_BYTES / sizeof image_stack[0]];
    while ((word < image_stack_end) && (*word == STACK_PATTERN)) {
        word++;
    }
    return (uint32_t)((uintptr_t)image_stack_end - (uintptr_t)word);
}

_Noreturn void start_image(uint32_t address) {
    const uint32_t *table = (const uint32_t *)(uintptr_t)address;
    interrupts_off();
    SYSTICK->CTRL = 0U;
    SCB->ICSR = SCB_ICSR_PENDSTCLR; /* a tick that came meanwhile would be the image's, before it has any memory */
    for (uint32_t i = 0U; i < ((IRQ_COUNT + 31U) / 32U); i++) {
        NVIC_ICER[i] = 0xFFFFFFFFU;
        NVIC_ICPR[i] = 0xFFFFFFFFU;
    }
    MPU->CTRL = 0U;
    SCB->VTOR = address;
    begin_at(table[0], table[1]);
    for (;;) {
    }
}
