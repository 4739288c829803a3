/* SHA-256 and SHA-512 (FIPS 180-4), in portions.
 *
 *     terrapin_sha2 hash;
 *     terrapin_sha2_begin(&hash, TERRAPIN_SHA256);
 *     terrapin_sha2_take(&hash, bytes, length);        any number of times, 2^29 bytes in all at most
 *     terrapin_sha2_end(&hash, digest);                32 or 64 bytes
 *
 * Small rather than quick: the two share their constants, since SHA-256's are the upper halves of the first 64 of
 * SHA-512's.
 */
#ifndef TERRAPIN_SHA2_H
#define TERRAPIN_SHA2_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_SHA256_SIZE 32U
#define TERRAPIN_SHA512_SIZE 64U

typedef enum { TERRAPIN_SHA256 = 0, TERRAPIN_SHA512 = 1 } terrapin_sha2_kind;

typedef struct {
    uint64_t state[8]; /* SHA-256: the lower halves */
    uint8_t block[128];
    uint32_t length; /* bytes taken so far */
    terrapin_sha2_kind kind;
} terrapin_sha2;

void terrapin_sha2_begin(terrapin_sha2 *hash, terrapin_sha2_kind kind);
void terrapin_sha2_take(terrapin_sha2 *hash, const uint8_t *bytes, uint32_t length);
void terrapin_sha2_end(terrapin_sha2 *hash, uint8_t *digest);

#ifdef __cplusplus
}
#endif
#endif
