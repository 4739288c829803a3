#include "chaskey.h"

#include "terrapin_assert.h"

#define ROUNDS 12U

static uint32_t rotated(uint32_t value, uint32_t by) {
    TERRAPIN_ASSERT((by > 0U) && (by < 32U));
    return (value << by) | (value >> (32U - by));
}

void terrapin_chaskey(const uint32_t key[4], const uint32_t block[4], uint32_t tag[4]) {
    /* Twice the key, in the field of 2^128: what whole last blocks are masked with. */
    const uint32_t mask[4] = {
        (key[0] << 1U) ^ (((key[3] >> 31U) != 0U) ? 0x87U : 0U),
        (key[1] << 1U) | (key[0] >> 31U),
        (key[2] << 1U) | (key[1] >> 31U),
        (key[3] << 1U) | (key[2] >> 31U),
    };
    uint32_t a = key[0] ^ block[0] ^ mask[0];
    uint32_t b = key[1] ^ block[1] ^ mask[1];
    uint32_t c = key[2] ^ block[2] ^ mask[2];
    uint32_t d = key[3] ^ block[3] ^ mask[3];
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
