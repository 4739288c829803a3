/* The chip's parts put together with the robot's board, on registers made of memory: which pin and which bit of which
 * register the e-stop, the bridge and the supply are, what a reset leaves, what test and boot loader's slots change. */
#include <setjmp.h>
#include <string.h>

#include "unity.h"

#include "registers.h"

static rcc_registers rcc;
static pwr_registers pwr;
static flash_registers flash_chip;
static gpio_registers ports[9];
static tim_registers tim1, tim2, tim3, tim4;
static adc_registers adc1;
static adc_common_registers adc_common;
static dma_registers dma2;
static iwdg_registers iwdg;
static scb_registers scb;
static dwt_registers dwt;
static systick_registers systick;
static spi_registers spi1;
static reg32 demcr, dbgmcu;
#undef RCC
#undef PWR
#undef FLASH
#undef GPIO
#undef TIM1
#undef TIM2
#undef TIM3
#undef TIM4
#undef ADC1
#undef ADC_COMMON
#undef DMA2
#undef IWDG
#undef SCB
#undef DWT
#undef SYSTICK
#undef SPI1
#undef DEMCR
#undef DBGMCU_CR
#define RCC            (&rcc)
#define PWR            (&pwr)
#define FLASH          (&flash_chip)
#define GPIO(port)     (&ports[(port)])
#define TIM1           (&tim1)
#define TIM2           (&tim2)
#define TIM3           (&tim3)
#define TIM4           (&tim4)
#define ADC1           (&adc1)
#define ADC_COMMON     (&adc_common)
#define DMA2           (&dma2)
#define IWDG           (&iwdg)
#define SCB            (&scb)
#define DWT            (&dwt)
#define SYSTICK        (&systick)
#define SPI1           (&spi1)
#define DEMCR          demcr
#define DBGMCU_CR      dbgmcu
#define TERRAPIN_BOARD "terrapin_board.h"

#include "boards/selected.h"
#undef BOARD_IMU
static bool has_imu; /* the robot's board has none; others have */
#define BOARD_IMU has_imu

#include "../../firmware/ports/stm32f405/bridge.c"
#include "../../firmware/ports/stm32f405/pins.c"
#include "../../firmware/ports/stm32f405/hardware.c"

/* ---- the other parts, which have tests of their own */

retained_memory retained;
static bool adc_good = true;
static uint16_t count3 = 24, count4 = 77;
static terrapin_flash_area served[4];
static uint32_t opened_flashes;
static const terrapin_flash_area *store_pages;
static bool store_good;
static watchdog_time guarded;
static bool watchdog_good = true;
static uint32_t fed, confirmed, kept_stop = 9, noted, asked_channels, reversed;
static int idle_after;
static uint32_t polls;
static uint32_t key_words[4];
static bool key_there, random_good;
static jmp_buf at_reset;
static uint32_t wanted_resets;

