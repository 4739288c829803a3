/* The chip's parts against registers made of memory: a clock that does not come, flash that refuses, samples that fail
 * to arrive, a dead time that must not be shorter than asked. */
#include <stdio.h>
#include <string.h>

#include "unity.h"

#include <stdint.h>

static void hardware_moves(void);
static void hardware_takes(volatile uint32_t *address, uint32_t value);
#define TERRAPIN_SPIN()          hardware_moves()
#define TERRAPIN_PUT(reg, value) hardware_takes(&(reg), (value))

#include "../../firmware/ports/stm32f405/analog.c"
#include "../../firmware/ports/stm32f405/bridge.c"
#include "../../firmware/ports/stm32f405/clock.c"
#include "../../firmware/ports/encoder_count.h"
#include "../../firmware/ports/stm32f405/encoder.c"
#include "../../firmware/ports/stm32f405/flash.c"
#include "../../firmware/ports/stm32f405/phases.c"
#include "../../firmware/ports/stm32f405/pins.c"
#include "../../firmware/ports/stm32f405/reset_cause.c"
#include "../../firmware/ports/stm32f405/retained.c"
#include "../../firmware/ports/stm32f405/ring.c"
#include "../../firmware/ports/stm32f405/usart.c"
#include "../../firmware/ports/stm32f405/watchdog.c"
#include "terrapin_scaling.h"

static rcc_registers rcc;
static pwr_registers pwr;
static flash_registers flash_chip;
static iwdg_registers iwdg;
static tim_registers timer;
static tim_registers relay;
static adc_registers adc;
static adc_common_registers adc_common;
static dma_registers dma;
static usart_registers serial;
static uint8_t memory[0x40000]; /* sectors 0 to 5 */
static uint32_t spins;
static bool crystal_comes, pll_comes, switch_comes;
static uint32_t flash_error; /* raised by the next operation */
static bool flash_stuck;
static uint32_t keys;
static uint32_t erased;
static uint32_t caches_emptied;
static uint32_t iwdg_spins; /* until a new time of the watchdog is in force */
static uint32_t iwdg_slowness;
static bool bridge_locked, bridge_written;
static uint32_t compares_at_on; /* CCR1, CCR2 when the outputs were switched on: high and low half */
static gpio_registers port_e;   /* RM0090, 8.4: a pin shows what MODER selects */

static void hardware_moves(void) {
    spins++;
    if (crystal_comes && ((rcc.CR & RCC_CR_HSEON) != 0U) && (spins > 1000U)) {
        rcc.CR |= RCC_CR_HSERDY;
    }
    if ((rcc.CR & RCC_CR_PLLON) == 0U) {
        rcc.CR &= ~RCC_CR_PLLRDY;
    } else if (pll_comes) {
        rcc.CR |= RCC_CR_PLLRDY;
    } else {
        /* never comes */
    }
    rcc.CR |= ((rcc.CR & RCC_CR_HSION) != 0U) ? RCC_CR_HSIRDY : 0U;
    if ((rcc.CFGR & RCC_CFGR_SW) == 0U) {
        rcc.CFGR &= ~RCC_CFGR_SWS;
    }
    if (switch_comes && ((rcc.CFGR & RCC_CFGR_SW) == RCC_CFGR_SW_PLL)) {
        rcc.CFGR = (rcc.CFGR & ~RCC_CFGR_SWS) | RCC_CFGR_SWS_PLL;
    }
    if (!flash_stuck) {
        flash_chip.SR &= ~FLASH_SR_BSY;
    }
    if (iwdg_spins > 0U) {
        iwdg_spins--;
        iwdg.SR = (iwdg_spins == 0U) ? 0U : iwdg.SR;
    }
}

/* RM0090, 21.4: written behind the key alone, and ignored while the one before is on its way. */
static void iwdg_takes(volatile uint32_t *address, uint32_t value) {
    const uint32_t flag = (address == &iwdg.PR) ? BIT(0) : BIT(1);
    TEST_ASSERT_EQUAL_HEX32(IWDG_KR_ACCESS, iwdg.KR);
    if ((iwdg.SR & flag) == 0U) {
        *address = value;
        iwdg.SR |= (iwdg_slowness > 0U) ? flag : 0U;
        iwdg_spins = iwdg_slowness;
    }
}

/* The pin below test must have its function, pull and speed before it is more than an input. */
static const pin *expected_pin;
static void port_takes(volatile uint32_t *address, uint32_t value) {
    *address = value;
    if ((address == &port_e.MODER) && (expected_pin != NULL)) {
        const uint32_t number = expected_pin->number;
        TEST_ASSERT_EQUAL_HEX32(expected_pin->function, (port_e.AFR[number / 8U] >> (4U * (number % 8U))) & 15U);
        TEST_ASSERT_EQUAL_HEX32(expected_pin->pull, (port_e.PUPDR >> (2U * number)) & 3U);
    }
}

/* RM0090, 3.6 to 3.8: keys, errors cleared by ones, erase by STRT, a write that only clears bits and only when PG. */
static void hardware_takes(volatile uint32_t *address, uint32_t value) {
    if (address == &flash_chip.KEYR) {
        keys = (value == FLASH_KEY1) ? 1U : (((keys == 1U) && (value == FLASH_KEY2)) ? 2U : 3U);
        flash_chip.CR &= (keys == 2U) ? ~FLASH_CR_LOCK : 0xFFFFFFFFU;
    } else if (address == &flash_chip.SR) {
        flash_chip.SR &= ~(value & FLASH_SR_ERRORS);
    } else if (address == &flash_chip.CR) {
        TEST_ASSERT_TRUE(((flash_chip.CR & FLASH_CR_LOCK) == 0U) || (value == FLASH_CR_LOCK));
        flash_chip.CR = value;
        if ((value & FLASH_CR_STRT) != 0U) {
            const uint32_t sector = (value >> FLASH_CR_SNB) & 0xFU;
            uint32_t start = 0;
            for (uint32_t i = 0; i < sector; i++) {
                start += flash_sector_size(i);
            }
            memset(&memory[start], 0xFF, flash_sector_size(sector));
            erased |= BIT(sector);
            flash_chip.SR |= FLASH_SR_BSY | flash_error;
        }
    } else if (address == &flash_chip.ACR) {
        const uint32_t emptied = value & (FLASH_ACR_ICRST | FLASH_ACR_DCRST);
        TEST_ASSERT_TRUE((emptied == 0U) || ((flash_chip.ACR & (FLASH_ACR_ICEN | FLASH_ACR_DCEN)) == 0U));
        caches_emptied |= emptied;
        flash_chip.ACR = value;
    } else if ((address == &iwdg.PR) || (address == &iwdg.RLR)) {
        iwdg_takes(address, value);
    } else if (address ==
               &rcc.PLLCFGR) { /* RM0090, 7.3.2: written only while the PLL is off; not while it drives all */
        rcc.PLLCFGR = ((rcc.CR & RCC_CR_PLLON) == 0U) ? value : rcc.PLLCFGR;
    } else if (address == &timer.BDTR) { /* RM0090, 17.4.18: LOCK is frozen by the first write */
        const uint32_t lock = BIT(8) | BIT(9);
        bridge_locked = bridge_written ? bridge_locked : ((value & lock) == TIM_BDTR_LOCK_1);
        bridge_written = true;
        if ((value & ~timer.BDTR & TIM_BDTR_MOE) != 0U) {
            compares_at_on = (timer.CCR1 << 16U) | timer.CCR2;
        }
        timer.BDTR = (value & ~lock) | (bridge_locked ? TIM_BDTR_LOCK_1 : 0U);
    } else if ((address >= &port_e.MODER) && (address <= &port_e.AFR[1])) {
        port_takes(address, value);
    } else {
        TEST_ASSERT_TRUE((flash_chip.CR & (FLASH_CR_PG | FLASH_CR_LOCK)) == FLASH_CR_PG);
        TEST_ASSERT_EQUAL_HEX32(FLASH_CR_PSIZE_32, flash_chip.CR & FLASH_CR_PSIZE_32);
        *address &= value;
        flash_chip.SR |= FLASH_SR_BSY | flash_error;
    }
}

