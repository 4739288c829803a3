#include "random.h"

#include <math.h>

#define GOLDEN 0x9E3779B97F4A7C15ULL
#define TWO_PI 6.28318530717958647692

static uint64_t mix(uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
}

hil_random hil_random_split(uint64_t seed, uint64_t stream) {
    /* Mixed twice, so that neighbouring seeds and streams share no stretch of the sequence. */
    const hil_random random = {mix(mix(seed + GOLDEN) + GOLDEN * (stream + 1)), 0, 0.0, false};
    return random;
}

double hil_random_uniform(hil_random *random) {
    random->index++;
    const uint64_t bits = mix(random->key + random->index * GOLDEN);
    return ((double)(bits >> 11) + 0.5) * (1.0 / 9007199254740992.0);
}

double hil_random_normal(hil_random *random) {
    if (random->has_spare) {
        random->has_spare = false;
        return random->spare;
    }
    const double size = sqrt(-2.0 * log(hil_random_uniform(random)));
    const double angle = TWO_PI * hil_random_uniform(random);
    random->spare = size * sin(angle);
    random->has_spare = true;
    return size * cos(angle);
}
