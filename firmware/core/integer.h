/* Integer arithmetic of the core: saturating, rounding, and the few functions that need more than + - * /.
 *
 * Every function is total over the range that its comment states; callers keep to it, and say why at the call.
 */
#ifndef TERRAPIN_INTEGER_H
#define TERRAPIN_INTEGER_H

#include <stdbool.h>
#include <stdint.h>

#include "terrapin_assert.h"

/* Products with constant shifts are a few instructions, and thirty where the compiler makes a function of them. */
#if defined(__GNUC__)
#define INTEGER_INLINE static inline __attribute__((always_inline))
#else
#define INTEGER_INLINE static inline
#endif

/* Results are held within these, so that the sum of any two still fits an int32_t; a Cortex-M4 has an instruction for
 * it (SSAT). */
#define INTEGER_MOST  0x3FFFFFFF
#define INTEGER_LEAST (-INTEGER_MOST - 1)

/* cppcheck-suppress [shiftNegativeLHS, misra-c2012-10.1] ; what integer_down rests on */
_Static_assert((-3 >> 1) == -2, "a shift to the right takes the sign along");

/* value, held within low..high; low <= high. */
static inline int32_t integer_clamp(int32_t value, int32_t low, int32_t high) {
    TERRAPIN_ASSERT(low <= high);
    const int32_t held = (value < low) ? low : value;
    return (held > high) ? high : held;
}

/* value / 2^bits, downwards: the result must fit. bits 0 to 63. One instruction or two, where a division is a dozen. */
INTEGER_INLINE int32_t integer_down(int64_t value, uint32_t bits) {
    /* cppcheck-suppress misra-c2012-10.1 ; GCC, Clang and Arm's compiler shift the sign in, which is held above */
    return (int32_t)(value >> bits);
}

/* The sum or difference of two that are held, held again. */
static inline int32_t integer_hold(int32_t value) {
    return integer_clamp(value, INTEGER_LEAST, INTEGER_MOST);
}

/* |value|; value > INT32_MIN. */
static inline int32_t integer_abs(int32_t value) {
    TERRAPIN_ASSERT(value > INT32_MIN);
    return (value < 0) ? -value : value;
}

/* -1 of a negative number, else 1. */
static inline int32_t integer_direction(int32_t value) {
    return (value < 0) ? -1 : 1;
}

/* -1, 0 or 1. */
static inline int32_t integer_sign(int32_t value) {
    return ((value > 0) ? 1 : 0) - ((value < 0) ? 1 : 0);
}

/* value/divisor to the nearest, halves away from zero. |value| + divisor/2 < 2^31, divisor > 0. */
static inline int32_t integer_ratio(int32_t value, int32_t divisor) {
    TERRAPIN_ASSERT(divisor > 0);
    const int32_t half = divisor / 2;
    TERRAPIN_ASSERT((value <= (INT32_MAX - half)) && (value >= (half - INT32_MAX)));
    return (value + ((value < 0) ? -half : half)) / divisor;
}

/* later - earlier of two counts that wrap at 2^32, as the signed number of least magnitude. */
static inline int32_t integer_difference(uint32_t later, uint32_t earlier) {
    const uint32_t forward = later - earlier;
    const uint32_t backward = ~forward;
    /* cppcheck-suppress knownConditionTrueFalse ; one caller of several keeps below */
    return (forward < 0x80000000U) ? (int32_t)forward : (-(int32_t)backward - 1);
}

/* The same, of any width. */
int32_t integer_narrow(int64_t value, int32_t low, int32_t high);

/* value held within INTEGER_MOST. */
int32_t integer_saturate(int64_t value);

/* value * factor / divisor to the nearest, halves away from zero, held within INTEGER_MOST. divisor > 0; any others.
 * Quick while |factor| * divisor is below 2^31. */
int32_t integer_scale(int32_t value, int32_t factor, int32_t divisor);

/* ---- products with a factor in a Q format: factor / 2^bits, prepared where a parameter changes */

/* The same of 32 bits: one instruction. bits below 32. */
INTEGER_INLINE int32_t integer_right(int32_t value, uint32_t bits) {
    /* cppcheck-suppress misra-c2012-10.1 ; as above */
    return value >> bits;
}

/* 2^bits; bits below 63. */
INTEGER_INLINE int64_t integer_power(uint32_t bits) {
    const uint64_t power = (uint64_t)1U << bits;
    return (int64_t)power;
}

