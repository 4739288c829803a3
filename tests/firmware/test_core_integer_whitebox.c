/* Integer arithmetic of the core against double precision, at its edges and over random values. */
#include <math.h>
#include <stdlib.h>

#include "unity.h"

#include "integer.c"

#define PI 3.14159265358979323846

void setUp(void) {
    srand(7);
}

void tearDown(void) {}

static int32_t any(void) {
    return (int32_t)(((uint32_t)rand() << 17) ^ ((uint32_t)rand() << 2) ^ (uint32_t)rand());
}

static void test_clamp_and_saturate(void) {
    TEST_ASSERT_EQUAL_INT32(-5, integer_narrow(INT64_MIN, -5, 7));
    TEST_ASSERT_EQUAL_INT32(7, integer_narrow(INT64_MAX, -5, 7));
    TEST_ASSERT_EQUAL_INT32(-5, integer_clamp(INT32_MIN, -5, 7));
    TEST_ASSERT_EQUAL_INT32(7, integer_clamp(INT32_MAX, -5, 7));
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST, integer_hold(INT32_MAX));
    TEST_ASSERT_EQUAL_INT32(-INTEGER_MOST, integer_hold(INT32_MIN));
    TEST_ASSERT_EQUAL_INT32(-5, integer_clamp(-5, -5, 7));
    TEST_ASSERT_EQUAL_INT32(7, integer_clamp(7, -5, 7));
    TEST_ASSERT_EQUAL_INT32(0, integer_clamp(0, -5, 7));
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST, integer_saturate((int64_t)INTEGER_MOST + 1));
    TEST_ASSERT_EQUAL_INT32(-INTEGER_MOST, integer_saturate(INT64_MIN));
    TEST_ASSERT_EQUAL_INT32(123, integer_saturate(123));
}

static void test_abs_and_sign(void) {
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, integer_abs(-INT32_MAX));
    TEST_ASSERT_EQUAL_INT32(3, integer_abs(3));
    TEST_ASSERT_EQUAL_INT32(0, integer_abs(0));
    TEST_ASSERT_EQUAL_INT32(-1, integer_sign(INT32_MIN));
    TEST_ASSERT_EQUAL_INT32(-1, integer_direction(-1));
    TEST_ASSERT_EQUAL_INT32(1, integer_direction(0));
    TEST_ASSERT_EQUAL_INT32(1, integer_direction(5));
    TEST_ASSERT_EQUAL_INT32(0, integer_sign(0));
    TEST_ASSERT_EQUAL_INT32(1, integer_sign(INT32_MAX));
}

static void test_divide_rounds_halves_away_from_zero(void) {
    static const int64_t rows[][3] = {
        {7, 2, 4}, {-7, 2, -4}, {5, 3, 2}, {4, 3, 1}, {-5, 3, -2}, {0, 9, 0}, {(1LL << 61), 1, 1LL << 61}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        TEST_ASSERT_EQUAL_INT64(rows[i][2], integer_divide(rows[i][0], rows[i][1]));
    }
    for (int i = 0; i < 100000; i++) {
        const int64_t n = (int64_t)any() * (any() >> 4);
        const int64_t d = ((any() & INTEGER_MOST) >> (rand() % 30)) + 1;
        const int64_t expected = (int64_t)roundl((long double)n / (long double)d);
        TEST_ASSERT_EQUAL_INT64(expected, integer_divide(n, d));
    }
}

static void test_divide_by_large_denominators_is_good_to_4e_9(void) {
    for (int i = 0; i < 10000; i++) {
        const int64_t n = (int64_t)any() * (any() >> 3);
        const int64_t d = ((int64_t)1 << 30) + ((int64_t)any() & INT64_C(0x7FFFFFFF)) * 1000;
        const double exact = (double)n / (double)d;
        TEST_ASSERT_TRUE(fabs((double)integer_divide(n, d) - exact) <= 0.51 + fabs(exact) * 4e-9);
    }
}

