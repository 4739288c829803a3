#include "stack.h"

#define PATTERN 0x5AFE57ACU

extern uint32_t image_stack[], image_stack_end[];

void stack_paint(void) {
    uintptr_t pointer;
    __asm__ volatile("mov %0, sp" : "=r"(pointer));
    for (uint32_t *word = image_stack; (uintptr_t)word < pointer; word++) {
        *word = PATTERN;
    }
}

uint32_t stack_used(void) {
    const uint32_t *word = image_stack;
    while ((word < image_stack_end) && (*word == PATTERN)) {
        word++;
    }
    return (uint32_t)((uintptr_t)image_stack_end - (uintptr_t)word);
}
