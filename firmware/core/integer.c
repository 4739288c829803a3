#include "integer.h"

int32_t integer_narrow(int64_t value, int32_t low, int32_t high) {
    TERRAPIN_ASSERT(low <= high);
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
    return integer_narrow(value, -INTEGER_MOST, INTEGER_MOST);
}

static uint32_t leading_zeros(uint32_t value) { /* value > 0 */
    TERRAPIN_ASSERT(value > 0U);
    return (uint32_t)__builtin_clz(value);
}

/* One digit of 16 bits of a long division (Knuth 4.3.1, algorithm D): *rest, below d, takes in `next` and keeps what is
 * left. d has its top bit set. */
INTEGER_INLINE uint32_t digit(uint32_t *rest, uint32_t next, uint32_t d) {
    TERRAPIN_ASSERT((d >= 0x80000000U) && (*rest < d));
    TERRAPIN_ASSERT(next <= 0xFFFFU);
    const uint32_t high = d >> 16U;
    uint32_t q = *rest / high;
    uint32_t r = *rest - (q * high);
    /* At most twice; q is below 2^16 + 2, so that its product with the low half of d fits. */
    while ((r < 0x10000U) && ((q * (d & 0xFFFFU)) > ((r << 16U) | next))) {
        q--;
        r += high;
    }
    *rest = ((*rest << 16U) | next) - (q * d); /* modulo 2^32, as the result is below d */
    TERRAPIN_ASSERT((q <= 0xFFFFU) && (*rest < d));
    return q;
}

/* (high 2^32 + low) / d; high < d, so that the quotient fits. A 32-bit machine has no such instruction. */
static uint32_t quotient(uint32_t high, uint32_t low, uint32_t d) {
    TERRAPIN_ASSERT(high < d);
    const uint32_t shift = leading_zeros(d);
    uint32_t rest = (high << shift) | ((low >> 1U) >> (31U - shift));
    const uint32_t first = digit(&rest, (low << shift) >> 16U, d << shift);
    return (first << 16U) | digit(&rest, (low << shift) & 0xFFFFU, d << shift);
}

int64_t integer_divide(int64_t numerator, int64_t denominator) {
    TERRAPIN_ASSERT(denominator > 0);
    TERRAPIN_ASSERT((numerator < INT64_C(0x4000000000000000)) && (numerator > -INT64_C(0x4000000000000000)));
    uint64_t n = (numerator < 0) ? (uint64_t)-numerator : (uint64_t)numerator;
    uint64_t d = (uint64_t)denominator;
    while (d > (uint64_t)INTEGER_MOST) {
        n >>= 1U;
        d >>= 1U;
    }
    n += d / 2U;
    const uint32_t divisor = (uint32_t)d;
    const uint32_t high = (uint32_t)(n >> 32U) / divisor;
    const uint32_t rest = (uint32_t)(n >> 32U) - (high * divisor);
    const uint64_t magnitude64 = ((uint64_t)high << 32U) | quotient(rest, (uint32_t)n, divisor);
    const int64_t size = (int64_t)magnitude64;
    return (numerator < 0) ? -size : size;
}

static uint32_t magnitude(int32_t value) {
    return (value < 0) ? (0U - (uint32_t)value) : (uint32_t)value;
}

int32_t integer_scale(int32_t value, int32_t factor, int32_t divisor) {
    TERRAPIN_ASSERT(divisor > 0);
    const uint32_t d = (uint32_t)divisor;
    const uint32_t whole = magnitude(value);
    const uint32_t times = magnitude(factor);
    const uint32_t half = d / 2U;
    const uint64_t n = ((uint64_t)whole * times) + half; /* at most 2^62 + 2^30 */
    const uint32_t high = (uint32_t)(n >> 32U);
    uint32_t size = (uint32_t)INTEGER_MOST;
    if (high == 0U) { /* mostly; 32-bit division is an instruction */
        const uint32_t ratio = (uint32_t)n / d;
        size = (ratio < size) ? ratio : size;
    } else if ((n >> 30U) >= d) {
        /* held */
    } else if (((uint64_t)times * d) < 0x80000000U) { /* what is left of value / divisor takes the factor in 32 bits */
        const uint32_t ones = whole / d;
        size = (ones * times) + ((((whole - (ones * d)) * times) + (d / 2U)) / d);
    } else {
        size = quotient(high, (uint32_t)n, d); /* high is below a quarter of d */
    }
    TERRAPIN_ASSERT(size <= (uint32_t)INTEGER_MOST);
    return ((value < 0) != (factor < 0)) ? -(int32_t)size : (int32_t)size;
}

/* n / d downwards, held below 2^31. */
static uint32_t held_ratio(uint64_t n, uint32_t d) {
    const uint32_t high = (uint32_t)(n >> 32U);
    uint32_t ratio = (uint32_t)INT32_MAX;
    if (high < d) {
        const uint32_t found = quotient(high, (uint32_t)n, d);
        ratio = (found < ratio) ? found : ratio;
    }
    return ratio;
}

int32_t integer_factor(int64_t value, uint32_t bits, int32_t divisor) {
    TERRAPIN_ASSERT((value >= 0) && (bits < 62U) && (value < integer_power(62U - bits)));
    TERRAPIN_ASSERT(divisor > 0);
    const uint32_t d = (uint32_t)divisor;
    const uint64_t scaled = (uint64_t)value << bits;
    return (int32_t)held_ratio(scaled + d - 1U, d);
}