static void test_scale_equals_the_rounded_quotient(void) {
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST, integer_scale(INT32_MAX, INT32_MAX, 1));
    TEST_ASSERT_EQUAL_INT32(-INTEGER_MOST, integer_scale(INT32_MIN, INT32_MAX, 1));
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST, integer_scale(INT32_MIN, INT32_MIN, 1));
    TEST_ASSERT_EQUAL_INT32(0, integer_scale(0, INT32_MIN, INTEGER_MOST));
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST, integer_scale(INTEGER_MOST, 1, 1));
    TEST_ASSERT_EQUAL_INT32(INTEGER_MOST - 1, integer_scale(INTEGER_MOST - 1, 1, 1));
    TEST_ASSERT_EQUAL_INT32(1, integer_scale(INTEGER_MOST - 1, 1, INTEGER_MOST));
    for (int i = 0; i < 200000; i++) {
        const int32_t a = any() >> (rand() % 31);
        const int32_t b = any() >> (rand() % 31);
        const int32_t d = ((any() & INTEGER_MOST) >> (rand() % 30)) + (rand() % 2);
        if (d > 0) {
            const long double exact = roundl((long double)a * (long double)b / (long double)d);
            const long double most = INTEGER_MOST;
            const long double held = exact > most ? most : (exact < -most ? -most : exact);
            TEST_ASSERT_EQUAL_INT32((int32_t)held, integer_scale(a, b, d));
        }
    }
}

/* The rounded quotient by double precision's wider kin, held within INTEGER_MOST. */
static int32_t quotient_of(int32_t a, int32_t b, int32_t d) {
    const long double exact = roundl((long double)a * (long double)b / (long double)d);
    const long double most = INTEGER_MOST;
    return (int32_t)(exact > most ? most : (exact < -most ? -most : exact));
}

/* Where 32 bits, one digit or the hold take over: quotients just below and above 2^30, divisors about powers of two. */
static void test_scale_at_its_edges(void) {
    for (int i = 0; i < 200000; i++) {
        const int32_t d = (int32_t)((1U << (rand() % 31)) + (uint32_t)(rand() % 3)) - 1;
        const int32_t a = (rand() % 2 == 0) ? INTEGER_MOST - 2 + (rand() % 5) : any() >> (rand() % 31);
        const int32_t b = (rand() % 2 == 0) ? d : any() >> (rand() % 31);
        if (d > 0) {
            TEST_ASSERT_EQUAL_INT32(quotient_of(a, b, d), integer_scale(a, b, d));
            TEST_ASSERT_EQUAL_INT32(quotient_of(-a, b, d), integer_scale(-a, b, d));
        }
    }
}

/* Also about the count where the quick way ends. */
static void test_times_equals_scale(void) {
    uint32_t quick = 0U;
    for (int i = 0; i < 300000; i++) {
        const int32_t value = ((any() & INT32_MAX) >> (rand() % 31)) + (rand() % 2);
        const int32_t d = ((any() & INTEGER_MOST) >> (rand() % 30)) + (rand() % 2);
        if ((d > 0) && (value > 0)) {
            integer_rate rate;
            integer_split(&rate, value, d);
            const int32_t edge = (int32_t)rate.most - 1 + (rand() % 3);
            const int32_t counts[] = {any() >> (rand() % 31), edge, -edge, INT32_MIN, 0};
            for (size_t k = 0; k < (sizeof counts / sizeof counts[0]); k++) {
                TEST_ASSERT_EQUAL_INT32(integer_scale(value, counts[k], d), integer_times(&rate, counts[k]));
            }
            quick += (magnitude(counts[0]) <= rate.most) ? 1U : 0U;
        }
    }
    TEST_ASSERT_TRUE(quick > 10000U);
}

static void test_millionth_and_shift_equal_scale(void) {
    for (int i = 0; i < 200000; i++) {
        const int32_t a = any() >> (rand() % 31);
        const int32_t factor = (any() & INT32_MAX) >> (rand() % 31);
        const uint32_t bits = 2U + (uint32_t)(rand() % 29);
        TEST_ASSERT_EQUAL_INT32(quotient_of(a, factor, 1000000), integer_millionth(a, (uint32_t)factor));
        TEST_ASSERT_EQUAL_INT32(quotient_of(a, factor, (int32_t)(1U << bits)),
                                integer_shift(a, (uint32_t)factor, bits));
        const int64_t edge = ((int64_t)INTEGER_MOST * 1000000) / (factor + 1); /* where the hold begins */
        if (edge < INT32_MAX) {
            const int32_t near = (int32_t)edge + (rand() % 3) - 1;
            TEST_ASSERT_EQUAL_INT32(quotient_of(near, factor, 1000000), integer_millionth(near, (uint32_t)factor));
        }
    }
}

static void test_ratio_rounds_halves_away_from_zero(void) {
    for (int32_t value = -100; value <= 100; value++) {
        for (int32_t divisor = 1; divisor < 20; divisor++) {
            TEST_ASSERT_EQUAL_INT32(quotient_of(value, 1, divisor), integer_ratio(value, divisor));
        }
    }
}

