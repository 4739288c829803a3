#include "integer.h"

int32_t integer_clamp(int64_t value, int32_t low, int32_t high) {
    int64_t held = value;
    if (held < low) {
        held = low;
    }
    if (held > high) {
        held = high;
    }
    return (int32_t)held;
}

int32_t integer_saturate(int64_t value) {
    return integer_clamp(value, INT32_MIN, INT32_MAX);
}

int64_t integer_abs(int64_t value) {
    return (value < 0) ? -value : value;
}

int32_t integer_sign(int64_t value) {
    return ((value > 0) ? 1 : 0) - ((value < 0) ? 1 : 0);
}

int64_t integer_divide(int64_t numerator, int64_t denominator) {
    const int64_t half = denominator / 2;
    return (numerator < 0) ? -((half - numerator) / denominator) : ((numerator + half) / denominator);
}

int64_t integer_shift(int64_t value, uint32_t bits) {
    /* On magnitudes: what a right shift makes of a negative number is the compiler's choice. */
    const uint64_t half = (uint64_t)1U << (bits - 1U);
    const int64_t size = (int64_t)(((uint64_t)integer_abs(value) + half) >> bits);
    return (value < 0) ? -size : size;
}

int32_t integer_difference(uint32_t later, uint32_t earlier) {
    const uint32_t forward = later - earlier;
    return (forward < 0x80000000U) ? (int32_t)forward : -(int32_t)(~forward) - 1;
}

uint32_t integer_root(uint64_t value) {
    uint64_t rest = value;
    uint64_t root = 0U;
    for (uint64_t bit = (uint64_t)1U << 62U; bit != 0U; bit >>= 2U) {
        const uint64_t trial = root + bit;
        root >>= 1U;
        if (rest >= trial) {
            rest -= trial;
            root += bit;
        }
    }
    return (uint32_t)root;
}

int32_t integer_sine(uint32_t turn) {
    /* sin(pi/2 z), |z| <= 1 in Q15, is z (1.570320 - 0.642113 z^2 + 0.071860 z^4) to 6.8e-5: minimax of this form. */
    const uint32_t folded = ((turn + 0x40000000U) < 0x80000000U) ? turn : (0x80000000U - turn);
    const int64_t z = integer_shift(integer_difference(folded, 0U), 15U); /* -32768..32768 */
    const int64_t square = integer_shift(z * z, 15U);
    const int64_t inner = integer_shift(2355 * square, 15U) - 21041;
    const int64_t gain = integer_shift(inner * square, 15U) + 51456;
    return integer_clamp(integer_shift(gain * z, 15U), -32767, 32767);
}

int32_t integer_cosine(uint32_t turn) {
    return integer_sine(turn + 0x40000000U);
}

uint32_t integer_turn(int32_t angle_mrad) {
    /* 2^32 / 2 pi / 1000 = 683565.28; the product stays below 2^51, the part above one turn falls away. */
    return (uint32_t)((uint64_t)((int64_t)angle_mrad * 683565) & 0xFFFFFFFFU);
}

int32_t integer_exp(uint32_t x_q16) {
    /* exp(-x) = 2^-(k + f), y = x log2(e) = k + f; 2^-f by a cubic (Chebyshev), error 1.02e-4 over 0 <= f < 1. */
    const uint64_t y = ((uint64_t)x_q16 * 94548U) >> 16U;
    const uint64_t whole = y >> 16U;
    const int64_t f = (int64_t)(y & 0xFFFFU);
    const int64_t cubic = 15112 - integer_shift(2589 * f, 16U);
    const int64_t square = integer_shift(cubic * f, 16U) - 45290;
    const int64_t power = integer_shift(square * f, 16U) + 65529;
    return (whole < 31U) ? (int32_t)(power >> whole) : 0;
}