void setUp(void) {
    memset(&rcc, 0, sizeof rcc);
    memset(&pwr, 0, sizeof pwr);
    memset(&flash_chip, 0, sizeof flash_chip);
    memset(&iwdg, 0, sizeof iwdg);
    memset(&timer, 0, sizeof timer);
    memset(&adc, 0, sizeof adc);
    memset(&dma, 0, sizeof dma);
    memset(&serial, 0, sizeof serial);
    memset(&port_e, 0, sizeof port_e);
    expected_pin = NULL;
    memset(memory, 0xFF, sizeof memory);
    caches_emptied = 0U;
    iwdg_spins = 0U;
    iwdg_slowness = 0U;
    bridge_locked = bridge_written = false;
    flash_chip.CR = FLASH_CR_LOCK;
    spins = 0;
    crystal_comes = pll_comes = switch_comes = true;
    flash_error = 0;
    flash_stuck = false;
    keys = 0;
    erased = 0;
}

void tearDown(void) {}

/* ---- clock */

static clocks start(void) {
    return clock_start(&rcc, &flash_chip, &pwr, 8000000U, CLOCK_HSI_HZ);
}

static void test_clock_from_the_crystal(void) {
    const clocks speed = start();
    TEST_ASSERT_EQUAL(CLOCK_GOOD, speed.result);
    TEST_ASSERT_EQUAL_UINT32(168000000U, speed.core_hz);
    TEST_ASSERT_EQUAL_UINT32(42000000U, speed.apb1_hz);
    TEST_ASSERT_EQUAL_UINT32(84000000U, speed.apb2_hz);
    /* 8 MHz / M * N / 2 = 168 MHz */
    const uint32_t m = rcc.PLLCFGR & 0x3FU;
    const uint32_t n = (rcc.PLLCFGR >> RCC_PLLCFGR_N) & 0x1FFU;
    TEST_ASSERT_EQUAL_UINT32(168000000U, 8000000U / m * n / 2U);
    TEST_ASSERT_EQUAL_UINT32(0U, (rcc.PLLCFGR >> RCC_PLLCFGR_P) & 3U);
    TEST_ASSERT_EQUAL_UINT32(5U, flash_chip.ACR & FLASH_ACR_LATENCY);
    TEST_ASSERT_TRUE((rcc.CR & RCC_CR_CSSON) != 0U);
}

/* After `GO` of ST's boot loader: 24 MHz from the internal oscillator, by the PLL. */
static void test_clock_after_another_loader(void) {
    rcc.CR = RCC_CR_HSION | RCC_CR_HSIRDY | RCC_CR_PLLON | RCC_CR_PLLRDY;
    rcc.CFGR = RCC_CFGR_SW_PLL | RCC_CFGR_SWS_PLL;
    rcc.PLLCFGR = BIT(29) | 16U | (192U << RCC_PLLCFGR_N) | (3U << RCC_PLLCFGR_P) | (4U << RCC_PLLCFGR_Q);
    test_clock_from_the_crystal();
    spins = 0U;
    const uint32_t cr = rcc.CR;
    TEST_ASSERT_TRUE((rcc.PLLCFGR & BIT(29)) != 0U); /* reserved, and 1 after a reset */
    test_clock_from_the_crystal();                   /* after our own: the clock is left as it is */
    TEST_ASSERT_EQUAL_HEX32(cr, rcc.CR);
    TEST_ASSERT_EQUAL_UINT32(0U, spins);
}

static void falls_back(clock_result expected) {
    const clocks speed = start();
    TEST_ASSERT_EQUAL(expected, speed.result);
    TEST_ASSERT_EQUAL_UINT32(16000000U, speed.core_hz);
    TEST_ASSERT_EQUAL_UINT32(16000000U, speed.apb1_hz);
    TEST_ASSERT_EQUAL_UINT32(16000000U, speed.apb2_hz);
    TEST_ASSERT_EQUAL_UINT32(0U, rcc.CR & (RCC_CR_HSEON | RCC_CR_PLLON | RCC_CR_CSSON));
    TEST_ASSERT_EQUAL_UINT32(0U, rcc.CFGR & (RCC_CFGR_SW | RCC_CFGR_PRE));
    TEST_ASSERT_LESS_THAN(400000U, spins);                 /* 0.2 s at 16 MHz */
    TEST_ASSERT_TRUE((rcc.APB1ENR & RCC_APB1_CAN1) != 0U); /* the rest runs all the same */
}

static void test_clock_without_crystal(void) {
    crystal_comes = false;
    falls_back(CLOCK_NO_CRYSTAL);
}

static void test_clock_without_pll(void) {
    pll_comes = false;
    falls_back(CLOCK_NO_PLL);
}

static void test_clock_that_does_not_switch(void) {
    switch_comes = false;
    falls_back(CLOCK_NO_SWITCH);
}

/* ---- reset */

static void test_reset_causes(void) {
    static const struct {
        uint32_t flags;
        retained_reason noted;
        uint8_t cause;
    } cases[] = {
        {RCC_CSR_PORRSTF | RCC_CSR_BORRSTF | RCC_CSR_PINRSTF, RETAINED_NOTHING, TERRAPIN_RESET_CAUSE_POWER_ON},
        {RCC_CSR_BORRSTF | RCC_CSR_PINRSTF, RETAINED_NOTHING, TERRAPIN_RESET_CAUSE_BROWN_OUT},
        {RCC_CSR_IWDGRSTF | RCC_CSR_PINRSTF, RETAINED_NOTHING, TERRAPIN_RESET_CAUSE_WATCHDOG},
        {RCC_CSR_SFTRSTF | RCC_CSR_PINRSTF, RETAINED_NOTHING, TERRAPIN_RESET_CAUSE_SOFTWARE},
        {RCC_CSR_SFTRSTF | RCC_CSR_PINRSTF, RETAINED_UPDATE, TERRAPIN_RESET_CAUSE_SOFTWARE},
        {RCC_CSR_SFTRSTF, RETAINED_PROCESSOR_FAULT, TERRAPIN_RESET_CAUSE_PROCESSOR_FAULT},
        {RCC_CSR_SFTRSTF, RETAINED_STACK_OVERFLOW, TERRAPIN_RESET_CAUSE_STACK_OVERFLOW},
        {RCC_CSR_SFTRSTF, RETAINED_CRYSTAL_STOPPED, TERRAPIN_RESET_CAUSE_CRYSTAL_STOPPED},
        {RCC_CSR_LPWRRSTF | RCC_CSR_PINRSTF, RETAINED_NOTHING, TERRAPIN_RESET_CAUSE_LOW_POWER},
        {RCC_CSR_PINRSTF, RETAINED_NOTHING, TERRAPIN_RESET_CAUSE_PIN},
        {0U, RETAINED_NOTHING, TERRAPIN_RESET_CAUSE_UNKNOWN},
    };
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        TEST_ASSERT_EQUAL_UINT8(cases[i].cause, reset_cause(cases[i].flags, cases[i].noted));
    }
    reset_cause_forget(&rcc);
    TEST_ASSERT_EQUAL_HEX32(RCC_CSR_RMVF, rcc.CSR);
}

