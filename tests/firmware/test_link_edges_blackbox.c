/* Edges of the link: what a store, a seal and a node's number are told at their bounds, and the queue's budget to its
 * last instruction. */
#include <string.h>

#include "unity.h"

#include "sealed_host.h"
#include "intake.h"
#include "parameters.h"
#include "service.h"
#include "state.h"
#include "terrapin_interface.h"

#define GENERATION 1U

static const uint32_t link_key[4] = {0x81020304U, 0x05060708U, 0x090A0B0CU, 0x0D0E0F10U};
static terrapin_state state;
static terrapin_link link;
static terrapin_inputs inputs;
static terrapin_frame reply;
static uint32_t counter;

void setUp(void) {
    counter = 0U;
    terrapin_link_init(&link, &state, &inputs);
}

void tearDown(void) {}

static terrapin_accept_result give(const terrapin_frame *frame) {
    return terrapin_accept(&link, &state, frame, &inputs, &reply);
}

static terrapin_accept_result give_protected(terrapin_frame *frame) {
    counter++;
    terrapin_e2e_protect(frame, counter);
    return give(frame);
}

/* ---- what a store says */

static terrapin_store_status_t status(void) {
    terrapin_frame frame;
    terrapin_store_status_t answer;
    const terrapin_store_read_t message = {.part = 0};
    TEST_ASSERT_TRUE(terrapin_encode_store_read(&message, &frame));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give(&frame));
    TEST_ASSERT_TRUE(terrapin_decode_store_status(&reply, &answer));
    return answer;
}

static void test_a_store_tells_what_it_does_and_found(void) {
    static terrapin_store store; /* as terrapin_store_open leaves one whose pages were refused */
    memset(&store, 0, sizeof store);
    link.store = &store;
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_RESULT_OK, status().result);
    TEST_ASSERT_EQUAL(0, status().remains);
    store.remains = true;
    store.failed = true;
    TEST_ASSERT_EQUAL(1, status().remains);
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_RESULT_FAILED, status().result);
    store.phase = TERRAPIN_STORE_WRITE;
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_RESULT_BUSY, status().result);
    store.origin = TERRAPIN_STORE_ORIGIN_STORED;
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_STORED, status().origin);
    store.foreign = true;
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_FOREIGN, status().origin);
    store.dropped = 3U;
    store.replaced = 5U;
    store.missing = 7U;
    terrapin_frame frame;
    terrapin_store_found_t found;
    const terrapin_store_read_t message = {.part = 1};
    TEST_ASSERT_TRUE(terrapin_encode_store_read(&message, &frame));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give(&frame));
    TEST_ASSERT_TRUE(terrapin_decode_store_found(&reply, &found));
    TEST_ASSERT_EQUAL(3, found.dropped);
    TEST_ASSERT_EQUAL(5, found.replaced);
    TEST_ASSERT_EQUAL(7, found.missing);
}

static int32_t save(void) {
    terrapin_frame frame;
    terrapin_store_status_t answer;
    const terrapin_store_command_t message = {.action = TERRAPIN_STORE_ACTION_SAVE};
    TEST_ASSERT_TRUE(terrapin_encode_store_command(&message, &frame));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give_protected(&frame));
    TEST_ASSERT_TRUE(terrapin_decode_store_status(&reply, &answer));
    return answer.result;
}

static void test_a_save_begins_or_fails(void) {
    static terrapin_store store;
    memset(&store, 0, sizeof store);
    link.store = &store;
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_RESULT_FAILED, save()); /* no pages */
    store.page[0].size = 16384U;
    store.page[1].size = 16384U;
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_RESULT_BUSY, save());
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ERASE, store.phase);
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_RESULT_BUSY, save()); /* one at a time */
}

/* ---- the seal */

static sealed_host host;

static bool open_session(uint32_t generation) {
    terrapin_frame frame;
    terrapin_session_t answer;
    const terrapin_session_open_t message = {.host = 99U, .generation = generation};
    TEST_ASSERT_TRUE(terrapin_encode_session_open(&message, &frame));
    if (give(&frame) != TERRAPIN_ACCEPT_REPLY) {
        return false;
    }
    TEST_ASSERT_TRUE(terrapin_decode_session(&reply, &answer));
    sealed_host_opens(&host, link_key, 99U, generation, &answer, link.seal.now_ms);
    return true;
}

/* The frame, and the SEAL behind it, 10 ms after the last one. */
static terrapin_accept_result give_sealed(terrapin_frame *frame) {
    counter++;
    terrapin_seal_at(&link.seal, link.seal.now_ms + 10U);
    sealed_host_at(&host, link.seal.now_ms);
    terrapin_e2e_protect(frame, counter);
    const terrapin_frame seal = sealed_host_seals(&host, frame);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, give(frame));
    return give(&seal);
}

