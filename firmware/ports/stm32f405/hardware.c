/* The chip's parts put together with a board. */
#include "hardware.h"

#include "analog.h"
#include "boards/selected.h"
#include "boot_key.h"
#include "bridge.h"
#include "../encoder_count.h"
#include "encoder.h"
#include "flash_driver.h"
#include "imu_bus.h"
#include "layout.h"
#include "link_key.h"
#include "parameters.h"
#include "phases.h"
#include "pins.h"
#include "processor.h"
#include "reset_cause.h"
#include "retained.h"
#include "spi.h"
#include "startup.h"
#include "swing.h"
#include "unique.h"
#include "watchdog.h"

#define FLUSH_TRIES 2000000U /* 0.1 s at 168 MHz */
#define FLUSH_TICKS 5U       /* for the frames that wait for the bus */

static terrapin_store store;
static flash_driver store_memory, boot_memory;
static terrapin_flash store_flash, boot_flash;
static const terrapin_boot boot = {.flash = &boot_flash, .keys = terrapin_boot_keys, .key_ids = TERRAPIN_BOOT_KEY_IDS};
static terrapin_update update;
static analog sensors;
static watchdog guard;
static bridge motor;
static encoder_count motor_encoder;

static volatile uint32_t ticks;
static volatile uint32_t tick_cycles;
static uint32_t tick_period; /* cycles */

const hardware_parameter hardware_parameters[] = BOARD_PARAMETERS;
const uint32_t hardware_parameter_count = sizeof hardware_parameters / sizeof hardware_parameters[0];

static const pin estop_pin = BOARD_ESTOP;
static const pin enable_pin = BOARD_ENABLE;
static const pin led_pin = BOARD_LED;

static swing pendulum = {.forward = BOARD_IMU_FORWARD, .up = BOARD_IMU_UP, .right = BOARD_IMU_RIGHT};

/* ---- which image this is */

static uint8_t slot(void) {
    switch (SCB->VTOR - TERRAPIN_LAYOUT_BASE - TERRAPIN_LAYOUT_HEADER_SIZE) {
    case TERRAPIN_LAYOUT_SLOT_A:
        return TERRAPIN_UPDATE_SLOT_A;
    case TERRAPIN_LAYOUT_SLOT_B:
        return TERRAPIN_UPDATE_SLOT_B;
    default:
        return TERRAPIN_UPDATE_SLOT_NONE; /* alone */
    }
}

/* ---- interrupts */

void systick_interrupt(void) {
    static uint32_t base;
    const uint32_t now = DWT->CYCCNT;
    ticks += phases_periods(&base, now, tick_period);
    tick_cycles = base;
}

void emergency_stop(void) {
    bridge_off(TIM1);
    pin_write(GPIO(enable_pin.port), &enable_pin, false);
}

/* ---- each tick */

void hardware_sense(hardware_facts *facts, terrapin_inputs *inputs) {
    facts->adc_silent = !analog_read(&sensors);
    facts->bridge_break = motor.broken;
    facts->brown_out = (PWR->CSR & PWR_CSR_PVDO) != 0U;
    inputs->current_code = sensors.codes[0];
    inputs->supply_code = sensors.codes[1];
    inputs->temperature_code = sensors.codes[2];
    inputs->motor_count = encoder_divided(&motor_encoder, encoder_read(TIM3), TERRAPIN_ENCODER_DIVIDER);
    inputs->ground_count = encoder_read(TIM4); /* stands at 0 where the board has no ground wheel */
    if (BOARD_IMU) {
        facts->imu_absent = !swing_sense(&pendulum, inputs);
    }
    inputs->estop = pin_read(GPIO(estop_pin.port), &estop_pin);
}

void hardware_drive(const hardware_facts *facts, int16_t duty_q15, bool on) {
    bridge_drive(&motor, duty_q15, on && !facts->brown_out);
    pin_write(GPIO(enable_pin.port), &enable_pin, on && !motor.broken);
}

void hardware_flash_work(bool begins) {
    (void)watchdog_set(&guard, IWDG, begins ? WATCHDOG_ERASE : WATCHDOG_WORK); /* absent: said at the start */
}

void hardware_healthy(void) {
    if (slot() != (uint8_t)TERRAPIN_UPDATE_SLOT_NONE) {
        (void)terrapin_boot_confirm(&boot, slot()); /* refused: the boot loader falls back at the next start */
    }
}

bool hardware_store_node(uint8_t node) {
    return terrapin_records_set_node(&boot_flash, node);
}

void hardware_keep_stop(bool stopped) {
    retained_set_stopped(&retained, stopped);
}

void hardware_reset(can *bus, usart *line, bool stay) {
    if (stay) {
        retained_note(&retained, RETAINED_UPDATE, 0U, 0U);
    }
    const uint32_t begin = ticks;
    while (!can_idle(bus) && ((ticks - begin) < FLUSH_TICKS)) {
        can_poll(bus); /* the answer leaves before the chip does */
    }
    (void)usart_flush(line, FLUSH_TRIES);
    system_reset();
}

void hardware_alive(bool lit) {
    watchdog_feed(&guard);
    pin_write(GPIO(led_pin.port), &led_pin, lit);
}

uint32_t hardware_cycles(void) {
    return DWT->CYCCNT;
}

uint32_t hardware_tick_cycles(void) {
    return tick_cycles;
}

uint32_t hardware_stack_used(void) {
    return stack_used();
}