static void test_retained_memory_is_not_believed_blindly(void) {
    retained_memory kept;
    memset(&kept, 0xA5, sizeof kept); /* after power-on: anything */
    TEST_ASSERT_EQUAL(RETAINED_NOTHING, retained_take(&kept));
    retained_note(&kept, RETAINED_STACK_OVERFLOW, 0x08001234U, 0x82U);
    kept.status ^= 1U; /* damaged */
    TEST_ASSERT_EQUAL(RETAINED_NOTHING, retained_look(&kept));
    kept.status ^= 1U;
    TEST_ASSERT_EQUAL(RETAINED_STACK_OVERFLOW, retained_look(&kept));
    TEST_ASSERT_EQUAL(RETAINED_STACK_OVERFLOW, retained_take(&kept));
    TEST_ASSERT_EQUAL(RETAINED_NOTHING, retained_take(&kept)); /* once */
    for (uint32_t noise = 0U; noise < 256U; noise++) {         /* what a RAM holds after a loss of power says nothing */
        memset(&kept, (int)noise, sizeof kept);
        TEST_ASSERT_FALSE(retained_stopped(&kept));
    }
    retained_set_stopped(&kept, true);
    retained_note(&kept, RETAINED_UPDATE, 0U, 0U);
    (void)retained_take(&kept);
    TEST_ASSERT_TRUE(retained_stopped(&kept)); /* the boot loader was there in between */
    kept.running ^= 1U;
    TEST_ASSERT_FALSE(retained_stopped(&kept));
    retained_set_stopped(&kept, true);
    retained_set_stopped(&kept, false);
    TEST_ASSERT_FALSE(retained_stopped(&kept));
}

static void test_watchdog(void) {
    watchdog w;
    TEST_ASSERT_TRUE(watchdog_set(&w, &iwdg, WATCHDOG_WORK));
    TEST_ASSERT_EQUAL_HEX32(IWDG_KR_RELOAD, iwdg.KR);
    /* divider 4 at the fastest and slowest 32 kHz (17 to 47): longer than ten ticks, shorter than a command's time-out
     */
    TEST_ASSERT_EQUAL_UINT32(0U, iwdg.PR);
    TEST_ASSERT_GREATER_THAN(10U, iwdg.RLR * 4U / 47U);
    TEST_ASSERT_LESS_THAN(200U, iwdg.RLR * 4U / 17U);
    TEST_ASSERT_TRUE(watchdog_set(&w, &iwdg, WATCHDOG_ERASE));
    TEST_ASSERT_GREATER_THAN(4000U, iwdg.RLR * (4U << iwdg.PR) / 47U); /* ms: 128 kB take 4 s at most */
    iwdg.KR = 0U;
    watchdog_feed(&w);
    TEST_ASSERT_EQUAL_HEX32(IWDG_KR_RELOAD, iwdg.KR);
}

static void test_watchdog_that_does_not_answer(void) {
    watchdog w;
    iwdg.SR = 1U; /* its clock does not run */
    TEST_ASSERT_FALSE(watchdog_set(&w, &iwdg, WATCHDOG_ERASE));
}

/* A new time takes six periods of the divided clock: at 256 to 32 kHz 48 ms, a million spins at 168 MHz. */
static void test_watchdog_is_short_again_however_slowly_it_takes_its_times(void) {
    watchdog w;
    iwdg_slowness = 1000000U;
    TEST_ASSERT_TRUE(watchdog_set(&w, &iwdg, WATCHDOG_ERASE)); /* the boot loader's, */
    TEST_ASSERT_TRUE(watchdog_set(&w, &iwdg, WATCHDOG_ERASE)); /* the application's: an erase may follow each */
    TEST_ASSERT_EQUAL_UINT32(6U, iwdg.PR);
    TEST_ASSERT_EQUAL_UINT32(0U, iwdg.SR);
    TEST_ASSERT_TRUE(watchdog_set(&w, &iwdg, WATCHDOG_WORK)); /* the tick does not wait for it */
    TEST_ASSERT_TRUE(iwdg.SR != 0U);
    spins = 0U;
    TEST_ASSERT_TRUE(watchdog_set(&w, &iwdg, WATCHDOG_ERASE)); /* before that is in force */
    TEST_ASSERT_GREATER_THAN(iwdg_slowness, spins);
    TEST_ASSERT_EQUAL_UINT32(6U, iwdg.PR);
    TEST_ASSERT_EQUAL_UINT32(1000U, iwdg.RLR);
    iwdg.SR = 3U; /* an update that the boot loader left behind */
    iwdg_spins = 1000U;
    TEST_ASSERT_TRUE(watchdog_set(&w, &iwdg, WATCHDOG_WORK));
    TEST_ASSERT_EQUAL_UINT32(6U, iwdg.PR);
    for (uint32_t i = 0U; i < 1000U; i++) {
        hardware_moves();
    }
    watchdog_feed(&w);
    TEST_ASSERT_EQUAL_UINT32(0U, iwdg.PR);
    TEST_ASSERT_EQUAL_UINT32(160U, iwdg.RLR);
}

/* ---- flash */

static flash_driver driver;
static const terrapin_flash_area pages = {0x4000U, 0x8000U}; /* sectors 1 and 2 */

static terrapin_flash open_pages(void) {
    return flash_open(&driver, &flash_chip, memory, pages);
}

static void test_flash_sectors(void) {
    static const uint32_t starts[] = {0x0U,     0x4000U,  0x8000U,  0xC000U,  0x10000U, 0x20000U,
                                      0x40000U, 0x60000U, 0x80000U, 0xA0000U, 0xC0000U, 0xE0000U};
    for (int32_t i = 0; i < 12; i++) {
        TEST_ASSERT_EQUAL_INT32(i, flash_sector_at(starts[i]));
    }
    TEST_ASSERT_EQUAL_INT32(-1, flash_sector_at(0x2000U));
    TEST_ASSERT_EQUAL_INT32(-1, flash_sector_at(0x100000U));
}

