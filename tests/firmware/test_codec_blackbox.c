/* The generated codec on messages whose layout is fixed: known bytes, clamping, E2E. The differential test against an
 * independent DBC reader is tests/python/test_interface.py. */
#include <string.h>

#include "unity.h"

#include "terrapin_interface.h"

void setUp(void) {}

void tearDown(void) {}

static void test_known_bytes(void) {
    terrapin_frame frame;
    const terrapin_sensors_slow_t message = {
        .slow_code = 0xABC, .slow_channel = 1, .swing_angle = -1, .swing_rate = 0, .pitch = -2048, .ground_speed = 1};
    /* bit 0: 0xABC; 12: 1; 13 to 25: ones; 26 to 38: zeros; 50 (sign of pitch): 1; 51: 1 */
    static const uint8_t expected[8] = {0xBC, 0xFA, 0xFF, 0x03, 0x00, 0x00, 0x0C, 0x00};
    TEST_ASSERT_TRUE(terrapin_encode_sensors_slow(&message, &frame));
    TEST_ASSERT_EQUAL_HEX16(0x101, frame.id);
    TEST_ASSERT_EQUAL(8, frame.length);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected, frame.data, 8);
    terrapin_sensors_slow_t back;
    TEST_ASSERT_TRUE(terrapin_decode_sensors_slow(&frame, &back));
    TEST_ASSERT_EQUAL_MEMORY(&message, &back, sizeof back);
}

/* What does not fit is clamped to its own field, flagged, and touches no neighbour. */
static void test_saturation(void) {
    static const int32_t beyond[] = {4096, 5000, 65536, INT32_MAX};
    for (size_t i = 0; i < 4U; i++) {
        terrapin_frame frame;
        terrapin_sensors_slow_t back;
        terrapin_sensors_slow_t message = {.swing_angle = beyond[i]};
        TEST_ASSERT_FALSE(terrapin_encode_sensors_slow(&message, &frame));
        TEST_ASSERT_TRUE(terrapin_decode_sensors_slow(&frame, &back));
        TEST_ASSERT_EQUAL(4095, back.swing_angle);
        TEST_ASSERT_EQUAL(0, back.slow_channel | back.swing_rate);
        message.swing_angle = -beyond[i] - 1;
        TEST_ASSERT_FALSE(terrapin_encode_sensors_slow(&message, &frame));
        TEST_ASSERT_TRUE(terrapin_decode_sensors_slow(&frame, &back));
        TEST_ASSERT_EQUAL(-4096, back.swing_angle);
        message = (terrapin_sensors_slow_t){.slow_code = beyond[i]};
        TEST_ASSERT_FALSE(terrapin_encode_sensors_slow(&message, &frame));
        TEST_ASSERT_TRUE(terrapin_decode_sensors_slow(&frame, &back));
        TEST_ASSERT_EQUAL(4095, back.slow_code);
        message.slow_code = -1;
        TEST_ASSERT_FALSE(terrapin_encode_sensors_slow(&message, &frame));
        TEST_ASSERT_TRUE(terrapin_decode_sensors_slow(&frame, &back));
        TEST_ASSERT_EQUAL(0, back.slow_code);
    }
}

static void test_bounds_themselves_fit(void) {
    terrapin_frame frame;
    terrapin_parameter_write_t back;
    static const int32_t values[] = {INT32_MIN, -1, 0, 1, INT32_MAX};
    for (size_t i = 0; i < 5U; i++) {
        const terrapin_parameter_write_t message = {.index = 65535, .value = values[i]};
        TEST_ASSERT_TRUE(terrapin_encode_parameter_write(&message, &frame));
        TEST_ASSERT_TRUE(terrapin_decode_parameter_write(&frame, &back));
        TEST_ASSERT_EQUAL(values[i], back.value);
        TEST_ASSERT_EQUAL(65535, back.index);
    }
}

