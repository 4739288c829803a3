#include "startup.h"

#include "instructions.h"
#include "processor.h"
#include "registers.h"
#include "retained.h"

extern uint32_t image_data_load[], image_data[], image_data_end[], image_bss[], image_bss_end[];
extern uint32_t image_stack[], image_stack_end[];

typedef void (*handler)(void);

_Noreturn void reset(void);
void fault(void);
void fault_seen(uint32_t *frame); /* called from assembly alone */
static void nothing(void);
static _Noreturn void stray(void);
static _Noreturn void crystal_stopped(void);

__attribute__((weak, alias("nothing"))) void emergency_stop(void);
__attribute__((weak, alias("nothing"))) void systick_interrupt(void);
__attribute__((weak, alias("nothing"))) void usart1_interrupt(void);
__attribute__((weak, alias("nothing"))) void can1_receive_interrupt(void);

#define STRAY_4  stray, stray, stray, stray
#define STRAY_16 STRAY_4, STRAY_4, STRAY_4, STRAY_4

/* RM0090, table 62. Interrupts that nobody enables lead to stray(). */
__attribute__((section(".vectors"), used)) static const handler vectors[16U + IRQ_COUNT] = {
    (handler)image_stack_end,
    reset,
    crystal_stopped /* NMI: clock security */,
    fault,
    fault,
    fault,
    fault,
    stray,
    STRAY_4,
    stray,
    stray,
    stray,
    systick_interrupt, /* 7 to 15 */
    STRAY_16,
    STRAY_4,                /* interrupts 0 to 19 */
    can1_receive_interrupt, /* 20 */
    STRAY_16,               /* to 36 */
    usart1_interrupt,       /* 37 */
    STRAY_16,
    STRAY_16,
    STRAY_4,
    STRAY_4,
    STRAY_4, /* to 81 */
};
_Static_assert((IRQ_CAN1_RX0 == 20U) && (IRQ_USART1 == 37U) && (IRQ_COUNT == 82U), "as listed");

static void nothing(void) {}

static _Noreturn void stray(void) {
    emergency_stop();
    retained_note(&retained, RETAINED_PROCESSOR_FAULT, 0U, SCB->ICSR);
    system_reset();
}

static _Noreturn void crystal_stopped(void) {
    emergency_stop();
    retained_note(&retained, RETAINED_CRYSTAL_STOPPED, 0U, 0U);
    system_reset(); /* to start again on 16 MHz, with a tick that fits it */
}

/* With the guard hit there is no stack to push on: look at the pointer first, and begin a new stack when little is left
 * of the old one. A fault while probing goes on behind the instruction that failed, which is one of 2 bytes. */
#if defined(__arm__)
__attribute__((naked)) void fault(void) {
    __asm__ volatile("mov r0, sp\n"
                     "ldr r1, =image_stack + 256\n"
                     "cmp r0, r1\n"
                     "bhs 1f\n"
                     "ldr r1, =image_stack_end\n"
                     "mov sp, r1\n"
                     "1: push {r4, lr}\n"
                     "bl fault_seen\n"
                     "pop {r4, pc}\n");
}
#endif

/* The guard was hit by what the exception pushed, whose frame then reaches into it, or by the instruction itself: a
 * push whose last words meet the guard leaves the pointer as it was, and above it the frame may find room. */
static bool stack_is_gone(const uint32_t *frame, uint32_t status) {
    const uintptr_t guard = (uintptr_t)image_stack;
    const bool named = ((status & SCB_CFSR_MMARVALID) != 0U) && ((SCB->MMFAR - (uint32_t)guard) < STACK_GUARD_BYTES);
    return named || ((uintptr_t)frame < (guard + STACK_GUARD_BYTES));
}

/* Returns only when it was a probe's. */
__attribute__((used)) void fault_seen(uint32_t *frame) {
    const uint32_t status = SCB->CFSR;
    const bool stack_gone = stack_is_gone(frame, status);
    if (!stack_gone && probe_failed(frame, status)) {
        return;
    }
    emergency_stop();
    const uint32_t address = stack_gone ? 0U : frame[6];
    retained_note(&retained, stack_gone ? RETAINED_STACK_OVERFLOW : RETAINED_PROCESSOR_FAULT, address, status);
    system_reset();
}

/* The lowest 32 bytes of the stack belong to nobody: touching them is a fault. */
static void guard_stack(void) {
    MPU->RNR = 0U;
    MPU->RBAR = (uint32_t)(uintptr_t)image_stack;
    MPU->RASR = MPU_RASR_NO_ACCESS | MPU_RASR_32_BYTES | MPU_RASR_ENABLE;
    MPU->CTRL = MPU_CTRL_ENABLE | MPU_CTRL_PRIVDEFENA;
    writes_take_effect();
}

static void paint_stack(void) {
    const uintptr_t pointer = stack_pointer();
    for (uint32_t *word = image_stack; (uintptr_t)word < pointer; word++) {
        *word = STACK_PATTERN;
    }
}

_Noreturn void reset(void) {
    interrupts_off();
    MPU->CTRL = 0U; /* a boot loader's guard is not this image's */
    SCB->VTOR = (uint32_t)(uintptr_t)vectors;
    paint_stack();
    const uint32_t *from = image_data_load;
    for (uint32_t *to = image_data; to < image_data_end; to++) {
        *to = *from;
        from++;
    }
    for (uint32_t *to = image_bss; to < image_bss_end; to++) {
        *to = 0U;
    }
    guard_stack();
    interrupts_on();
    application();
}
