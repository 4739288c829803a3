/* The controller's image: the chip's parts put together. What is decided is decided in the other files. */
#include "analog.h"
#include "boards/selected.h"
#include "boot_key.h"
#include "bridge.h"
#include "clock.h"
#include "crc32.h"
#include "encoder.h"
#include "flash_driver.h"
#include "layout.h"
#include "parameters.h"
#include "pins.h"
#include "port.h"
#include "reset_cause.h"
#include "startup.h"
#include "state_memory.h"
#include "watchdog.h"

#define FLUSH_TRIES 2000000U /* 0.1 s at 168 MHz */
#define FLUSH_TICKS 5U       /* for the frames that wait for the bus */

static terrapin_store store;
static flash_driver store_memory, boot_memory;
static terrapin_flash store_flash, boot_flash;
static const terrapin_boot boot = {.flash = &boot_flash, .key = terrapin_boot_key};
static terrapin_update update;
static can bus;
static usart line;
static analog sensors;
static watchdog guard;
static bridge motor;
static port controller;

static volatile uint32_t ticks;
static volatile uint32_t tick_cycles;
static uint32_t tick_period; /* cycles */

const port_parameter port_parameters[] = BOARD_PARAMETERS;
const uint32_t port_parameter_count = sizeof port_parameters / sizeof port_parameters[0];

static const pin estop_pin = BOARD_ESTOP;
static const pin enable_pin = BOARD_ENABLE;
static const pin led_pin = BOARD_LED;

/* COMMAND to STORE_READ, updates, SENSORS_*: eight identifiers each. All other traffic stays in the chip. */
static const can_filter filters[] = {{0x080U, 0x7F8U}, {0x0A0U, 0x7F8U}, {0x100U, 0x7F8U}};

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

void usart1_interrupt(void) {
    usart_interrupt(&line);
}

void can1_receive_interrupt(void) {
    can_receive_interrupt(&bus);
}

void emergency_stop(void) {
    bridge_off(TIM1);
    pin_write(GPIO(enable_pin.port), &enable_pin, false);
}

/* ---- what port.c asks for */

void port_sense(port *p, terrapin_inputs *inputs) {
    p->hardware.adc_silent = !analog_read(&sensors);
    p->hardware.bridge_break = motor.broken;
    p->hardware.brown_out = (PWR->CSR & PWR_CSR_PVDO) != 0U;
    inputs->current_code = sensors.codes[0];
    inputs->supply_code = sensors.codes[1];
    inputs->temperature_code = sensors.codes[2];
    inputs->motor_count = encoder_read(TIM3);
    inputs->ground_count = encoder_read(TIM4);
    inputs->estop = pin_read(GPIO(estop_pin.port), &estop_pin);
}

void port_drive(port *p, int16_t duty_q15, bool on) {
    bridge_drive(&motor, duty_q15, on && !p->hardware.brown_out);
    pin_write(GPIO(enable_pin.port), &enable_pin, on && !motor.broken);
}

void port_flash_work(bool begins) {
    (void)watchdog_set(&guard, IWDG, begins ? WATCHDOG_ERASE : WATCHDOG_WORK); /* absent: said at the start */
}

void port_healthy(port *p) {
    if (p->update != NULL) {
        (void)terrapin_boot_confirm(&boot, slot()); /* refused: the boot loader falls back at the next start */
    }
}

void port_reset(port *p, bool stay) {
    if (stay) {
        retained_note(&retained, RETAINED_UPDATE, 0U, 0U);
    }
    const uint32_t begin = ticks;
    while (!can_idle(p->bus) && ((ticks - begin) < FLUSH_TICKS)) {
        can_poll(p->bus); /* the answer leaves before the chip does */
    }
    (void)usart_flush(p->line, FLUSH_TRIES);
    system_reset();
}

void port_alive(port *p) {
    watchdog_feed(&guard);
    pin_write(GPIO(led_pin.port), &led_pin, (p->tick & (p->outputs.enable ? 0x80U : 0x200U)) != 0U);
}

uint32_t port_cycles(void) {
    return DWT->CYCCNT;
}

uint32_t port_tick_cycles(void) {
    return tick_cycles;
}

uint32_t port_stack_used(void) {
    return stack_used();
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
}

