/* The port's passes, with the real controller, a chip and a clock made of memory: nothing that comes from outside makes
 * it miss a tick, its queues stay bounded, its own frames leave by priority, and the bridge follows what it may. */
#include <string.h>

#include "unity.h"

#include "fake_can.h"
#include "flash_emulated.h"
#include "parameters.h"
#include "port.h"
#include "terrapin_interface.h"
#include "terrapin_scaling.h"

/* What things take, in microseconds; the chip is faster (docs/stm32f405.md). */
#define TICK_US      1000U
#define OWN_TICK_US  400U
#define EMPTY_US     1U
#define FRAME_BIT_US 1U /* 1 Mbit/s */

static _Alignas(8) uint8_t memory[16384];
static terrapin_state *const state = (terrapin_state *)memory;
static fake_can chip;
static can bus;
static usart_registers serial;
static usart line;
static port controller;
static bool driven;
static int16_t duty;
static uint32_t now_us;
static uint32_t alive;
static bool estop;
static uint32_t flash_work, flash_rest, healthy, resets;
static uint8_t stored_node;

const hardware_parameter hardware_parameters[] = {{TERRAPIN_PARAMETER_SUPPLY_SCALE, 4592}};
const uint32_t hardware_parameter_count = 1U;

void hardware_sense(hardware_facts *facts, terrapin_inputs *inputs) {
    (void)facts;
    inputs->current_code = 2048U;
    inputs->supply_code = 2613U; /* 12 V at 4592 uV a code */
    inputs->temperature_code = 1500U;
    inputs->estop = estop;
}

void hardware_drive(const hardware_facts *facts, int16_t duty_q15, bool on) {
    (void)facts;
    driven = on;
    duty = on ? duty_q15 : 0;
}

void hardware_flash_work(bool begins) {
    flash_work += begins ? 1U : 0U;
    flash_rest += begins ? 0U : 1U;
}

void hardware_healthy(void) {
    TEST_ASSERT_FALSE(driven);
    healthy++;
}

bool hardware_store_node(uint8_t node) {
    TEST_ASSERT_FALSE(driven);
    TEST_ASSERT_EQUAL_UINT32(flash_rest + 1U, flash_work); /* the watchdog has time for an erase */
    stored_node = node;
    return true;
}

static bool stop_kept;
void hardware_keep_stop(bool stopped) {
    stop_kept = stopped;
}

void hardware_reset(can *to_bus, usart *to_line, bool stay) {
    TEST_ASSERT_EQUAL_PTR(&bus, to_bus);
    TEST_ASSERT_EQUAL_PTR(&line, to_line);
    TEST_ASSERT_FALSE(driven);
    resets += stay ? 100U : 1U;
}

/* The LED: half periods of 0.5 s, and of 0.128 s while the bridge is on. */
void hardware_alive(bool lit) {
    TEST_ASSERT_EQUAL(((controller.tick / (controller.outputs.enable ? 128U : 512U)) % 2U) == 1U, lit);
    alive++;
}

static uint32_t cycles_a_look, cycles_looked; /* that pass from one look at the counter to the next */
uint32_t hardware_cycles(void) {
    cycles_looked += cycles_a_look;
    return (now_us * 168U) + cycles_looked;
}

uint32_t hardware_tick_cycles(void) {
    return (now_us / TICK_US) * TICK_US * 168U;
}

uint32_t hardware_stack_used(void) {
    return 1000U;
}

void setUp(void) {
    static const terrapin_filter all = {0U, 0U};
    fake_open(&chip);
    memset(&serial, 0, sizeof serial);
    usart_open(&line, &serial, 84000000U, 1000000U);
    (void)can_open(&bus, &chip.r, can_timing(42000000U, 1000000U), &all, 1U);
    chip.r.MSR = 0U;
    can_poll(&bus);
    const hardware_facts hardware = {.core_hz = 168000000U, .reset_cause = TERRAPIN_RESET_CAUSE_POWER_ON};
    estop = false;
    driven = false;
    now_us = 0U;
    alive = 0U;
    flash_work = flash_rest = healthy = resets = 0U;
    TEST_ASSERT_LESS_OR_EQUAL(sizeof memory, terrapin_state_size());
    port_open(&controller, state, &bus, &line, NULL, NULL, &hardware);
}

void tearDown(void) {}

/* ---- a bus at 1 Mbit/s that is never idle */

typedef struct {
    terrapin_frame foreign; /* somebody always wants to send this */
    uint32_t foreign_bits;  /* that it takes */
    uint32_t frame_us;      /* what one received frame costs us */
    uint32_t busy_until_us; /* the bus */
    uint32_t own[0x800];    /* own frames that left, by identifier */
    uint16_t last_own;
    uint32_t inversions; /* an own frame left while one before it waited in a mailbox */
    uint32_t worst_queue;
} traffic;

/* The bus up to the present: each frame goes to the lowest identifier that wants to send. */
static void run_bus(traffic *t) {
    while (t->busy_until_us <= now_us) {
        fake_settle(&chip);
        const int box = fake_first(&chip);
        const uint16_t ours = (box >= 0) ? (uint16_t)(chip.r.tx[box].IR >> CAN_IR_STID) : 0xFFFFU;
        if (ours < t->foreign.id) {
            t->own[fake_sent(&chip, box)]++;
            t->last_own = ours;
            t->busy_until_us += 135U * FRAME_BIT_US; /* 8 bytes, stuffed */
        } else {
            fake_receive(&chip, &bus, &t->foreign);
            t->busy_until_us += t->foreign_bits * FRAME_BIT_US;
        }
        const uint32_t queue = bus.in_head - bus.in_tail;
        t->worst_queue = (queue > t->worst_queue) ? queue : t->worst_queue;
    }
}