uint32_t hardware_ticks(void) {
    return ticks;
}

/* ---- start */

static void setup_pins(void) {
    static const pin pins[] = BOARD_PINS;
    for (uint32_t i = 0; i < (sizeof pins / sizeof pins[0]); i++) {
        pin_setup(GPIO(pins[i].port), &pins[i]);
    }
    pin_setup(GPIO(enable_pin.port), &enable_pin);
    pin_setup(GPIO(led_pin.port), &led_pin);
    pin_setup(GPIO(estop_pin.port), &estop_pin);
    if (BOARD_IMU) {
        imu_bus_open();
    }
}

/* Behind the boot loader the store has sectors 1 and 2; an image that stands alone covers these, and takes the last
 * two. */
terrapin_store *hardware_store(void) {
    static const terrapin_flash_area behind[2] = {{0x4000U, 0x4000U}, {0x8000U, 0x4000U}};
    static const terrapin_flash_area last[2] = {{0xC0000U, 0x20000U}, {0xE0000U, 0x20000U}};
    const terrapin_flash_area *pages = (slot() == (uint8_t)TERRAPIN_UPDATE_SLOT_NONE) ? last : behind;
    const terrapin_flash_area both = {pages[0].offset, pages[0].size + pages[1].size};
    store_flash = flash_open(&store_memory, FLASH, (uint8_t *)FLASH_MEMORY, both);
    return terrapin_store_open(&store, &store_flash, pages) ? &store : NULL;
}

terrapin_update *hardware_update(void) {
    const terrapin_flash_area records_and_slots = {
        TERRAPIN_LAYOUT_RECORDS_0, TERRAPIN_LAYOUT_SLOT_B + TERRAPIN_LAYOUT_SLOT_SIZE - TERRAPIN_LAYOUT_RECORDS_0};
    if (slot() == (uint8_t)TERRAPIN_UPDATE_SLOT_NONE) {
        return NULL;
    }
    boot_flash = flash_open(&boot_memory, FLASH, (uint8_t *)FLASH_MEMORY, records_and_slots);
    terrapin_update_init(&update, &boot, slot());
    return &update;
}

static void start_tick(uint32_t core_hz) {
    DBGMCU_CR |= DBGMCU_SLEEP; /* else the cycle counter stands still while the controller waits */
    DEMCR |= DEMCR_TRCENA;
    DWT->CYCCNT = 0U;
    DWT->CTRL |= DWT_CTRL_CYCCNTENA;
    tick_period = core_hz / (uint32_t)TERRAPIN_TICK_HZ;
    SYSTICK->LOAD = tick_period - 1U;
    SYSTICK->VAL = 0U;
    SYSTICK->CTRL = SYSTICK_CORE | SYSTICK_TICKINT | SYSTICK_ENABLE;
}

static void start_motor(const clocks *speed) {
    static const uint8_t channels[ANALOG_CHANNELS] = BOARD_CHANNELS;
    bridge_open(&motor, TIM1, speed->tim_hz, BOARD_PWM_HZ, BOARD_DEAD_TIME_NS);
    analog_open(&sensors, ADC1, ADC_COMMON, DMA2, TIM2, channels);
    encoder_open(TIM3, BOARD_MOTOR_REVERSED);
    encoder_open(TIM4, BOARD_GROUND_REVERSED);
}

void hardware_open(const clocks *speed) {
    PWR->CR |= PWR_CR_PVDE | PWR_CR_PLS_2V7;
    setup_pins();
    start_motor(speed);
    if (BOARD_IMU) {
        spi_open(SPI1);
    }
}

static uint8_t stored_node(void) {
    terrapin_record record = {0};
    if (slot() != (uint8_t)TERRAPIN_UPDATE_SLOT_NONE) {
        terrapin_records_read(&boot_flash, &record);
    }
    return record.node;
}

hardware_facts hardware_look(const clocks *speed, uint32_t flags) {
    uint32_t generation = 0U;
    uint32_t start = 0U;
    const uint32_t *key = NULL;
    if (slot() != (uint8_t)TERRAPIN_UPDATE_SLOT_NONE) {
        key = link_key((const uint32_t *)(FLASH_MEMORY + TERRAPIN_LAYOUT_LINK_KEY), &generation);
    }
    if ((key != NULL) && !random_word(&start)) {
        generation = 0U; /* no session without a number of this start: IDLE alone is taken */
    }
    const hardware_facts facts = {
        .link_key = key,
        .link_generation = generation,
        .start = start,
        .stopped = retained_stopped(&retained),
        .clock_fallback = speed->result != CLOCK_GOOD,
        .watchdog_absent = !watchdog_set(&guard, IWDG, WATCHDOG_ERASE), /* the stored parameters are read first */
        .brown_out_unset = (FLASH->OPTCR & FLASH_OPTCR_BOR) == FLASH_OPTCR_BOR_OFF,
        .reset_cause = reset_cause(flags, retained_take(&retained)),
        .board = BOARD_NUMBER,
        .no_ground_wheel = !BOARD_GROUND_WHEEL,
        .slot = slot(),
        .node = stored_node(),
        .unique = unique_number(),
        .core_hz = speed->core_hz,
    };
    reset_cause_forget(RCC);
    return facts;
}

void hardware_start(uint32_t core_hz) {
    start_tick(core_hz);
    (void)watchdog_set(&guard, IWDG, WATCHDOG_WORK);
}
