#include "ed25519.h"

#include "field.h"
#include "sha2.h"
#include "terrapin_assert.h"

/* A point (x, y) of -x^2 + y^2 = 1 + d x^2 y^2 as x = X/Z, y = Y/Z, x y = T/Z. */
typedef struct {
    field x;
    field y;
    field z;
    field t;
} point;

typedef struct {
    uint32_t limb[8];
} scalar;

static const field zero = {0};
static const field one = {{1U, 0U, 0U, 0U, 0U, 0U, 0U, 0U}};

/* Hisil et al. 2008, "add-2008-hwcd-3": complete on this curve, so it doubles too. */
static void point_add(point *sum, const point *p, const point *q) {
    static const field curve_2d = {
        {0x26B2F159U, 0xEBD69B94U, 0x8283B156U, 0x00E0149AU, 0xEEF3D130U, 0x198E80F2U, 0x56DFFCE7U, 0x2406D9DCU}};
    field a;
    field b;
    field c;
    field d;
    field e;
    field_subtract(&a, &p->y, &p->x);
    field_subtract(&b, &q->y, &q->x);
    field_multiply(&a, &a, &b); /* A */
    field_add(&b, &p->y, &p->x);
    field_add(&c, &q->y, &q->x);
    field_multiply(&b, &b, &c); /* B */
    field_multiply(&c, &p->t, &q->t);
    field_multiply(&c, &c, &curve_2d); /* C */
    field_multiply(&d, &p->z, &q->z);
    field_add(&d, &d, &d);      /* D */
    field_subtract(&e, &b, &a); /* E */
    field_add(&b, &b, &a);      /* H */
    field_subtract(&a, &d, &c); /* F */
    field_add(&c, &d, &c);      /* G */
    field_multiply(&sum->x, &e, &a);
    field_multiply(&sum->y, &c, &b);
    field_multiply(&sum->t, &e, &b);
    field_multiply(&sum->z, &a, &c);
}

/* RFC 8032, 5.1.3. False when the 32 bytes are no point. */
static bool point_decode(point *p, const uint8_t bytes[32]) {
    static const field curve_d = {
        {0x135978A3U, 0x75EB4DCAU, 0x4141D8ABU, 0x00700A4DU, 0x7779E898U, 0x8CC74079U, 0x2B6FFE73U, 0x52036CEEU}};
    static const field root_of_minus_1 = {
        {0x4A0EA0B0U, 0xC4EE1B27U, 0xAD2FE478U, 0x2F431806U, 0x3DFBD7A7U, 0x2B4D0099U, 0x4FC1DF0BU, 0x2B832480U}};
    const bool odd = (bytes[31] & 0x80U) != 0U;
    field u;
    field v;
    field w;
    if (!field_decode(&p->y, bytes)) {
        return false;
    }
    p->z = one;
    field_multiply(&w, &p->y, &p->y);
    field_subtract(&u, &w, &one); /* u = y^2 - 1 */
    field_multiply(&w, &w, &curve_d);
    field_add(&v, &w, &one); /* v = d y^2 + 1 */
    /* x = u v^3 (u v^7)^((p-5)/8) */
    field_multiply(&w, &v, &v);
    field_multiply(&w, &w, &v);
    field_multiply(&p->x, &u, &w); /* u v^3 */
    field_multiply(&w, &w, &v);
    field_multiply(&w, &w, &p->x); /* u^1 v^7 */
    field_root_power(&w, &w);
    field_multiply(&p->x, &p->x, &w);
    field_multiply(&w, &p->x, &p->x);
    field_multiply(&w, &w, &v); /* v x^2 is u, or -u, or there is no root */
    if (!field_equal(&w, &u)) {
        field_subtract(&u, &zero, &u);
        if (!field_equal(&w, &u)) {
            return false;
        }
        field_multiply(&p->x, &p->x, &root_of_minus_1);
    }
    uint8_t encoded[32];
    field_encode(encoded, &p->x);
    if (((encoded[0] & 1U) != 0U) != odd) {
        if (field_equal(&p->x, &zero)) {
            return false;
        }
        field_subtract(&p->x, &zero, &p->x);
    }
    field_multiply(&p->t, &p->x, &p->y);
    return true;
}

static void point_encode(uint8_t bytes[32], const point *p) {
    field inverse;
    field x;
    field y;
    uint8_t encoded[32];
    field_invert(&inverse, &p->z);
    field_multiply(&x, &p->x, &inverse);
    field_multiply(&y, &p->y, &inverse);
    field_encode(bytes, &y);
    field_encode(encoded, &x);
    bytes[31] |= (uint8_t)((encoded[0] & 1U) << 7U);
}

static bool small_order(const point *p) {
    point q;
    q = *p;
    for (uint32_t i = 0U; i < 3U; i++) {
        point_add(&q, &q, &q);
    }
    return field_equal(&q.x, &zero) && field_equal(&q.y, &q.z);
}

