/* Reset of a Cortex-M4: memory as C expects it, stack filled with a pattern so that its use can be measured, then main.
 * Any exception ends the emulator with status 3: nothing here runs on after a fault.
 */
#include <stdint.h>

#include "semihosting.h"

extern uint32_t image_data_load[], image_data[], image_data_end[], image_bss[], image_bss_end[];
extern uint32_t image_stack_end[];

int main(void);
_Noreturn void reset(void);
static _Noreturn void fault(void);

#define STATUS_FAULT 3

typedef void (*handler)(void);
__attribute__((section(".vectors"), used)) static const handler vectors[16] = {
    (handler)image_stack_end, reset, fault, fault, fault, fault, fault, 0, 0, 0, 0, fault, fault, 0, fault, fault,
};

_Noreturn void reset(void) {
    const uint32_t *from = image_data_load;
    for (uint32_t *to = image_data; to < image_data_end; to++) {
        *to = *from;
        from++;
    }
    for (uint32_t *to = image_bss; to < image_bss_end; to++) {
        *to = 0U;
    }
    semihosting_exit(main());
}

static _Noreturn void fault(void) {
    semihosting_exit(STATUS_FAULT);
}
