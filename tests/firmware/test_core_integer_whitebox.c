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
    TEST_ASSERT_EQUAL_INT32(INTEGER_LEAST, integer_hold(INT32_MIN));
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

static int32_t held_of(long double exact) {
    const long double most = INTEGER_MOST;
    const long double least = INTEGER_LEAST;
    return (int32_t)(exact > most ? most : (exact < least ? least : exact));
}

/* Halves upwards: the floor of what is one half more. */
static void test_products_in_q_formats(void) {
    int held = 0;
    for (int i = 0; i < 300000; i++) {
        const int32_t a = any() >> (rand() % 31);
        const int32_t factor = any() >> (rand() % 31);
        const uint32_t bits = 2U + (uint32_t)(rand() % 29);
        const long double product = (long double)a * (long double)factor;
        const long double exact = floorl(ldexpl(product, -(int)bits) + 0.5L);
        TEST_ASSERT_EQUAL_INT32(held_of(exact), integer_q_held(a, factor, bits));
        TEST_ASSERT_EQUAL_INT32((int32_t)floorl(ldexpl(product, -32) + 0.5L), integer_q32(a, factor));
        const int32_t summand = any() / 2;
        TEST_ASSERT_EQUAL_INT32(summand + integer_q32(a / 2, factor), integer_q32_plus(summand, a / 2, factor));
        if (fabsl(exact) <= INTEGER_MOST) {
            TEST_ASSERT_EQUAL_INT32((int32_t)exact, integer_q(a, factor, bits));
        } else {
            held++;
        }
    }
    TEST_ASSERT_TRUE((held > 1000) && (held < 200000));
    TEST_ASSERT_EQUAL_INT32(-1, integer_q(-3, 1, 1U)); /* the half goes up */
    TEST_ASSERT_EQUAL_INT32(2, integer_q(3, 1, 1U));
    TEST_ASSERT_EQUAL_INT32(-1, integer_down(-1, 40U));
}

/* Where the hold begins: quotients just below and above 2^30. */
static void test_the_hold_of_products(void) {
    for (uint32_t bits = 2U; bits <= 30U; bits++) {
        for (int64_t off = -70; off <= 70; off++) {
            const int64_t product = ((int64_t)1 << (30U + bits)) + (off * ((int64_t)1 << (bits - 2U)));
            const int32_t factor = 1 << 29;
            const int64_t value = product / factor; /* exact while 2^29 divides */
            if ((value <= INT32_MAX) && ((value * factor) == product)) {
                const long double exact = floorl(ldexpl((long double)product, -(int)bits) + 0.5L);
                const long double mirrored = floorl(ldexpl(-(long double)product, -(int)bits) + 0.5L);
                TEST_ASSERT_EQUAL_INT32(held_of(exact), integer_q_held((int32_t)value, factor, bits));
                TEST_ASSERT_EQUAL_INT32(held_of(mirrored), integer_q_held((int32_t)-value, factor, bits));
            }
        }
    }
}

static void test_factors_are_the_quotient_upwards(void) {
    for (int i = 0; i < 100000; i++) {
        const int32_t value = (any() & INT32_MAX) >> (rand() % 31);
        const int32_t divisor = ((any() & INTEGER_MOST) >> (rand() % 30)) + 1;
        const uint32_t bits = (uint32_t)(rand() % 31);
        const int64_t scaled = (int64_t)value * ((int64_t)1 << bits);
        const int64_t exact = (scaled + divisor - 1) / divisor;
        const int32_t expected = (int32_t)(exact > INT32_MAX ? INT32_MAX : exact);
        TEST_ASSERT_EQUAL_INT32(expected, integer_factor(value, bits, divisor));
        TEST_ASSERT_EQUAL_INT32(-expected, integer_signed_factor(-(int64_t)value, bits, divisor));
    }
}

/* A gain is good to a unit of its factor a count, and never passes what it is held within. */
static void test_gains_of_counts(void) {
    int beyond = 0;
    for (int i = 0; i < 100000; i++) {
        const int32_t value = ((any() & 0x1FFFFFFF) >> (rand() % 29)) + 1;
        const int32_t divisor = 1024 + ((any() & INTEGER_MOST) >> (rand() % 30));
        const integer_gain gain = integer_gain_of(value, divisor);
        const int32_t counts[] = {any() >> (rand() % 31), gain.most, -gain.most, INT32_MAX, INT32_MIN, 0};
        for (size_t k = 0; k < (sizeof counts / sizeof counts[0]); k++) {
            const int32_t found = integer_gained(&gain, counts[k]);
            TEST_ASSERT_TRUE((found <= INTEGER_MOST) && (found >= -INTEGER_MOST));
            if (fabs((double)counts[k]) <= gain.most) {
                const double exact = (double)value * (double)counts[k] / (double)divisor;
                TEST_ASSERT_TRUE(fabs(found - exact) <= 0.51 + (fabs((double)counts[k]) / 4096.0));
            } else {
                beyond++;
            }
        }
    }
    TEST_ASSERT_TRUE(beyond > 1000);
}

static void test_of_a_sine(void) {
    for (int i = 0; i < 100000; i++) {
        const int32_t value = any() / 2;
        const int32_t sine = (any() % 32768);
        const double exact = (double)value * (double)sine / 32767.0;
        TEST_ASSERT_TRUE(fabs(integer_of_sine(value, sine) - exact) <= 0.51 + (fabs(exact) * 2e-9));
    }
    TEST_ASSERT_EQUAL_INT32(1000000, integer_of_sine(1000000, 32767));
    TEST_ASSERT_EQUAL_INT32(-1000000, integer_of_sine(1000000, -32767));
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
    RUN_TEST(test_products_in_q_formats);
    RUN_TEST(test_the_hold_of_products);
    RUN_TEST(test_factors_are_the_quotient_upwards);
    RUN_TEST(test_gains_of_counts);
    RUN_TEST(test_of_a_sine);
    RUN_TEST(test_ratio_rounds_halves_away_from_zero);
    RUN_TEST(test_difference_wraps);
    RUN_TEST(test_root_is_the_floor_of_the_square_root);
    RUN_TEST(test_sine_and_cosine_within_five);
    RUN_TEST(test_turn_of_an_angle);
    RUN_TEST(test_exp_within_nine);
    return UNITY_END();
}