/* The processor and the bus for some time: each pass takes as long as what it did. */
static void run_for(traffic *t, uint32_t duration_us) {
    const uint32_t end = now_us + duration_us;
    while (now_us < end) {
        const uint32_t tick = controller.tick;
        const uint32_t tail = bus.in_tail;
        (void)port_pass(&controller, now_us / TICK_US);
        now_us += EMPTY_US + ((bus.in_tail - tail) * t->frame_us) + ((controller.tick != tick) ? OWN_TICK_US : 0U);
        run_bus(t);
    }
}

static void test_foreign_frames_at_full_load(void) {
    /* The shortest frames there are, past the filters, behind ours in priority: 21 a tick. */
    static traffic t;
    t = (traffic){.foreign = {.id = 0x300U}, .foreign_bits = 47U, .frame_us = 5U};
    run_for(&t, 5U * 1000U * 1000U);
    TEST_ASSERT_EQUAL_UINT32(0U, controller.overruns);
    TEST_ASSERT_EQUAL_UINT32(5000U, controller.tick + 1U); /* 0 to 4999 */
    TEST_ASSERT_EQUAL_UINT32(controller.tick, alive);
    TEST_ASSERT_EQUAL_UINT32(0U, bus.in_lost);
    TEST_ASSERT_LESS_OR_EQUAL(CAN_IN_SIZE, t.worst_queue);
    TEST_ASSERT_GREATER_THAN(30000U, controller.link.unknown); /* and they did come */
    /* Own frames all left: one ACTUATE a tick, each message of telemetry in its slot, the port's own. */
    TEST_ASSERT_EQUAL_UINT32(0U, bus.out_lost);
    TEST_ASSERT_GREATER_OR_EQUAL(4997U, t.own[TERRAPIN_ID_ACTUATE]);
    TEST_ASSERT_GREATER_OR_EQUAL(498U, t.own[TERRAPIN_ID_GROUND]);
    TEST_ASSERT_GREATER_OR_EQUAL(48U, t.own[TERRAPIN_ID_PORT_STATUS]);
    TEST_ASSERT_GREATER_OR_EQUAL(48U, t.own[TERRAPIN_ID_PORT_TIMES]);
    TEST_ASSERT_GREATER_OR_EQUAL(4U, t.own[TERRAPIN_ID_PORT_IDENTITY]);
}

static void test_more_frames_than_it_can_take(void) {
    /* Frames that cost more than there is time for: 21 times 60 us in a tick. Ticks still come first. */
    static traffic t;
    t = (traffic){.foreign = {.id = 0x300U}, .foreign_bits = 47U, .frame_us = 60U};
    run_for(&t, 2U * 1000U * 1000U);
    TEST_ASSERT_EQUAL_UINT32(0U, controller.overruns);
    TEST_ASSERT_EQUAL_UINT32(2000U, controller.tick + 1U);
    TEST_ASSERT_EQUAL_UINT32(CAN_IN_SIZE, t.worst_queue); /* full, no more */
    TEST_ASSERT_GREATER_THAN(1000U, bus.in_lost);         /* and said */
    TEST_ASSERT_GREATER_OR_EQUAL(1997U, t.own[TERRAPIN_ID_ACTUATE]);
}

static void test_flood_of_parameter_writes(void) {
    /* Well-formed, 8 bytes, each the same counter: dropped, but only after their CRC was computed, and at the price of
     * writes: one a tick with the bridge off. Those for which there is no room are counted. */
    static traffic t;
    t = (traffic){.foreign = {.id = TERRAPIN_ID_PARAMETER_WRITE, .length = 8}, .foreign_bits = 111U, .frame_us = 30U};
    terrapin_e2e_protect(&t.foreign, 3U);
    run_for(&t, 2U * 1000U * 1000U);
    TEST_ASSERT_EQUAL_UINT32(0U, controller.overruns);
    TEST_ASSERT_EQUAL_UINT32(2000U, controller.tick + 1U);
    const uint32_t taken = controller.link.repeated + 1U; /* the first was no repetition */
    TEST_ASSERT_UINT32_WITHIN(2U, 2000U, taken);
    TEST_ASSERT_EQUAL_UINT32(0U, bus.in_lost);
    TEST_ASSERT_GREATER_THAN(10000U, controller.intake.lost);
    TEST_ASSERT_EQUAL_UINT32(bus.in_tail,
                             taken + controller.intake.lost + controller.intake.count); /* all accounted for */
}

static void test_babbling_idiot_before_us(void) {
    /* Somebody sends before all our identifiers, without a gap: nothing of ours gets out, nothing piles up. */
    static traffic t;
    t = (traffic){.foreign = {.id = 0x001U, .length = 8}, .foreign_bits = 111U, .frame_us = 5U};
    run_for(&t, 1000U * 1000U);
    TEST_ASSERT_EQUAL_UINT32(0U, controller.overruns);
    TEST_ASSERT_EQUAL_UINT32(0U, t.own[TERRAPIN_ID_ACTUATE]);
    TEST_ASSERT_LESS_OR_EQUAL(CAN_OUT_SIZE, bus.out_count);
    TEST_ASSERT_EQUAL_UINT32(0U, bus.out_lost); /* telemetry is replaced by newer telemetry */
    /* When it ends, the first of ours leaves first, and what leaves is of now. */
    t.foreign.id = 0x7FFU;
    t.own[TERRAPIN_ID_ACTUATE] = 0U;
    run_for(&t, 100U * 1000U);
    TEST_ASSERT_GREATER_OR_EQUAL(99U, t.own[TERRAPIN_ID_ACTUATE]);
    TEST_ASSERT_LESS_OR_EQUAL(103U, t.own[TERRAPIN_ID_ACTUATE]);
}

/* ---- what the bridge follows */