/* s - order when that is not negative; whether it was. */
static bool reduce(scalar *s) {
    static const scalar order = {
        {0x5CF5D3EDU, 0x5812631AU, 0xA2F79CD6U, 0x14DEF9DEU, 0x00000000U, 0x00000000U, 0x00000000U, 0x10000000U}};
    scalar less;
    uint32_t borrow = 0U;
    for (uint32_t i = 0U; i < 8U; i++) {
        const uint64_t d = (uint64_t)s->limb[i] - order.limb[i] - borrow;
        less.limb[i] = (uint32_t)(d & 0xFFFFFFFFU);
        borrow = (uint32_t)(d >> 63U);
    }
    if (borrow == 0U) {
        *s = less;
    }
    return borrow == 0U;
}

/* `size` bytes, the least first, modulo the group's order; a bit at a time, which is small. */
static void scalar_of(scalar *s, const uint8_t *bytes, uint32_t size) {
    static const scalar nothing = {0};
    *s = nothing;
    for (uint32_t bit = size * 8U; bit > 0U; bit--) {
        uint32_t carry = ((uint32_t)bytes[(bit - 1U) / 8U] >> ((bit - 1U) % 8U)) & 1U;
        for (uint32_t i = 0U; i < 8U; i++) {
            const uint32_t top = s->limb[i] >> 31U;
            s->limb[i] = (s->limb[i] << 1U) | carry;
            carry = top;
        }
        TERRAPIN_ASSERT(carry == 0U);
        (void)reduce(s); /* below the order before, so below twice the order now: 2^254 */
        TERRAPIN_ASSERT(s->limb[7] <= 0x10000000U);
    }
}

static uint32_t scalar_bit(const scalar *s, uint32_t bit) {
    TERRAPIN_ASSERT(bit < 256U);
    return (s->limb[bit / 32U] >> (bit % 32U)) & 1U;
}

/* a P + b Q, a bit of both at a time (Shamir's trick). */
static void double_multiply(point *sum, const scalar *a, const point *p, const scalar *b, const point *q) {
    point both;
    point r;
    r.x = zero;
    r.y = one;
    r.z = one;
    r.t = zero;
    point_add(&both, p, q);
    TERRAPIN_ASSERT(((a->limb[7] >> 29U) == 0U) && ((b->limb[7] >> 29U) == 0U));
    for (uint32_t bit = 253U; bit > 0U; bit--) { /* both are below 2^253 */
        const bool first = scalar_bit(a, bit - 1U) != 0U;
        const bool second = scalar_bit(b, bit - 1U) != 0U;
        point_add(&r, &r, &r);
        if (first || second) {
            point_add(&r, &r, first ? (second ? &both : p) : q);
        }
    }
    *sum = r;
}

/* The 32 bytes are below the group's order. */
static bool canonical(const uint8_t bytes[32]) {
    scalar s;
    for (size_t i = 0U; i < 8U; i++) {
        const uint8_t *b = &bytes[4U * i];
        s.limb[i] = ((uint32_t)b[3] << 24U) | ((uint32_t)b[2] << 16U) | ((uint32_t)b[1] << 8U) | b[0];
    }
    return !reduce(&s);
}

bool terrapin_ed25519_verify(const uint8_t key[32], const uint8_t signature[64], const uint8_t *message,
                             uint32_t length) {
    TERRAPIN_ASSERT((key != NULL) && (signature != NULL) && (message != NULL));
    static const field base_x = {
        {0x8F25D51AU, 0xC9562D60U, 0x9525A7B2U, 0x692CC760U, 0xFDD6DC5CU, 0xC0A4E231U, 0xCD6E53FEU, 0x216936D3U}};
    static const field base_y = {
        {0x66666658U, 0x66666666U, 0x66666666U, 0x66666666U, 0x66666666U, 0x66666666U, 0x66666666U, 0x66666666U}};
    static const field base_t = {
        {0xA5B7DDA3U, 0x6DDE8AB3U, 0x775152F5U, 0x20F09F80U, 0x64ABE37DU, 0x66EA4E8EU, 0xD78B7665U, 0x67875F0FU}};
    point public_key;
    if (!canonical(&signature[32]) || !point_decode(&public_key, key) || small_order(&public_key)) {
        return false;
    }
    uint8_t bytes[TERRAPIN_SHA512_SIZE];
    terrapin_sha2 hash;
    terrapin_sha2_begin(&hash, TERRAPIN_SHA512);
    terrapin_sha2_take(&hash, signature, 32U);
    terrapin_sha2_take(&hash, key, 32U);
    terrapin_sha2_take(&hash, message, length);
    terrapin_sha2_end(&hash, bytes);
    scalar challenge;
    scalar response;
    scalar_of(&challenge, bytes, 64U);
    scalar_of(&response, &signature[32], 32U);

    /* R = S B - k A */
    point base;
    base.x = base_x;
    base.y = base_y;
    base.z = one;
    base.t = base_t;
    field_subtract(&public_key.x, &zero, &public_key.x);
    field_subtract(&public_key.t, &zero, &public_key.t);
    point commitment;
    double_multiply(&commitment, &response, &base, &challenge, &public_key);
    point_encode(bytes, &commitment);
    bool same = true;
    for (uint32_t i = 0U; i < 32U; i++) {
        same = same && (bytes[i] == signature[i]);
    }
    return same;
}