static terrapin_frame write_of(int32_t value) {
    terrapin_frame frame;
    const terrapin_parameter_write_t message = {.index = TERRAPIN_PARAMETER_SPEED_KP, .value = value};
    TEST_ASSERT_TRUE(terrapin_encode_parameter_write(&message, &frame));
    return frame;
}

static void test_a_sealed_write_whatever_its_bytes(void) {
    terrapin_link_seal(&link, link_key, GENERATION, 5U);
    TEST_ASSERT_FALSE(open_session(0U));
    TEST_ASSERT_FALSE(open_session(GENERATION + 1U));
    TEST_ASSERT_TRUE(open_session(GENERATION));
    for (int32_t i = 0; i < 300; i++) { /* every value of every byte but the high ones; CRCs of all kinds */
        terrapin_frame frame = write_of(0x01010101 * (i % 127));
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, give_sealed(&frame));
    }
    TEST_ASSERT_EQUAL(0U, link.unsealed);
}

static void test_a_sealed_clear_and_no_request_above_it(void) {
    terrapin_link_seal(&link, link_key, GENERATION, 5U);
    TEST_ASSERT_TRUE(open_session(GENERATION));
    for (int32_t request = 0; request <= 7; request++) {
        const terrapin_command_sealed_t message = {.request = request};
        terrapin_frame frame;
        TEST_ASSERT_TRUE(terrapin_encode_command_sealed(&message, &frame));
        terrapin_seal_at(&link.seal, link.seal.now_ms + 10U);
        sealed_host_at(&host, link.seal.now_ms);
        sealed_host_commands(&host, &frame);
        inputs.command_fresh = false;
        (void)give(&frame);
        TEST_ASSERT_EQUAL(request <= TERRAPIN_REQUEST_CLEAR, inputs.command_fresh);
    }
    TEST_ASSERT_EQUAL(7 - TERRAPIN_REQUEST_CLEAR, link.malformed);
}

static void test_the_last_session_and_a_short_frame(void) {
    terrapin_link_seal(&link, link_key, GENERATION, 5U);
    link.seal.opened = 0x80000000U; /* a number that comes twice would open an old session again */
    TEST_ASSERT_FALSE(open_session(GENERATION));
    link.seal.opened--;
    TEST_ASSERT_TRUE(open_session(GENERATION));
    const terrapin_frame half = {.id = TERRAPIN_ID_SESSION_OPEN, .length = 4U};
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, give(&half));
    TEST_ASSERT_EQUAL(1U, link.malformed);
}

static void test_another_key_leaves_nothing_of_the_last_one(void) {
    memset(&link.seal, 0xA5, sizeof link.seal);
    terrapin_link_init(&link, &state, &inputs);
    terrapin_link_seal(&link, link_key, GENERATION, 6U);
    TEST_ASSERT_EQUAL_PTR(link_key, link.seal.key);
    TEST_ASSERT_EQUAL_UINT32(GENERATION, link.seal.generation);
    TEST_ASSERT_EQUAL_UINT32(6U, link.seal.start);
    TEST_ASSERT_EQUAL_UINT32(0U, link.seal.opened);
    TEST_ASSERT_EQUAL_UINT32(0U, link.seal.session[0].next);
    TEST_ASSERT_EQUAL_UINT32(0U, link.seal.session[1].next);
    TEST_ASSERT_EQUAL_UINT8(0U, link.seal.waiting);
    TEST_ASSERT_FALSE(link.seal.holding);
    TEST_ASSERT_EQUAL_UINT16(0U, link.seal.checks);
    TEST_ASSERT_EQUAL_UINT32(0U, link.seal.checks_ms);
    TEST_ASSERT_EQUAL_UINT32(0U, link.seal.now_ms);
}

