/* The queue of frames before the dispatcher, with the real controller behind it. */
#include <string.h>

#include "unity.h"

#include "core.h"
#include "intake.h"
#include "terrapin_interface.h"

static terrapin_state state;
static terrapin_link link;
static terrapin_inputs inputs;
static terrapin_intake intake;

void setUp(void) {
    terrapin_link_init(&link, &state, &inputs);
    terrapin_intake_init(&intake);
}

void tearDown(void) {}

static void put(const terrapin_frame *frame, uint8_t source) {
    terrapin_intake_put(&intake, &link, &state, &inputs, frame, source);
}

static terrapin_frame command(int32_t request, uint32_t counter) {
    terrapin_frame frame;
    const terrapin_command_t message = {.request = request, .setpoint = 100};
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static terrapin_frame read_of(uint16_t index) {
    terrapin_frame frame;
    const terrapin_parameter_read_t message = {.index = index};
    TEST_ASSERT_TRUE(terrapin_encode_parameter_read(&message, &frame));
    return frame;
}

static void put_command(int32_t request, uint32_t counter) {
    const terrapin_frame frame = command(request, counter);
    put(&frame, 0U);
}

static void put_read(uint16_t index) {
    const terrapin_frame frame = read_of(index);
    put(&frame, (uint8_t)(index % 3U));
}

/* What is taken in this tick, given to the dispatcher; the indexes of reads are noted. */
static uint32_t take(uint16_t *indexes) {
    terrapin_frame frame;
    terrapin_frame reply;
    uint8_t source = 0;
    uint32_t taken = 0;
    while (terrapin_intake_next(&intake, &link, &state, &frame, &source)) {
        if (frame.id == TERRAPIN_ID_PARAMETER_READ) {
            terrapin_parameter_read_t message;
            TEST_ASSERT_TRUE(terrapin_decode_parameter_read(&frame, &message));
            TEST_ASSERT_EQUAL((uint32_t)message.index % 3U, source);
            indexes[taken] = (uint16_t)message.index;
        }
        (void)terrapin_accept(&link, &state, &frame, &inputs, &reply);
        taken++;
    }
    return taken;
}

static void test_what_is_too_much_waits_in_order(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    uint32_t ticks = 0;
    uint16_t next = 0;
    state.drive.enable = true;
    for (uint16_t i = 0; i < TERRAPIN_INTAKE_SIZE; i++) {
        put_read(i);
    }
    while (intake.count > 0U) {
        terrapin_intake_begin_tick(&intake);
        const uint32_t taken = take(indexes);
        TEST_ASSERT_GREATER_OR_EQUAL(1U, taken);
        TEST_ASSERT_LESS_THAN(8U, taken);
        TEST_ASSERT_EQUAL_MESSAGE(0U, take(indexes + taken), "the budget stays spent until the next tick");
        for (uint32_t i = 0; i < taken; i++) {
            TEST_ASSERT_EQUAL(next, indexes[i]);
            next++;
        }
        ticks++;
    }
    TEST_ASSERT_EQUAL(TERRAPIN_INTAKE_SIZE, next);
    TEST_ASSERT_EQUAL(8U, ticks);
    TEST_ASSERT_EQUAL(0U, intake.lost);
}

static void test_four_reads_a_tick_are_never_lost(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    state.drive.enable = true;
    for (uint32_t tick = 0; tick < 1000U; tick++) {
        for (uint16_t i = 0; i < 4U; i++) {
            put_read(i);
        }
        terrapin_intake_begin_tick(&intake);
        TEST_ASSERT_EQUAL(4U, take(indexes));
    }
    TEST_ASSERT_EQUAL(0U, intake.lost);
}

static void test_with_the_bridge_off_more_is_taken(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    for (uint16_t i = 0; i < 8U; i++) {
        put_read(i);
    }
    TEST_ASSERT_EQUAL(8U, take(indexes));
}

static void test_a_frame_above_the_budget_is_the_first_of_a_tick(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    terrapin_frame defaults;
    const terrapin_store_command_t message = {.action = TERRAPIN_STORE_ACTION_DEFAULTS};
    TEST_ASSERT_TRUE(terrapin_encode_store_command(&message, &defaults));
    terrapin_e2e_protect(&defaults, 0U);
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set(&state, TERRAPIN_PARAMETER_SLIP_WINDOW, 20));
    put_read(0U);
    put(&defaults, 0U);
    put_read(1U);
    TEST_ASSERT_EQUAL(1U, take(indexes));
    terrapin_intake_begin_tick(&intake);
    TEST_ASSERT_EQUAL(1U, take(indexes));
    TEST_ASSERT_EQUAL(terrapin_parameter((uint16_t)TERRAPIN_PARAMETER_SLIP_WINDOW).default_value,
                      terrapin_parameter_values(&state)[TERRAPIN_PARAMETER_SLIP_WINDOW]);
    terrapin_intake_begin_tick(&intake);
    TEST_ASSERT_EQUAL(1U, take(indexes));
}