static void test_flash_writes_and_erases(void) {
    const terrapin_flash flash = open_pages();
    static const uint8_t bytes[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    uint8_t back[8] = {0};
    TEST_ASSERT_TRUE(flash.write(flash.context, 0x4010U, bytes, 8U));
    TEST_ASSERT_EQUAL_MEMORY(bytes, &memory[0x4010], 8U);
    TEST_ASSERT_TRUE(flash.read(flash.context, 0x4010U, back, 8U));
    TEST_ASSERT_EQUAL_MEMORY(bytes, back, 8U);
    TEST_ASSERT_TRUE((flash_chip.CR & FLASH_CR_LOCK) != 0U); /* locked in between */
    static const uint8_t others[4] = {2, 2, 3, 4};
    TEST_ASSERT_FALSE(flash.write(flash.context, 0x4010U, others, 4U)); /* bits only go down: seen by reading back */
    memory[0x3FFF] = 0x11;
    memory[0x8000] = 0x22;
    TEST_ASSERT_TRUE(flash.erase(flash.context, (terrapin_flash_area){0x4000U, 0x4000U}));
    TEST_ASSERT_EQUAL_HEX32(BIT(1), erased);
    TEST_ASSERT_EACH_EQUAL_HEX8(0xFF, &memory[0x4000], 0x4000);
    TEST_ASSERT_EQUAL_HEX8(0x11, memory[0x3FFF]);
    TEST_ASSERT_EQUAL_HEX8(0x22, memory[0x8000]);
    TEST_ASSERT_EQUAL_HEX32(FLASH_ACR_ICRST | FLASH_ACR_DCRST, caches_emptied);
    TEST_ASSERT_TRUE(flash.erase(flash.context, pages)); /* both */
    TEST_ASSERT_EQUAL_HEX32(BIT(1) | BIT(2), erased);
}

/* RM0090, 3.5.2: lines of a sector that was erased stand in the caches; they are emptied while off, then on again. */
static void test_an_erase_empties_the_caches_and_leaves_them_on(void) {
    const terrapin_flash flash = open_pages();
    const uint32_t as_started = 5U | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    flash_chip.ACR = as_started;
    TEST_ASSERT_TRUE(flash.erase(flash.context, (terrapin_flash_area){0x4000U, 0x4000U}));
    TEST_ASSERT_EQUAL_HEX32(FLASH_ACR_ICRST | FLASH_ACR_DCRST, caches_emptied);
    TEST_ASSERT_EQUAL_HEX32(as_started, flash_chip.ACR);
    flash_error = BIT(4);
    TEST_ASSERT_FALSE(flash.erase(flash.context, (terrapin_flash_area){0x4000U, 0x4000U}));
    TEST_ASSERT_EQUAL_HEX32(as_started, flash_chip.ACR);
}

static void test_flash_refuses_what_is_not_its_own(void) {
    const terrapin_flash flash = open_pages();
    uint8_t bytes[8] = {0};
    static const terrapin_flash_area bad[] = {
        {0x0U, 0x4000U},    {0xC000U, 0x4000U}, {0x4000U, 0x2000U}, {0x4000U, 0x6000U},     {0x4000U, 0xC000U},
        {0x5000U, 0x3000U}, {0x4000U, 0U},      {0x8000U, 0x8000U}, {0x4000U, 0xFFFFFFFFU}, {0xFFFFC000U, 0x4000U},
    };
    for (size_t i = 0; i < (sizeof bad / sizeof bad[0]); i++) {
        TEST_ASSERT_FALSE(flash.erase(flash.context, bad[i]));
    }
    TEST_ASSERT_EQUAL_HEX32(0U, erased);
    static const struct {
        uint32_t offset, size;
    } places[] = {{0x3FFCU, 4U}, {0xBFFCU, 8U}, {0xC000U, 4U}, {0x4001U, 4U}, {0x4000U, 3U}, {0xFFFFFFFCU, 8U}};
    for (size_t i = 0; i < (sizeof places / sizeof places[0]); i++) {
        TEST_ASSERT_FALSE(flash.write(flash.context, places[i].offset, bytes, places[i].size));
    }
    TEST_ASSERT_FALSE(flash.read(flash.context, 0x3FFFU, bytes, 1U));
    TEST_ASSERT_FALSE(flash.read(flash.context, 0xBFFFU, bytes, 2U));
    TEST_ASSERT_TRUE(flash.read(flash.context, 0xBFFFU, bytes, 1U));
}

/* What runs already, an erase of the boot loader's, is waited for and not disturbed (RM0090, 3.6.1). */
static void test_a_flash_at_work_is_not_written(void) {
    const terrapin_flash flash = open_pages();
    static const uint8_t bytes[4] = {0};
    flash_chip.SR = FLASH_SR_BSY;
    flash_stuck = true;
    TEST_ASSERT_FALSE(flash.write(flash.context, 0x4000U, bytes, 4U));
    TEST_ASSERT_FALSE(flash.erase(flash.context, pages));
    TEST_ASSERT_EQUAL_HEX8(0xFF, memory[0x4000]);
    TEST_ASSERT_EQUAL_UINT32_MESSAGE(0U, keys, "not even unlocked");
    TEST_ASSERT_EQUAL_HEX32(0U, erased);
    flash_stuck = false;
    TEST_ASSERT_TRUE(flash.write(flash.context, 0x4000U, bytes, 4U));
}

static void test_flash_says_errors_and_gives_up(void) {
    const terrapin_flash flash = open_pages();
    static const uint8_t bytes[4] = {0};
    flash_error = BIT(4); /* write protected */
    TEST_ASSERT_FALSE(flash.write(flash.context, 0x4000U, bytes, 4U));
    TEST_ASSERT_FALSE(flash.erase(flash.context, pages));
    flash_error = 0U; /* and what comes after is not tainted by it */
    TEST_ASSERT_TRUE(flash.erase(flash.context, pages));
    TEST_ASSERT_TRUE(flash.write(flash.context, 0x4000U, bytes, 4U));
    flash_stuck = true;
    TEST_ASSERT_FALSE(flash.write(flash.context, 0x4004U, bytes, 4U));
    TEST_ASSERT_LESS_THAN(3U * TRIES_WRITE, spins);
}

/* ---- what the parts write at their start, and that they write nothing else: all other registers are as a reset, or
 * somebody before, left them */

/* That `registers` are as they were (filled with a byte) but for what is written: pairs of register and value, 0 ends.
 */
typedef struct {
    volatile uint32_t *at;
    uint32_t value;
} write_of;

static void wrote(volatile void *block, size_t size, const write_of *writes) {
    volatile uint32_t *const words = block;
    for (size_t i = 0U; i < (size / 4U); i++) {
        uint32_t wanted = 0x5A5A5A5AU;
        for (const write_of *w = writes; w->at != NULL; w++) {
            wanted = (w->at == &words[i]) ? w->value : wanted;
        }
        char what[32];
        (void)snprintf(what, sizeof what, "register at 0x%02X", (unsigned int)(4U * i));
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(wanted, words[i], what);
    }
}

static void fill(volatile void *block, size_t size) {
    memset((void *)(uintptr_t)block, 0x5A, size);
}

static void test_what_the_bridge_writes(void) {
    bridge b;
    fill(&timer, sizeof timer);
    bridge_open(&b, &timer, 168000000U, 20000U, 500U);
    const write_of writes[] = {{&timer.CR1, BIT(5) | BIT(6) | BIT(7) | BIT(0)},
                               {&timer.CR2, 6U << 4U},
                               {&timer.SR, 0U},
                               {&timer.EGR, BIT(0)},
                               {&timer.CCMR1, (6U << 4U) | BIT(3) | (6U << 12U) | BIT(11)},
                               {&timer.CCMR2, (7U << 4U) | BIT(3)},
                               {&timer.CCER, BIT(0) | BIT(2) | BIT(4) | BIT(6)},
                               {&timer.PSC, 0U},
                               {&timer.ARR, 4200U},
                               {&timer.CCR1, 0U},
                               {&timer.CCR2, 0U},
                               {&timer.CCR3, 4192U}, /* 8 clocks before the top */
                               {&timer.BDTR, BIT(8) | BIT(10) | BIT(11) | BIT(12) | 84U},
                               {NULL, 0U}};
    wrote(&timer, sizeof timer, writes);
}

static void test_what_the_encoder_writes(void) {
    fill(&timer, sizeof timer);
    encoder_open(&timer, true);
    const write_of writes[] = {{&timer.CR1, BIT(0)},
                               {&timer.SMCR, 3U},
                               {&timer.CCMR1, BIT(0) | BIT(8) | (3U << 4U) | (3U << 12U)},
                               {&timer.CCER, BIT(1)},
                               {&timer.ARR, 0xFFFFU},
                               {&timer.CNT, 0U},
                               {NULL, 0U}};
    wrote(&timer, sizeof timer, writes);
}

static void test_what_the_line_writes(void) {
    static usart u;
    fill(&serial, sizeof serial);
    usart_open(&u, &serial, 84000000U, 1000000U);
    const write_of writes[] = {{&serial.CR1, BIT(2) | BIT(3) | BIT(5) | BIT(13)},
                               {&serial.CR2, 0U},
                               {&serial.CR3, 0U},
                               {&serial.BRR, 84U},
                               {NULL, 0U}};
    wrote(&serial, sizeof serial, writes);
    TEST_ASSERT_EQUAL_UINT32(0U, u.damaged);
}

static void test_what_the_converter_writes(void) {
    static analog a;
    static const uint8_t channels[3] = {10U, 11U, 12U};
    fill(&adc, sizeof adc);
    fill(&adc_common, sizeof adc_common);
    fill(&dma, sizeof dma);
    fill(&relay, sizeof relay);
    analog_open(&a, &adc, &adc_common, &dma, &relay, channels);
    const write_of of_adc[] = {{&adc.SR, 0U},
                               {&adc.CR1, BIT(8)},
                               {&adc.CR2, BIT(0) | BIT(8) | BIT(9) | (6U << 24U) | BIT(28)},
                               {&adc.SMPR1, 1U | (1U << 3U) | (1U << 6U)},
                               {&adc.SMPR2, 0U},
                               {&adc.SQR1, 2U << 20U},
                               {&adc.SQR3, 10U | (11U << 5U) | (12U << 10U)},
                               {NULL, 0U}};
    wrote(&adc, sizeof adc, of_adc);
    const write_of of_common[] = {{&adc_common.CCR, BIT(16)}, {NULL, 0U}};
    wrote(&adc_common, sizeof adc_common, of_common);
    const write_of of_dma[] = {{&dma.LIFCR, 0x3DU},
                               {&dma.stream[0].CR, BIT(0) | BIT(8) | BIT(10) | BIT(11) | BIT(13)},
                               {&dma.stream[0].NDTR, ANALOG_ROUNDS * 3U},
                               {&dma.stream[0].PAR, (uint32_t)(uintptr_t)&adc.DR},
                               {&dma.stream[0].M0AR, (uint32_t)(uintptr_t)a.samples},
                               {NULL, 0U}};
    wrote(&dma, sizeof dma, of_dma);
    TEST_ASSERT_EQUAL_UINT32(sizeof a.samples, dma.stream[0].NDTR * sizeof a.samples[0]); /* none beside its array */
    const write_of of_relay[] = {
        {&relay.CR1, BIT(0)}, {&relay.CR2, 0U}, {&relay.SMCR, 4U}, {&relay.ARR, 0xFFFFFFFFU}, {NULL, 0U}};
    wrote(&relay, sizeof relay, of_relay);
}

static void test_what_the_clock_writes(void) {
    rcc.AHB1ENR = BIT(30); /* the rest stays as it is */
    rcc.APB1ENR = BIT(30);
    rcc.APB2ENR = BIT(30);
    rcc.CFGR = 0x0000FCF0U;
    (void)start();
    TEST_ASSERT_EQUAL_HEX32(BIT(30) | 0x1FU | BIT(22), rcc.AHB1ENR);
    TEST_ASSERT_EQUAL_HEX32(BIT(30) | BIT(0) | BIT(1) | BIT(2) | BIT(25) | BIT(28), rcc.APB1ENR);
    TEST_ASSERT_EQUAL_HEX32(BIT(30) | BIT(0) | BIT(4) | BIT(8) | BIT(12), rcc.APB2ENR);
    TEST_ASSERT_EQUAL_HEX32((5U << 10U) | (4U << 13U) | BIT(1) | BIT(3), rcc.CFGR);
    TEST_ASSERT_EQUAL_HEX32(5U | BIT(8) | BIT(9) | BIT(10), flash_chip.ACR);
    TEST_ASSERT_EQUAL_HEX32(BIT(14), pwr.CR);
    TEST_ASSERT_EQUAL_HEX32(8U | (336U << 6U) | BIT(22) | (7U << 24U), rcc.PLLCFGR);
}

/* A clock that is as a reset leaves it, or as we left it, is not taken away from under what runs on it. */
static void test_the_clock_is_taken_back_to_change_a_pll_that_runs_alone(void) {
    rcc.CFGR = RCC_CFGR_SW_PLL | RCC_CFGR_SWS_PLL; /* a loader's PLL, off by now */
    rcc.CR = RCC_CR_HSION | RCC_CR_HSIRDY;
    switch_comes = true;
    const uint32_t before = spins;
    set_pll(&rcc, 5U);
    TEST_ASSERT_EQUAL_HEX32(RCC_CFGR_SW_PLL | RCC_CFGR_SWS_PLL, rcc.CFGR);
    TEST_ASSERT_EQUAL_UINT32(before, spins);
    TEST_ASSERT_EQUAL_HEX32(5U, rcc.PLLCFGR);
}

/* ---- ADC */

static analog sensors;
static uint32_t dma_at; /* samples written so far */

static void sample(uint16_t current, uint16_t supply, uint16_t temperature) {
    const uint16_t codes[3] = {current, supply, temperature};
    for (uint32_t i = 0; i < 3U; i++) {
        sensors.samples[dma_at % (ANALOG_ROUNDS * ANALOG_CHANNELS)] = codes[i];
        dma_at++;
    }
    const uint32_t total = ANALOG_ROUNDS * ANALOG_CHANNELS;
    dma.stream[0].NDTR = total - (dma_at % total); /* reloaded at 0 */
}

static void open_adc(void) {
    static const uint8_t channels[3] = {10U, 11U, 12U};
    dma_at = 0U;
    analog_open(&sensors, &adc, &adc_common, &dma, &relay, channels);
    TEST_ASSERT_EQUAL_HEX32(10U | (11U << 5U) | (12U << 10U), adc.SQR3);
    TEST_ASSERT_EQUAL_HEX32(2U << 20U, adc.SQR1);
    TEST_ASSERT_TRUE((dma.stream[0].CR & DMA_CR_EN) != 0U);
    TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFFU, relay.ARR); /* at 0 the counter is blocked: RM0090, 18.3.1 */
}

