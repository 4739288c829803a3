/* The products, quotients and curves of integer.h as contracts, in place of their arithmetic: what a caller must keep
 * to is an obligation, and of the result only this is known: its sign, and how long it is, which follows from the
 * lengths of what goes in. tests/python/test_proof.py asks functions and contracts at 1,000,000 points each. Include
 * it before any of the core.
 */
#ifndef INTEGERS_H
#define INTEGERS_H

#include "proof.h"

#include "integer.h"

/* Bits of a magnitude: |value| is below 2^length, and 2^(length - 1) or more, but of 0. */
static uint32_t length64(uint64_t size) {
    return (size == 0U) ? 0U : (64U - (uint32_t)__builtin_clzll(size));
}

static uint64_t magnitude_of(int32_t value) {
    return (value < 0) ? (0U - (uint64_t)(int64_t)value) : (uint64_t)value;
}

static uint32_t length_of(int32_t value) {
    return length64(magnitude_of(value));
}

/* |value| is at most 2^power. */
static uint32_t power_of(int32_t value) {
    return (value == 0) ? 0U : length64(magnitude_of(value) - 1U);
}

/* 2^(power - less), at least 1; held. */
static int64_t two_to(uint32_t power, uint32_t less) {
    const uint32_t left = (power > less) ? (power - less) : 0U;
    return (left < 62U) ? ((int64_t)1 << left) : INT64_MAX;
}

static int64_t size_of(int64_t value) {
    return (value < 0) ? -value : value;
}

/* Any number with the sign of value times factor, or 0, of at most `most`. */
static int32_t signed_as(int32_t value, int32_t factor, int64_t most) {
    const int32_t result = nondet_int();
    ASSUME(size_of(result) <= most);
    ASSUME(((value != 0) && (factor != 0)) || (result == 0));
    ASSUME(((value < 0) == (factor < 0)) ? (result >= 0) : (result <= 0));
    return result;
}

/* value factor / 2^bits, to the nearest. */
static int32_t product(int32_t value, int32_t factor, uint32_t bits) {
    const uint32_t power = power_of(value) + power_of(factor);
    const uint32_t length = length_of(value) + length_of(factor);
    const int64_t most = two_to(power, bits);
    const int32_t result = signed_as(value, factor, (most < INT32_MAX) ? most : INT32_MAX);
    ASSUME((size_of(factor) > ((int64_t)1 << bits)) || (size_of(result) <= size_of(value)));
    ASSUME((size_of(value) > ((int64_t)1 << bits)) || (size_of(result) <= size_of(factor)));
    if ((value != 0) && (factor != 0) && (length >= (bits + 2U))) {
        ASSUME(size_of(result) >= ((int64_t)1 << (length - bits - 2U)));
    }
    return result;
}

static int32_t contract_q(int32_t value, int32_t factor, uint32_t bits) {
    PROVE((bits >= 1U) && (bits <= 31U));
    PROVE(((power_of(value) + power_of(factor)) <= (bits + 30U)) || /* it fits: by its length, or as no more than one */
          (size_of(factor) <= ((int64_t)1 << bits)) || (size_of(value) <= ((int64_t)1 << bits)));
    return product(value, factor, bits);
}

static int32_t contract_q32(int32_t value, int32_t factor) {
    return product(value, factor, 32U);
}

static int32_t contract_q_held(int32_t value, int32_t factor, uint32_t bits) {
    PROVE((bits >= 2U) && (bits <= 30U));
    int32_t result;
    if ((power_of(value) + power_of(factor)) < (bits + 30U)) {
        result = product(value, factor, bits);
    } else {
        result = signed_as(value, factor, (int64_t)INTEGER_MOST + 1);
    }
    ASSUME((result >= INTEGER_LEAST) && (result <= INTEGER_MOST));
    return result;
}

static int32_t contract_of_sine(int32_t value, int32_t sine) {
    PROVE((sine >= -32767) && (sine <= 32767));
    return signed_as(value, sine, size_of(value));
}

/* Gains are made by integer_gain_of and integer_wide_of alone. */
static bool is_gain(const integer_gain *gain) {
    return (gain->factor >= 0) && (gain->most >= 0) && (gain->most <= INTEGER_MOST);
}

static bool is_wide(const integer_wide *wide) {
    return (wide->whole >= 0) && (wide->part_q31 >= 0) && (wide->most >= 0) && (wide->most <= INTEGER_MOST);
}

static int32_t contract_gained(const integer_gain *gain, int32_t count) {
    PROVE(is_gain(gain));
    return signed_as(count, gain->factor, INTEGER_MOST);
}

static int32_t contract_widened(const integer_wide *wide, int32_t value) {
    PROVE(is_wide(wide));
    return signed_as(value, ((wide->whole | wide->part_q31) != 0) ? 1 : 0, INTEGER_MOST);
}

