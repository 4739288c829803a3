#include "sha2.h"

#include "terrapin_assert.h"

/* First 64 bits of the fractions of the cube roots of the first 80 primes. */
static const uint64_t constants[80] = {
    0x428A2F98D728AE22U, 0x7137449123EF65CDU, 0xB5C0FBCFEC4D3B2FU, 0xE9B5DBA58189DBBCU, 0x3956C25BF348B538U,
    0x59F111F1B605D019U, 0x923F82A4AF194F9BU, 0xAB1C5ED5DA6D8118U, 0xD807AA98A3030242U, 0x12835B0145706FBEU,
    0x243185BE4EE4B28CU, 0x550C7DC3D5FFB4E2U, 0x72BE5D74F27B896FU, 0x80DEB1FE3B1696B1U, 0x9BDC06A725C71235U,
    0xC19BF174CF692694U, 0xE49B69C19EF14AD2U, 0xEFBE4786384F25E3U, 0x0FC19DC68B8CD5B5U, 0x240CA1CC77AC9C65U,
    0x2DE92C6F592B0275U, 0x4A7484AA6EA6E483U, 0x5CB0A9DCBD41FBD4U, 0x76F988DA831153B5U, 0x983E5152EE66DFABU,
    0xA831C66D2DB43210U, 0xB00327C898FB213FU, 0xBF597FC7BEEF0EE4U, 0xC6E00BF33DA88FC2U, 0xD5A79147930AA725U,
    0x06CA6351E003826FU, 0x142929670A0E6E70U, 0x27B70A8546D22FFCU, 0x2E1B21385C26C926U, 0x4D2C6DFC5AC42AEDU,
    0x53380D139D95B3DFU, 0x650A73548BAF63DEU, 0x766A0ABB3C77B2A8U, 0x81C2C92E47EDAEE6U, 0x92722C851482353BU,
    0xA2BFE8A14CF10364U, 0xA81A664BBC423001U, 0xC24B8B70D0F89791U, 0xC76C51A30654BE30U, 0xD192E819D6EF5218U,
    0xD69906245565A910U, 0xF40E35855771202AU, 0x106AA07032BBD1B8U, 0x19A4C116B8D2D0C8U, 0x1E376C085141AB53U,
    0x2748774CDF8EEB99U, 0x34B0BCB5E19B48A8U, 0x391C0CB3C5C95A63U, 0x4ED8AA4AE3418ACBU, 0x5B9CCA4F7763E373U,
    0x682E6FF3D6B2B8A3U, 0x748F82EE5DEFB2FCU, 0x78A5636F43172F60U, 0x84C87814A1F0AB72U, 0x8CC702081A6439ECU,
    0x90BEFFFA23631E28U, 0xA4506CEBDE82BDE9U, 0xBEF9A3F7B2C67915U, 0xC67178F2E372532BU, 0xCA273ECEEA26619CU,
    0xD186B8C721C0C207U, 0xEADA7DD6CDE0EB1EU, 0xF57D4F7FEE6ED178U, 0x06F067AA72176FBAU, 0x0A637DC5A2C898A6U,
    0x113F9804BEF90DAEU, 0x1B710B35131C471BU, 0x28DB77F523047D84U, 0x32CAAB7B40C72493U, 0x3C9EBE0A15C9BEBCU,
    0x431D67C49C100D4CU, 0x4CC5D4BECB3E42B6U, 0x597F299CFC657E2AU, 0x5FCB6FAB3AD6FAECU, 0x6C44198C4A475817U};

static uint32_t rotate32(uint32_t x, uint32_t n) {
    TERRAPIN_ASSERT((n > 0U) && (n < 32U));
    return (x >> n) | (x << (32U - n));
}

static uint64_t rotate64(uint64_t x, uint32_t n) {
    TERRAPIN_ASSERT((n > 0U) && (n < 64U));
    const uint32_t left = 64U - n;
    return (x >> n) | (x << left);
}

/* The schedule is kept as a ring of the last 16 words. FIPS 180-4, 6.2.2. */
static void block256(terrapin_sha2 *hash) {
    uint32_t w[16];
    uint32_t s[8];
    for (size_t i = 0U; i < 16U; i++) {
        const uint8_t *b = &hash->block[4U * i];
        w[i] = ((uint32_t)b[0] << 24U) | ((uint32_t)b[1] << 16U) | ((uint32_t)b[2] << 8U) | b[3];
    }
    for (uint32_t i = 0U; i < 8U; i++) {
        s[i] = (uint32_t)(hash->state[i] & 0xFFFFFFFFU);
    }
    for (uint32_t t = 0U; t < 64U; t++) {
        const uint32_t e = s[4];
        const uint32_t a = s[0];
        const uint32_t big1 = rotate32(e, 6U) ^ rotate32(e, 11U) ^ rotate32(e, 25U);
        const uint32_t big0 = rotate32(a, 2U) ^ rotate32(a, 13U) ^ rotate32(a, 22U);
        const uint32_t one = s[7] + big1 + ((e & s[5]) ^ (~e & s[6])) + (uint32_t)(constants[t] >> 32U) + w[t & 15U];
        const uint32_t two = big0 + ((a & s[1]) ^ (a & s[2]) ^ (s[1] & s[2]));
        for (uint32_t i = 7U; i > 0U; i--) {
            s[i] = s[i - 1U];
        }
        s[4] += one;
        s[0] = one + two;
        const uint32_t x = w[(t + 1U) & 15U];
        const uint32_t y = w[(t + 14U) & 15U];
        w[t & 15U] += (rotate32(x, 7U) ^ rotate32(x, 18U) ^ (x >> 3U)) + w[(t + 9U) & 15U] +
                      (rotate32(y, 17U) ^ rotate32(y, 19U) ^ (y >> 10U));
    }
    for (uint32_t i = 0U; i < 8U; i++) {
        hash->state[i] += s[i];
    }
}