static void test_adc_sampling_times_of_all_channels(void) {
    static const uint8_t channels[3] = {9U, 0U, 15U};
    analog_open(&sensors, &adc, &adc_common, &dma, &relay, channels);
    TEST_ASSERT_EQUAL_HEX32((1U << 27U) | 1U, adc.SMPR2);
    TEST_ASSERT_EQUAL_HEX32(1U << 15U, adc.SMPR1);
    open_adc();
    TEST_ASSERT_EQUAL_HEX32(0U, adc.SMPR2);
    TEST_ASSERT_EQUAL_HEX32(1U | (1U << 3U) | (1U << 6U), adc.SMPR1);
}

static void test_adc_means_of_a_tick(void) {
    open_adc();
    for (uint32_t tick = 0; tick < 100U; tick++) { /* round and round in the buffer */
        for (uint32_t i = 0; i < 20U; i++) {
            sample((uint16_t)(2000U + tick + (i % 2U)), 3000U, (uint16_t)(i + 1U)); /* means .5, exact, 10.5 */
        }
        TEST_ASSERT_TRUE(analog_read(&sensors));
        TEST_ASSERT_EQUAL_UINT16(2001U + tick, sensors.codes[0]); /* half rounds up */
        TEST_ASSERT_EQUAL_UINT16(3000U, sensors.codes[1]);
        TEST_ASSERT_EQUAL_UINT16(11U, sensors.codes[2]);
    }
    for (uint32_t i = 0; i < 20U; i++) {
        sample(4095U, 4095U, 0U);
    }
    TEST_ASSERT_TRUE(analog_read(&sensors));
    TEST_ASSERT_EQUAL_UINT16(4095U, sensors.codes[0]);
}

static void test_adc_that_falls_silent_reads_zero(void) {
    open_adc();
    sample(2048U, 3000U, 1500U);
    TEST_ASSERT_TRUE(analog_read(&sensors));
    TEST_ASSERT_TRUE(analog_read(&sensors)); /* one late sample is no fault */
    TEST_ASSERT_TRUE(analog_read(&sensors));
    TEST_ASSERT_EQUAL_UINT16(2048U, sensors.codes[0]);
    TEST_ASSERT_FALSE(analog_read(&sensors));
    TEST_ASSERT_EQUAL_UINT16(0U, sensors.codes[0]);
    TEST_ASSERT_EQUAL_UINT16(0U, sensors.codes[1]);
    sample(2048U, 3000U, 1500U);
    TEST_ASSERT_TRUE(analog_read(&sensors));
    TEST_ASSERT_EQUAL_UINT16(2048U, sensors.codes[0]);
}

static void test_absent_adc_is_silent(void) {
    open_adc();
    dma.stream[0].NDTR = 0U; /* as an emulator without one reads */
    for (uint32_t i = 0; i < ANALOG_SILENT; i++) {
        (void)analog_read(&sensors);
    }
    TEST_ASSERT_FALSE(analog_read(&sensors));
}