static terrapin_frame command(uint8_t request, int16_t setpoint, uint32_t counter) {
    const terrapin_command_t message = {.request = request, .control = TERRAPIN_CONTROL_VOLTAGE, .setpoint = setpoint};
    terrapin_frame frame = {0};
    (void)terrapin_encode_command(&message, &frame);
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static terrapin_frame test_mode(uint32_t key, uint32_t counter) {
    const terrapin_test_mode_t message = {.key = key};
    terrapin_frame frame = {0};
    (void)terrapin_encode_test_mode(&message, &frame);
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static void give(const terrapin_frame *frame) {
    fake_receive(&chip, &bus, frame);
    (void)port_pass(&controller, controller.tick);
}

#define UNTIL_RUN (TERRAPIN_LIMIT_STOP_HOLD + 300U) /* an IDLE holds for so long, and the bridge is on after it */

/* Ticks with a command each 50 ms; the bridge's state at the end. */
static bool ticks(uint32_t count, uint8_t request) {
    for (uint32_t i = 0; i < count; i++) {
        if ((i % 50U) == 0U) {
            static uint32_t counter;
            const terrapin_frame frame = command(request, 1000, counter % 15U);
            counter++;
            give(&frame);
        }
        (void)port_pass(&controller, controller.tick + 1U);
    }
    return driven;
}

static void test_idle_stops_the_motor_in_the_same_tick(void) {
    /* Behind as many store requests as there is room for, which would take 32 ticks with the bridge on. */
    (void)ticks(1000U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    const terrapin_frame read = {.id = TERRAPIN_ID_STORE_READ, .length = 1U};
    for (uint32_t i = 0; i < TERRAPIN_INTAKE_SIZE; i++) {
        give(&read);
    }
    TEST_ASSERT_GREATER_OR_EQUAL(TERRAPIN_INTAKE_SIZE - 2U, controller.intake.count);
    const terrapin_frame idle = command(TERRAPIN_REQUEST_IDLE, 0, 14U);
    give(&idle);
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, controller.inputs.command.request);
    (void)port_pass(&controller, controller.tick + 1U);
    TEST_ASSERT_FALSE(driven);
    TEST_ASSERT_EQUAL_UINT32(0U, controller.intake.lost);
}

static void test_runs_and_stops_on_the_port_s_faults(void) {
    TEST_ASSERT_FALSE(ticks(1500U, TERRAPIN_REQUEST_IDLE)); /* never starts with the bridge on */
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    TEST_ASSERT_GREATER_THAN(0, duty);
    controller.hardware.bridge_break = true;
    (void)port_pass(&controller, controller.tick + 1U);
    TEST_ASSERT_FALSE(driven); /* in the same tick */
    TEST_ASSERT_TRUE((controller.outputs.faults & BIT(TERRAPIN_FAULT_ESTOP)) != 0U);
    controller.hardware.bridge_break = false;
    TEST_ASSERT_FALSE(ticks(300U, TERRAPIN_REQUEST_RUN)); /* latched */
    (void)ticks(300U, TERRAPIN_REQUEST_CLEAR);
    (void)ticks(300U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    controller.hardware.brown_out = true;
    (void)port_pass(&controller, controller.tick + 1U);
    TEST_ASSERT_FALSE(driven);
}

/* The port has no sensor of the swing: with a guard the motor does not start, and STATUS says why. */
static void test_a_guard_without_its_sensor_keeps_the_bridge_off(void) {
    (void)ticks(1500U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set(state, TERRAPIN_PARAMETER_SWING_LIMIT, 1134));
    (void)ticks(50U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_FALSE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    TEST_ASSERT_EQUAL_HEX32(BIT(TERRAPIN_FAULT_SWING_SENSOR), controller.outputs.faults);
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set(state, TERRAPIN_PARAMETER_SWING_LIMIT, 0));
    (void)ticks(300U, TERRAPIN_REQUEST_CLEAR);
    (void)ticks(300U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    TEST_ASSERT_EQUAL_HEX32(0U, controller.outputs.faults);
}

static void test_test_mode_holds_the_bridge_off_and_stops_the_own_clock(void) {
    (void)ticks(1500U, TERRAPIN_REQUEST_IDLE);
    const terrapin_frame arm = test_mode(TERRAPIN_TEST_MODE_KEY, 1U);
    driven = true; /* whatever it was */
    give(&arm);
    TEST_ASSERT_TRUE(controller.link.test_mode);
    TEST_ASSERT_FALSE(driven);
    int32_t scale = 0;
    (void)terrapin_parameter_get(state, TERRAPIN_PARAMETER_SUPPLY_SCALE, &scale);
    TEST_ASSERT_EQUAL_INT32(terrapin_parameter((uint16_t)TERRAPIN_PARAMETER_SUPPLY_SCALE).default_value, scale);
    const terrapin_outputs before = controller.outputs;
    for (int i = 0; i < 100; i++) {
        driven = true; /* said again each tick */
        (void)port_pass(&controller, controller.tick + 1U);
        TEST_ASSERT_FALSE(driven);
    }
    TEST_ASSERT_EQUAL_MEMORY(&before, &controller.outputs, sizeof before); /* no step was taken */
    /* A tick by frames is one step, answered where it came from; the bridge stays off whatever it says. */
    for (uint32_t tick = 1; tick < 1500U; tick++) {
        if ((tick % 50U) == 0U) {
            const terrapin_frame run = command((tick < 600U) ? 0U : TERRAPIN_REQUEST_RUN, 1000, (tick / 50U) % 15U);
            give(&run);
        }
        for (int32_t channel = 0; channel < 2; channel++) {
            const terrapin_sensors_slow_t slow = {.slow_channel = channel, .slow_code = 3000};
            terrapin_frame frame = {0};
            (void)terrapin_encode_sensors_slow(&slow, &frame);
            give(&frame);
        }
        const terrapin_sensors_fast_t fast = {.current_code = 2048, .tick = (int32_t)(tick & 0xFFFFU)};
        terrapin_frame frame = {0};
        (void)terrapin_encode_sensors_fast(&fast, &frame);
        give(&frame);
        TEST_ASSERT_FALSE(driven);
    }
    TEST_ASSERT_TRUE(controller.outputs.enable);
    const terrapin_frame leave = test_mode(0U, 2U);
    give(&leave);
    TEST_ASSERT_FALSE(controller.link.test_mode);
    (void)terrapin_parameter_get(state, TERRAPIN_PARAMETER_SUPPLY_SCALE, &scale);
    TEST_ASSERT_EQUAL_INT32(4592, scale); /* the board's again */
    TEST_ASSERT_FALSE(ticks(100U, TERRAPIN_REQUEST_IDLE));
}

/* Nobody opened the line: what is published goes to the bus alone. */
static void test_a_line_that_was_not_opened_is_silent(void) {
    (void)ticks(1500U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_FALSE(controller.parser.open);
    TEST_ASSERT_EQUAL_UINT32(0U, ring_used(&line.out));
    TEST_ASSERT_EQUAL_UINT32(0U, controller.send_lost);
}

/* ---- what is kept, and what the boot loader is told */

static uint8_t pages[32768];

/* A clear ends it and is known to the next start; a reset, an IDLE or a RUN does not. */
static void test_stop_all_outlives_a_reset(void) {
    const terrapin_stop_all_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame stop;
    TEST_ASSERT_TRUE(terrapin_encode_stop_all(&message, &stop));
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    terrapin_intake_put(&controller.intake, &controller.link, state, &controller.inputs, &stop, 0U);
    (void)port_pass(&controller, controller.tick + 1U);
    TEST_ASSERT_FALSE_MESSAGE(driven, "in the next tick, in which the chip knows it, too");
    TEST_ASSERT_TRUE(stop_kept);
    hardware_facts hardware = {.core_hz = 168000000U, .stopped = stop_kept};
    port_open(&controller, state, &bus, &line, NULL, NULL, &hardware);
    TEST_ASSERT_FALSE(ticks(500U, TERRAPIN_REQUEST_IDLE));
    TEST_ASSERT_FALSE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    TEST_ASSERT_TRUE((controller.outputs.faults & BIT(TERRAPIN_FAULT_STOP_ALL)) != 0U);
    TEST_ASSERT_TRUE(stop_kept);
    (void)ticks(300U, TERRAPIN_REQUEST_CLEAR);
    TEST_ASSERT_FALSE(stop_kept);
    hardware.stopped = stop_kept;
    port_open(&controller, state, &bus, &line, NULL, NULL, &hardware);
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
}

static hardware_facts plain(void) {
    return (hardware_facts){.core_hz = 168000000U};
}

static terrapin_store store;
static terrapin_flash store_flash;
static const terrapin_flash_area areas[2] = {{0U, 16384U}, {16384U, 16384U}};

/* The port with an erased store. */
static void open_with_a_store(void) {
    static const uint32_t sectors[2] = {16384U, 16384U};
    static terrapin_flash_emulated chip_memory;
    const hardware_facts hardware = plain();
    memset(pages, 0xFF, sizeof pages);
    terrapin_flash_emulated_init(&chip_memory, pages, sectors, 2U, 4U);
    store_flash = terrapin_flash_emulated_driver(&chip_memory);
    TEST_ASSERT_TRUE(terrapin_store_open(&store, &store_flash, areas));
    port_open(&controller, state, &bus, &line, &store, NULL, &hardware);
}

static void test_saves_parameters_and_finds_them_again(void) {
    open_with_a_store();
    int32_t value = 0;
    (void)terrapin_parameter_get(state, TERRAPIN_PARAMETER_SUPPLY_SCALE, &value);
    TEST_ASSERT_EQUAL_INT32(4592, value); /* nothing stored yet: the board's */
    (void)terrapin_parameter_set(state, TERRAPIN_PARAMETER_RADIUS, 81234);

    const terrapin_store_command_t save = {.action = TERRAPIN_STORE_ACTION_SAVE};
    terrapin_frame frame = {0};
    (void)terrapin_encode_store_command(&save, &frame);
    terrapin_e2e_protect(&frame, 0U);
    give(&frame);
    for (uint32_t i = 0; i < 2000U; i++) {
        (void)port_pass(&controller, controller.tick + 1U);
    }
    TEST_ASSERT_GREATER_OR_EQUAL(1U, flash_work); /* the watchdog got its time, and lost it again */
    TEST_ASSERT_EQUAL_UINT32(flash_work, flash_rest);
    TEST_ASSERT_EQUAL_UINT32(0U, controller.overruns);

    const hardware_facts hardware = plain();
    TEST_ASSERT_TRUE(terrapin_store_open(&store, &store_flash, areas));
    port_open(&controller, state, &bus, &line, &store, NULL, &hardware);
    (void)terrapin_parameter_get(state, TERRAPIN_PARAMETER_RADIUS, &value);
    TEST_ASSERT_EQUAL_INT32(81234, value);
    (void)terrapin_parameter_get(state, TERRAPIN_PARAMETER_SUPPLY_SCALE, &value);
    TEST_ASSERT_EQUAL_INT32(4592, value);
}

/* `terrapin param reset`: a scale that is the board's would otherwise be lost with the save that follows. */
static void test_defaults_are_the_boards(void) {
    open_with_a_store();
    (void)terrapin_parameter_set(state, TERRAPIN_PARAMETER_RADIUS, 81234);
    (void)terrapin_parameter_set(state, TERRAPIN_PARAMETER_SUPPLY_SCALE, 5000);
    const terrapin_store_command_t defaults = {.action = TERRAPIN_STORE_ACTION_DEFAULTS};
    terrapin_frame frame = {0};
    (void)terrapin_encode_store_command(&defaults, &frame);
    terrapin_e2e_protect(&frame, 0U);
    give(&frame);
    (void)port_pass(&controller, controller.tick);
    int32_t value = 0;
    (void)terrapin_parameter_get(state, TERRAPIN_PARAMETER_RADIUS, &value);
    TEST_ASSERT_EQUAL_INT32(terrapin_parameter(TERRAPIN_PARAMETER_RADIUS).default_value, value);
    (void)terrapin_parameter_get(state, TERRAPIN_PARAMETER_SUPPLY_SCALE, &value);
    TEST_ASSERT_EQUAL_INT32(4592, value);
}

/* A save that begins while the bridge is off and has to wait while it is on: the watchdog stays short. */
static void test_the_watchdog_has_no_more_time_while_the_motor_is_on(void) {
    open_with_a_store();
    controller.health.decided = true; /* the boot loader's records are no matter of this test */
    (void)ticks(1000U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    store.phase = TERRAPIN_STORE_ERASE; /* the other page, after a write that failed */
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    TEST_ASSERT_EQUAL_UINT32(0U, flash_work);
    (void)ticks(3000U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_EQUAL_INT(TERRAPIN_STORE_IDLE, store.phase);
    TEST_ASSERT_GREATER_OR_EQUAL(1U, flash_work);
    TEST_ASSERT_EQUAL_UINT32(flash_work, flash_rest);
}

static void test_a_start_is_healthy_once(void) {
    (void)ticks(HEALTH_GOOD_MS, TERRAPIN_REQUEST_IDLE); /* the self test comes before */
    TEST_ASSERT_EQUAL_UINT32(0U, healthy);
    (void)ticks(3000U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_EQUAL_UINT32(1U, healthy);
}

/* The updates of an empty flash. */
static terrapin_update *empty_update(void) {
    static uint8_t bytes[TERRAPIN_FLASH_F405_SIZE];
    static const uint8_t keys[64] = {0};
    static terrapin_flash_emulated chip_memory;
    static terrapin_flash flash;
    static terrapin_boot boot;
    static terrapin_update update;
    memset(bytes, 0xFF, sizeof bytes);
    terrapin_flash_emulated_init(&chip_memory, bytes, terrapin_flash_f405_sectors, TERRAPIN_FLASH_F405_SECTORS, 4U);
    flash = terrapin_flash_emulated_driver(&chip_memory);
    boot = (terrapin_boot){.flash = &flash, .keys = keys};
    terrapin_update_init(&update, &boot, TERRAPIN_UPDATE_SLOT_A);
    return &update;
}

/* Who has not the key cannot make it leave its work, nor write another image: such a frame waits for its seal. */
static void test_with_a_key_an_update_waits_for_its_seal(void) {
    static const uint32_t link_key[4] = {1U, 2U, 3U, 4U};
    hardware_facts hardware = plain();
    const terrapin_update_reset_t message = {.key = TERRAPIN_UPDATE_RESET_KEY, .stay = 0};
    terrapin_frame frame = {0};
    (void)terrapin_encode_update_reset(&message, &frame);
    for (uint32_t sealed = 2U; sealed > 0U; sealed--) {
        hardware.link_key = (sealed == 2U) ? link_key : NULL;
        hardware.link_generation = (sealed == 2U) ? 1U : 0U;
        port_open(&controller, state, &bus, &line, NULL, empty_update(), &hardware);
        (void)port_pass(&controller, controller.tick + 1U);
        for (uint32_t counter = 0U; counter < 2U; counter++) {
            terrapin_e2e_protect(&frame, (uint8_t)counter);
            give(&frame);
        }
        TEST_ASSERT_EQUAL_UINT32((sealed == 2U) ? 0U : 2U, resets);
        TEST_ASSERT_EQUAL_UINT32((sealed == 2U) ? 1U : 0U, controller.link.unsealed);
    }
}

static void test_update_resets_with_the_motor_off_alone(void) {
    const hardware_facts hardware = plain();
    port_open(&controller, state, &bus, &line, NULL, empty_update(), &hardware);
    (void)ticks(1000U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_TRUE(ticks(UNTIL_RUN, TERRAPIN_REQUEST_RUN));
    const terrapin_update_reset_t message = {.key = TERRAPIN_UPDATE_RESET_KEY, .stay = 1};
    terrapin_frame frame = {0};
    (void)terrapin_encode_update_reset(&message, &frame);
    terrapin_e2e_protect(&frame, 0U);
    give(&frame);
    TEST_ASSERT_EQUAL_UINT32(0U, resets);
    TEST_ASSERT_TRUE(driven);
    const terrapin_update_query_t question = {0};
    terrapin_frame query = {0};
    (void)terrapin_encode_update_query(&question, &query);
    give(&query); /* reads the log of the boot loader, which takes long: not while the motor is on */
    TEST_ASSERT_EQUAL_UINT32(0U, flash_work);
    TEST_ASSERT_EQUAL_UINT32(1U, controller.link.out_of_place);
    (void)ticks(3000U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_FALSE(driven);
    const uint32_t before = flash_work;
    give(&query);
    TEST_ASSERT_EQUAL_UINT32(before + 1U, flash_work);
    TEST_ASSERT_EQUAL_UINT32(before + 1U, flash_rest);
    terrapin_e2e_protect(&frame, 1U);
    driven = true; /* whatever it was: it is put off before the reset, which asserts it */
    give(&frame);
    TEST_ASSERT_EQUAL_UINT32(100U, resets); /* and stays in the boot loader */
}

/* ---- a node of its own */

static void test_a_node_has_identifiers_of_its_own(void) {
    hardware_facts hardware = plain();
    hardware.node = 3U;
    hardware.unique = 0x12345678U;
    port_open(&controller, state, &bus, &line, NULL, empty_update(), &hardware);
    const terrapin_parameter_read_t question = {.index = 0};
    terrapin_frame frame = {0};
    (void)terrapin_encode_parameter_read(&question, &frame);
    give(&frame); /* node 0 is asked */
    TEST_ASSERT_EQUAL_UINT32(1U, controller.link.unknown);
    const terrapin_node_request_t another = {.unique = 0x12345678U, .node = 6, .action = TERRAPIN_NODE_ACTION_WRITE};
    (void)terrapin_encode_node_request(&another, &frame);
    frame.id = 0x039U;
    terrapin_e2e_protect(&frame, 1U);
    give(&frame);
    fake_settle(&chip);
    TEST_ASSERT_EQUAL(6, stored_node);
    TEST_ASSERT_EQUAL_UINT32(flash_work, flash_rest);
    TEST_ASSERT_EQUAL(3, controller.node.number); /* until the reset */
    bool seen[0x800] = {false};
    for (uint32_t i = 0; i < 2000U; i++) {
        (void)port_pass(&controller, controller.tick + 1U);
        fake_settle(&chip);
        for (int box = fake_first(&chip); box >= 0; box = fake_first(&chip)) {
            seen[fake_sent(&chip, box)] = true;
            can_poll(&bus);
            fake_settle(&chip);
        }
    }
    for (uint32_t id = 0; id < 0x800U; id++) {
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(seen[id] ? (0x240U | (id & 0x3FU)) : id, id, "an identifier of node 3");
    }
    static const uint32_t some[] = {0x240U, 0x241U, 0x24AU - 1U, 0x251U, 0x253U, 0x257U};
    for (uint32_t i = 0; i < (sizeof some / sizeof some[0]); i++) {
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(some[i], seen[some[i]] ? some[i] : 0U, "sent");
    }
}

/* ---- what is told */

static bool told(uint16_t id, terrapin_frame *frame, uint32_t most) {
    for (uint32_t i = 0; i < most; i++) {
        (void)port_pass(&controller, controller.tick + 1U);
        for (uint32_t k = 0; k < 8U; k++) {
            fake_settle(&chip);
            const int box = fake_first(&chip);
            if (box < 0) {
                break;
            }
            const can_mailbox_registers *m = &chip.r.tx[box];
            for (uint32_t b = 0; b < 4U; b++) {
                frame->data[b] = (uint8_t)(m->DLR >> (8U * b));
                frame->data[b + 4U] = (uint8_t)(m->DHR >> (8U * b));
            }
            frame->length = (uint8_t)m->DTR;
            frame->id = fake_sent(&chip, box);
            can_poll(&bus);
            if (frame->id == id) {
                return true;
            }
        }
    }
    return false;
}

static void test_tells_status_once_and_counts(void) {
    terrapin_frame frame = {0};
    terrapin_port_status_t status;
    controller.hardware.clock_fallback = true;
    controller.hardware.watchdog_absent = true;
    TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_STATUS, &frame, 101U));
    TEST_ASSERT_TRUE(terrapin_decode_port_status(&frame, &status));
    TEST_ASSERT_EQUAL(1, status.clock_fallback);
    TEST_ASSERT_EQUAL(1, status.watchdog_absent);
    TEST_ASSERT_EQUAL(0, status.overrun);
    TEST_ASSERT_EQUAL(0, status.receive_overflow);
    TEST_ASSERT_EQUAL(TERRAPIN_RESET_CAUSE_POWER_ON, status.reset_cause);

    (void)port_pass(&controller, controller.tick + 4U); /* three missed */
    line.in.lost += 2U;
    chip.r.ESR = CAN_ESR_LEC_AK | CAN_ESR_EPVF | (128U << CAN_ESR_TEC);
    TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_STATUS, &frame, 101U));
    TEST_ASSERT_TRUE(terrapin_decode_port_status(&frame, &status));
    TEST_ASSERT_EQUAL(1, status.overrun);
    TEST_ASSERT_EQUAL(3, status.overruns);
    TEST_ASSERT_EQUAL(1, status.receive_overflow);
    TEST_ASSERT_EQUAL(2, status.lost_frames);
    TEST_ASSERT_EQUAL(1, status.can_passive);
    TEST_ASSERT_EQUAL(128, status.transmit_errors);

    TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_STATUS, &frame, 101U));
    TEST_ASSERT_TRUE(terrapin_decode_port_status(&frame, &status));
    TEST_ASSERT_EQUAL(0, status.overrun); /* told already; the count stays */
    TEST_ASSERT_EQUAL(3, status.overruns);
    TEST_ASSERT_EQUAL(0, status.receive_overflow);
}

/* Each count in its own place, held at what eight bits tell; the same of the times. */
static void test_tells_what_it_dropped_and_how_long_it_takes(void) {
    terrapin_frame frame = {0};
    terrapin_port_link_t dropped;
    terrapin_port_times_t times;
    terrapin_link *link = &controller.link;
    link->bad_crc = 1U;
    link->repeated = 2U;
    link->out_of_step = 3U;
    link->malformed = 4U;
    link->out_of_place = 5U;
    link->unsealed = 6U;
    link->seal.opened = 7U;
    link->seal.generation = 300U;
    TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_LINK, &frame, 1001U));
    TEST_ASSERT_TRUE(terrapin_decode_port_link(&frame, &dropped));
    TEST_ASSERT_EQUAL(1, dropped.bad_crc);
    TEST_ASSERT_EQUAL(2, dropped.repeated);
    TEST_ASSERT_EQUAL(3, dropped.out_of_step);
    TEST_ASSERT_EQUAL(4, dropped.malformed);
    TEST_ASSERT_EQUAL(5, dropped.out_of_place);
    TEST_ASSERT_EQUAL(6, dropped.unsealed);
    TEST_ASSERT_EQUAL(7, dropped.sessions);
    TEST_ASSERT_EQUAL(255, dropped.generation);
    while ((controller.tick % 100U) != 0U) {
        (void)port_pass(&controller, controller.tick + 1U);
    }
    for (uint32_t i = 0; i < 5U; i++) {
        phases_note(&controller.times, (phase)i, 168000U * (i + 1U));
    }
    TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_TIMES, &frame, 101U));
    TEST_ASSERT_TRUE(terrapin_decode_port_times(&frame, &times));
    const terrapin_port_times_source longest = {.receive_250ns = 4000 * (PHASE_RECEIVE + 1),
                                                .sense_250ns = 4000 * (PHASE_SENSE + 1),
                                                .step_250ns = 4000 * (PHASE_STEP + 1),
                                                .send_250ns = 4000 * (PHASE_SEND + 1),
                                                .late_250ns = 4000 * (PHASE_LATE + 1)};
    const terrapin_port_times_t expected = terrapin_scale_port_times(&longest);
    TEST_ASSERT_EQUAL_MEMORY(&expected, &times, sizeof times);
}