/* FIPS 180-4, 6.4.2. */
static void block512(terrapin_sha2 *hash) {
    uint64_t w[16];
    uint64_t s[8];
    for (uint32_t i = 0U; i < 16U; i++) {
        w[i] = 0U;
        for (uint32_t k = 0U; k < 8U; k++) {
            w[i] = (w[i] << 8U) | hash->block[(8U * i) + k];
        }
    }
    for (uint32_t i = 0U; i < 8U; i++) {
        s[i] = hash->state[i];
    }
    for (uint32_t t = 0U; t < 80U; t++) {
        const uint64_t e = s[4];
        const uint64_t a = s[0];
        const uint64_t big1 = rotate64(e, 14U) ^ rotate64(e, 18U) ^ rotate64(e, 41U);
        const uint64_t big0 = rotate64(a, 28U) ^ rotate64(a, 34U) ^ rotate64(a, 39U);
        const uint64_t one = s[7] + big1 + ((e & s[5]) ^ (~e & s[6])) + constants[t] + w[t & 15U];
        const uint64_t two = big0 + ((a & s[1]) ^ (a & s[2]) ^ (s[1] & s[2]));
        for (uint32_t i = 7U; i > 0U; i--) {
            s[i] = s[i - 1U];
        }
        s[4] += one;
        s[0] = one + two;
        const uint64_t x = w[(t + 1U) & 15U];
        const uint64_t y = w[(t + 14U) & 15U];
        w[t & 15U] += (rotate64(x, 1U) ^ rotate64(x, 8U) ^ (x >> 7U)) + w[(t + 9U) & 15U] +
                      (rotate64(y, 19U) ^ rotate64(y, 61U) ^ (y >> 6U));
    }
    for (uint32_t i = 0U; i < 8U; i++) {
        hash->state[i] += s[i];
    }
}

static uint32_t block_size(const terrapin_sha2 *hash) {
    return (hash->kind == TERRAPIN_SHA512) ? 128U : 64U;
}

/* Put a byte at `place` of the block; a full block is worked in. */
static void put(terrapin_sha2 *hash, uint32_t place, uint8_t byte) {
    TERRAPIN_ASSERT(place < block_size(hash));
    hash->block[place] = byte;
    if (place == (block_size(hash) - 1U)) {
        if (hash->kind == TERRAPIN_SHA512) {
            block512(hash);
        } else {
            block256(hash);
        }
    }
}

void terrapin_sha2_begin(terrapin_sha2 *hash, terrapin_sha2_kind kind) {
    /* First 64 bits of the fractions of the square roots of the first 8 primes. */
    static const uint64_t start[8] = {0x6A09E667F3BCC908U, 0xBB67AE8584CAA73BU, 0x3C6EF372FE94F82BU,
                                      0xA54FF53A5F1D36F1U, 0x510E527FADE682D1U, 0x9B05688C2B3E6C1FU,
                                      0x1F83D9ABFB41BD6BU, 0x5BE0CD19137E2179U};
    hash->kind = kind;
    hash->length = 0U;
    for (uint32_t i = 0U; i < 8U; i++) {
        hash->state[i] = (kind == TERRAPIN_SHA512) ? start[i] : (start[i] >> 32U);
    }
}

void terrapin_sha2_take(terrapin_sha2 *hash, const uint8_t *bytes, uint32_t length) {
    TERRAPIN_ASSERT(length <= (0x20000000U - hash->length));
    for (uint32_t i = 0U; i < length; i++) {
        put(hash, hash->length & (block_size(hash) - 1U), bytes[i]);
        hash->length++;
    }
}

void terrapin_sha2_end(terrapin_sha2 *hash, uint8_t *digest) {
    const uint32_t size = block_size(hash);
    const uint32_t length = hash->length;
    /* A one bit, zeros, the number of bits in the last 8 (of 16) bytes of a block. */
    const uint32_t used = length & (size - 1U);
    const uint32_t end = (used < (size - (size / 8U))) ? size : (2U * size);
    TERRAPIN_ASSERT((end - used) > (size / 8U));
    const uint64_t bits = (uint64_t)length * 8U;
    for (uint32_t i = used; i < end; i++) {
        const uint32_t shift = (end - 1U - i) * 8U;
        uint8_t byte = (shift < 64U) ? (uint8_t)((bits >> (shift & 63U)) & 0xFFU) : 0U;
        if (i == used) {
            byte = 0x80U;
        }
        put(hash, i & (size - 1U), byte);
    }
    for (uint32_t i = 0U; i < 8U; i++) {
        if (hash->kind == TERRAPIN_SHA512) {
            for (uint32_t k = 0U; k < 8U; k++) {
                digest[(8U * i) + k] = (uint8_t)((hash->state[i] >> (56U - (8U * k))) & 0xFFU);
            }
        } else {
            for (uint32_t k = 0U; k < 4U; k++) {
                digest[(4U * i) + k] = (uint8_t)((hash->state[i] >> (24U - (8U * k))) & 0xFFU);
            }
        }
    }
}
