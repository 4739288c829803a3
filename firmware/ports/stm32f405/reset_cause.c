#include "reset_cause.h"

#include "terrapin_interface.h"

uint8_t reset_cause(uint32_t flags, retained_reason noted) {
    /* The chip's reset pulls the pin as well, so PINRSTF alone is the pin; power-on also sets the brown-out flag. */
    if ((flags & RCC_CSR_PORRSTF) != 0U) {
        return TERRAPIN_RESET_CAUSE_POWER_ON;
    }
    if ((flags & RCC_CSR_BORRSTF) != 0U) {
        return TERRAPIN_RESET_CAUSE_BROWN_OUT;
    }
    if ((flags & (RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF)) != 0U) {
        return TERRAPIN_RESET_CAUSE_WATCHDOG;
    }
    switch (noted) {
    case RETAINED_PROCESSOR_FAULT:
        return TERRAPIN_RESET_CAUSE_PROCESSOR_FAULT;
    case RETAINED_STACK_OVERFLOW:
        return TERRAPIN_RESET_CAUSE_STACK_OVERFLOW;
    case RETAINED_CRYSTAL_STOPPED:
        return TERRAPIN_RESET_CAUSE_CRYSTAL_STOPPED;
    case RETAINED_NOTHING:
    case RETAINED_UPDATE:
    default:
        break;
    }
    if ((flags & RCC_CSR_SFTRSTF) != 0U) {
        return TERRAPIN_RESET_CAUSE_SOFTWARE;
    }
    if ((flags & RCC_CSR_LPWRRSTF) != 0U) {
        return TERRAPIN_RESET_CAUSE_LOW_POWER;
    }
    if ((flags & RCC_CSR_PINRSTF) != 0U) {
        return TERRAPIN_RESET_CAUSE_PIN;
    }
    return TERRAPIN_RESET_CAUSE_UNKNOWN;
}

void reset_cause_forget(rcc_registers *rcc) {
    rcc->CSR |= RCC_CSR_RMVF;
}