void analog_open(analog *a, adc_registers *adc, adc_common_registers *common, dma_registers *dma, tim_registers *relay,
                 const uint8_t channels[ANALOG_CHANNELS]) {
    (void)a;
    TEST_ASSERT_TRUE((adc == &adc1) && (common == &adc_common) && (dma == &dma2) && (relay == &tim2));
    asked_channels = channels[0] | ((uint32_t)channels[1] << 8U) | ((uint32_t)channels[2] << 16U);
}
bool analog_read(analog *a) {
    a->codes[0] = 11;
    a->codes[1] = 22;
    a->codes[2] = 33;
    return adc_good;
}
void encoder_open(tim_registers *timer, bool is_reversed) {
    TEST_ASSERT_TRUE((timer == &tim3) || (timer == &tim4));
    reversed |= is_reversed ? 1U : 0U;
}
uint16_t encoder_read(const tim_registers *timer) {
    return (timer == &tim3) ? count3 : count4;
}
terrapin_flash flash_open(flash_driver *driver, flash_registers *registers, uint8_t *memory,
                          terrapin_flash_area serves) {
    const terrapin_flash none = {0};
    (void)driver;
    TEST_ASSERT_TRUE((registers == &flash_chip) && (memory == (uint8_t *)FLASH_MEMORY));
    served[opened_flashes % 4U] = serves;
    opened_flashes++;
    return none;
}
bool terrapin_store_open(terrapin_store *opened, const terrapin_flash *flash, const terrapin_flash_area pages[2]) {
    TEST_ASSERT_TRUE((opened == &store) && (flash == &store_flash));
    store_pages = pages;
    return store_good;
}
void terrapin_update_init(terrapin_update *u, const terrapin_boot *of, uint8_t running) {
    TEST_ASSERT_TRUE((u == &update) && (of == &boot));
    u->running = running;
}
bool terrapin_boot_confirm(const terrapin_boot *of, uint8_t which) {
    TEST_ASSERT_EQUAL_PTR(&boot, of);
    confirmed += 1U + (16U * which);
    return true;
}
bool terrapin_records_set_node(const terrapin_flash *flash, uint8_t node) {
    TEST_ASSERT_EQUAL_PTR(&boot_flash, flash);
    return node != 7U;
}
void terrapin_records_read(const terrapin_flash *flash, terrapin_record *record) {
    TEST_ASSERT_EQUAL_PTR(&boot_flash, flash);
    record->node = 5U;
}
static uint32_t imu_opened, spi_opened;
static bool imu_good;
void imu_bus_open(void) {
    TEST_ASSERT_TRUE_MESSAGE(has_imu, "this board has none");
    imu_opened++;
}
void spi_open(spi_registers *spi) {
    TEST_ASSERT_TRUE_MESSAGE(has_imu, "this board has none");
    TEST_ASSERT_EQUAL_PTR(&spi1, spi);
    spi_opened++;
}
static terrapin_inputs inputs;
bool swing_sense(swing *s, terrapin_inputs *of) {
    TEST_ASSERT_TRUE_MESSAGE(has_imu, "this board has none");
    TEST_ASSERT_TRUE((s == &pendulum) && (of == &inputs));
    return imu_good;
}
const uint32_t *link_key(const uint32_t words[LINK_KEY_WORDS], uint32_t *generation) {
    TEST_ASSERT_EQUAL_PTR((const uint32_t *)0x08003FC0U, words); /* the last 64 bytes of sector 0 */
    *generation = 3U;
    return key_there ? key_words : NULL;
}
bool random_word(uint32_t *word) {
    *word = 12345U;
    return random_good;
}
uint32_t phases_periods(uint32_t *base, uint32_t now, uint32_t period) {
    TEST_ASSERT_EQUAL_UINT32(tick_period, period);
    *base = now - 5U;
    return 2U;
}
uint8_t reset_cause(uint32_t flags, retained_reason reason) {
    TEST_ASSERT_EQUAL_HEX32(0x20000000U, flags);
    return (uint8_t)(40 + (int)reason);
}
void reset_cause_forget(rcc_registers *registers) {
    registers->CSR |= RCC_CSR_RMVF;
}
void retained_note(retained_memory *memory, retained_reason reason, uint32_t address, uint32_t status) {
    TEST_ASSERT_TRUE((memory == &retained) && (address == 0U) && (status == 0U));
    noted = (uint32_t)reason;
}
retained_reason retained_take(retained_memory *memory) {
    (void)memory;
    return RETAINED_CRYSTAL_STOPPED;
}
void retained_set_stopped(retained_memory *memory, bool stopped) {
    (void)memory;
    kept_stop = stopped ? 1U : 0U;
}
bool retained_stopped(const retained_memory *memory) {
    (void)memory;
    return kept_stop == 1U;
}
uint32_t stack_used(void) {
    return 321U;
}
_Noreturn void system_reset(void) {
    wanted_resets++;
    longjmp(at_reset, 1);
}
uint32_t unique_number(void) {
    return 0xABCDU;
}
bool watchdog_set(watchdog *w, iwdg_registers *registers, watchdog_time time) {
    TEST_ASSERT_TRUE((w == &guard) && (registers == &iwdg));
    guarded = time;
    return watchdog_good;
}
void watchdog_feed(const watchdog *w) {
    TEST_ASSERT_EQUAL_PTR(&guard, w);
    fed++;
}
bool can_idle(const can *c) {
    (void)c;
    return polls >= (uint32_t)idle_after;
}
void can_poll(can *c) {
    (void)c;
    polls++;
    ticks++; /* a tick's interrupt */
}
bool usart_flush(usart *u, uint32_t tries) {
    (void)u;
    TEST_ASSERT_GREATER_THAN(1000U, tries);
    noted |= 0x100U;
    return true;
}

