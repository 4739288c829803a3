/* What a Cortex-M4 does that C has no words for, and nothing else. On a host these are a test's own functions. */
#ifndef TERRAPIN_INSTRUCTIONS_H
#define TERRAPIN_INSTRUCTIONS_H

#include <stdint.h>

#if defined(__arm__)
#define TERRAPIN_INSTRUCTION __attribute__((always_inline)) static inline

TERRAPIN_INSTRUCTION void interrupts_off(void) {
    __asm__ volatile("cpsid i" ::: "memory");
}

TERRAPIN_INSTRUCTION void interrupts_on(void) {
    __asm__ volatile("cpsie i" ::: "memory");
}

/* What was written before has arrived. */
TERRAPIN_INSTRUCTION void writes_end(void) {
    __asm__ volatile("dsb" ::: "memory");
}

/* And what is executed next knows it. */
TERRAPIN_INSTRUCTION void writes_take_effect(void) {
    __asm__ volatile("dsb\n isb" ::: "memory");
}

/* Until an interrupt is pending, be they off or not. */
TERRAPIN_INSTRUCTION void sleep_until_interrupt(void) {
    __asm__ volatile("dsb\n wfi" ::: "memory");
}

TERRAPIN_INSTRUCTION uintptr_t stack_pointer(void) {
    uintptr_t pointer = 0;
    __asm__ volatile("mov %0, sp" : "=r"(pointer));
    return pointer;
}

/* Read a word by an instruction of 2 bytes; a fault that it causes has come when this returns. */
TERRAPIN_INSTRUCTION uint32_t read_narrow(uint32_t address) {
    uint32_t found = 0U;
    __asm__ volatile("dsb\n ldr.n %0, [%1]\n dsb" : "=&l"(found) : "l"(address) : "memory");
    return found;
}

/* As after a reset: this stack, interrupts on, and on from there. */
TERRAPIN_INSTRUCTION void begin_at(uint32_t stack, uint32_t entry) {
    __asm__ volatile("dsb\n isb\n"
                     "msr msp, %0\n"
                     "cpsie i\n"
                     "bx %1\n"
                     :
                     : "r"(stack), "r"(entry)
                     : "memory");
}
#else
void interrupts_off(void);
void interrupts_on(void);
void writes_end(void);
void writes_take_effect(void);
void sleep_until_interrupt(void);
uintptr_t stack_pointer(void);
uint32_t read_narrow(uint32_t address);
void begin_at(uint32_t stack, uint32_t entry);
#endif

#endif