static int32_t contract_ratio(int32_t value, int32_t divisor) {
    PROVE(divisor > 0);
    PROVE((value <= (INT32_MAX - (divisor / 2))) && (value >= ((divisor / 2) - INT32_MAX)));
    const uint32_t shift = length_of(divisor) - 1U;
    return signed_as(value, 1, (size_of(value) >> shift) + 1);
}

int32_t integer_scale(int32_t value, int32_t factor, int32_t divisor) {
    PROVE(divisor > 0);
    const uint32_t length = length_of(value) + length_of(factor);
    const uint32_t shift = length_of(divisor) - 1U;
    const int64_t most = two_to(length, shift);
    const int32_t result = signed_as(value, factor, (most < INTEGER_MOST) ? most : INTEGER_MOST);
    ASSUME((size_of(factor) > divisor) || (size_of(result) <= size_of(value)));
#ifdef TO_THE_UNIT /* which takes longer */
    const int64_t exact = size_of(value) * size_of(factor);
    ASSUME((size_of(result) * divisor) <= (exact + (divisor / 2)));
    ASSUME((size_of(result) == INTEGER_MOST) || (exact <= ((size_of(result) * divisor) + (divisor / 2))));
#endif
    return result;
}

int32_t integer_factor(int64_t value, uint32_t bits, int32_t divisor) {
    PROVE((value >= 0) && (bits < 62U) && (value < two_to(62U, bits)));
    PROVE(divisor > 0);
    const uint32_t length = length64((uint64_t)value) + bits;
    const uint32_t shift = length_of(divisor) - 1U;
    const int64_t most = two_to(length, shift);
    const int32_t factor = signed_as((value > 0) ? 1 : 0, 1, (most < INT32_MAX) ? most : INT32_MAX);
    ASSUME((value > divisor) || (factor <= ((int64_t)1 << bits)));
    const int64_t least = two_to(length, length_of(divisor) + 1U);
    ASSUME((value == 0) || (factor >= least) || (factor == INT32_MAX));
    return factor;
}

int32_t integer_signed_factor(int64_t value, uint32_t bits, int32_t divisor) {
    return (value < 0) ? -integer_factor(-value, bits, divisor) : integer_factor(value, bits, divisor);
}

integer_gain integer_gain_of(int32_t value, int32_t divisor) {
    PROVE((value >= 0) && (divisor > 0));
    const integer_gain gain = {.factor = nondet_int(), .most = nondet_int()};
    ASSUME(is_gain(&gain));
    return gain;
}

integer_wide integer_wide_of(int32_t value, int32_t divisor) {
    PROVE((value >= 0) && (value < INT32_MAX) && (divisor > 0));
    const integer_wide wide = {.whole = nondet_int(), .part_q31 = nondet_int(), .most = nondet_int()};
    ASSUME(is_wide(&wide));
    return wide;
}

int64_t integer_divide(int64_t numerator, int64_t denominator) {
    PROVE(denominator > 0);
    PROVE((numerator < INT64_C(0x4000000000000000)) && (numerator > -INT64_C(0x4000000000000000)));
    int64_t result;
    ANYTHING(result);
    const uint32_t shift = length64((uint64_t)denominator) - 1U;
    const int64_t most = (size_of(numerator) >> shift) + 1;
    ASSUME((result >= -most) && (result <= most));
    ASSUME((numerator < 0) ? (result <= 0) : (result >= 0));
    return result;
}

uint32_t integer_root(uint64_t value) {
    const uint32_t root = nondet_word();
    const uint32_t length = length64(value);
    ASSUME((uint64_t)root < ((uint64_t)1 << ((length + 1U) / 2U)));
#ifdef TO_THE_UNIT
    ASSUME((((uint64_t)root * root) <= value) && ((((uint64_t)root + 1U) * ((uint64_t)root + 1U)) > value));
#endif
    ASSUME((length == 0U) || (root >= ((uint32_t)1 << ((length - 1U) / 2U))));
    return root;
}

int32_t integer_sine(uint32_t turn) {
    (void)turn;
    const int32_t sine = nondet_int();
    ASSUME((sine >= -32767) && (sine <= 32767));
    return sine;
}

int32_t integer_cosine(uint32_t turn) {
    return integer_sine(turn);
}

uint32_t integer_turn(int32_t angle_mrad) {
    (void)angle_mrad;
    return nondet_word();
}

int32_t integer_exp(int32_t x_q16) {
    PROVE(x_q16 >= 0);
    const int32_t result = nondet_int();
    ASSUME((result >= 0) && (result <= 65536));
    return result;
}

int32_t integer_narrow(int64_t value, int32_t low, int32_t high) {
    PROVE(low <= high);
    return (int32_t)((value < low) ? low : ((value > high) ? high : value));
}

int32_t integer_saturate(int64_t value) {
    return integer_narrow(value, -INTEGER_MOST, INTEGER_MOST);
}

#define integer_q       contract_q
#define integer_q32     contract_q32
#define integer_q_held  contract_q_held
#define integer_of_sine contract_of_sine
#define integer_gained  contract_gained
#define integer_widened contract_widened
#define integer_ratio   contract_ratio

#endif
