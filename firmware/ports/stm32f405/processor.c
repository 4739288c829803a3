#include "processor.h"

#include "registers.h"

extern uint32_t image_stack[], image_stack_end[];

/* An address that a probe may read in vain; set while it does. */
static volatile bool probing;
static volatile bool probe_refused;

_Noreturn void system_reset(void) {
    __asm__ volatile("cpsid i\n dsb" ::: "memory");
    SCB->AIRCR = SCB_AIRCR_RESET;
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
    uint32_t found = 0U;
    probe_refused = false;
    probing = true;
    __asm__ volatile("dsb\n ldr.n %0, [%1]\n dsb" : "=&l"(found) : "l"(address) : "memory");
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
    const uint32_t *table = (const uint32_t *)address;
    __asm__ volatile("cpsid i" ::: "memory");
    SYSTICK->CTRL = 0U;
    SCB->ICSR = SCB_ICSR_PENDSTCLR; /* a tick that came meanwhile would be the image's, before it has any memory */
    for (uint32_t i = 0U; i < ((IRQ_COUNT + 31U) / 32U); i++) {
        NVIC_ICER[i] = 0xFFFFFFFFU;
        NVIC_ICPR[i] = 0xFFFFFFFFU;
    }
    MPU->CTRL = 0U;
    SCB->VTOR = address;
    __asm__ volatile("dsb\n isb\n"
                     "msr msp, %0\n"
                     "cpsie i\n" /* as after a reset */
                     "bx %1\n"
                     :
                     : "r"(table[0]), "r"(table[1])
                     : "memory");
    for (;;) {
    }
}
