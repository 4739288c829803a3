/* Reset and exceptions of a Cortex-M4: what an image (controller, boot loader) starts from.
 *
 * After reset: vectors, memory as C expects it, stack filled with a pattern and guarded, then application(). An image
 * defines application() and those of the weak functions below that it needs; the others do nothing.
 */
#ifndef TERRAPIN_STARTUP_H
#define TERRAPIN_STARTUP_H

/* The image's own; it never returns. Interrupts are enabled. */
_Noreturn void application(void);

/* Called when the processor can no longer be trusted, before the chip is reset: outputs off, by registers alone. The
 * stack may be gone: no variable but constants. */
void emergency_stop(void);

void systick_interrupt(void);
void usart1_interrupt(void);
void can1_receive_interrupt(void);

#endif