/* Keys with the top bit of each word, as tests/python/test_chaskey.py's model has them. */
static void test_the_cipher_with_every_top_bit(void) {
    static const uint32_t known[][3][4] = {
        {{0xE25DAC49U, 0x62AEED19U, 0x20EEFDF9U, 0x743A3FFCU},
         {0x1AD480B2U, 0xE35B99EBU, 0x9475BE7EU, 0x6F0313CAU},
         {0x3F417B8BU, 0xE625782BU, 0xDBEB31F3U, 0xC41AD3BDU}},
        {{0x72A57B22U, 0x9F10C9C6U, 0x064AC4E5U, 0x3793F396U},
         {0xFABDBDCAU, 0xA912C602U, 0x495E2E65U, 0x8091DB65U},
         {0xCFB5E213U, 0x9DC73D06U, 0x9EC6C119U, 0x632041FCU}},
        {{0x7E25F208U, 0x5B4AE908U, 0xC0DAA21DU, 0x27D1FC79U},
         {0xAA01203CU, 0x01B2EACCU, 0xF7AF5BC9U, 0xA80DD19BU},
         {0xACBCE8ECU, 0xEC717475U, 0x37FD96D1U, 0x4A812222U}},
        {{0x1CE13E3DU, 0x6A7FBF2FU, 0x216A1E6BU, 0xB126386CU},
         {0xAE447756U, 0x7AF6D25CU, 0xD024EDA5U, 0xC761B11EU},
         {0x031D5259U, 0x4AB2CB39U, 0xDC8E02A0U, 0xAEE41162U}},
        {{0xE18C78A1U, 0xB4E89FD8U, 0xCC6DE256U, 0xD663FD37U},
         {0xAAC56B8EU, 0xCC41A344U, 0x31E84A42U, 0x010BE3F6U},
         {0x428C4682U, 0xB750632EU, 0xAA25EC00U, 0x977746C4U}},
        {{0x059CEC4FU, 0x9CDBF6B7U, 0x75DD5F1BU, 0xF20751BCU},
         {0xC0749915U, 0xC4F13FF5U, 0xBE1BFF2DU, 0xA08EBEB1U},
         {0x78C26EE4U, 0xC98F8986U, 0xC9707482U, 0x655A1760U}},
    };
    for (uint32_t i = 0U; i < (sizeof known / sizeof known[0]); i++) {
        uint32_t tag[4];
        terrapin_chaskey(known[i][0], known[i][1], tag);
        TEST_ASSERT_EQUAL_HEX32_ARRAY(known[i][2], tag, 4);
    }
}

/* ---- the node's identifiers: of those that it sends, the protected ones get the CRC of theirs, the others stay */

static void test_every_answer_of_a_node(void) {
    static const uint16_t protected_ids[] = {TERRAPIN_ID_ACTUATE, TERRAPIN_ID_PARAMETER_VALUE, TERRAPIN_ID_STORE_STATUS,
                                             TERRAPIN_ID_NODE_STATUS, TERRAPIN_ID_UPDATE_STATUS};
    terrapin_node node;
    for (uint8_t number = 0U; number < TERRAPIN_NODES; number++) {
        terrapin_node_init(&node, number);
        for (uint16_t id = 0x180U; id < 0x1C0U; id++) {
            bool protected_id = false;
            for (uint32_t i = 0U; i < (sizeof protected_ids / sizeof protected_ids[0]); i++) {
                protected_id = protected_id || (protected_ids[i] == id);
            }
            terrapin_frame frame = {.id = id, .length = 8U, .data = {1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U}};
            uint8_t last = TERRAPIN_E2E_NO_COUNTER;
            if (protected_id) {
                terrapin_e2e_protect(&frame, 3U);
            }
            const terrapin_frame before = frame;
            terrapin_node_send(&node, &frame);
            if (protected_id) {
                TEST_ASSERT_EQUAL(TERRAPIN_E2E_OK, terrapin_e2e_check(&frame, &last));
            } else {
                TEST_ASSERT_EQUAL_MEMORY(before.data, frame.data, 8U);
            }
        }
    }
}

/* ---- the queue */

static terrapin_intake intake;

static void wait_for(uint16_t id, uint32_t times) {
    const terrapin_frame frame = {.id = id, .length = 8U};
    for (uint32_t i = 0U; i < times; i++) {
        terrapin_intake_put(&intake, &link, &state, &inputs, &frame, 0U);
    }
}

static uint32_t taken_in_a_tick(void) {
    terrapin_frame frame;
    uint8_t source = 0U;
    uint32_t count = 0U;
    terrapin_intake_begin_tick(&intake);
    while (terrapin_intake_next(&intake, &link, &state, &frame, &source)) {
        count++;
    }
    return count;
}

