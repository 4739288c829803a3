#include "random.h"

#include <math.h>

#define GOLDEN 0x9E3779B97F4A7C15ULL

/* Ziggurat of LAYERS layers of area AREA under exp(-x^2/2), the last one with a tail beyond TAIL (Doornik 2005). */
enum { LAYERS = 128 };
#define TAIL 3.442619855899
#define AREA 9.91256303526217e-3

static double edge[LAYERS + 1];
static double inner[LAYERS]; /* share of a layer that lies wholly under the curve */

static uint64_t mix(uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
}

hil_random hil_random_split(uint64_t seed, uint64_t stream) {
    /* Mixed twice, so that neighbouring seeds and streams share no stretch of the sequence. */
    const hil_random random = {mix(mix(seed + GOLDEN) + GOLDEN * (stream + 1)), 0};
    return random;
}

/* When the library is loaded, before anything can draw from it. */
__attribute__((constructor)) static void build_ziggurat(void) {
    double height = exp(-0.5 * TAIL * TAIL);
    edge[0] = AREA / height;
    edge[1] = TAIL;
    edge[LAYERS] = 0.0;
    for (int i = 2; i < LAYERS; i++) {
        edge[i] = sqrt(-2.0 * log(AREA / edge[i - 1] + height));
        height = exp(-0.5 * edge[i] * edge[i]);
    }
    for (int i = 0; i < LAYERS; i++) {
        inner[i] = edge[i + 1] / edge[i];
    }
}

static uint64_t draw(hil_random *random) {
    random->index++;
    return mix(random->key + random->index * GOLDEN);
}

/* Upper 53 bits as a number in (0, 1). */
static double fraction(uint64_t bits) {
    return ((double)(int64_t)(bits >> 11) + 0.5) * (1.0 / 9007199254740992.0);
}

double hil_random_uniform(hil_random *random) {
    return fraction(draw(random));
}

static double beyond_tail(hil_random *random) {
    double x;
    double y;
    do {
        x = -log(hil_random_uniform(random)) / TAIL;
        y = -log(hil_random_uniform(random));
    } while (y + y < x * x);
    return TAIL + x;
}

double hil_random_normal(hil_random *random) {
    for (;;) { /* 98.8 % return in the first line of the first turn */
        const uint64_t bits = draw(random);
        const int layer = (int)(bits & (LAYERS - 1));
        const double u = 2.0 * fraction(bits) - 1.0;
        if (fabs(u) < inner[layer]) {
            return u * edge[layer];
        }
        if (layer == 0) {
            return copysign(beyond_tail(random), u);
        }
        const double x = u * edge[layer];
        const double upper = exp(-0.5 * (edge[layer] * edge[layer] - x * x));
        const double lower = exp(-0.5 * (edge[layer + 1] * edge[layer + 1] - x * x));
        if (lower + hil_random_uniform(random) * (upper - lower) < 1.0) {
            return x;
        }
    }
}
