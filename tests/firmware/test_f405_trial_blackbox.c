/* An image on trial, with the real port, controller and records: a hundred healthy starts are confirmed in 5 to 7 s of
 * simulated time, and none of the faulty kinds ever is. */
#include <string.h>

#include "unity.h"

#include "fake_can.h"
#include "flash_emulated.h"
#include "port.h"
#include "terrapin_interface.h"

#define LIMIT_MS 130000U /* twice the time of a trial, and more */

typedef enum {
    HEALTHY,
    NO_ACKNOWLEDGE,
    BUS_OFF,
    ERROR_PASSIVE,
    NO_CAN,
    NOBODY_SPEAKS,
    DAMAGED_FRAMES,
    FOREIGN_FRAMES,
    REPEATED_FRAMES,
    NO_CURRENT_SENSOR,
    CURRENT_SENSOR_HIGH,
    NO_SUPPLY_SENSOR,
    NO_TEMPERATURE_SENSOR,
    HOT,
    SUPPLY_LOW,
    ESTOP,
    BRIDGE_BREAK,
    BROWN_OUT,
    ADC_SILENT,
    SLOW_TICK,
    HANGS,
    BUS_COMES_AND_GOES,
    LATCHED_AFTER_FOUR_SECONDS,
    PARAMETERS_CONTRADICT,
    BRIDGE_STAYS_ON,
    KINDS
} kind;

static _Alignas(8) uint8_t memory[16384];
static terrapin_state *const state = (terrapin_state *)memory;
static uint8_t flash_bytes[TERRAPIN_FLASH_F405_SIZE];
static terrapin_flash_emulated chip_memory;
static terrapin_flash flash;
static const uint8_t keys[64];
static terrapin_boot boot;
static terrapin_update update;
static fake_can chip;
static can bus;
static usart_registers serial;
static usart line;
static port controller;
static kind now_kind;
static uint32_t healthy, healthy_at, resets;
static bool driven;
static bool spoilt; /* frames are damaged from the second on */

const hardware_parameter hardware_parameters[] = {{TERRAPIN_PARAMETER_SUPPLY_SCALE, 4592}};
const uint32_t hardware_parameter_count = 1U;

void hardware_sense(hardware_facts *facts, terrapin_inputs *inputs) {
    inputs->current_code = (now_kind == NO_CURRENT_SENSOR) ? 0U : ((now_kind == CURRENT_SENSOR_HIGH) ? 4095U : 2048U);
    inputs->supply_code = (now_kind == NO_SUPPLY_SENSOR) ? 4095U : ((now_kind == SUPPLY_LOW) ? 900U : 2613U);
    inputs->temperature_code = (now_kind == NO_TEMPERATURE_SENSOR) ? 0U : ((now_kind == HOT) ? 4000U : 1500U);
    inputs->estop = (now_kind == ESTOP) || ((now_kind == LATCHED_AFTER_FOUR_SECONDS) && (inputs->tick == 4000U));
    facts->adc_silent = now_kind == ADC_SILENT;
    facts->bridge_break = now_kind == BRIDGE_BREAK;
    facts->brown_out = now_kind == BROWN_OUT;
}

void hardware_drive(const hardware_facts *facts, int16_t duty_q15, bool on) {
    (void)facts;
    (void)duty_q15;
    driven = on;
}

void hardware_flash_work(bool begins) {
    (void)begins;
}

void hardware_healthy(void) {
    TEST_ASSERT_FALSE(driven);
    healthy++;
    healthy_at = controller.tick;
}

bool hardware_store_node(uint8_t node) {
    (void)node;
    return false;
}

void hardware_keep_stop(bool stopped) {
    TEST_ASSERT_FALSE(stopped); /* nobody said so */
}

void hardware_reset(can *to_bus, usart *to_line, bool stay) {
    (void)to_bus;
    (void)to_line;
    TEST_ASSERT_FALSE(stay);
    TEST_ASSERT_FALSE(driven);
    resets++;
}