/* value factor / 2^bits to the nearest, halves upwards; the result must fit. bits 1 to 31. */
INTEGER_INLINE int32_t integer_q(int32_t value, int32_t factor, uint32_t bits) {
    TERRAPIN_ASSERT((bits >= 1U) && (bits <= 31U));
    return integer_down(((int64_t)value * factor) + integer_power(bits - 1U), bits);
}

/* The same for 2^32, and a summand; the sum must fit: SMLAL. */
INTEGER_INLINE int32_t integer_q32_plus(int32_t summand, int32_t value, int32_t factor) {
    return integer_down(((int64_t)summand * integer_power(32U)) + integer_power(31U) + ((int64_t)value * factor), 32U);
}

/* Without a summand, which fits whatever it is: SMMULR. */
INTEGER_INLINE int32_t integer_q32(int32_t value, int32_t factor) {
    return integer_q32_plus(0, value, factor);
}

/* As integer_q, held from INTEGER_LEAST to INTEGER_MOST. bits 2 to 30. */
INTEGER_INLINE int32_t integer_q_held(int32_t value, int32_t factor, uint32_t bits) {
    TERRAPIN_ASSERT((bits >= 2U) && (bits <= 30U));
    const int64_t product = ((int64_t)value * factor) + integer_power(bits - 1U);
    const int32_t high = integer_down(product, 32U);
    const uint32_t edge = (uint32_t)1U << (bits - 2U); /* of the high word, where 2^30 begins */
    int32_t result = INTEGER_MOST;
    if (((uint32_t)high + edge) < (2U * edge)) {
        result = integer_down(product, bits);
    } else if (high < 0) {
        result = INTEGER_LEAST;
    } else {
        /* held */
    }
    return result;
}

/* value times a sine or cosine of integer_sine. 32767 * 32769 is 2^30 to 1e-9. */
INTEGER_INLINE int32_t integer_of_sine(int32_t value, int32_t sine) {
    TERRAPIN_ASSERT((sine >= -32767) && (sine <= 32767));
    return integer_q(value, sine * 32769, 30U);
}

/* A factor whose products with a count are held within INTEGER_MOST: the count is, before. */
typedef struct {
    int32_t factor; /* Q12 */
    int32_t most;   /* counts */
} integer_gain;

/* value / divisor as a gain. value >= 0, divisor > 0, value / divisor < 2^19. */
integer_gain integer_gain_of(int32_t value, int32_t divisor);

INTEGER_INLINE int32_t integer_gained(const integer_gain *gain, int32_t count) {
    return integer_q(integer_clamp(count, -gain->most, gain->most), gain->factor, 12U);
}

/* A factor of any size, good to 2^-31: whole and part. Its products are held as those of a gain. */
typedef struct {
    int32_t whole;
    int32_t part_q31;
    int32_t most;
} integer_wide;

/* value / divisor. 0 <= value < 2^31 - 1, divisor > 0. */
integer_wide integer_wide_of(int32_t value, int32_t divisor);

INTEGER_INLINE int32_t integer_widened(const integer_wide *wide, int32_t value) {
    const int32_t held = integer_clamp(value, -wide->most, wide->most);
    return (held * wide->whole) + integer_q(held, wide->part_q31, 31U);
}

/* value 2^bits / divisor, upwards, held within INT32_MAX: a factor for the functions above. So it errs to one side, and
 * a product that is a half of its unit goes away from zero. value 2^bits < 2^62, value >= 0, divisor > 0. */
int32_t integer_factor(int64_t value, uint32_t bits, int32_t divisor);
/* The same of any sign. */
int32_t integer_signed_factor(int64_t value, uint32_t bits, int32_t divisor);

/* numerator/denominator to the nearest, halves away from zero. denominator > 0, |numerator| < 2^62. Denominators from
 * 2^30 on lose low bits, with the numerator: the result is then good to 4e-9 of itself. */
int64_t integer_divide(int64_t numerator, int64_t denominator);

/* Largest integer whose square is at most value. Any value. */
uint32_t integer_root(uint64_t value);

/* 32767 sin(2 pi turn / 2^32), error at most 5 (1.5e-4). Any turn. */
int32_t integer_sine(uint32_t turn);

/* 32767 cos(2 pi turn / 2^32), error at most 5. */
int32_t integer_cosine(uint32_t turn);

/* The part of a turn (2^32) that an angle is. |angle_mrad| < 2^31. */
uint32_t integer_turn(int32_t angle_mrad);

/* 65536 exp(-x / 65536), error at most 9 (1.4e-4). x >= 0. */
int32_t integer_exp(int32_t x_q16);

#endif
