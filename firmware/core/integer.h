/* Integer arithmetic of the core: saturating, rounding, and the few functions that need more than + - * /.
 *
 * Every function is total over the range that its comment states; callers keep to it, and say why at the call.
 */
#ifndef TERRAPIN_INTEGER_H
#define TERRAPIN_INTEGER_H

#include <stdbool.h>
#include <stdint.h>

/* Results are held within this, so that the sum of any two still fits an int32_t. */
#define INTEGER_MOST 0x3FFFFFFF

/* value, held within low..high; low <= high. */
int32_t integer_clamp(int64_t value, int32_t low, int32_t high);

/* value held within INTEGER_MOST. */
int32_t integer_saturate(int64_t value);

/* value * factor / divisor to the nearest, halves away from zero, held within INTEGER_MOST. divisor > 0; any others. */
int32_t integer_scale(int32_t value, int32_t factor, int32_t divisor);

/* numerator/denominator to the nearest, halves away from zero. denominator > 0, |numerator| < 2^62. Denominators from
 * 2^30 on lose low bits, with the numerator: the result is then good to 4e-9 of itself. */
int64_t integer_divide(int64_t numerator, int64_t denominator);

/* |value|; value > INT32_MIN. */
int32_t integer_abs(int32_t value);

/* -1 of a negative number, else 1. */
int32_t integer_direction(int32_t value);

/* -1, 0 or 1. */
int32_t integer_sign(int32_t value);

/* later - earlier of two counts that wrap at 2^32, as the signed number of least magnitude. */
int32_t integer_difference(uint32_t later, uint32_t earlier);

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
