#include "field.h"

#include "terrapin_assert.h"

#define LIMBS   8U
#define FOLD    38U /* 2^256 = 38 modulo p */
#define TOP_BIT 0x80000000U

/* Add a small number that stands for limb 8, folded, as often as that itself carries: twice at most. */
static void fold(field *a, uint32_t carry) {
    uint64_t c = carry;
    for (uint32_t round = 0U; round < 2U; round++) {
        c *= FOLD;
        for (uint32_t i = 0U; i < LIMBS; i++) {
            c += a->limb[i];
            a->limb[i] = (uint32_t)(c & 0xFFFFFFFFU);
            c >>= 32U;
        }
    }
    TERRAPIN_ASSERT(c == 0U);
}

void field_add(field *sum, const field *a, const field *b) {
    uint64_t c = 0U;
    for (uint32_t i = 0U; i < LIMBS; i++) {
        c += (uint64_t)a->limb[i] + b->limb[i];
        sum->limb[i] = (uint32_t)(c & 0xFFFFFFFFU);
        c >>= 32U;
    }
    TERRAPIN_ASSERT(c <= 1U);
    fold(sum, (uint32_t)c);
}

/* a - b; the borrow, 0 or 1. */
static uint32_t subtract(field *difference, const field *a, const field *b) {
    uint32_t borrow = 0U;
    for (uint32_t i = 0U; i < LIMBS; i++) {
        const uint64_t d = (uint64_t)a->limb[i] - b->limb[i] - borrow;
        difference->limb[i] = (uint32_t)(d & 0xFFFFFFFFU);
        borrow = (uint32_t)(d >> 63U);
    }
    return borrow;
}

void field_subtract(field *difference, const field *a, const field *b) {
    static const field none = {0};
    static const field once = {{FOLD, 0U, 0U, 0U, 0U, 0U, 0U, 0U}};
    uint32_t borrow = subtract(difference, a, b);
    borrow = subtract(difference, difference, (borrow != 0U) ? &once : &none);
    (void)subtract(difference, difference, (borrow != 0U) ? &once : &none);
}

void field_multiply(field *product, const field *a, const field *b) {
    uint32_t wide[2U * LIMBS] = {0};
    for (uint32_t i = 0U; i < LIMBS; i++) {
        uint64_t c = 0U;
        for (uint32_t k = 0U; k < LIMBS; k++) {
            c += ((uint64_t)a->limb[i] * b->limb[k]) + wide[i + k]; /* at most 2^64 - 1 with the carry */
            wide[i + k] = (uint32_t)(c & 0xFFFFFFFFU);
            c >>= 32U;
        }
        wide[i + LIMBS] = (uint32_t)c;
    }
    uint64_t c = 0U;
    for (uint32_t i = 0U; i < LIMBS; i++) {
        c += ((uint64_t)wide[i + LIMBS] * FOLD) + wide[i];
        product->limb[i] = (uint32_t)(c & 0xFFFFFFFFU);
        c >>= 32U;
    }
    TERRAPIN_ASSERT(c <= FOLD);
    fold(product, (uint32_t)c);
}

/* a^(2^250 - 1), then `count` further bits of the exponent. */
static void power(field *result, const field *a, uint32_t bits, uint32_t count) {
    TERRAPIN_ASSERT((count <= 5U) && ((bits >> count) == 0U));
    field base;
    field x;
    base = *a; /* the result may stand where it stood */
    x = base;
    for (uint32_t i = 0U; i < 249U; i++) {
        field_multiply(&x, &x, &x);
        field_multiply(&x, &x, &base);
    }
    for (uint32_t i = count; i > 0U; i--) {
        field_multiply(&x, &x, &x);
        if (((bits >> (i - 1U)) & 1U) != 0U) {
            field_multiply(&x, &x, &base);
        }
    }
    *result = x;
}

void field_invert(field *inverse, const field *a) {
    power(inverse, a, 0x0BU, 5U); /* p - 2 = (2^250 - 1) 2^5 + 11 */
}

void field_root_power(field *result, const field *a) {
    power(result, a, 0x01U, 2U); /* (p - 5)/8 = (2^250 - 1) 2^2 + 1 */
}

/* The one representative below p. */
static void freeze(field *a) {
    static const field p = {
        {0xFFFFFFEDU, 0xFFFFFFFFU, 0xFFFFFFFFU, 0xFFFFFFFFU, 0xFFFFFFFFU, 0xFFFFFFFFU, 0xFFFFFFFFU, 0x7FFFFFFFU}};
    for (uint32_t round = 0U; round < 2U; round++) { /* 2^256 - 1 is below 3 p */
        field less;
        if (subtract(&less, a, &p) == 0U) {
            *a = less;
        }
    }
    TERRAPIN_ASSERT(a->limb[7] <= 0x7FFFFFFFU);
}

bool field_equal(const field *a, const field *b) {
    field difference;
    uint32_t bits = 0U;
    field_subtract(&difference, a, b);
    freeze(&difference);
    for (uint32_t i = 0U; i < LIMBS; i++) {
        bits |= difference.limb[i];
    }
    return bits == 0U;
}

bool field_decode(field *a, const uint8_t bytes[32]) {
    for (size_t i = 0U; i < LIMBS; i++) {
        const uint8_t *b = &bytes[4U * i];
        a->limb[i] = ((uint32_t)b[3] << 24U) | ((uint32_t)b[2] << 16U) | ((uint32_t)b[1] << 8U) | b[0];
    }
    a->limb[7] &= ~TOP_BIT;
    field below;
    bool same = true;
    below = *a;
    freeze(&below);
    for (uint32_t i = 0U; i < LIMBS; i++) {
        same = same && (below.limb[i] == a->limb[i]);
    }
    return same;
}

void field_encode(uint8_t bytes[32], const field *a) {
    field x;
    x = *a;
    freeze(&x);
    for (uint32_t i = 0U; i < 32U; i++) {
        bytes[i] = (uint8_t)((x.limb[i / 4U] >> (8U * (i % 4U))) & 0xFFU);
    }
}