static void test_adc_overrun_begins_anew(void) {
    open_adc();
    sample(1000U, 1000U, 1000U);
    (void)analog_read(&sensors);
    adc.SR = ADC_SR_OVR;
    dma.LIFCR = dma.HIFCR = 0U;
    sample(1234U, 1U, 1U); /* channels may be mixed up: not to be believed */
    TEST_ASSERT_TRUE(analog_read(&sensors));
    TEST_ASSERT_EQUAL_UINT16(1000U, sensors.codes[0]);
    TEST_ASSERT_EQUAL_UINT32(0U, adc.SR);
    TEST_ASSERT_EQUAL_HEX32(0x3DU, dma.LIFCR); /* all flags of stream 0, in the low register: RM0090, 10.5.3 */
    TEST_ASSERT_EQUAL_HEX32(0U, dma.HIFCR);
    TEST_ASSERT_EQUAL_HEX32(BIT(8), adc.CR2 & BIT(8));
    TEST_ASSERT_EQUAL_HEX32(BIT(0), dma.stream[0].CR & BIT(0));
    TEST_ASSERT_EQUAL_UINT32(ANALOG_ROUNDS * ANALOG_CHANNELS, dma.stream[0].NDTR);
    dma_at = 0U;
    sample(2222U, 1U, 1U);
    TEST_ASSERT_TRUE(analog_read(&sensors));
    TEST_ASSERT_EQUAL_UINT16(2222U, sensors.codes[0]);
}

/* ---- bridge */

/* Nanoseconds that a register code gives (RM0090, 17.4.18). */
static uint32_t dead_ns(uint32_t code, uint32_t hz) {
    uint32_t steps = code & 0x7FU;
    if ((code >> 5U) == 7U) {
        steps = (32U + (code & 0x1FU)) * 16U;
    } else if ((code >> 5U) == 6U) {
        steps = (32U + (code & 0x1FU)) * 8U;
    } else if ((code >> 7U) == 1U) {
        steps = (64U + (code & 0x3FU)) * 2U;
    } else {
        /* as it stands */
    }
    return (uint32_t)((uint64_t)steps * 1000000000U / hz);
}

static void test_dead_time_is_never_shorter_than_asked(void) {
    for (uint32_t hz = 16000000U; hz <= 168000000U; hz += 152000000U) {
        for (uint16_t ns = 0; ns <= 5900U; ns++) {
            const uint32_t code = bridge_dead_time(hz, ns);
            const uint32_t step_ns = 16000000U / (hz / 1000U);        /* the coarsest */
            TEST_ASSERT_GREATER_OR_EQUAL(ns, dead_ns(code, hz) + 1U); /* 1: of the division */
            TEST_ASSERT_LESS_OR_EQUAL(ns + step_ns, dead_ns(code, hz));
        }
    }
    TEST_ASSERT_EQUAL_HEX32(0xFFU, bridge_dead_time(168000000U, 65535U));
    TEST_ASSERT_EQUAL_HEX32(2U, bridge_dead_time(1000000001U, 1U)); /* a little more than one step is two */
    TEST_ASSERT_EQUAL_HEX32(1U, bridge_dead_time(1000000000U, 1U));
    TEST_ASSERT_EQUAL_HEX32(0xFFU, bridge_dead_time(1000000000U, 1009U)); /* the most that there is */
}

/* The shortest that is not shorter, of all that the register knows; at 1 GHz a step is a nanosecond. */
static void test_dead_time_is_the_shortest_of_all_codes(void) {
    for (uint16_t ns = 0U; ns <= 1008U; ns++) {
        uint32_t least = 0xFFFFFFFFU;
        for (uint32_t code = 0U; code < 256U; code++) {
            const uint32_t given = dead_ns(code, 1000000000U);
            least = ((given >= ns) && (given < least)) ? given : least;
        }
        TEST_ASSERT_EQUAL_UINT32(least, dead_ns(bridge_dead_time(1000000000U, ns), 1000000000U));
    }
}

/* What a channel of the timer makes of its two gates: RM0090, table 95 (complementary channels with break). */
typedef enum { FLOATING, DRIVEN_OFF, SWITCHING, ONE_SIDE } gates;
static gates gates_of(uint32_t channel) {
    const uint32_t both = BIT(0) | BIT(2);
    const uint32_t enabled = (timer.CCER >> (4U * channel)) & both;
    const uint32_t idle_high = (timer.CR2 >> (8U + (2U * channel))) & 3U; /* OISx, OISxN */
    const uint32_t inverted = (timer.CCER >> (4U * channel)) & (BIT(1) | BIT(3));
    if ((timer.BDTR & TIM_BDTR_MOE) == 0U) {
        const bool held = ((timer.BDTR & TIM_BDTR_OSSI) != 0U) && (enabled == both);
        return (held && (idle_high == 0U) && (inverted == 0U)) ? DRIVEN_OFF : FLOATING;
    }
    return ((enabled == both) && (inverted == 0U)) ? SWITCHING : ONE_SIDE;
}

static void all_gates(gates expected) {
    for (uint32_t channel = 0; channel < 2U; channel++) {
        TEST_ASSERT_EQUAL(expected, gates_of(channel));
    }
}

/* Off means all four gates held off, never floating: a floating gate keeps what charge it has. */
static void test_gates_are_held_off_from_the_start_and_after_each_off(void) {
    bridge b;
    bridge_open(&b, &timer, 168000000U, 20000U, 500U);
    all_gates(DRIVEN_OFF);
    bridge_drive(&b, 1000, false);
    all_gates(DRIVEN_OFF);
    bridge_drive(&b, 1000, true);
    all_gates(SWITCHING);
    TEST_ASSERT_EQUAL_HEX32(((1000U * 4200U + 16384U) >> 15U) << 16U, compares_at_on);
    bridge_drive(&b, 1000, false);
    all_gates(DRIVEN_OFF);
    bridge_drive(&b, -2000, true); /* on with its own duty, not with the last one */
    TEST_ASSERT_EQUAL_HEX32((2000U * 4200U + 16384U) >> 15U, compares_at_on);
    bridge_off(&timer);
    all_gates(DRIVEN_OFF);
    bridge_drive(&b, 500, true);
    timer.SR = TIM_SR_BIF;
    bridge_drive(&b, 500, true);
    all_gates(DRIVEN_OFF);
    TEST_ASSERT_EQUAL_HEX32(TIM_CR2_MMS_OC3REF, timer.CR2);
    TEST_ASSERT_EQUAL_HEX32(TIM_CR1_CENTRE | TIM_CR1_ARPE | TIM_CR1_CEN, timer.CR1);
    TEST_ASSERT_TRUE((timer.EGR & TIM_EGR_UG) != 0U);
    TEST_ASSERT_EQUAL_HEX32(TIM_BDTR_OSSR, timer.BDTR & TIM_BDTR_OSSR);
}

static void test_bridge_follows_duty(void) {
    bridge b;
    bridge_open(&b, &timer, 168000000U, 20000U, 500U);
    TEST_ASSERT_GREATER_OR_EQUAL(2U * 4U, 2U * (timer.ARR - timer.CCR3)); /* four clocks of TIM2: it sees the trigger */
    TEST_ASSERT_EQUAL_UINT32(4200U, timer.ARR);                           /* up and down: 20 kHz */
    TEST_ASSERT_EQUAL_UINT32(0U, timer.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_TRUE((timer.BDTR & TIM_BDTR_BKE) != 0U);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.BDTR & (TIM_BDTR_BKP | BIT(14))); /* active low; no automatic return */
    TEST_ASSERT_EQUAL_UINT32(84U, timer.BDTR & 0xFFU);
    TEST_ASSERT_TRUE(bridge_locked);
    bridge_drive(&b, 16384, true);
    TEST_ASSERT_EQUAL_UINT32(2100U, timer.CCR1);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.CCR2);
    TEST_ASSERT_TRUE((timer.BDTR & TIM_BDTR_MOE) != 0U);
    bridge_drive(&b, -32767, true);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.CCR1);
    TEST_ASSERT_EQUAL_UINT32(4200U, timer.CCR2);
    bridge_drive(&b, -32768, true);
    TEST_ASSERT_EQUAL_UINT32(4200U, timer.CCR2);
    bridge_drive(&b, 100, false);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.CCR1 | timer.CCR2);
    bridge_drive(&b, 100, true);
    bridge_drive(&b, 100, false);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.CCR1 | timer.CCR2);
    bridge_drive(&b, 100, true);
    bridge_off(&timer);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.BDTR & TIM_BDTR_MOE);
}