static void test_decode_refuses_other_frames(void) {
    terrapin_frame frame = {.id = TERRAPIN_ID_COMMAND, .length = 8};
    terrapin_command_t message = {.setpoint = 42};
    frame.length = 7;
    TEST_ASSERT_FALSE(terrapin_decode_command(&frame, &message));
    frame.length = 8;
    frame.id++;
    TEST_ASSERT_FALSE(terrapin_decode_command(&frame, &message));
    TEST_ASSERT_EQUAL(42, message.setpoint);
}

/* Vectors of AUTOSAR's CRC library specification (SWS_CRCLibrary), CRC-8 SAE J1850. */
static void test_crc_vectors(void) {
    static const uint8_t zeros[4] = {0};
    static const uint8_t a[3] = {0xF2, 0x01, 0x83};
    static const uint8_t b[4] = {0x0F, 0xAA, 0x00, 0x55};
    static const uint8_t c[4] = {0x00, 0xFF, 0x55, 0x11};
    static const uint8_t d[9] = {0x33, 0x22, 0x55, 0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF};
    static const uint8_t e[3] = {0x92, 0x6B, 0x55};
    static const uint8_t f[4] = {0xFF, 0xFF, 0xFF, 0xFF};
    static const uint8_t check[9] = {'1', '2', '3', '4', '5', '6', '7', '8', '9'};
    TEST_ASSERT_EQUAL_HEX8(0x59, terrapin_crc8(0, zeros, 4));
    TEST_ASSERT_EQUAL_HEX8(0x37, terrapin_crc8(0, a, 3));
    TEST_ASSERT_EQUAL_HEX8(0x79, terrapin_crc8(0, b, 4));
    TEST_ASSERT_EQUAL_HEX8(0xB8, terrapin_crc8(0, c, 4));
    TEST_ASSERT_EQUAL_HEX8(0xCB, terrapin_crc8(0, d, 9));
    TEST_ASSERT_EQUAL_HEX8(0x8C, terrapin_crc8(0, e, 3));
    TEST_ASSERT_EQUAL_HEX8(0x74, terrapin_crc8(0, f, 4));
    TEST_ASSERT_EQUAL_HEX8(0x4B, terrapin_crc8(0, check, 9));
    for (size_t split = 0; split <= 9U; split++) {
        TEST_ASSERT_EQUAL_HEX8(0x4B, terrapin_crc8(terrapin_crc8(0, check, split), &check[split], 9U - split));
    }
}

static void test_protection_detects_every_error_of_up_to_two_bits(void) {
    terrapin_frame good = {.id = 0x080, .length = 8, .data = {1, 2, 3, 4, 5, 6, 0, 0}};
    terrapin_e2e_protect(&good, 17); /* modulo 15 */
    TEST_ASSERT_EQUAL(2, good.data[6] & 0x0F);
    for (size_t i = 0; i < 64U; i++) {
        for (size_t j = 0; j < 64U; j++) {
            uint8_t last = TERRAPIN_E2E_NO_COUNTER;
            terrapin_frame bad = good;
            bad.data[i / 8U] ^= (uint8_t)(1U << (i % 8U));
            if (j != i) {
                bad.data[j / 8U] ^= (uint8_t)(1U << (j % 8U));
            }
            TEST_ASSERT_EQUAL(TERRAPIN_E2E_BAD_CRC, terrapin_e2e_check(&bad, &last));
            TEST_ASSERT_EQUAL_HEX8(TERRAPIN_E2E_NO_COUNTER, last);
        }
    }
}

/* The CRC of a frame is worked out by words; terrapin_crc8, byte by byte, is checked against published vectors above.
 * It is linear, so that each bit alone would do. */
