/* The clock tree: crystal and PLL to 168 MHz, or, when one of them does not come, on with the internal 16 MHz. */
#ifndef TERRAPIN_CLOCK_H
#define TERRAPIN_CLOCK_H

#include "registers.h"

#define CLOCK_FAST_HZ 168000000U
#define CLOCK_HSI_HZ  16000000U

typedef enum { CLOCK_GOOD = 0, CLOCK_NO_CRYSTAL = 1, CLOCK_NO_PLL = 2, CLOCK_NO_SWITCH = 3 } clock_result;

typedef struct {
    clock_result result;
    uint32_t core_hz; /* also SysTick's */
    uint32_t apb1_hz; /* CAN */
    uint32_t apb2_hz; /* USART1, ADC */
    uint32_t tim_hz;  /* TIM1 */
} clocks;

/* Start them. crystal_hz is a whole number of MHz, 4 to 26; internal_hz what the core runs at without it (CLOCK_HSI_HZ
 * on every chip). Takes at most about 0.2 s, whatever is missing. The clocks of all peripherals that the port uses are
 * on afterwards. When the crystal stops later, the chip goes on with 16 MHz by itself and raises an NMI. */
clocks clock_start(rcc_registers *rcc, flash_registers *flash, pwr_registers *pwr, uint32_t crystal_hz,
                   uint32_t internal_hz);

#endif
