/* SLCAN parser and encoder, every branch: good lines, each way of being wrong, lines that never end. */
#include <string.h>

#include "unity.h"

#include "slcan.c"

static terrapin_slcan parser;
static terrapin_slcan_reply reply;
static terrapin_frame frame;

void setUp(void) {
    terrapin_slcan_init(&parser);
    parser.open = true;
    frame = (terrapin_frame){.id = 0xFFFFU, .length = 0xFFU};
}

void tearDown(void) {}

/* Feed text and its CR; the event of the CR. Every byte before it must give MORE. */
static terrapin_slcan_event feed(const char *text) {
    for (size_t i = 0; text[i] != '\0'; i++) {
        TEST_ASSERT_EQUAL(TERRAPIN_SLCAN_MORE, terrapin_slcan_feed(&parser, (uint8_t)text[i], &frame, &reply));
    }
    return terrapin_slcan_feed(&parser, CR, &frame, &reply);
}

static void expect_reply(const char *text, const char *expected) {
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_SLCAN_DONE, feed(text), text);
    TEST_ASSERT_EQUAL_MESSAGE(strlen(expected), reply.length, text);
    TEST_ASSERT_EQUAL_MEMORY_ARRAY(expected, reply.text, 1, reply.length);
    TEST_ASSERT_EQUAL_HEX16_MESSAGE(0xFFFFU, frame.id, "a line that is no frame leaves the frame alone");
}

static void expect_malformed(const char *text) {
    const uint32_t before = parser.malformed;
    expect_reply(text, "\a");
    TEST_ASSERT_EQUAL_MESSAGE(before + 1U, parser.malformed, text);
}

static void expect_refused(const char *text) {
    const uint32_t before = parser.refused;
    expect_reply(text, "\a");
    TEST_ASSERT_EQUAL_MESSAGE(before + 1U, parser.refused, text);
}

static void test_frames_of_every_length(void) {
    static const char *const lines[9] = {
        "t0000",           "t7FF111",           "t123211AB",           "t1233010203",          "t123401020304",
        "t12350102030405", "t1236010203040506", "t123701020304050607", "t1238fFeEdDcCbBaA9988"};
    for (uint8_t length = 0; length <= 8U; length++) {
        TEST_ASSERT_EQUAL(TERRAPIN_SLCAN_FRAME, feed(lines[length]));
        TEST_ASSERT_EQUAL(length, frame.length);
        TEST_ASSERT_EQUAL(1, reply.length);
        TEST_ASSERT_EQUAL_HEX8(CR, reply.text[0]);
    }
    static const uint8_t last[8] = {0xFF, 0xEE, 0xDD, 0xCC, 0xBB, 0xAA, 0x99, 0x88};
    TEST_ASSERT_EQUAL_HEX16(0x123, frame.id);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(last, frame.data, 8);
}

static void test_unused_data_is_zero(void) {
    for (size_t i = 0; i < 8U; i++) {
        frame.data[i] = 0xA5U;
    }
    TEST_ASSERT_EQUAL(TERRAPIN_SLCAN_FRAME, feed("t1231FF"));
    for (size_t i = 1; i < 8U; i++) {
        TEST_ASSERT_EQUAL_HEX8(0, frame.data[i]);
    }
}

static void test_bad_frames(void) {
    expect_malformed("t");
    expect_malformed("t1");
    expect_malformed("t123");
    expect_malformed("t800 ");
    expect_malformed("t8000"); /* identifier above 11 bits */
    expect_malformed("tG000"); /* no digit */
    expect_malformed("t/000"); /* around the digits in ASCII */
    expect_malformed("t:000");
    expect_malformed("t@000");
    expect_malformed("t`000");
    expect_malformed("tg000");
    expect_malformed("t1239"); /* length above 8 */
    expect_malformed("t123x");
    expect_malformed("t12310");   /* too few digits */
    expect_malformed("t1231001"); /* too many */
    expect_malformed("t1231G0");
    expect_malformed("t12310G");
    expect_malformed("t12300000"); /* a time stamp is for received frames */
    expect_malformed("r1231FF");   /* remote frames have no data */
    expect_malformed("T123");
    expect_malformed("T200000000"); /* above 29 bits */
}

static void test_foreign_and_remote_frames(void) {
    expect_reply("T1FFFFFFF2AABB", "\r");
    TEST_ASSERT_EQUAL(1, parser.foreign);
    expect_refused("r1238");
    expect_refused("R000001238");
}

static void test_closed_channel_takes_no_frames(void) {
    expect_reply("C", "\r");
    expect_refused("t1230");
    expect_refused("T000001230");
    expect_reply("O", "\r");
    TEST_ASSERT_EQUAL(TERRAPIN_SLCAN_FRAME, feed("t1230"));
}