static bool *const facts[] = {&controller.hardware.clock_fallback,  &controller.hardware.adc_silent,
                              &controller.hardware.watchdog_absent, &controller.hardware.bridge_break,
                              &controller.hardware.brown_out,       &controller.hardware.brown_out_unset,
                              &controller.hardware.imu_absent};

static void test_each_fact_of_the_chip_is_told_in_its_place(void) {
    for (size_t i = 0U; i < (sizeof facts / sizeof facts[0]); i++) {
        terrapin_frame frame = {0};
        terrapin_port_status_t status;
        setUp();
        *facts[i] = true;
        TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_STATUS, &frame, 101U));
        TEST_ASSERT_TRUE(terrapin_decode_port_status(&frame, &status));
        const int32_t found[] = {status.clock_fallback, status.adc_silent, status.watchdog_absent,
                                 status.bridge_break,   status.brown_out,  status.brown_out_unset,
                                 status.imu_absent};
        for (size_t k = 0U; k < (sizeof found / sizeof found[0]); k++) {
            TEST_ASSERT_EQUAL_INT32((k == i) ? 1 : 0, found[k]);
        }
        TEST_ASSERT_EQUAL_INT32(0, status.can_absent | status.can_bus_off | status.can_passive |
                                       status.can_no_acknowledge | status.receive_overflow | status.send_overflow |
                                       status.watchdog_reset | status.overrun | status.limiter_refused);
    }
}

