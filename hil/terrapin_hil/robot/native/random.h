/* Random numbers that are a function of (seed, stream, index): the same seed gives the same bits on every run.
 *
 * Counter based: the SplitMix64 finaliser (Steele, Lea, Flood 2014) of key + index * golden ratio. Each sensor owns a
 * stream, so switching one off leaves the noise of the others as it was.
 */
#ifndef HIL_RANDOM_H
#define HIL_RANDOM_H

#include <stdint.h>

typedef struct {
    uint64_t key;
    uint64_t index;
} hil_random;

/* Stream number `stream` of `seed`. */
hil_random hil_random_split(uint64_t seed, uint64_t stream);

/* Uniform in (0, 1). */
double hil_random_uniform(hil_random *random);

/* Standard normal, by a ziggurat. */
double hil_random_normal(hil_random *random);

#endif