void hardware_alive(bool lit) {
    (void)lit;
}

uint32_t hardware_cycles(void) {
    return 0U;
}

uint32_t hardware_tick_cycles(void) {
    return 0U;
}

uint32_t hardware_stack_used(void) {
    return 1000U;
}

void setUp(void) {}

void tearDown(void) {}

static void start(kind is, bool trial) {
    static const terrapin_filter all = {0U, 0U};
    const hardware_facts hardware = {.core_hz = 168000000U};
    const terrapin_record record = {
        .confirmed = TERRAPIN_UPDATE_SLOT_B,
        .candidate = trial ? TERRAPIN_UPDATE_SLOT_A : TERRAPIN_UPDATE_SLOT_NONE,
        .phase = trial ? TERRAPIN_UPDATE_PHASE_TRIAL : TERRAPIN_UPDATE_PHASE_NONE,
    };
    now_kind = is;
    healthy = healthy_at = resets = 0U;
    memset(flash_bytes, 0xFF, sizeof flash_bytes);
    terrapin_flash_emulated_init(&chip_memory, flash_bytes, terrapin_flash_f405_sectors, TERRAPIN_FLASH_F405_SECTORS,
                                 4U);
    flash = terrapin_flash_emulated_driver(&chip_memory);
    TEST_ASSERT_TRUE(terrapin_records_append(&flash, &record));
    boot = (terrapin_boot){.flash = &flash, .keys = keys};
    terrapin_update_init(&update, &boot, TERRAPIN_UPDATE_SLOT_A);
    fake_open(&chip);
    memset(&serial, 0, sizeof serial);
    usart_open(&line, &serial, 84000000U, 1000000U);
    (void)can_open(&bus, &chip.r, can_timing(42000000U, 1000000U), &all, 1U);
    chip.r.MSR = (is == NO_CAN) ? CAN_MSR_INAK : 0U;
    can_poll(&bus);
    port_open(&controller, state, &bus, &line, NULL, &update, &hardware);
}

static void give(kind is, uint32_t request, uint32_t counter) {
    terrapin_frame frame = {0};
    const terrapin_command_t message = {.request = (int32_t)request, .setpoint = 1000};
    (void)terrapin_encode_command(&message, &frame);
    terrapin_e2e_protect(&frame, counter);
    if ((is == DAMAGED_FRAMES) || (spoilt && controller.health.heard)) {
        frame.data[7] ^= 1U;
    } else if (is == FOREIGN_FRAMES) {
        frame.id = 0x300U;
    } else {
        /* as it is */
    }
    fake_receive(&chip, &bus, &frame);
}

/* One tick of controller and bus. */
static void live(uint32_t tick, uint32_t first, uint32_t request) {
    static uint32_t counter;
    const kind is = now_kind;
    const bool lost = (is == NO_ACKNOWLEDGE) || ((is == BUS_COMES_AND_GOES) && (tick % 4000U < 20U));
    const bool broken = lost || (is == NO_CAN);
    if ((tick >= first) && (tick % 50U == 0U) && (is != NOBODY_SPEAKS) && !broken) {
        counter = (is == REPEATED_FRAMES) ? 0U : ((counter + 1U) % 15U);
        give(is, (is == REPEATED_FRAMES) ? TERRAPIN_REQUEST_RUN : request, counter);
    }
    chip.r.ESR = lost ? (CAN_ESR_EPVF | CAN_ESR_LEC_AK) : 0U;
    chip.r.ESR |= (is == BUS_OFF) ? CAN_ESR_BOFF : 0U;
    chip.r.ESR |= (is == ERROR_PASSIVE) ? CAN_ESR_EPVF : 0U;
    fake_settle(&chip);
    for (int box = fake_first(&chip); !broken && (box >= 0); box = fake_first(&chip)) {
        (void)fake_sent(&chip, box);
    }
    for (uint32_t pass = 0U; (pass < 4U) && (controller.tick == tick - 1U); pass++) {
        (void)port_pass(&controller, tick - 1U); /* frames */
    }
    (void)port_pass(&controller, tick);
}