/* 7,300 instructions with the bridge off, 1,100 with it on: what fits exactly is taken, and nothing after it. */
static void test_a_tick_is_spent_to_its_last_instruction(void) {
    terrapin_intake_init(&intake);
    wait_for(TERRAPIN_ID_PARAMETER_WRITE, 1U); /* 4,200, and 5 x 260, 1,000, 4 x 200 */
    wait_for(TERRAPIN_ID_PARAMETER_READ, 5U);
    wait_for(TERRAPIN_ID_STORE_READ, 1U);
    wait_for(TERRAPIN_ID_UPDATE_DATA, 5U);
    TEST_ASSERT_EQUAL(11U, taken_in_a_tick());
    terrapin_intake_init(&intake);
    wait_for(TERRAPIN_ID_COMMAND, 20U); /* 20 x 275 is 5,500, and 9 x 200: a tenth is too much */
    wait_for(TERRAPIN_ID_UPDATE_DATA, 10U);
    TEST_ASSERT_EQUAL(29U, taken_in_a_tick());
    state.drive.enable = true;
    terrapin_intake_init(&intake);
    wait_for(TERRAPIN_ID_PARAMETER_READ, 1U); /* 260, 430, and 3 x 110: a fourth is too much */
    wait_for(TERRAPIN_ID_PARAMETER_WRITE, 1U);
    wait_for(TERRAPIN_ID_SENSORS_SLOW, 9U);
    TEST_ASSERT_EQUAL(5U, taken_in_a_tick());
    terrapin_intake_init(&intake);
    terrapin_frame run;
    const terrapin_command_t message = {.request = TERRAPIN_REQUEST_RUN};
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &run));
    terrapin_intake_put(&intake, &link, &state, &inputs, &run, 0U); /* 2 x 275 and 5 x 110: all of it */
    terrapin_intake_put(&intake, &link, &state, &inputs, &run, 0U);
    wait_for(TERRAPIN_ID_SENSORS_SLOW, 9U);
    TEST_ASSERT_EQUAL(7U, taken_in_a_tick());
}

/* What an IDLE took out of turn is no longer there for those that wait: 200 of the next tick's 1,100. */
static void test_an_idle_ahead_is_charged(void) {
    const terrapin_command_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame idle;
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &idle));
    state.drive.enable = true;
    terrapin_intake_init(&intake);
    wait_for(TERRAPIN_ID_PARAMETER_READ, 9U);
    TEST_ASSERT_EQUAL(4U, taken_in_a_tick());
    terrapin_intake_put(&intake, &link, &state, &inputs, &idle, 0U); /* damaged, but tried */
    TEST_ASSERT_EQUAL(3U, taken_in_a_tick());
    TEST_ASSERT_EQUAL(2U, taken_in_a_tick());
}

/* Two IDLEs are taken out of turn in a tick, and two more in the next one. */
static void test_two_idles_ahead_in_each_tick(void) {
    const terrapin_command_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame frame;
    terrapin_intake_init(&intake);
    state.drive.enable = true;
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &frame));
    wait_for(TERRAPIN_ID_PARAMETER_READ, 1U);
    for (uint32_t tick = 1U; tick <= 3U; tick++) {
        terrapin_intake_begin_tick(&intake);
        for (uint32_t i = 0U; i < 3U; i++) {
            counter++;
            terrapin_e2e_protect(&frame, counter);
            terrapin_intake_put(&intake, &link, &state, &inputs, &frame, 0U);
        }
        TEST_ASSERT_EQUAL(1U + tick, intake.count); /* the third one waits */
    }
}

/* ---- the serial line */

static void test_refused_lines_are_counted_and_no_others(void) {
    terrapin_slcan parser;
    terrapin_slcan_reply line;
    terrapin_frame frame;
    const char *text = "O\rt1230\rV\r";
    terrapin_slcan_init(&parser);
    for (const char *c = text; *c != '\0'; c++) {
        (void)terrapin_slcan_feed(&parser, (uint8_t)*c, &frame, &line);
    }
    TEST_ASSERT_EQUAL(0U, parser.refused + parser.malformed + parser.foreign);
    text = "r1230\rC\rt1230\r";
    for (const char *c = text; *c != '\0'; c++) {
        (void)terrapin_slcan_feed(&parser, (uint8_t)*c, &frame, &line);
    }
    TEST_ASSERT_EQUAL(2U, parser.refused);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_store_tells_what_it_does_and_found);
    RUN_TEST(test_a_save_begins_or_fails);
    RUN_TEST(test_a_sealed_write_whatever_its_bytes);
    RUN_TEST(test_a_sealed_clear_and_no_request_above_it);
    RUN_TEST(test_the_last_session_and_a_short_frame);
    RUN_TEST(test_another_key_leaves_nothing_of_the_last_one);
    RUN_TEST(test_the_cipher_with_every_top_bit);
    RUN_TEST(test_every_answer_of_a_node);
    RUN_TEST(test_a_tick_is_spent_to_its_last_instruction);
    RUN_TEST(test_an_idle_ahead_is_charged);
    RUN_TEST(test_two_idles_ahead_in_each_tick);
    RUN_TEST(test_refused_lines_are_counted_and_no_others);
    return UNITY_END();
}
