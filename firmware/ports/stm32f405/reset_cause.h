/* Why the chip started. */
#ifndef TERRAPIN_RESET_CAUSE_H
#define TERRAPIN_RESET_CAUSE_H

#include "registers.h"
#include "retained.h"

/* Numbers of enum reset_cause in controller.toml. `flags` is RCC CSR as read, `noted` what the firmware left behind. */
uint8_t reset_cause(uint32_t flags, retained_reason noted);

/* Forget the flags, so that the next start sees its own. A boot loader must not. */
void reset_cause_forget(rcc_registers *rcc);

#endif