static void wait_in_line(uint32_t count) {
    for (uint32_t i = 0U; i < count; i++) {
        const terrapin_parameter_read_t message = {.index = (int32_t)i};
        terrapin_frame frame = {0};
        TEST_ASSERT_TRUE(terrapin_encode_parameter_read(&message, &frame));
        terrapin_intake_put(&controller.intake, &controller.link, state, &controller.inputs, &frame, 0U);
    }
    TEST_ASSERT_EQUAL_UINT32(count, controller.intake.count);
}

/* Sense and send are timed by two looks each, and the step by those that it takes itself. */
static void test_each_phase_is_timed_as_its_own(void) {
    (void)port_pass(&controller, controller.tick + 1U);
    for (uint32_t i = 0; i < PHASE_COUNT; i++) {
        (void)phases_take_250ns(&controller.times, (phase)i);
    }
    cycles_a_look = 1000U;
    (void)port_pass(&controller, controller.tick + 1U);
    cycles_a_look = 0U;
    TEST_ASSERT_EQUAL_UINT32(1000U, controller.times.longest[PHASE_SENSE]);
    TEST_ASSERT_EQUAL_UINT32(1000U, controller.times.longest[PHASE_STEP]);
    TEST_ASSERT_EQUAL_UINT32(1000U, controller.times.longest[PHASE_SEND]);
    TEST_ASSERT_EQUAL_UINT32(0U, controller.times.longest[PHASE_RECEIVE]);
    cycles_a_look = 1000U;
    TEST_ASSERT_FALSE(port_pass(&controller, controller.tick));
    TEST_ASSERT_EQUAL_UINT32_MESSAGE(0U, controller.times.longest[PHASE_RECEIVE],
                                     "looking costs nothing worth telling");
    wait_in_line(1U);
    TEST_ASSERT_TRUE(port_pass(&controller, controller.tick));
    cycles_a_look = 0U;
    TEST_ASSERT_EQUAL_UINT32(1000U, controller.times.longest[PHASE_RECEIVE]);
}

