/* The link key beside the boot loader (link/seal.h), and the chip's generator of random numbers.
 *
 * The last 64 bytes of sector 0: "LKEY", the key's generation, four words of key, their CRC-32. Written by a debug
 * probe with the boot loader, and by nothing else.
 */
#ifndef TERRAPIN_LINK_KEY_H
#define TERRAPIN_LINK_KEY_H

#include <stdbool.h>
#include <stdint.h>

#define LINK_KEY_WORDS 7U /* from its mark to its CRC */
#define LINK_KEY_MARK  0x59454B4CU

/* The key in those words, NULL when they are erased. A damaged one is a key that nobody has, of generation 0: what was
 * sealed once does not come open by itself. */
const uint32_t *link_key(const uint32_t words[LINK_KEY_WORDS], uint32_t *generation);

/* A random word of the chip; false when its generator does not run (it needs the PLL). */
bool random_word(uint32_t *word);

#endif
