#include "chaskey.h"

#include "terrapin_assert.h"

#define ROUNDS 12U

static uint32_t rotated(uint32_t value, uint32_t by) {
    TERRAPIN_ASSERT((by > 0U) && (by < 32U));
    return (value << by) | (value >> (32U - by));
}

void terrapin_chaskey(const uint32_t key[4], const uint32_t block[4], uint32_t tag[4]) {
    /* Twice the key, in the field of 2^128: what whole last blocks are masked with. */
    uint32_t mask[TERRAPIN_CHASKEY_WORDS];
    uint32_t carry = (key[3] >> 31U) * 0x87U;
    for (uint32_t i = 0U; i < TERRAPIN_CHASKEY_WORDS; i++) {
        mask[i] = (key[i] << 1U) ^ carry;
        carry = key[i] >> 31U;
        tag[i] = key[i] ^ block[i] ^ mask[i];
    }
    uint32_t a = tag[0];
    uint32_t b = tag[1];
    uint32_t c = tag[2];
    uint32_t d = tag[3];
    for (uint32_t i = 0U; i < ROUNDS; i++) {
        a += b;
        b = rotated(b, 5U) ^ a;
        a = rotated(a, 16U);
        c += d;
        d = rotated(d, 8U) ^ c;
        a += d;
        d = rotated(d, 13U) ^ a;
        c += b;
        b = rotated(b, 7U) ^ c;
        c = rotated(c, 16U);
    }
    tag[0] = a ^ mask[0];
    tag[1] = b ^ mask[1];
    tag[2] = c ^ mask[2];
    tag[3] = d ^ mask[3];
}