/* A tick waits for one pass at most. */
static void test_a_pass_takes_four_frames_that_wait_and_no_more(void) {
    (void)port_pass(&controller, controller.tick + 1U);
    wait_in_line(10U);
    for (uint32_t left = 10U; left > 4U; left -= PORT_FRAMES_A_PASS) {
        TEST_ASSERT_TRUE(port_pass(&controller, controller.tick));
        TEST_ASSERT_EQUAL_UINT32(left - PORT_FRAMES_A_PASS, controller.intake.count);
    }
}

static void test_when_nothing_waits_nothing_is_taken(void) {
    for (uint32_t i = 0U; i < 100U; i++) {
        TEST_ASSERT_FALSE(port_pass(&controller, controller.tick));
        (void)port_pass(&controller, controller.tick + 1U);
    }
    const terrapin_link *link = &controller.link;
    TEST_ASSERT_EQUAL_UINT32(0U, link->bad_crc | link->repeated | link->out_of_step | link->malformed |
                                     link->out_of_place | link->unsealed | link->unknown);
    TEST_ASSERT_FALSE(controller.health.heard);
}

/* In test mode the answer to a line leaves before the line's own, also where others wait in front. */
static void test_in_test_mode_a_line_is_answered_at_once(void) {
    static const char text[] = "O\rt0900\r"; /* whatever it is: a frame for the controller */
    for (uint32_t mode = 0U; mode < 2U; mode++) {
        setUp();
        (void)port_pass(&controller, controller.tick + 1U);
        controller.link.test_mode = mode == 1U;
        wait_in_line(8U);
        for (uint32_t i = 0U; text[i] != '\0'; i++) {
            TEST_ASSERT_TRUE(ring_put(&line.in, (uint8_t)text[i]));
        }
        (void)port_pass(&controller, controller.tick);
        if (mode == 1U) {
            TEST_ASSERT_EQUAL_UINT32(0U, controller.intake.count);
        } else {
            TEST_ASSERT_GREATER_THAN_UINT32(1U, controller.intake.count);
        }
    }
}