/* Half a count goes up; either way alike. */
static void test_the_duty_is_the_nearest_that_the_timer_has(void) {
    static const uint32_t periods[] = {4200U, 4201U, 20001U};
    for (size_t i = 0; i < (sizeof periods / sizeof periods[0]); i++) {
        bridge b;
        bridge_open(&b, &timer, 2U * periods[i] * 1000U, 1000U, 500U);
        TEST_ASSERT_EQUAL_UINT32(periods[i], timer.ARR);
        for (int32_t duty = 0; duty <= 32767; duty++) {
            bridge_drive(&b, (int16_t)duty, true);
            const int32_t rest = (duty * (int32_t)periods[i]) - ((int32_t)timer.CCR1 * 32768);
            TEST_ASSERT_TRUE((rest >= -16384) && (rest < 16384));
            TEST_ASSERT_EQUAL_UINT32(0U, timer.CCR2);
            const uint32_t ahead = timer.CCR1;
            bridge_drive(&b, (int16_t)-duty, true);
            TEST_ASSERT_EQUAL_UINT32(ahead, (duty > 0) ? timer.CCR2 : timer.CCR1);
            TEST_ASSERT_EQUAL_UINT32(0U, (duty > 0) ? timer.CCR1 : timer.CCR2);
        }
    }
}

static void test_break_holds_until_off_was_asked_for(void) {
    bridge b;
    bridge_open(&b, &timer, 168000000U, 20000U, 500U);
    bridge_drive(&b, 1000, true);
    timer.BDTR &= ~TIM_BDTR_MOE; /* the hardware does this by itself */
    timer.SR = TIM_SR_BIF;
    bridge_drive(&b, 1000, true);
    TEST_ASSERT_TRUE(b.broken);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.SR & TIM_SR_BIF); /* or a break that has passed would hold forever */
    timer.SR = 0U;
    bridge_drive(&b, 1000, true); /* quiet again, but not asked off yet */
    TEST_ASSERT_TRUE(b.broken);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.BDTR & TIM_BDTR_MOE);
    bridge_drive(&b, 0, false);
    TEST_ASSERT_FALSE(b.broken);
    bridge_drive(&b, 1000, true);
    TEST_ASSERT_TRUE((timer.BDTR & TIM_BDTR_MOE) != 0U);
}

/* ---- small things */

/* Every n-th count of an encoder's own is given, whichever way it turns, over the wrap of its 16 bits. */
static void test_a_divided_encoder(void) {
    static const int32_t steps[] = {0, 1, 1, 1, -1, -2, -7, 13, 32767, 32767, -32768, -32768, -5};
    for (int32_t divider = 1; divider <= 7; divider += 3) {
        encoder_count encoder = {0};
        int64_t own = 0;
        for (size_t i = 0; i < (sizeof steps / sizeof steps[0]); i++) {
            own += steps[i];
            const int64_t whole = (own >= 0) ? (own / divider) : -((-own + divider - 1) / divider);
            TEST_ASSERT_EQUAL_UINT16((uint16_t)whole, encoder_divided(&encoder, (uint16_t)own, divider));
            TEST_ASSERT_TRUE((encoder.rest >= 0) && (encoder.rest < divider));
        }
    }
}

static void test_encoder(void) {
    encoder_open(&timer, false);
    TEST_ASSERT_EQUAL_UINT32(3U, timer.SMCR);
    TEST_ASSERT_EQUAL_UINT32(0U, timer.CCER);
    timer.CNT = 0xFFFFU;
    TEST_ASSERT_EQUAL_UINT16(0xFFFFU, encoder_read(&timer));
    encoder_open(&timer, true);
    TEST_ASSERT_EQUAL_UINT32(BIT(1), timer.CCER);
    TEST_ASSERT_EQUAL_UINT16(0U, encoder_read(&timer));
}

static void test_pins(void) {
    port_e.MODER = 0xFFFFFFFFU;
    static const pin p = {4U, 9U, PIN_FUNCTION, PIN_DOWN, 1U};
    pin_setup(&port_e, &p);
    TEST_ASSERT_EQUAL_HEX32(0xFFFBFFFFU, port_e.MODER);
    TEST_ASSERT_EQUAL_HEX32(2U << 18U, port_e.PUPDR);
    TEST_ASSERT_EQUAL_HEX32(1U << 4U, port_e.AFR[1]);
    TEST_ASSERT_EQUAL_HEX32(0U, port_e.AFR[0]);
    pin_write(&port_e, &p, true);
    TEST_ASSERT_EQUAL_HEX32(BIT(9), port_e.BSRR);
    pin_write(&port_e, &p, false);
    TEST_ASSERT_EQUAL_HEX32(BIT(25), port_e.BSRR);
    port_e.IDR = BIT(9);
    TEST_ASSERT_TRUE(pin_read(&port_e, &p));
}

/* From the reset's input to its function in one step: nothing else on the way, its neighbours untouched. */
static void test_a_pin_is_an_input_until_all_of_it_is_set(void) {
    static const pin pins[] = {{4U, 9U, PIN_FUNCTION, PIN_DOWN, 1U},
                               {4U, 14U, PIN_OUTPUT, PIN_DOWN, 0U},
                               {4U, 3U, PIN_FUNCTION, PIN_UP, 7U},
                               {4U, 2U, PIN_ANALOG, PIN_FLOATING, 0U},
                               {4U, 0U, PIN_INPUT, PIN_UP, 0U}};
    for (size_t i = 0; i < (sizeof pins / sizeof pins[0]); i++) {
        memset(&port_e, 0, sizeof port_e);
        port_e.AFR[0] = port_e.AFR[1] = 0xFFFFFFFFU; /* as another loader may leave them */
        port_e.PUPDR = port_e.OSPEEDR = 0xFFFFFFFFU;
        expected_pin = &pins[i];
        pin_setup(&port_e, &pins[i]);
        const uint32_t at = 2U * pins[i].number;
        TEST_ASSERT_EQUAL_HEX32((uint32_t)pins[i].mode << at, port_e.MODER);
        TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFFU ^ ((3U ^ (uint32_t)pins[i].pull) << at), port_e.PUPDR);
        const uint32_t speed = (pins[i].mode == (uint8_t)PIN_FUNCTION) ? 2U : 0U;
        TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFFU ^ ((3U ^ speed) << at), port_e.OSPEEDR);
        const uint32_t nibble = 4U * (pins[i].number % 8U);
        TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFFU ^ ((15U ^ (uint32_t)pins[i].function) << nibble),
                                port_e.AFR[pins[i].number / 8U]);
        TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFFU, port_e.AFR[1U - (pins[i].number / 8U)]);
    }
}

static void test_phases(void) {
    phases p;
    phases_open(&p, 168000000U);
    phases_note(&p, PHASE_STEP, 168U * 100U);
    phases_note(&p, PHASE_STEP, 168U * 50U);
    phases_note(&p, PHASE_SEND, 1U);
    TEST_ASSERT_EQUAL_INT32(400, phases_take_250ns(&p, PHASE_STEP)); /* 100 us, the longest */
    TEST_ASSERT_EQUAL_INT32(0, phases_take_250ns(&p, PHASE_STEP));   /* begins anew */
    TEST_ASSERT_EQUAL_INT32(1, phases_take_250ns(&p, PHASE_SEND));   /* rounded up */
    phases_note(&p, PHASE_LATE, 0xFFFFFFFFU);
    const terrapin_port_times_source source = {.late_250ns = phases_take_250ns(&p, PHASE_LATE)};
    TEST_ASSERT_EQUAL_INT32(102261127, source.late_250ns);
    TEST_ASSERT_EQUAL_INT32(4095, terrapin_scale_port_times(&source).late); /* twelve bits */
}