int32_t integer_signed_factor(int64_t value, uint32_t bits, int32_t divisor) {
    return (value < 0) ? -integer_factor(-value, bits, divisor) : integer_factor(value, bits, divisor);
}

integer_gain integer_gain_of(int32_t value, int32_t divisor) {
    const int32_t factor = integer_factor(value, 12U, divisor);
    const uint32_t above = (uint32_t)factor + ((factor < INT32_MAX) ? 1U : 0U); /* rounding adds less than one */
    const uint32_t half = above / 2U;
    const uint32_t most = held_ratio(((uint64_t)INTEGER_MOST * 4096U) + half, above) - 1U;
    const integer_gain gain = {
        .factor = factor,
        .most = (most < (uint32_t)INTEGER_MOST) ? (int32_t)most : INTEGER_MOST,
    };
    return gain;
}

integer_wide integer_wide_of(int32_t value, int32_t divisor) {
    TERRAPIN_ASSERT((value >= 0) && (value < INT32_MAX) && (divisor > 0));
    const int32_t whole = value / divisor;
    const integer_wide wide = {
        .whole = whole,
        .part_q31 = integer_factor((int64_t)value - ((int64_t)whole * divisor), 31U, divisor),
        .most = INTEGER_MOST / (whole + 1), /* the part is less than one, or one where it is held */
    };
    return wide;
}

/* Floor of the root of a number with one of its two top bits set. Newton's steps from a straight line that is within
 * 4.2 % are within 9e-4 and 4e-7, and never below. */
static uint32_t short_root(uint32_t value) {
    TERRAPIN_ASSERT(value >= 0x40000000U);
    const uint32_t line = 23211U + (((value >> 16U) * 43691U) >> 16U);
    const uint32_t once = (line + (value / line)) / 2U;
    const uint32_t root = (once + (value / once)) / 2U;
    return root - ((((root * root) - 1U) >= value) ? 1U : 0U); /* root may be 2^16, its square 2^32 */
}

uint32_t integer_root(uint64_t value) {
    const uint32_t high = (uint32_t)(value >> 32U);
    uint32_t root = 0U;
    if (high != 0U) { /* Karatsuba square root (Zimmermann 1999): sixteen bits, then sixteen more from one division */
        const uint32_t shift = leading_zeros(high) & 0x1EU;
        const uint64_t v = value << shift;
        const uint32_t first = short_root((uint32_t)(v >> 32U));
        const uint32_t rest = (uint32_t)(v >> 32U) - (first * first); /* at most 2 first */
        const uint32_t next = ((rest << 15U) | ((uint32_t)v >> 17U)) / first;
        root = (first << 16U) + ((next > 0xFFFFU) ? 0xFFFFU : next); /* or one more than the root */
        root -= (((uint64_t)root * root) > v) ? 1U : 0U;
        root >>= shift / 2U;
    } else if (value != 0U) {
        const uint32_t shift = leading_zeros((uint32_t)value) & 0x1EU;
        root = short_root((uint32_t)value << shift) >> (shift / 2U);
    } else {
        /* of nothing */
    }
    TERRAPIN_ASSERT(((uint64_t)root * root) <= value);
    TERRAPIN_ASSERT((root == UINT32_MAX) || (((uint64_t)root + 1U) * ((uint64_t)root + 1U)) > value);
    return root;
}

int32_t integer_sine(uint32_t turn) {
    /* sin(pi/2 z), |z| <= 1 in Q15, is z (1.570320 - 0.642113 z^2 + 0.071860 z^4) to 6.8e-5: minimax of this form.
     * Each product stays below 51456 * 32768, below 2^31. */
    const uint32_t folded = ((turn + 0x40000000U) < 0x80000000U) ? turn : (0x80000000U - turn);
    const int32_t z = integer_right(integer_difference(folded, 0U), 15U); /* -32768..32768 */
    const int32_t square = integer_right(z * z, 15U);
    TERRAPIN_ASSERT((square >= 0) && (square <= 32768));
    const int32_t inner = integer_right(2355 * square, 15U) - 21041;
    const int32_t gain = integer_right(inner * square, 15U) + 51456;
    return integer_clamp(integer_right(gain * z, 15U), -32767, 32767);
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
    TERRAPIN_ASSERT(x_q16 >= 0);
    /* exp(-x) = 2^-(k + f), x log2(e) = k + f; 2^-f by a cubic (Chebyshev), error 1.02e-4 over 0 <= f < 1.
     * f in Q15: each product stays below 45290 * 32768, below 2^31. */
    const int32_t y = integer_q_held(x_q16, 94548, 16U);
    const uint32_t whole = (uint32_t)y / 65536U;
    const int32_t f = (y % 65536) / 2;
    const int32_t cubic = 15112 - ((2589 * f) / 32768);
    const int32_t square = ((cubic * f) / 32768) - 45290;
    const int32_t power = ((square * f) / 32768) + 65529;
    TERRAPIN_ASSERT((power > 0) && (power <= 65536));
    const uint32_t shifted = (whole < 31U) ? ((uint32_t)power >> whole) : 0U;
    return (int32_t)shifted;
}