static void test_in_test_mode_nothing_waits(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    terrapin_frame arm;
    const terrapin_test_mode_t message = {.key = (uint32_t)TERRAPIN_TEST_MODE_KEY};
    TEST_ASSERT_TRUE(terrapin_encode_test_mode(&message, &arm));
    terrapin_e2e_protect(&arm, 0U);
    put_read(0U);
    put(&arm, 0U);
    TEST_ASSERT_EQUAL(1U, take(indexes));
    TEST_ASSERT_FALSE(link.test_mode); /* a reset of the controller is a tick's work */
    terrapin_intake_begin_tick(&intake);
    TEST_ASSERT_EQUAL(1U, take(indexes));
    TEST_ASSERT_TRUE(link.test_mode);
    state.drive.enable = true;
    for (uint16_t i = 0; i < TERRAPIN_INTAKE_SIZE; i++) {
        put_read(i);
    }
    TEST_ASSERT_EQUAL(TERRAPIN_INTAKE_SIZE, take(indexes));
    terrapin_e2e_protect(&arm, 1U);
    put(&arm, 0U);
    put_read(0U);
    TEST_ASSERT_EQUAL(0U, take(indexes)); /* what is behind it waits as well */
    terrapin_intake_begin_tick(&intake);
    TEST_ASSERT_EQUAL(2U, take(indexes));
}

static void test_a_full_queue_loses_the_oldest(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    state.drive.enable = true;
    for (uint16_t i = 0; i < (TERRAPIN_INTAKE_SIZE + 3U); i++) {
        put_read(i);
    }
    TEST_ASSERT_EQUAL(3U, intake.lost);
    TEST_ASSERT_EQUAL(TERRAPIN_INTAKE_SIZE, intake.count);
    (void)take(indexes);
    TEST_ASSERT_EQUAL(3U, indexes[0]);
}

static void test_idle_is_taken_before_seven_others(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    state.drive.enable = true;
    for (uint16_t i = 0; i < 6U; i++) {
        put_read(i);
    }
    put_command(TERRAPIN_REQUEST_RUN, 4U);
    put_command(TERRAPIN_REQUEST_IDLE, 5U);
    TEST_ASSERT_TRUE(inputs.command_fresh);
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, inputs.command.request);
    for (uint32_t i = 0; i < 4U; i++) {
        terrapin_intake_begin_tick(&intake);
        (void)take(indexes);
        TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_REQUEST_IDLE, inputs.command.request, "the older RUN is passed over");
    }
    TEST_ASSERT_EQUAL(0U, intake.count);
    inputs.command_fresh = false; /* a tick was made of it */
    put_command(TERRAPIN_REQUEST_RUN, 6U);
    terrapin_intake_begin_tick(&intake);
    (void)take(indexes);
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_REQUEST_RUN, inputs.command.request, "a newer one counts");
    TEST_ASSERT_EQUAL(0U, link.repeated + link.bad_crc + link.malformed + intake.lost);
}

static void test_idle_after_its_counter_came_round(void) {
    state.drive.enable = true;
    put_command(TERRAPIN_REQUEST_RUN, 0U);
    (void)take(NULL);
    for (uint32_t i = 1; i < 15U; i++) {
        put_command(TERRAPIN_REQUEST_RUN, i);
    }
    put_command(TERRAPIN_REQUEST_IDLE, 0U); /* that of the last one that was accepted */
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, inputs.command.request);
    terrapin_intake_begin_tick(&intake);
    TEST_ASSERT_EQUAL(0U, take(NULL));
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, inputs.command.request);
}

static void test_a_damaged_idle_changes_nothing(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    terrapin_frame idle = command(TERRAPIN_REQUEST_IDLE, 2U);
    idle.data[7] ^= 1U;
    link.command_counter = 1U;
    state.drive.enable = true;
    put_command(TERRAPIN_REQUEST_RUN, 2U);
    put(&idle, 0U);
    TEST_ASSERT_EQUAL(1U, link.bad_crc);
    TEST_ASSERT_EQUAL(1U, link.command_counter);
    TEST_ASSERT_FALSE(inputs.command_fresh);
    (void)take(indexes);
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_RUN, inputs.command.request);
}

static void test_a_third_idle_waits_in_order(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    state.drive.enable = true;
    put_read(0U);
    for (uint32_t i = 0; i < 3U; i++) {
        put_command(TERRAPIN_REQUEST_IDLE, i);
    }
    TEST_ASSERT_EQUAL(2U, intake.count);
    TEST_ASSERT_EQUAL(2U, take(indexes));
    TEST_ASSERT_EQUAL(0U, link.repeated);
}

