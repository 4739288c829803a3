/* Chaskey-12, a message authentication code for 32-bit machines (Mouha et al., SAC 2014; ISO/IEC 29192-6): 128-bit key,
 * here for messages of exactly one block of 16 bytes. Words are little-endian.
 */
#ifndef TERRAPIN_CHASKEY_H
#define TERRAPIN_CHASKEY_H

#include "terrapin.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_CHASKEY_WORDS 4U

/* The whole tag of one block, 128 bits. tag may be block or key. */
TERRAPIN_API void terrapin_chaskey(const uint32_t key[4], const uint32_t block[4], uint32_t tag[4]);

#ifdef __cplusplus
}
#endif
#endif