static void test_commands(void) {
    expect_reply("", "\r");
    expect_refused("O"); /* is open */
    expect_refused("S6");
    expect_reply("C", "\r");
    expect_reply("C", "\r");
    for (char rate = '0'; rate <= '8'; rate++) {
        const char line[3] = {'S', rate, '\0'};
        expect_reply(line, "\r");
    }
    expect_malformed("S9");
    expect_malformed("S");
    expect_malformed("S66");
    expect_malformed("OO");
    expect_malformed("CC");
    expect_reply("V", "V0101\r");
    expect_malformed("V1");
    expect_reply("N", "NTRPN\r");
    expect_malformed("N1");
    expect_reply("F", "F00\r");
    expect_malformed("F0");
    expect_reply("Z0", "\r");
    expect_refused("Z1");
    expect_malformed("Z2");
    expect_malformed("Z");
    expect_refused("L");
    expect_malformed("L1");
    expect_refused("s031C");
    expect_refused("M00000000");
    expect_refused("mFFFFFFFF");
    expect_malformed("x");
    expect_malformed("\a");
    expect_reply("O", "\r");
    TEST_ASSERT_TRUE(parser.open);
}

static void test_line_feeds_between_lines_are_ignored(void) {
    expect_reply("\n", "\r");
    expect_malformed("t12\n30");
    TEST_ASSERT_EQUAL(TERRAPIN_SLCAN_FRAME, feed("\nt1230"));
}

static void test_lines_are_bounded(void) {
    for (int i = 0; i < 100000; i++) {
        TEST_ASSERT_EQUAL(TERRAPIN_SLCAN_MORE, terrapin_slcan_feed(&parser, (uint8_t)'t', &frame, &reply));
        TEST_ASSERT_LESS_OR_EQUAL(TERRAPIN_SLCAN_LINE_MAX, parser.length);
    }
    TEST_ASSERT_EQUAL(TERRAPIN_SLCAN_DONE, terrapin_slcan_feed(&parser, CR, &frame, &reply));
    TEST_ASSERT_EQUAL_HEX8(BEL, reply.text[0]);
    TEST_ASSERT_EQUAL(1, parser.malformed);
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_SLCAN_FRAME, feed("t1230"), "the next line is good again");
}

/* A line of exactly the largest size is judged by what it says; one byte more is malformed whatever it says. */
static void test_longest_line(void) {
    char line[TERRAPIN_SLCAN_LINE_MAX + 2];
    memset(line, 'x', sizeof line);
    line[0] = 'M'; /* refused at any length */
    line[TERRAPIN_SLCAN_LINE_MAX] = '\0';
    expect_refused(line);
    line[TERRAPIN_SLCAN_LINE_MAX] = 'x';
    line[TERRAPIN_SLCAN_LINE_MAX + 1] = '\0';
    expect_malformed(line);
}

static void test_encode(void) {
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX + 1U] = {0};
    const terrapin_frame full = {.id = 0x7AF, .length = 8, .data = {0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF}};
    TEST_ASSERT_EQUAL(22, terrapin_slcan_encode(&full, text));
    TEST_ASSERT_EQUAL_STRING("t7AF80123456789ABCDEF\r", (const char *)text);
    memset(text, 0, sizeof text);
    const terrapin_frame empty = {.id = 0, .length = 0};
    TEST_ASSERT_EQUAL(6, terrapin_slcan_encode(&empty, text));
    TEST_ASSERT_EQUAL_STRING("t0000\r", (const char *)text);
}

static void test_encode_refuses_what_is_no_frame(void) {
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX] = {0};
    const terrapin_frame wide = {.id = 0x800, .length = 0};
    const terrapin_frame lengthy = {.id = 0, .length = 9};
    TEST_ASSERT_EQUAL(0, terrapin_slcan_encode(&wide, text));
    TEST_ASSERT_EQUAL(0, terrapin_slcan_encode(&lengthy, text));
    TEST_ASSERT_EQUAL(0, text[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_frames_of_every_length);
    RUN_TEST(test_unused_data_is_zero);
    RUN_TEST(test_bad_frames);
    RUN_TEST(test_foreign_and_remote_frames);
    RUN_TEST(test_closed_channel_takes_no_frames);
    RUN_TEST(test_commands);
    RUN_TEST(test_line_feeds_between_lines_are_ignored);
    RUN_TEST(test_lines_are_bounded);
    RUN_TEST(test_longest_line);
    RUN_TEST(test_encode);
    RUN_TEST(test_encode_refuses_what_is_no_frame);
    return UNITY_END();
}