/* Behind a full queue, bridge on or off, with whatever COMMANDs before it: stopped in the tick in which it came. */
static void test_stop_all_never_waits(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    const terrapin_stop_all_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame stop;
    TEST_ASSERT_TRUE(terrapin_encode_stop_all(&message, &stop));
    for (uint32_t on = 0; on < 2U; on++) {
        setUp();
        state.drive.enable = on == 1U;
        terrapin_intake_begin_tick(&intake);
        for (uint16_t i = 0; i < 20U; i++) {
            put_read(i);
            put_command(TERRAPIN_REQUEST_RUN, i % 15U);
        }
        const uint32_t waiting = intake.count;
        for (uint32_t i = 0; i < 9U; i++) {
            put(&stop, 0U);
        }
        TEST_ASSERT_EQUAL(waiting, intake.count);
        TEST_ASSERT_TRUE(inputs.command_fresh);
        TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, inputs.command.request);
        for (uint32_t tick = 0; tick < 40U; tick++) {
            terrapin_intake_begin_tick(&intake);
            (void)take(indexes);
            TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, inputs.command.request);
            TEST_ASSERT_EQUAL_MESSAGE(tick == 0U, inputs.command_fresh, "each RUN that waited is passed over");
            inputs.command_fresh = false; /* a tick was made of it */
        }
        TEST_ASSERT_EQUAL(0, intake.count);
    }
}

static bool held(void) {
    return (terrapin_latched(&state) & TERRAPIN_LINK_STOPPED) != 0U;
}

static void tick(void) {
    terrapin_outputs outputs;
    terrapin_intake_begin_tick(&intake);
    inputs.tick++;
    terrapin_link_step(&state, &inputs, &outputs);
}

/* No request of its tick ends it, nor an IDLE or a RUN after it; a clear does, and then it can hold anew. */
static void test_stop_all_holds_until_a_clear(void) {
    uint16_t indexes[TERRAPIN_INTAKE_SIZE];
    const terrapin_stop_all_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame stop;
    uint32_t counter = 0U;
    TEST_ASSERT_TRUE(terrapin_encode_stop_all(&message, &stop));
    for (uint32_t again = 0U; again < 2U; again++) {
        put(&stop, 0U);
        for (uint32_t i = 0U; i < 100U; i++) {
            for (int32_t request = 0; request < ((i == 0U) ? 4 : 3); request++) {
                put_command(request, counter++ % 15U);
            }
            (void)take(indexes);
            TEST_ASSERT_TRUE(held());
            tick();
            TEST_ASSERT_TRUE(held());
        }
        put_command(TERRAPIN_REQUEST_CLEAR, counter++ % 15U);
        (void)take(indexes);
        tick();
        TEST_ASSERT_FALSE(held());
    }
}

/* Frames of these kinds, by letter, in this order. */
static void put_mixture(const char *letters) {
    for (const char *at = letters; *at != '\0'; at++) {
        static const struct {
            char letter;
            uint16_t id;
        } kinds[] = {
            {'C', TERRAPIN_ID_COMMAND},     {'W', TERRAPIN_ID_PARAMETER_WRITE}, {'R', TERRAPIN_ID_PARAMETER_READ},
            {'T', TERRAPIN_ID_TEST_MODE},   {'L', TERRAPIN_ID_STORE_READ},      {'S', TERRAPIN_ID_SENSORS_FAST},
            {'U', TERRAPIN_ID_UPDATE_DATA}, {'N', TERRAPIN_ID_NODE_REQUEST},
        };
        terrapin_frame frame = {.length = 8U};
        for (uint32_t i = 0; i < (sizeof kinds / sizeof kinds[0]); i++) {
            frame.id = (kinds[i].letter == *at) ? kinds[i].id : frame.id;
        }
        frame.data[0] = (uint8_t)TERRAPIN_REQUEST_RUN; /* of a COMMAND */
        TEST_ASSERT_NOT_EQUAL(0U, frame.id);
        put(&frame, 0U);
    }
}

static uint32_t taken_of(const char *letters) {
    terrapin_frame frame;
    uint8_t source = 0;
    uint32_t taken = 0;
    put_mixture(letters);
    while (terrapin_intake_next(&intake, &link, &state, &frame, &source)) {
        taken++;
    }
    return taken;
}

/* What a tick takes is bounded by prices that were measured: to the instruction, so that no price drifts unseen. The
 * first of each pair spends the whole budget; the second is over it by the least that prices allow. */
