/* The edges of Ed25519's arithmetic that a signature meets once in 2^128: the group's order and the field's prime, with
 * each bit beside them. */
#include <string.h>

#include "unity.h"

#include "sha2.c"
#include "ed25519.c"
#include "field.c"

void setUp(void) {}

void tearDown(void) {}

/* RFC 8032: L = 2^252 + 27742317777372353535851937790883648493, p = 2^255 - 19; the least byte first. */
static const uint8_t group_order[32] = {0xEDU, 0xD3U, 0xF5U, 0x5CU, 0x1AU, 0x63U, 0x12U, 0x58U, 0xD6U, 0x9CU, 0xF7U,
                                        0xA2U, 0xDEU, 0xF9U, 0xDEU, 0x14U, 0U,    0U,    0U,    0U,    0U,    0U,
                                        0U,    0U,    0U,    0U,    0U,    0U,    0U,    0U,    0U,    0x10U};

/* from + 2^bit, or from - 2^bit when `down`; false when that is below 0 or takes more than 32 bytes. */
static bool beside(uint8_t to[32], const uint8_t from[32], uint32_t bit, bool down) {
    int32_t carry = 0;
    for (uint32_t i = 0U; i < 32U; i++) {
        const int32_t step = ((bit / 8U) == i) ? (1 << (bit % 8U)) : 0;
        const int32_t sum = (int32_t)from[i] + (down ? -step : step) + carry;
        to[i] = (uint8_t)(sum & 0xFF);
        carry = (sum < 0) ? -1 : ((sum > 0xFF) ? 1 : 0);
    }
    return carry == 0;
}

static void test_below_the_order_and_from_it_on(void) {
    uint8_t other[32];
    TEST_ASSERT_FALSE(canonical(group_order));
    for (uint32_t bit = 0U; bit < 256U; bit++) {
        if (beside(other, group_order, bit, true)) {
            TEST_ASSERT_TRUE(canonical(other));
        }
        if (beside(other, group_order, bit, false)) {
            TEST_ASSERT_FALSE(canonical(other));
        }
    }
}

static void test_below_the_prime_and_from_it_on(void) {
    uint8_t prime[32];
    uint8_t other[32];
    field a;
    memset(prime, 0xFF, sizeof prime);
    prime[0] = 0xEDU;
    prime[31] = 0x7FU;
    TEST_ASSERT_FALSE(field_decode(&a, prime));
    for (uint32_t bit = 0U; bit < 255U; bit++) {
        TEST_ASSERT_TRUE(beside(other, prime, bit, true));
        TEST_ASSERT_TRUE(field_decode(&a, other));
        uint8_t again[32];
        field_encode(again, &a);
        TEST_ASSERT_EQUAL_MEMORY(other, again, 32U);
        (void)beside(other, prime, bit, false);
        if ((other[31] & 0x80U) == 0U) {
            TEST_ASSERT_FALSE(field_decode(&a, other));
        }
    }
}

/* Sums, differences and products whose carries run through all limbs, or fold twice, against p - 1 = -1. */
static void test_the_largest_carries(void) {
    field most;
    field sum;
    field minus_one = zero;
    memset(&most, 0xFF, sizeof most); /* 2^256 - 1 = 37 modulo p */
    field_subtract(&minus_one, &zero, &one);
    const field value_37 = {{37U, 0U, 0U, 0U, 0U, 0U, 0U, 0U}};
    const field value_74 = {{74U, 0U, 0U, 0U, 0U, 0U, 0U, 0U}};
    const field value_1369 = {{1369U, 0U, 0U, 0U, 0U, 0U, 0U, 0U}};
    TEST_ASSERT_TRUE(field_equal(&most, &value_37));
    TEST_ASSERT_FALSE(field_equal(&most, &value_74));
    field_add(&sum, &most, &most);
    TEST_ASSERT_TRUE(field_equal(&sum, &value_74));
    field_multiply(&sum, &most, &most);
    TEST_ASSERT_TRUE(field_equal(&sum, &value_1369));
    field_add(&sum, &most, &one);
    const field value_38 = {{38U, 0U, 0U, 0U, 0U, 0U, 0U, 0U}};
    TEST_ASSERT_TRUE(field_equal(&sum, &value_38));
    field_subtract(&sum, &zero, &most);
    field_add(&sum, &sum, &value_37);
    TEST_ASSERT_TRUE(field_equal(&sum, &zero));
    field_multiply(&sum, &minus_one, &minus_one);
    TEST_ASSERT_TRUE(field_equal(&sum, &one));
    field_invert(&sum, &minus_one);
    TEST_ASSERT_TRUE(field_equal(&sum, &minus_one));
    for (uint32_t i = 0U; i < 8U; i++) { /* values that differ in one limb are not equal */
        field other = zero;
        other.limb[i] = 1U;
        TEST_ASSERT_FALSE(field_equal(&other, &zero));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_below_the_order_and_from_it_on);
    RUN_TEST(test_below_the_prime_and_from_it_on);
    RUN_TEST(test_the_largest_carries);
    return UNITY_END();
}