/* A board without a ground wheel refuses the limiter, and says so until something else is commanded. */
static void test_a_limiter_without_a_wheel_is_refused_and_told(void) {
    const hardware_facts hardware = {.core_hz = 168000000U, .no_ground_wheel = true, .imu_absent = true};
    terrapin_frame frame = {0};
    terrapin_port_status_t status;
    port_open(&controller, state, &bus, &line, NULL, NULL, &hardware);
    (void)ticks(300U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_STATUS, &frame, 101U));
    TEST_ASSERT_TRUE(terrapin_decode_port_status(&frame, &status));
    TEST_ASSERT_EQUAL(0, status.limiter_refused);
    TEST_ASSERT_EQUAL(1, status.imu_absent);
    controller.link.limiter_refused = true;
    TEST_ASSERT_TRUE(told(TERRAPIN_ID_PORT_STATUS, &frame, 101U));
    TEST_ASSERT_TRUE(terrapin_decode_port_status(&frame, &status));
    TEST_ASSERT_EQUAL(1, status.limiter_refused);
    TEST_ASSERT_TRUE(controller.link.no_ground_wheel);
}

static void test_missed_ticks_are_the_core_s_fault_too(void) {
    (void)ticks(100U, TERRAPIN_REQUEST_IDLE);
    TEST_ASSERT_EQUAL_HEX32(0U, controller.outputs.faults & BIT(TERRAPIN_FAULT_OVERRUN));
    (void)port_pass(&controller, controller.tick + 2U);
    TEST_ASSERT_NOT_EQUAL(0U, controller.outputs.faults & BIT(TERRAPIN_FAULT_OVERRUN));
}