static void test_a_tick_takes_what_its_budget_buys(void) {
    static const struct {
        const char *letters;
        bool on;
        bool all;
    } mixtures[] = {
        {"CCCC", true, true},           {"WTSSSS", true, true},
        {"NTSSSS", true, true},         {"UTSSSS", true, true},
        {"CCCCWLL", false, true},       {"RWLLSSSSUU", false, true},
        {"CCCCCWLSSSUU", false, false}, {"RRRRRCWLSSSU", false, false},
        {"LLLLLCCCRLSS", false, false}, {"SSSSSCCCWLSSSUU", false, false},
        {"UUUUUCWRRLSU", false, false},
    };
    for (uint32_t i = 0; i < (sizeof mixtures / sizeof mixtures[0]); i++) {
        setUp();
        state.drive.enable = mixtures[i].on;
        const uint32_t count = (uint32_t)strlen(mixtures[i].letters);
        TEST_ASSERT_EQUAL_MESSAGE(count - (mixtures[i].all ? 0U : 1U), taken_of(mixtures[i].letters),
                                  mixtures[i].letters);
    }
}

/* The same behind a tick in which two IDLEs were taken out of turn, which this tick pays for. */
static void test_what_was_taken_out_of_turn_is_paid_for(void) {
    for (uint32_t more = 0; more < 2U; more++) {
        setUp();
        state.drive.enable = true;
        put_read(0U);
        put_command(TERRAPIN_REQUEST_IDLE, 0U);
        put_command(TERRAPIN_REQUEST_IDLE, 1U);
        TEST_ASSERT_EQUAL(1U, intake.count);
        terrapin_intake_begin_tick(&intake);
        TEST_ASSERT_EQUAL(5U, taken_of((more == 0U) ? "SSSS" : "SSSSS"));
    }
}

/* One that stands is heard in every tick, as one COMMAND after the other is: what it says is never late. */
static void test_stop_all_is_fresh_in_each_tick(void) {
    const terrapin_stop_all_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame stop;
    TEST_ASSERT_TRUE(terrapin_encode_stop_all(&message, &stop));
    for (uint32_t tick = 0; tick < 3U; tick++) {
        inputs.command_fresh = false;
        terrapin_intake_begin_tick(&intake);
        put(&stop, 0U);
        TEST_ASSERT_TRUE(inputs.command_fresh);
    }
}

static void test_foreign_traffic_never_waits(void) {
    const terrapin_frame frame = {.id = 0x7FFU, .length = 8U};
    for (uint32_t i = 0; i < 100U; i++) {
        put(&frame, 0U);
    }
    TEST_ASSERT_EQUAL(100U, link.unknown);
    TEST_ASSERT_EQUAL(0U, intake.count);
}

static void test_every_message_of_the_controller_waits(void) {
    static const uint16_t ids[] = {
        TERRAPIN_ID_COMMAND,         TERRAPIN_ID_PARAMETER_WRITE, TERRAPIN_ID_PARAMETER_READ, TERRAPIN_ID_TEST_MODE,
        TERRAPIN_ID_STORE_COMMAND,   TERRAPIN_ID_STORE_READ,      TERRAPIN_ID_SENSORS_SLOW,   TERRAPIN_ID_SENSORS_FAST,
        TERRAPIN_ID_SENSORS_HEADING, TERRAPIN_ID_UPDATE_BEGIN,    TERRAPIN_ID_UPDATE_DATA,    TERRAPIN_ID_UPDATE_BLOCK,
        TERRAPIN_ID_UPDATE_END,      TERRAPIN_ID_UPDATE_QUERY,    TERRAPIN_ID_UPDATE_RESET,
    };
    for (uint32_t i = 0; i < (sizeof ids / sizeof ids[0]); i++) {
        const terrapin_frame frame = {.id = ids[i], .length = 1U};
        put(&frame, 0U);
        TEST_ASSERT_EQUAL(i + 1U, intake.count);
    }
    TEST_ASSERT_EQUAL(0U, link.unknown);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_is_too_much_waits_in_order);
    RUN_TEST(test_four_reads_a_tick_are_never_lost);
    RUN_TEST(test_with_the_bridge_off_more_is_taken);
    RUN_TEST(test_a_frame_above_the_budget_is_the_first_of_a_tick);
    RUN_TEST(test_in_test_mode_nothing_waits);
    RUN_TEST(test_a_full_queue_loses_the_oldest);
    RUN_TEST(test_idle_is_taken_before_seven_others);
    RUN_TEST(test_idle_after_its_counter_came_round);
    RUN_TEST(test_a_damaged_idle_changes_nothing);
    RUN_TEST(test_a_third_idle_waits_in_order);
    RUN_TEST(test_stop_all_never_waits);
    RUN_TEST(test_stop_all_holds_until_a_clear);
    RUN_TEST(test_a_tick_takes_what_its_budget_buys);
    RUN_TEST(test_what_was_taken_out_of_turn_is_paid_for);
    RUN_TEST(test_stop_all_is_fresh_in_each_tick);
    RUN_TEST(test_foreign_traffic_never_waits);
    RUN_TEST(test_every_message_of_the_controller_waits);
    return UNITY_END();
}
