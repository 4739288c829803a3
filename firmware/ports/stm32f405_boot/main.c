/* The boot loader's image: sector 0 of the STM32F405. The chip's parts are those of ports/stm32f405.
 *
 * After reset it listens for 100 ms on CAN and USART1. A host that asks (UPDATE_QUERY), or an application that asked
 * before its reset (RETAINED_UPDATE), makes it stay and serve updates; otherwise it starts what terrapin_boot_choose
 * says. It stays, too, when there is nothing to start. A minute outside of an update, or without one of its frames,
 * is a reset: a host that went away, or that only asks, leaves no robot behind that waits for ever. The motor is off
 * throughout: its pins are left as the reset leaves them, but for the gate driver's enable line, which is held low.
 */
#include "boards/selected.h"
#include "boot_key.h"
#include "can.h"
#include "clock.h"
#include "flash_driver.h"
#include "layout.h"
#include "pins.h"
#include "processor.h"
#include "retained.h"
#include "serial.h"
#include "startup.h"
#include "unique.h"
#include "usart.h"
#include "watchdog.h"

#define LISTEN_MS 100U
#define IDLE_MS   60000U
#define FLUSH     2000000U /* tries: 0.1 s */

static can bus;
static usart line;
static watchdog guard;
static flash_driver flash_memory;
static terrapin_boot_serial serial;
static volatile uint32_t now_ms;

static const pin enable_pin = BOARD_ENABLE;

void systick_interrupt(void) {
    now_ms++;
}

void usart1_interrupt(void) {
    usart_interrupt(&line);
}

void can1_receive_interrupt(void) {
    can_receive_interrupt(&bus);
}

void emergency_stop(void) {
    pin_write(GPIO(enable_pin.port), &enable_pin, false);
}

/* Of the board's pins those of USART1 and CAN1 alone (alternate functions 7 and 9, DS8626 table 9). */
static void setup_pins(void) {
    static const pin pins[] = BOARD_PINS;
    for (uint32_t i = 0U; i < (sizeof pins / sizeof pins[0]); i++) {
        if ((pins[i].function == 7U) || (pins[i].function == 9U)) {
            pin_setup(GPIO(pins[i].port), &pins[i]);
        }
    }
    pin_setup(GPIO(enable_pin.port), &enable_pin);
    pin_write(GPIO(enable_pin.port), &enable_pin, false);
}

static void enable_interrupt(uint32_t number) {
    NVIC_ISER[number / 32U] = BIT(number % 32U);
}

static void start_chip(const clocks *speed) {
    const terrapin_filter updates = {serial.node.first[TERRAPIN_BLOCK_UPDATES],
                                     0x7FFU & ~(TERRAPIN_UPDATE_ID_LAST - TERRAPIN_UPDATE_ID_FIRST)};
    setup_pins();
    usart_open(&line, USART1, speed->apb2_hz, BOARD_BAUD);
    (void)can_open(&bus, CAN1, can_timing(speed->apb1_hz, BOARD_CAN_BIT_S), &updates, 1U);
    enable_interrupt(IRQ_USART1);
    enable_interrupt(IRQ_CAN1_RX0);
    SYSTICK->LOAD = (speed->core_hz / 1000U) - 1U;
    SYSTICK->VAL = 0U;
    SYSTICK->CTRL = SYSTICK_CORE | SYSTICK_TICKINT | SYSTICK_ENABLE;
}

/* The two sources have one update between them: the last that asked is answered. True when it was answered. */
static bool serve(void) {
    uint8_t text[TERRAPIN_BOOT_SERIAL_ANSWER_MAX];
    terrapin_frame frame = {0};
    terrapin_frame replies[TERRAPIN_UPDATE_REPLIES];
    uint8_t byte = 0U;
    bool any = false;
    serial.update.now_ms = now_ms;
    if (can_take(&bus, &frame)) {
        const uint32_t count = terrapin_boot_frame(&serial, &frame, false, replies);
        for (uint32_t i = 0U; i < count; i++) {
            (void)can_send(&bus, &replies[i], CAN_KEEP);
        }
        any = any || (count > 0U);
    }
    /* Nothing is taken whose answer has no room. */
    if ((ring_free(&line.out) >= sizeof text) && usart_take(&line, &byte)) {
        const uint32_t length = terrapin_boot_serial_take(&serial, byte, false, text);
        (void)usart_send(&line, text, length);
        any = any || (length > TERRAPIN_SLCAN_REPLY_MAX); /* a frame went out */
    }
    can_poll(&bus);
    return any;
}

/* Whether somebody asked within the time. */
static bool asked(uint32_t time_ms) {
    const uint32_t begin = now_ms;
    bool any = false;
    while (!any && ((now_ms - begin) < time_ms)) {
        any = serve();
    }
    return any;
}

_Noreturn void application(void) {
    const bool wanted = retained_look(&retained) == RETAINED_UPDATE;
    const terrapin_flash_area serves = {TERRAPIN_LAYOUT_RECORDS_0,
                                        TERRAPIN_LAYOUT_SLOT_B + TERRAPIN_LAYOUT_SLOT_SIZE - TERRAPIN_LAYOUT_RECORDS_0};
    const clocks speed = clock_start(RCC, FLASH, PWR, BOARD_CRYSTAL_HZ, BOARD_INTERNAL_HZ);
    const terrapin_flash flash = flash_open(&flash_memory, FLASH, (uint8_t *)FLASH_MEMORY, serves);
    const terrapin_boot boot = {.flash = &flash,
                                .keys = terrapin_boot_keys,
                                .key_ids = TERRAPIN_BOOT_KEY_IDS,
                                .release = TERRAPIN_BOOT_RELEASE,
                                .board = (uint8_t)BOARD_NUMBER,
                                .unit = unique_number()};
    terrapin_boot_serial_init(&serial, &boot, TERRAPIN_UPDATE_SLOT_NONE);
    start_chip(&speed);
    if (wanted) {
        (void)retained_take(&retained);
    } else if (!asked(LISTEN_MS)) {
        terrapin_boot_choice choice = {0};
        terrapin_boot_choose(&boot, &choice);
        if (choice.slot != (uint8_t)TERRAPIN_UPDATE_SLOT_NONE) {
            (void)usart_flush(&line, FLUSH);
            /* For an image that hangs before it has set it itself: its trial ends by this. */
            (void)watchdog_set(&guard, IWDG, WATCHDOG_ERASE);
            start_image(choice.address);
        }
    } else {
        /* a host is there */
    }
    uint32_t last_ms = now_ms;
    while (!serial.update.reset && ((now_ms - last_ms) < IDLE_MS)) {
        if (serve() && serial.update.active) {
            last_ms = now_ms;
        }
    }
    const uint32_t end_ms = now_ms;
    while ((now_ms - end_ms) < 10U) { /* the last answer leaves, over CAN as well */
        can_poll(&bus);
    }
    (void)usart_flush(&line, FLUSH);
    if (serial.update.stay) {
        retained_note(&retained, RETAINED_UPDATE, 0U, 0U);
    }
    system_reset();
}
