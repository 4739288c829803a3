/* The controller behind a serial line: SLCAN lines in, SLCAN lines out, a step for each SENSORS_FAST in test mode. */
#include <string.h>

#include "unity.h"

#include "service.h"
#include "state.h"
#include "terrapin_interface.h"

static terrapin_state state;
static terrapin_service service;
static uint8_t answer[TERRAPIN_SERVICE_ANSWER_MAX];
static size_t length;
static uint32_t counter;

/* Bytes as they come; what the last one is answered with. */
static void feed(const uint8_t *bytes, size_t count) {
    for (size_t i = 0; i < count; i++) {
        length = terrapin_service_take(&service, bytes[i], answer);
        TEST_ASSERT_TRUE((length == 0U) || (i == (count - 1U)));
    }
}

static void send(terrapin_frame frame) {
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX];
    terrapin_e2e_protect(&frame, counter);
    counter++;
    feed(text, terrapin_slcan_encode(&frame, text));
}

/* The frames in the answer, and the end of the line behind them. */
static uint32_t frames(uint16_t *first) {
    terrapin_slcan parser;
    terrapin_slcan_reply reply;
    terrapin_frame frame = {0};
    uint32_t count = 0U;
    terrapin_slcan_init(&parser);
    parser.open = true;
    for (size_t i = 0; i < (length - 1U); i++) {
        if (terrapin_slcan_feed(&parser, answer[i], &frame, &reply) == TERRAPIN_SLCAN_FRAME) {
            *first = (count == 0U) ? frame.id : *first;
            count++;
        }
    }
    TEST_ASSERT_EQUAL_HEX8('\r', answer[length - 1U]);
    return count;
}

void setUp(void) {
    memset(&service, 0xA5, sizeof service); /* memory as it is found */
    memset(answer, 0, sizeof answer);
    counter = 0U;
    terrapin_service_init(&service, &state);
    feed((const uint8_t *)"O\r", 2U);
}

void tearDown(void) {}

static void arm(void) {
    const terrapin_test_mode_t message = {.key = TERRAPIN_TEST_MODE_KEY};
    terrapin_frame frame;
    TEST_ASSERT_TRUE(terrapin_encode_test_mode(&message, &frame));
    send(frame);
}

static void sense(int32_t tick) {
    const terrapin_sensors_fast_t message = {.tick = tick};
    terrapin_frame frame;
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX];
    TEST_ASSERT_TRUE(terrapin_encode_sensors_fast(&message, &frame)); /* has no counter, and the tick in its place */
    feed(text, terrapin_slcan_encode(&frame, text));
}

static void test_begins_with_nothing(void) {
    TEST_ASSERT_EQUAL_UINT32(0U, service.ticks);
    TEST_ASSERT_EQUAL_UINT8(0U, service.outputs.frame_count);
    TEST_ASSERT_FALSE(service.outputs.enable);
    TEST_ASSERT_EQUAL_UINT32(0U, service.link.unknown);
    TEST_ASSERT_EQUAL_PTR(&state, service.state);
    TEST_ASSERT_EQUAL(1, length); /* the line is open */
    TEST_ASSERT_EQUAL_HEX8('\r', answer[0]);
}

static void test_a_question_is_answered_on_the_line(void) {
    const terrapin_parameter_read_t message = {.index = 3};
    terrapin_frame frame;
    uint16_t id = 0U;
    TEST_ASSERT_TRUE(terrapin_encode_parameter_read(&message, &frame));
    send(frame);
    TEST_ASSERT_EQUAL_UINT32(1U, frames(&id));
    TEST_ASSERT_EQUAL_HEX16(TERRAPIN_ID_PARAMETER_VALUE, id);
    TEST_ASSERT_EQUAL_UINT32(0U, service.ticks);
}

static void test_steps_in_test_mode_alone(void) {
    uint16_t id = 0U;
    sense(1);
    TEST_ASSERT_EQUAL(1, length); /* the line's end, and no frame */
    TEST_ASSERT_EQUAL_UINT32(0U, service.ticks);
    arm();
    for (uint32_t tick = 1U; tick <= 12U; tick++) { /* HEADING's, without a heading, is the one of a single frame */
        sense((int32_t)tick);
        TEST_ASSERT_EQUAL_UINT32((tick == 9U) ? 1U : 2U, service.outputs.frame_count);
        TEST_ASSERT_EQUAL_UINT32(tick, service.ticks);
        TEST_ASSERT_EQUAL_UINT32(service.outputs.frame_count, frames(&id));
        TEST_ASSERT_EQUAL_HEX16(service.outputs.frames[0].id, id);
    }
}

static void test_a_line_that_is_wrong_is_answered_and_does_nothing(void) {
    feed((const uint8_t *)"t12\r", 4U);
    TEST_ASSERT_EQUAL(1, length);
    TEST_ASSERT_EQUAL_HEX8('\a', answer[0]);
    TEST_ASSERT_EQUAL_UINT32(0U, service.ticks);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_begins_with_nothing);
    RUN_TEST(test_a_question_is_answered_on_the_line);
    RUN_TEST(test_steps_in_test_mode_alone);
    RUN_TEST(test_a_line_that_is_wrong_is_answered_and_does_nothing);
    return UNITY_END();
}