/* 96 bits folded to 32; 0 where the chip has none. */
static uint32_t unique_number(void) {
    uint8_t bytes[12] = {0};
    for (uint32_t i = 0; i < 3U; i++) {
        uint32_t word = 0;
        if (!probe_read(UNIQUE_ID + (4U * i), &word)) {
            return 0U;
        }
        for (uint32_t k = 0; k < 4U; k++) {
            bytes[(4U * i) + k] = (uint8_t)(word >> (8U * k));
        }
    }
    return terrapin_crc32(0U, bytes, sizeof bytes);
}

/* Behind the boot loader the store has sectors 1 and 2; an image that stands alone covers these, and takes the last
 * two. */
static terrapin_store *open_store(void) {
    static const terrapin_flash_area behind[2] = {{0x4000U, 0x4000U}, {0x8000U, 0x4000U}};
    static const terrapin_flash_area last[2] = {{0xC0000U, 0x20000U}, {0xE0000U, 0x20000U}};
    const terrapin_flash_area *pages = (slot() == (uint8_t)TERRAPIN_UPDATE_SLOT_NONE) ? last : behind;
    const terrapin_flash_area both = {pages[0].offset, pages[0].size + pages[1].size};
    store_flash = flash_open(&store_memory, FLASH, (uint8_t *)FLASH_MEMORY, both);
    return terrapin_store_open(&store, &store_flash, pages) ? &store : NULL;
}

static terrapin_update *open_update(void) {
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

static void enable_interrupt(uint32_t number) {
    NVIC_ISER[number / 32U] = BIT(number % 32U);
}

static void start_motor(const clocks *speed) {
    static const uint8_t channels[ANALOG_CHANNELS] = BOARD_CHANNELS;
    bridge_open(&motor, TIM1, speed->tim_hz, BOARD_PWM_HZ, BOARD_DEAD_TIME_NS);
    analog_open(&sensors, ADC1, ADC_COMMON, DMA2, TIM2, channels);
    encoder_open(TIM3, BOARD_MOTOR_REVERSED);
    encoder_open(TIM4, BOARD_GROUND_REVERSED);
}

_Noreturn void application(void) {
    const uint32_t flags = RCC->CSR;
    const clocks speed = clock_start(RCC, FLASH, PWR, BOARD_CRYSTAL_HZ, BOARD_INTERNAL_HZ);
    PWR->CR |= PWR_CR_PVDE | PWR_CR_PLS_2V7;
    setup_pins();
    start_motor(&speed);
    usart_open(&line, USART1, speed.apb2_hz, BOARD_BAUD);
    (void)can_open(&bus, CAN1, can_timing(speed.apb1_hz, BOARD_CAN_BIT_S), filters, sizeof filters / sizeof filters[0]);

    const port_hardware hardware = {
        .clock_fallback = speed.result != CLOCK_GOOD,
        .watchdog_absent = !watchdog_set(&guard, IWDG, WATCHDOG_ERASE), /* the stored parameters are read first */
        .brown_out_unset = (FLASH->OPTCR & FLASH_OPTCR_BOR) == FLASH_OPTCR_BOR_OFF,
        .reset_cause = reset_cause(flags, retained_take(&retained)),
        .board = BOARD_NUMBER,
        .slot = slot(),
        .unique = unique_number(),
        .core_hz = speed.core_hz,
    };
    reset_cause_forget(RCC);
    port_open(&controller, state_memory(), &bus, &line, open_store(), open_update(), &hardware);
    enable_interrupt(IRQ_USART1);
    enable_interrupt(IRQ_CAN1_RX0);
    start_tick(speed.core_hz);
    (void)watchdog_set(&guard, IWDG, WATCHDOG_WORK);
    for (;;) {
        if (!port_pass(&controller, ticks)) {
            /* Masked, so that what comes between the last look and the sleep still ends it. */
            __asm__ volatile("cpsid i" ::: "memory");
            if ((ticks == controller.tick) && (ring_used(&line.in) == 0U) && (bus.in_head == bus.in_tail)) {
                __asm__ volatile("dsb\n wfi" ::: "memory");
            }
            __asm__ volatile("cpsie i" ::: "memory");
        }
    }
}
