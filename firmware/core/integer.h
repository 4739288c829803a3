/* Integer arithmetic of the core: saturating, rounding, and the few functions that need more than + - * /.
 *
 * Every function is total over the range that its comment states; callers keep to it, and say why at the call.
 */
#ifndef TERRAPIN_INTEGER_H
#define TERRAPIN_INTEGER_H

#include <stdbool.h>
#include <stdint.h>

#include "terrapin_assert.h"

/* Results are held within this, so that the sum of any two still fits an int32_t. */
#define INTEGER_MOST 0x3FFFFFFF

/* value, held within low..high; low <= high. */
static inline int32_t integer_clamp(int32_t value, int32_t low, int32_t high) {
    TERRAPIN_ASSERT(low <= high);
    const int32_t held = (value < low) ? low : value;
    return (held > high) ? high : held;
}

/* The sum or difference of two that are held within INTEGER_MOST, held so again. */
static inline int32_t integer_hold(int32_t value) {
    return integer_clamp(value, -INTEGER_MOST, INTEGER_MOST);
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

/* A value over a divisor, split once so that integer_times is quick. */
typedef struct {
    uint32_t ones; /* the value is ones * divisor + rest */
    uint32_t rest;
    uint32_t divisor;
    uint32_t most; /* counts up to this take the quick way */
} integer_rate;

/* value and divisor > 0. */
void integer_split(integer_rate *rate, int32_t value, int32_t divisor);
/* integer_scale(value, count, divisor). Any count. */
int32_t integer_times(const integer_rate *rate, int32_t count);

/* integer_scale(value, factor, 1000000), and with 2^bits, bits 2 to 30. Factors below 2^31. */
int32_t integer_millionth(int32_t value, uint32_t factor);
int32_t integer_shift(int32_t value, uint32_t factor, uint32_t bits);

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