static void test_ticks_that_were_missed_are_counted(void) {
    uint32_t base = 0xFFFFFF00U; /* the counter wraps */
    const uint32_t start = base;
    TEST_ASSERT_EQUAL_UINT32(1U, phases_periods(&base, start + 1000U, 1000U));
    TEST_ASSERT_EQUAL_UINT32(1U, phases_periods(&base, start + 2900U, 1000U)); /* late, not missed */
    TEST_ASSERT_EQUAL_UINT32(1U, phases_periods(&base, start + 3001U, 1000U));
    TEST_ASSERT_EQUAL_UINT32(500U, phases_periods(&base, start + 503500U, 1000U)); /* an erase of 0.5 s */
    TEST_ASSERT_EQUAL_UINT32(1U, phases_periods(&base, start + 504002U, 1000U));
    TEST_ASSERT_EQUAL_UINT32(start + 504000U, base);
    uint32_t none = 0U;
    TEST_ASSERT_EQUAL_UINT32(1U, phases_periods(&none, 0U, 1000U)); /* no counter */
    TEST_ASSERT_EQUAL_UINT32(1U, phases_periods(&none, 0U, 1000U));
}

static void test_ring(void) {
    uint8_t bytes[8];
    ring r;
    ring_init(&r, bytes, sizeof bytes);
    r.head = r.tail = 0xFFFFFFFCU; /* the counters wrap */
    uint8_t next_in = 0;
    uint8_t next_out = 0;
    uint8_t byte = 0;
    for (uint32_t round = 0; round < 20U; round++) {
        while (ring_put(&r, next_in)) {
            next_in++;
        }
        TEST_ASSERT_EQUAL_UINT32(8U, ring_used(&r));
        for (uint32_t i = 0; i < 5U; i++) {
            TEST_ASSERT_TRUE(ring_take(&r, &byte));
            TEST_ASSERT_EQUAL_UINT8(next_out, byte);
            next_out++;
        }
    }
    TEST_ASSERT_EQUAL_UINT32(20U, r.lost);
    TEST_ASSERT_FALSE(ring_put_all(&r, (const uint8_t *)"123456", 6U)); /* all or nothing */
    TEST_ASSERT_EQUAL_UINT32(3U, ring_used(&r));
    TEST_ASSERT_EQUAL_UINT32(26U, r.lost);
}

static void test_usart(void) {
    static usart u;
    usart_open(&u, &serial, 84000000U, 1000000U);
    TEST_ASSERT_EQUAL_UINT32(84U, serial.BRR);
    TEST_ASSERT_TRUE((serial.CR1 & USART_CR1_RXNEIE) != 0U);
    usart_open(&u, &serial, 16000000U, 115200U);
    TEST_ASSERT_EQUAL_UINT32(139U, serial.BRR); /* 0.08 % off */
    uint8_t byte = 0;
    serial.SR = USART_SR_RXNE;
    serial.DR = 'A';
    usart_interrupt(&u);
    serial.SR = USART_SR_RXNE | USART_SR_FE;
    serial.DR = 'B';
    usart_interrupt(&u);
    serial.SR = USART_SR_ORE;
    usart_interrupt(&u);
    serial.SR = 0U;
    usart_interrupt(&u);
    TEST_ASSERT_EQUAL_UINT32(2U, u.damaged);
    TEST_ASSERT_TRUE(usart_take(&u, &byte));
    TEST_ASSERT_EQUAL_UINT8('A', byte);
    TEST_ASSERT_TRUE(usart_take(&u, &byte));
    TEST_ASSERT_FALSE(usart_take(&u, &byte));
    /* A transmitter that is busy asks by its interrupt. */
    TEST_ASSERT_TRUE(usart_send(&u, (const uint8_t *)"xy", 2U));
    TEST_ASSERT_TRUE((serial.CR1 & USART_CR1_TXEIE) != 0U);
    TEST_ASSERT_EQUAL_UINT32(2U, ring_used(&u.out));
    serial.SR = USART_SR_TXE;
    usart_interrupt(&u);
    TEST_ASSERT_EQUAL_UINT32('y', serial.DR);
    TEST_ASSERT_EQUAL_UINT32(0U, serial.CR1 & USART_CR1_TXEIE);
    TEST_ASSERT_FALSE(usart_flush(&u, 10U)); /* never complete */
    serial.SR = 0U;                          /* nor ever empty */
    TEST_ASSERT_TRUE(usart_send(&u, (const uint8_t *)"xy", 2U));
    TEST_ASSERT_FALSE(usart_flush(&u, 10U));
    TEST_ASSERT_EQUAL_UINT32(2U, ring_used(&u.out));
    TEST_ASSERT_TRUE(ring_take(&u.out, &byte) && ring_take(&u.out, &byte));
    serial.SR = USART_SR_TXE | USART_SR_TC;
    TEST_ASSERT_TRUE(usart_flush(&u, 10U));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_clock_from_the_crystal);
    RUN_TEST(test_clock_after_another_loader);
    RUN_TEST(test_clock_without_crystal);
    RUN_TEST(test_clock_without_pll);
    RUN_TEST(test_clock_that_does_not_switch);
    RUN_TEST(test_reset_causes);
    RUN_TEST(test_retained_memory_is_not_believed_blindly);
    RUN_TEST(test_watchdog);
    RUN_TEST(test_watchdog_that_does_not_answer);
    RUN_TEST(test_watchdog_is_short_again_however_slowly_it_takes_its_times);
    RUN_TEST(test_flash_sectors);
    RUN_TEST(test_flash_writes_and_erases);
    RUN_TEST(test_an_erase_empties_the_caches_and_leaves_them_on);
    RUN_TEST(test_flash_refuses_what_is_not_its_own);
    RUN_TEST(test_a_flash_at_work_is_not_written);
    RUN_TEST(test_flash_says_errors_and_gives_up);
    RUN_TEST(test_what_the_bridge_writes);
    RUN_TEST(test_what_the_encoder_writes);
    RUN_TEST(test_what_the_line_writes);
    RUN_TEST(test_what_the_converter_writes);
    RUN_TEST(test_what_the_clock_writes);
    RUN_TEST(test_the_clock_is_taken_back_to_change_a_pll_that_runs_alone);
    RUN_TEST(test_adc_sampling_times_of_all_channels);
    RUN_TEST(test_adc_means_of_a_tick);
    RUN_TEST(test_adc_that_falls_silent_reads_zero);
    RUN_TEST(test_absent_adc_is_silent);
    RUN_TEST(test_adc_overrun_begins_anew);
    RUN_TEST(test_dead_time_is_never_shorter_than_asked);
    RUN_TEST(test_dead_time_is_the_shortest_of_all_codes);
    RUN_TEST(test_gates_are_held_off_from_the_start_and_after_each_off);
    RUN_TEST(test_bridge_follows_duty);
    RUN_TEST(test_the_duty_is_the_nearest_that_the_timer_has);
    RUN_TEST(test_break_holds_until_off_was_asked_for);
    RUN_TEST(test_encoder);
    RUN_TEST(test_a_divided_encoder);
    RUN_TEST(test_pins);
    RUN_TEST(test_a_pin_is_an_input_until_all_of_it_is_set);
    RUN_TEST(test_phases);
    RUN_TEST(test_ticks_that_were_missed_are_counted);
    RUN_TEST(test_ring);
    RUN_TEST(test_usart);
    return UNITY_END();
}
