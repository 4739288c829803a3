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
    return integer_clamp(value, -INTEGER_MOST, INTEGER_MOST);
}

int32_t integer_abs(int32_t value) {
    return (value < 0) ? -value : value;
}

int32_t integer_direction(int32_t value) {
    return 1 - ((value < 0) ? 2 : 0);
}

int32_t integer_sign(int32_t value) {
    return ((value > 0) ? 1 : 0) - ((value < 0) ? 1 : 0);
}

/* n / d. A 32-bit machine would link a helper of 700 bytes for it; the remainder always stays below d, below 2^30. */
static uint64_t quotient(uint64_t n, uint32_t d) {
#ifdef __LP64__
    return n / d;
#else
    uint32_t rest = 0U;
    uint64_t result = n;
    for (uint32_t i = 0U; i < 64U; i++) {
        rest = (rest << 1U) | (uint32_t)(result >> 63U);
        result <<= 1U;
        if (rest >= d) {
            rest -= d;
            result |= 1U;
        }
    }
    return result;
#endif
}

int64_t integer_divide(int64_t numerator, int64_t denominator) {
    uint64_t n = (numerator < 0) ? (uint64_t)-numerator : (uint64_t)numerator;
    uint64_t d = (uint64_t)denominator;
    while (d > (uint64_t)INTEGER_MOST) {
        n >>= 1U;
        d >>= 1U;
    }
    const int64_t size = (int64_t)quotient(n + (d / 2U), (uint32_t)d);
    return (numerator < 0) ? -size : size;
}

int32_t integer_scale(int32_t value, int32_t factor, int32_t divisor) {
    const int64_t product = (int64_t)value * factor; /* at most 2^62 */
    int32_t result;
    if ((product < INTEGER_MOST) && (product > -INTEGER_MOST)) { /* mostly; 32-bit division is an instruction */
        const int32_t half = (product < 0) ? -(divisor / 2) : (divisor / 2);
        result = ((int32_t)product + half) / divisor;
    } else {
        result = integer_saturate(integer_divide(product, divisor));
    }
    return result;
}

int32_t integer_difference(uint32_t later, uint32_t earlier) {
    const uint32_t forward = later - earlier;
    const uint32_t backward = ~forward;
    /* cppcheck-suppress knownConditionTrueFalse ; one caller of several keeps below */
    return (forward < 0x80000000U) ? (int32_t)forward : (-(int32_t)backward - 1);
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
    /* sin(pi/2 z), |z| <= 1 in Q15, is z (1.570320 - 0.642113 z^2 + 0.071860 z^4) to 6.8e-5: minimax of this form.
     * Each product stays below 51456 * 32768, below 2^31. */
    const uint32_t folded = ((turn + 0x40000000U) < 0x80000000U) ? turn : (0x80000000U - turn);
    const int32_t z = integer_difference(folded, 0U) / 32768; /* -32768..32768 */
    const int32_t square = (z * z) / 32768;
    const int32_t inner = ((2355 * square) / 32768) - 21041;
    const int32_t gain = ((inner * square) / 32768) + 51456;
    return integer_clamp((gain * z) / 32768, -32767, 32767);
}

int32_t integer_cosine(uint32_t turn) {
    return integer_sine(turn + 0x40000000U);
}

uint32_t integer_turn(int32_t angle_mrad) {
    /* 2^32 / 2 pi / 1000 = 683565.28; the product stays below 2^51, the part above one turn falls away. */
    const int64_t turns_q32 = (int64_t)angle_mrad * 683565;
    return (uint32_t)turns_q32; /* modulo 2^32 */
}

int32_t integer_exp(int32_t x_q16) {
    /* exp(-x) = 2^-(k + f), x log2(e) = k + f; 2^-f by a cubic (Chebyshev), error 1.02e-4 over 0 <= f < 1.
     * f in Q15: each product stays below 45290 * 32768, below 2^31. */
    const int32_t y = integer_scale(x_q16, 94548, 65536);
    const uint32_t whole = (uint32_t)y / 65536U;
    const int32_t f = (y % 65536) / 2;
    const int32_t cubic = 15112 - ((2589 * f) / 32768);
    const int32_t square = ((cubic * f) / 32768) - 45290;
    const int32_t power = ((square * f) / 32768) + 65529;
    const uint32_t shifted = (whole < 31U) ? ((uint32_t)power >> whole) : 0U;
    return (int32_t)shifted;
}