static void test_difference_wraps(void) {
    TEST_ASSERT_EQUAL_INT32(2, integer_difference(1U, 0xFFFFFFFFU));
    TEST_ASSERT_EQUAL_INT32(-2, integer_difference(0xFFFFFFFFU, 1U));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, integer_difference(0x7FFFFFFFU, 0U));
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, integer_difference(0x80000000U, 0U));
    TEST_ASSERT_EQUAL_INT32(0, integer_difference(77U, 77U));
}

static void test_root_is_the_floor_of_the_square_root(void) {
    static const uint64_t roots[] = {0U, 1U, 2U, 3U, 65535U, 65536U, 0x7FFFFFFFU, 0xFFFFFFFFU};
    for (size_t i = 0; i < sizeof roots / sizeof roots[0]; i++) {
        const uint64_t square = roots[i] * roots[i];
        TEST_ASSERT_EQUAL_UINT32((uint32_t)roots[i], integer_root(square));
        if (roots[i] > 0U) {
            TEST_ASSERT_EQUAL_UINT32((uint32_t)(roots[i] - 1U), integer_root(square - 1U));
        }
    }
    TEST_ASSERT_EQUAL_UINT32(0xFFFFFFFFU, integer_root(UINT64_MAX));
    for (int i = 0; i < 200000; i++) { /* squares of every size, and what is just below and above */
        const uint64_t root = (((uint64_t)(uint32_t)any() << 1U) >> (rand() % 32)) & 0xFFFFFFFFU;
        const uint64_t value = (root * root) + (uint64_t)(rand() % 3);
        const uint64_t found = integer_root(value);
        TEST_ASSERT_TRUE((found * found) <= value);
        TEST_ASSERT_TRUE((found == 0xFFFFFFFFU) || (((found + 1U) * (found + 1U)) > value));
    }
}

static void test_sine_and_cosine_within_five(void) {
    double worst = 0.0;
    for (uint64_t turn = 0; turn < (1ULL << 32); turn += 65521U) {
        const double angle = 2.0 * PI * (double)turn / 4294967296.0;
        worst = fmax(worst, fabs(integer_sine((uint32_t)turn) - 32767.0 * sin(angle)));
        worst = fmax(worst, fabs(integer_cosine((uint32_t)turn) - 32767.0 * cos(angle)));
    }
    TEST_ASSERT_TRUE_MESSAGE(worst <= 5.0, "the bound stated in integer.h");
    TEST_ASSERT_TRUE_MESSAGE(worst >= 1.0, "better than the approximation can be: the test looks at nothing");
    TEST_ASSERT_EQUAL_INT32(0, integer_sine(0U));
    TEST_ASSERT_INT32_WITHIN(4, 32767, integer_sine(0x40000000U));
    TEST_ASSERT_INT32_WITHIN(4, -32767, integer_sine(0xC0000000U));
}

static void test_turn_of_an_angle(void) {
    for (int32_t mrad = -20000; mrad <= 20000; mrad += 37) {
        const double turns = mrad / 1000.0 / (2.0 * PI);
        const double fraction = turns - floor(turns);
        double off = fabs((double)integer_turn(mrad) / 4294967296.0 - fraction);
        off = fmin(off, 1.0 - off);
        TEST_ASSERT_TRUE(off < 2e-6);
    }
}

static void test_exp_within_nine(void) {
    double worst = 0.0;
    for (int32_t x = 0; x < 40 * 65536; x += 13) {
        worst = fmax(worst, fabs(integer_exp(x) - 65536.0 * exp(-x / 65536.0)));
    }
    TEST_ASSERT_TRUE_MESSAGE(worst <= 9.0, "the bound stated in integer.h");
    TEST_ASSERT_TRUE_MESSAGE(worst >= 1.0, "better than the approximation can be: the test looks at nothing");
    TEST_ASSERT_EQUAL_INT32(0, integer_exp(INT32_MAX));
    TEST_ASSERT_EQUAL_INT32(0, integer_exp(22 * 65536));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_clamp_and_saturate);
    RUN_TEST(test_abs_and_sign);
    RUN_TEST(test_divide_rounds_halves_away_from_zero);
    RUN_TEST(test_divide_by_large_denominators_is_good_to_4e_9);
    RUN_TEST(test_scale_equals_the_rounded_quotient);
    RUN_TEST(test_scale_at_its_edges);
    RUN_TEST(test_times_equals_scale);
    RUN_TEST(test_millionth_and_shift_equal_scale);
    RUN_TEST(test_ratio_rounds_halves_away_from_zero);
    RUN_TEST(test_difference_wraps);
    RUN_TEST(test_root_is_the_floor_of_the_square_root);
    RUN_TEST(test_sine_and_cosine_within_five);
    RUN_TEST(test_turn_of_an_angle);
    RUN_TEST(test_exp_within_nine);
    return UNITY_END();
}