static void test_absent_bus_is_told_on_the_line(void) {
    memset(&chip, 0, sizeof chip);
    (void)can_open(&bus, &chip.r, can_timing(42000000U, 1000000U), NULL, 0U);
    static const char hello[] = "O\r";
    for (size_t i = 0; i < (sizeof hello - 1U); i++) {
        (void)ring_put(&line.in, (uint8_t)hello[i]);
    }
    (void)port_pass(&controller, 0U);
    bool found = false;
    uint8_t text[32];
    uint32_t length = 0;
    for (uint32_t i = 1; (i <= 101U) && !found; i++) {
        (void)port_pass(&controller, i);
        uint8_t byte = 0;
        while (ring_take(&line.out, &byte)) {
            text[length % sizeof text] = byte;
            length++;
            if (byte == (uint8_t)'\r') {
                found = found || ((length > 8U) && (memcmp(text, "t191", 4U) == 0));
                if (found) {
                    TEST_ASSERT_EQUAL_UINT8('4', text[6]); /* low digit of byte 0: can_absent, bit 2 */
                }
                length = 0;
            }
        }
    }
    TEST_ASSERT_TRUE(found);
}

static void test_host_that_does_not_read_loses_its_own_lines(void) {
    /* No byte leaves (the transmitter is never empty), lines keep coming: nothing overflows but the receive ring. */
    for (uint32_t i = 0; i < 4000U; i++) {
        (void)ring_put(&line.in, (uint8_t)(((i % 2U) == 0U) ? 'V' : '\r'));
        (void)port_pass(&controller, controller.tick);
    }
    TEST_ASSERT_EQUAL_UINT32(0U, controller.send_lost);
    TEST_ASSERT_EQUAL_UINT32(0U, line.out.lost);
    TEST_ASSERT_GREATER_THAN(1000U, line.in.lost);
    TEST_ASSERT_LESS_OR_EQUAL(USART_IN_SIZE, ring_used(&line.in));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_line_that_was_not_opened_is_silent);
    RUN_TEST(test_stop_all_outlives_a_reset);
    RUN_TEST(test_foreign_frames_at_full_load);
    RUN_TEST(test_more_frames_than_it_can_take);
    RUN_TEST(test_flood_of_parameter_writes);
    RUN_TEST(test_babbling_idiot_before_us);
    RUN_TEST(test_idle_stops_the_motor_in_the_same_tick);
    RUN_TEST(test_runs_and_stops_on_the_port_s_faults);
    RUN_TEST(test_a_guard_without_its_sensor_keeps_the_bridge_off);
    RUN_TEST(test_test_mode_holds_the_bridge_off_and_stops_the_own_clock);
    RUN_TEST(test_saves_parameters_and_finds_them_again);
    RUN_TEST(test_defaults_are_the_boards);
    RUN_TEST(test_the_watchdog_has_no_more_time_while_the_motor_is_on);
    RUN_TEST(test_a_start_is_healthy_once);
    RUN_TEST(test_with_a_key_an_update_waits_for_its_seal);
    RUN_TEST(test_update_resets_with_the_motor_off_alone);
    RUN_TEST(test_a_node_has_identifiers_of_its_own);
    RUN_TEST(test_tells_status_once_and_counts);
    RUN_TEST(test_tells_what_it_dropped_and_how_long_it_takes);
    RUN_TEST(test_a_pass_takes_four_frames_that_wait_and_no_more);
    RUN_TEST(test_when_nothing_waits_nothing_is_taken);
    RUN_TEST(test_in_test_mode_a_line_is_answered_at_once);
    RUN_TEST(test_each_fact_of_the_chip_is_told_in_its_place);
    RUN_TEST(test_each_phase_is_timed_as_its_own);
    RUN_TEST(test_a_limiter_without_a_wheel_is_refused_and_told);
    RUN_TEST(test_missed_ticks_are_the_core_s_fault_too);
    RUN_TEST(test_absent_bus_is_told_on_the_line);
    RUN_TEST(test_host_that_does_not_read_loses_its_own_lines);
    return UNITY_END();
}