/* ---- tests */

static const clocks speed = {
    .result = CLOCK_GOOD, .core_hz = 168000000U, .apb1_hz = 42000000U, .apb2_hz = 84000000U, .tim_hz = 168000000U};
static hardware_facts facts;

void setUp(void) {
    memset(ports, 0, sizeof ports);
    memset(&tim1, 0, sizeof tim1);
    memset(&pwr, 0, sizeof pwr);
    memset(&scb, 0, sizeof scb);
    memset(&rcc, 0, sizeof rcc);
    memset(&facts, 0, sizeof facts);
    memset(&inputs, 0, sizeof inputs);
    memset(served, 0, sizeof served);
    opened_flashes = confirmed = noted = fed = polls = asked_channels = wanted_resets = 0U;
    adc_good = store_good = true;
    kept_stop = 0U;
    hardware_open(&speed);
    for (size_t i = 0; i < (sizeof ports / sizeof ports[0]); i++) {
        ports[i].BSRR = 0U;
    }
}
void tearDown(void) {}

static uint32_t mode_of(pin p) {
    return (ports[p.port].MODER >> (2U * p.number)) & 3U;
}

static void test_every_pin_of_the_board_has_its_mode(void) {
    static const pin all[] = BOARD_PINS;
    for (size_t i = 0; i < (sizeof all / sizeof all[0]); i++) {
        TEST_ASSERT_EQUAL(all[i].mode, mode_of(all[i]));
    }
    TEST_ASSERT_EQUAL(PIN_OUTPUT, mode_of((pin)BOARD_ENABLE));
    TEST_ASSERT_EQUAL(PIN_OUTPUT, mode_of((pin)BOARD_LED));
    TEST_ASSERT_EQUAL(PIN_INPUT, mode_of((pin)BOARD_ESTOP));
    TEST_ASSERT_EQUAL_MESSAGE(PIN_UP, (ports[estop_pin.port].PUPDR >> (2U * estop_pin.number)) & 3U,
                              "a broken wire reads as pressed");
    TEST_ASSERT_EQUAL_HEX32(PWR_CR_PVDE | PWR_CR_PLS_2V7, pwr.CR);
    TEST_ASSERT_EQUAL_HEX32(10U | (11U << 8U) | (12U << 16U), asked_channels);
    TEST_ASSERT_EQUAL(0U, tim1.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_UINT32(4200U, tim1.ARR);
}

static bool enable_high(void) {
    return ports[enable_pin.port].BSRR == BIT(enable_pin.number);
}
static bool enable_low(void) {
    return ports[enable_pin.port].BSRR == (BIT(enable_pin.number) << 16U);
}

static void test_the_bridge_and_its_enable_line_go_together(void) {
    hardware_drive(&facts, 1000, true);
    TEST_ASSERT_TRUE(enable_high());
    TEST_ASSERT_TRUE((tim1.BDTR & TIM_BDTR_MOE) != 0U);
    hardware_drive(&facts, 1000, false);
    TEST_ASSERT_TRUE(enable_low());
    TEST_ASSERT_EQUAL(0U, tim1.BDTR & TIM_BDTR_MOE);
    facts.brown_out = true; /* no transistor with too little voltage on its gate */
    hardware_drive(&facts, 1000, true);
    TEST_ASSERT_EQUAL(0U, tim1.BDTR & TIM_BDTR_MOE);
    facts.brown_out = false;
    hardware_drive(&facts, 1000, true);
    tim1.SR = TIM_SR_BIF;
    hardware_drive(&facts, 1000, true);
    TEST_ASSERT_TRUE(enable_low());
    TEST_ASSERT_EQUAL(0U, tim1.BDTR & TIM_BDTR_MOE);
    hardware_sense(&facts, &inputs);
    TEST_ASSERT_TRUE(facts.bridge_break);
    tim1.SR = 0U;
    hardware_drive(&facts, 0, false);
}

static void test_a_fault_s_handler_puts_both_off(void) {
    hardware_drive(&facts, 1000, true);
    emergency_stop();
    TEST_ASSERT_TRUE(enable_low());
    TEST_ASSERT_EQUAL(0U, tim1.BDTR & TIM_BDTR_MOE);
}

static void test_what_is_sensed(void) {
    ports[estop_pin.port].IDR = BIT(estop_pin.number);
    hardware_sense(&facts, &inputs);
    TEST_ASSERT_TRUE_MESSAGE(inputs.estop, "a high line: pressed, or a broken wire");
    TEST_ASSERT_EQUAL(11, inputs.current_code);
    TEST_ASSERT_EQUAL(22, inputs.supply_code);
    TEST_ASSERT_EQUAL(33, inputs.temperature_code);
    TEST_ASSERT_EQUAL(24 / TERRAPIN_ENCODER_DIVIDER, inputs.motor_count);
    TEST_ASSERT_EQUAL(77, inputs.ground_count);
    TEST_ASSERT_FALSE(facts.adc_silent || facts.brown_out || facts.bridge_break || facts.imu_absent);
    ports[estop_pin.port].IDR = ~BIT(estop_pin.number);
    adc_good = false;
    pwr.CSR = PWR_CSR_PVDO;
    hardware_sense(&facts, &inputs);
    TEST_ASSERT_FALSE(inputs.estop);
    TEST_ASSERT_TRUE(facts.adc_silent);
    TEST_ASSERT_TRUE(facts.brown_out);
    pwr.CSR = ~PWR_CSR_PVDO;
    hardware_sense(&facts, &inputs);
    TEST_ASSERT_FALSE(facts.brown_out);
}

static void test_a_board_with_an_imu_senses_it_and_says_when_it_is_absent(void) {
    has_imu = true;
    hardware_open(&speed);
    TEST_ASSERT_EQUAL_UINT32(1U, imu_opened);
    TEST_ASSERT_EQUAL_UINT32(1U, spi_opened);
    for (int good = 0; good < 2; good++) {
        imu_good = good == 1;
        hardware_sense(&facts, &inputs);
        TEST_ASSERT_EQUAL(good == 0, facts.imu_absent);
        TEST_ASSERT_FALSE(facts.no_ground_wheel || facts.adc_silent || facts.brown_out || facts.bridge_break);
    }
    has_imu = false;
}

static void runs_from(uint32_t offset) {
    scb.VTOR = FLASH_MEMORY + offset;
}

static void test_the_slot_is_known_by_where_the_vectors_stand(void) {
    static const struct {
        uint32_t vectors;
        uint8_t slot;
    } places[] = {{0U, TERRAPIN_UPDATE_SLOT_NONE},
                  {0x20200U, TERRAPIN_UPDATE_SLOT_A},
                  {0x40200U, TERRAPIN_UPDATE_SLOT_B},
                  {0x20000U, TERRAPIN_UPDATE_SLOT_NONE}};
    for (size_t i = 0; i < (sizeof places / sizeof places[0]); i++) {
        runs_from(places[i].vectors);
        confirmed = 0U;
        hardware_healthy();
        const bool alone = places[i].slot == (uint8_t)TERRAPIN_UPDATE_SLOT_NONE;
        TEST_ASSERT_EQUAL_UINT32(alone ? 0U : (1U + (16U * places[i].slot)), confirmed);
        terrapin_update *const found = hardware_update();
        TEST_ASSERT_EQUAL(alone, found == NULL);
        if (!alone) {
            TEST_ASSERT_EQUAL(places[i].slot, found->running);
            TEST_ASSERT_EQUAL_HEX32(0xC000U, served[(opened_flashes - 1U) % 4U].offset);
            TEST_ASSERT_EQUAL_HEX32(0x60000U - 0xC000U, served[(opened_flashes - 1U) % 4U].size);
        }
        TEST_ASSERT_NOT_NULL(hardware_store());
        TEST_ASSERT_EQUAL_HEX32(alone ? 0xC0000U : 0x4000U, store_pages[0].offset);
        TEST_ASSERT_EQUAL_HEX32(alone ? 0xE0000U : 0x8000U, store_pages[1].offset);
        TEST_ASSERT_EQUAL_HEX32(store_pages[0].offset, served[(opened_flashes - 1U) % 4U].offset);
        TEST_ASSERT_EQUAL_HEX32(store_pages[0].size + store_pages[1].size, served[(opened_flashes - 1U) % 4U].size);
    }
    store_good = false;
    TEST_ASSERT_NULL(hardware_store());
}

static hardware_facts look(void) {
    return hardware_look(&speed, 0x20000000U);
}

static void test_what_is_known_at_the_start(void) {
    runs_from(0x20200U);
    key_there = random_good = true;
    kept_stop = 1U;
    flash_chip.OPTCR = 0U;
    hardware_facts found = look();
    TEST_ASSERT_EQUAL_PTR(key_words, found.link_key);
    TEST_ASSERT_EQUAL_UINT32(3U, found.link_generation);
    TEST_ASSERT_EQUAL_UINT32(12345U, found.start);
    TEST_ASSERT_TRUE(found.stopped);
    TEST_ASSERT_FALSE(found.clock_fallback || found.watchdog_absent || found.brown_out_unset || found.no_ground_wheel);
    TEST_ASSERT_EQUAL(WATCHDOG_ERASE, guarded);
    TEST_ASSERT_EQUAL(40 + RETAINED_CRYSTAL_STOPPED, found.reset_cause);
    TEST_ASSERT_EQUAL(BOARD_NUMBER, found.board);
    TEST_ASSERT_EQUAL(TERRAPIN_UPDATE_SLOT_A, found.slot);
    TEST_ASSERT_EQUAL(5U, found.node);
    TEST_ASSERT_EQUAL_UINT32(0xABCDU, found.unique);
    TEST_ASSERT_EQUAL_UINT32(168000000U, found.core_hz);
    TEST_ASSERT_TRUE((rcc.CSR & RCC_CSR_RMVF) != 0U);
    watchdog_good = false;
    found = look();
    TEST_ASSERT_TRUE(found.watchdog_absent);
    TEST_ASSERT_FALSE(found.clock_fallback || found.bridge_break || found.brown_out_unset || found.no_ground_wheel);
    watchdog_good = true;
    flash_chip.OPTCR = FLASH_OPTCR_BOR_OFF;
    found = look();
    TEST_ASSERT_TRUE(found.brown_out_unset);
    TEST_ASSERT_FALSE(found.clock_fallback || found.bridge_break || found.watchdog_absent || found.no_ground_wheel);
    flash_chip.OPTCR = 0U;
    clocks slow = speed;
    slow.result = CLOCK_NO_CRYSTAL;
    found = hardware_look(&slow, 0x20000000U);
    TEST_ASSERT_TRUE(found.clock_fallback);
    TEST_ASSERT_FALSE(found.brown_out_unset || found.bridge_break || found.watchdog_absent || found.no_ground_wheel);
    random_good = false; /* no session without a number of this start; the key stays: nothing is taken unsealed */
    found = look();
    TEST_ASSERT_EQUAL_PTR(key_words, found.link_key);
    TEST_ASSERT_EQUAL_UINT32(0U, found.link_generation);
    kept_stop = 0U;
    flash_chip.OPTCR = FLASH_OPTCR_BOR_OFF;
    runs_from(0U); /* alone: no boot loader, no key, no number */
    found = look();
    TEST_ASSERT_NULL(found.link_key);
    TEST_ASSERT_EQUAL(0U, found.node);
    TEST_ASSERT_TRUE(found.brown_out_unset);
    TEST_ASSERT_FALSE(found.stopped);
}

static void test_the_watchdog_s_time(void) {
    hardware_flash_work(true);
    TEST_ASSERT_EQUAL(WATCHDOG_ERASE, guarded);
    hardware_flash_work(false);
    TEST_ASSERT_EQUAL(WATCHDOG_WORK, guarded);
    guarded = WATCHDOG_ERASE;
    dwt.CYCCNT = 77U;
    systick.VAL = 77U;
    hardware_start(168000000U);
    TEST_ASSERT_EQUAL_UINT32(0U, dwt.CYCCNT);
    TEST_ASSERT_EQUAL_UINT32(0U, systick.VAL);
    TEST_ASSERT_EQUAL(WATCHDOG_WORK, guarded);
    TEST_ASSERT_EQUAL_UINT32(167999U, systick.LOAD);
    TEST_ASSERT_EQUAL_UINT32(7U, systick.CTRL);
    TEST_ASSERT_TRUE((demcr & DEMCR_TRCENA) != 0U);
    TEST_ASSERT_TRUE((dbgmcu & DBGMCU_SLEEP) != 0U);
    TEST_ASSERT_TRUE((dwt.CTRL & DWT_CTRL_CYCCNTENA) != 0U);
    const uint32_t before = hardware_ticks();
    dwt.CYCCNT = 1000U;
    systick_interrupt();
    TEST_ASSERT_EQUAL_UINT32(before + 2U, hardware_ticks());
    TEST_ASSERT_EQUAL_UINT32(995U, hardware_tick_cycles());
    TEST_ASSERT_EQUAL_UINT32(1000U, hardware_cycles());
    hardware_alive(true);
    TEST_ASSERT_EQUAL_UINT32(1U, fed);
    TEST_ASSERT_EQUAL_HEX32(BIT(led_pin.number), ports[led_pin.port].BSRR);
}

/* What waits leaves first, but a bus that takes nothing does not hold the reset up. */
static void test_a_reset_lets_answers_leave_and_says_where_to_stay(void) {
    static can bus;
    static usart line;
    for (volatile int stay = 0; stay < 2; stay++) {
        idle_after = (stay == 0) ? 2 : 1000;
        noted = polls = 0U;
        if (setjmp(at_reset) == 0) {
            hardware_reset(&bus, &line, stay != 0);
        }
        TEST_ASSERT_EQUAL_HEX32(0x100U | ((stay != 0) ? RETAINED_UPDATE : 0U), noted);
        TEST_ASSERT_EQUAL_UINT32((stay == 0) ? 2U : FLUSH_TICKS, polls);
    }
    TEST_ASSERT_EQUAL_UINT32(2U, wanted_resets);
}

static void test_small_things(void) {
    hardware_keep_stop(true);
    TEST_ASSERT_EQUAL_UINT32(1U, kept_stop);
    hardware_keep_stop(false);
    TEST_ASSERT_EQUAL_UINT32(0U, kept_stop);
    TEST_ASSERT_TRUE(hardware_store_node(3U));
    TEST_ASSERT_FALSE(hardware_store_node(7U));
    TEST_ASSERT_EQUAL_UINT32(321U, hardware_stack_used());
    TEST_ASSERT_EQUAL_UINT32(0U, reversed);
    TEST_ASSERT_EQUAL_UINT32(2U, hardware_parameter_count);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_every_pin_of_the_board_has_its_mode);
    RUN_TEST(test_the_bridge_and_its_enable_line_go_together);
    RUN_TEST(test_a_fault_s_handler_puts_both_off);
    RUN_TEST(test_what_is_sensed);
    RUN_TEST(test_a_board_with_an_imu_senses_it_and_says_when_it_is_absent);
    RUN_TEST(test_the_slot_is_known_by_where_the_vectors_stand);
    RUN_TEST(test_what_is_known_at_the_start);
    RUN_TEST(test_the_watchdog_s_time);
    RUN_TEST(test_a_reset_lets_answers_leave_and_says_where_to_stay);
    RUN_TEST(test_small_things);
    return UNITY_END();
}
