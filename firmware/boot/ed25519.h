/* Verification of Ed25519 signatures (RFC 8032, 5.1.7, without the cofactor).
 *
 * Stricter than the RFC in one point: a public key of small order (8 A = 0), under which a signature may hold for any
 * message, is refused. Refused like in the RFC: S not below the group's order, points that are not on the curve or not
 * encoded canonically. About 5,000 multiplications of the field, whatever the message; stack below 1.5 kB.
 */
#ifndef TERRAPIN_ED25519_H
#define TERRAPIN_ED25519_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_ED25519_KEY_SIZE       32U
#define TERRAPIN_ED25519_SIGNATURE_SIZE 64U

bool terrapin_ed25519_verify(const uint8_t key[32], const uint8_t signature[64], const uint8_t *message,
                             uint32_t length);

#ifdef __cplusplus
}
#endif
#endif