static void test_a_hundred_healthy_images_are_confirmed(void) {
    for (uint32_t run = 0U; run < 100U; run++) {
        start(HEALTHY, (run % 2U) == 0U);
        TEST_ASSERT_EQUAL((run % 2U) == 0U, controller.trial);
        for (uint32_t tick = 1U; tick <= 7000U; tick++) {
            live(tick, run * 50U, TERRAPIN_REQUEST_IDLE);
        }
        TEST_ASSERT_EQUAL_UINT32(1U, healthy);
        TEST_ASSERT_GREATER_OR_EQUAL(5000U, healthy_at);
        TEST_ASSERT_LESS_OR_EQUAL(7000U, healthy_at);
        TEST_ASSERT_EQUAL_UINT32(0U, resets);
    }
}

/* One good frame, some time: a bus that is disturbed afterwards is no fault of the image. */
static void test_one_good_frame_is_enough(void) {
    spoilt = true;
    start(HEALTHY, true);
    for (uint32_t tick = 1U; tick <= 7000U; tick++) {
        live(tick, 0U, TERRAPIN_REQUEST_IDLE);
    }
    spoilt = false;
    TEST_ASSERT_EQUAL_UINT32(1U, healthy);
    TEST_ASSERT_GREATER_THAN_UINT32(100U, controller.link.bad_crc);
}

static void test_no_faulty_image_is_confirmed(void) {
    TEST_ASSERT_GREATER_OR_EQUAL(20, KINDS - 1);
    for (kind is = NO_ACKNOWLEDGE; is < KINDS; is++) {
        start(is, true);
        if (is == PARAMETERS_CONTRADICT) {
            TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK,
                              terrapin_parameter_set(state, TERRAPIN_PARAMETER_CALIBRATE_LOW, 7000));
        }
        const bool on = is == BRIDGE_STAYS_ON;
        const uint32_t end = on ? 600000U : LIMIT_MS;
        for (uint32_t tick = 1U; (tick <= end) && (resets == 0U) && !((is == HANGS) && (tick > 3000U)); tick++) {
            if ((is == SLOW_TICK) && (tick % 100U == 0U)) {
                continue;
            }
            live(tick, 0U, on ? TERRAPIN_REQUEST_RUN : TERRAPIN_REQUEST_IDLE);
        }
        TEST_ASSERT_EQUAL_UINT32_MESSAGE(0U, healthy, "confirmed");
        if (is == HANGS) { /* the boot loader's watchdog resets it */
            TEST_ASSERT_EQUAL_UINT32(0U, resets);
        } else if (on) { /* not while it drives; then */
            TEST_ASSERT_TRUE(driven);
            TEST_ASSERT_EQUAL_UINT32(0U, resets);
        } else {
            TEST_ASSERT_EQUAL_UINT32(1U, resets);
            TEST_ASSERT_UINT32_WITHIN(2U, HEALTH_LIMIT_MS + ((is == SLOW_TICK) ? 606U : 0U), controller.tick);
        }
    }
}

static void test_a_confirmed_image_never_resets_itself(void) {
    start(NO_ACKNOWLEDGE, false);
    for (uint32_t tick = 1U; tick <= LIMIT_MS; tick++) {
        live(tick, 0U, TERRAPIN_REQUEST_IDLE);
    }
    TEST_ASSERT_EQUAL_UINT32(0U, resets);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_hundred_healthy_images_are_confirmed);
    RUN_TEST(test_one_good_frame_is_enough);
    RUN_TEST(test_no_faulty_image_is_confirmed);
    RUN_TEST(test_a_confirmed_image_never_resets_itself);
    return UNITY_END();
}
