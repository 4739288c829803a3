#include "clock.h"

#include "wait.h"

/* Of wait_for, at 16 MHz about 2 million a second. DS8626: a crystal takes 2 ms, the PLL 0.3 ms, the rest less. */
#define TRIES_CRYSTAL 200000U
#define TRIES_PLL     20000U

static clocks internal_clocks(clock_result result, uint32_t hz) {
    const clocks slow = {.result = result, .core_hz = hz, .apb1_hz = hz, .apb2_hz = hz, .tim_hz = hz};
    return slow;
}

/* The PLL takes no other setting while it runs: what ran before, such as ST's boot loader, may have left it on. */
static void set_pll(rcc_registers *rcc, uint32_t setting) {
    const uint32_t wanted = (rcc->PLLCFGR & ~RCC_PLLCFGR_ALL) | setting;
    if ((rcc->PLLCFGR != wanted) && ((rcc->CR & RCC_CR_PLLON) != 0U)) {
        rcc->CR |= RCC_CR_HSION;
        (void)wait_for(&rcc->CR, RCC_CR_HSIRDY, RCC_CR_HSIRDY, TRIES_PLL);
        rcc->CFGR &= ~RCC_CFGR_SW;
        (void)wait_for(&rcc->CFGR, RCC_CFGR_SWS, 0U, TRIES_PLL);
        rcc->CR &= ~RCC_CR_PLLON;
        (void)wait_for(&rcc->CR, RCC_CR_PLLRDY, 0U, TRIES_PLL);
    }
    TERRAPIN_PUT(rcc->PLLCFGR, wanted);
}

static clock_result raise_speed(rcc_registers *rcc, flash_registers *flash, pwr_registers *pwr, uint32_t crystal_hz) {
    rcc->CR |= RCC_CR_HSEON;
    if (!wait_for(&rcc->CR, RCC_CR_HSERDY, RCC_CR_HSERDY, TRIES_CRYSTAL)) {
        rcc->CR &= ~RCC_CR_HSEON;
        return CLOCK_NO_CRYSTAL;
    }
    pwr->CR |= PWR_CR_VOS_FAST;
    /* 1 MHz into the PLL, its oscillator at 336 MHz, half of that out */
    set_pll(rcc, (crystal_hz / 1000000U) | (336U << RCC_PLLCFGR_N) | (0U << RCC_PLLCFGR_P) | RCC_PLLCFGR_HSE |
                     (7U << RCC_PLLCFGR_Q));
    rcc->CR |= RCC_CR_PLLON;
    if (!wait_for(&rcc->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, TRIES_PLL)) {
        rcc->CR &= ~(RCC_CR_PLLON | RCC_CR_HSEON);
        return CLOCK_NO_PLL;
    }
    /* Five wait states at 168 MHz and 2.7 V, in force before the clock rises (RM0090, 3.5.1). */
    flash->ACR = 5U | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    if (!wait_for(&flash->ACR, FLASH_ACR_LATENCY, 5U, TRIES_PLL)) {
        rcc->CR &= ~(RCC_CR_PLLON | RCC_CR_HSEON);
        return CLOCK_NO_SWITCH;
    }
    rcc->CFGR = (rcc->CFGR & ~RCC_CFGR_PRE) | RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2;
    rcc->CFGR = (rcc->CFGR & ~RCC_CFGR_SW) | RCC_CFGR_SW_PLL;
    if (!wait_for(&rcc->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL, TRIES_PLL)) {
        rcc->CFGR &= ~(RCC_CFGR_SW | RCC_CFGR_PRE);
        rcc->CR &= ~(RCC_CR_PLLON | RCC_CR_HSEON);
        return CLOCK_NO_SWITCH;
    }
    rcc->CR |= RCC_CR_CSSON; /* a crystal that stops later: back to 16 MHz by hardware, and an NMI */
    return CLOCK_GOOD;
}

clocks clock_start(rcc_registers *rcc, flash_registers *flash, pwr_registers *pwr, uint32_t crystal_hz,
                   uint32_t internal_hz) {
    rcc->AHB1ENR |= RCC_AHB1_GPIO_ALL | RCC_AHB1_DMA2;
    rcc->APB1ENR |= RCC_APB1_TIM2 | RCC_APB1_TIM3 | RCC_APB1_TIM4 | RCC_APB1_CAN1 | RCC_APB1_PWR;
    rcc->APB2ENR |= RCC_APB2_TIM1 | RCC_APB2_USART1 | RCC_APB2_ADC1 | RCC_APB2_SPI1;
    const clock_result result = raise_speed(rcc, flash, pwr, crystal_hz);
    if (result != CLOCK_GOOD) {
        return internal_clocks(result, internal_hz);
    }
    const clocks fast = {.result = CLOCK_GOOD,
                         .core_hz = CLOCK_FAST_HZ,
                         .apb1_hz = CLOCK_FAST_HZ / 4U,
                         .apb2_hz = CLOCK_FAST_HZ / 2U,
                         .tim_hz = CLOCK_FAST_HZ};
    return fast;
}