static void test_protection_is_the_crc_of_the_bytes(void) {
    uint32_t seed = 1U;
    for (uint32_t i = 0; i < 20000U; i++) {
        terrapin_frame frame = {.length = 8};
        uint8_t bytes[9] = {0};
        uint8_t words[10];
        for (size_t k = 0; k < sizeof words; k++) {
            seed = (seed * 1664525U) + 1013904223U;
            const uint32_t one_bit = (k == (i / 8U)) ? (1U << (i % 8U)) : 0U;
            words[k] = (uint8_t)((i < 80U) ? one_bit : (seed >> 24U));
        }
        frame.id = (uint16_t)(words[8] | ((uint32_t)words[9] << 8U));
        memcpy(frame.data, words, 8);
        terrapin_e2e_protect(&frame, i);
        bytes[0] = words[8];
        bytes[1] = words[9];
        memcpy(&bytes[2], frame.data, 7);
        TEST_ASSERT_EQUAL_HEX8(terrapin_crc8(0, bytes, 9), frame.data[7]);
    }
}

static void test_protection_covers_the_identifier(void) {
    terrapin_frame frame = {.id = 0x080, .length = 8};
    uint8_t last = TERRAPIN_E2E_NO_COUNTER;
    terrapin_e2e_protect(&frame, 0);
    frame.id = 0x081;
    TEST_ASSERT_EQUAL(TERRAPIN_E2E_BAD_CRC, terrapin_e2e_check(&frame, &last));
    frame.id = 0x180;
    TEST_ASSERT_EQUAL(TERRAPIN_E2E_BAD_CRC, terrapin_e2e_check(&frame, &last));
}

static void test_counters(void) {
    terrapin_frame frame = {.id = 0x080, .length = 8};
    uint8_t last = TERRAPIN_E2E_NO_COUNTER;
    for (uint32_t i = 0; i < 40U; i++) {
        terrapin_e2e_protect(&frame, i);
        TEST_ASSERT_EQUAL(TERRAPIN_E2E_OK, terrapin_e2e_check(&frame, &last));
        TEST_ASSERT_EQUAL(i % 15U, last);
        TEST_ASSERT_EQUAL(TERRAPIN_E2E_REPEATED, terrapin_e2e_check(&frame, &last));
    }
    frame.length = 7;
    last = TERRAPIN_E2E_NO_COUNTER;
    TEST_ASSERT_EQUAL(TERRAPIN_E2E_BAD_CRC, terrapin_e2e_check(&frame, &last));
}

/* Counter 15 does not exist, even with a CRC that fits. */
static void test_counter_15_is_refused(void) {
    terrapin_frame frame = {.id = 0x080, .length = 8, .data = {0, 0, 0, 0, 0, 0, 0x0F, 0}};
    static const uint8_t bytes[9] = {0x80, 0x00, 0, 0, 0, 0, 0, 0, 0x0F};
    uint8_t last = TERRAPIN_E2E_NO_COUNTER;
    frame.data[7] = terrapin_crc8(0, bytes, 9);
    TEST_ASSERT_EQUAL(TERRAPIN_E2E_BAD_CRC, terrapin_e2e_check(&frame, &last));
}

static void test_parameter_table(void) {
    for (size_t i = 0; i < TERRAPIN_PARAMETER_COUNT; i++) {
        TEST_ASSERT_LESS_OR_EQUAL(terrapin_parameter((uint16_t)i).default_value,
                                  terrapin_parameter((uint16_t)i).minimum);
        TEST_ASSERT_GREATER_OR_EQUAL(terrapin_parameter((uint16_t)i).default_value,
                                     terrapin_parameter((uint16_t)i).maximum);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_known_bytes);
    RUN_TEST(test_saturation);
    RUN_TEST(test_bounds_themselves_fit);
    RUN_TEST(test_decode_refuses_other_frames);
    RUN_TEST(test_crc_vectors);
    RUN_TEST(test_protection_detects_every_error_of_up_to_two_bits);
    RUN_TEST(test_protection_is_the_crc_of_the_bytes);
    RUN_TEST(test_protection_covers_the_identifier);
    RUN_TEST(test_counters);
    RUN_TEST(test_counter_15_is_refused);
    RUN_TEST(test_parameter_table);
    return UNITY_END();
}
