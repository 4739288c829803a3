#include "sixteen.h"

#include <string.h>

/* Adding 1.5 * 2^52 leaves a double's nearest integer in the low bits of its pattern. */
#define SHIFT    6755399441055744.0
#define LOG2E    1.4426950408889634
#define LN2_HIGH 0.693147180369123816490 /* its last 20 bits are zero: times an exponent it is exact */
#define LN2_LOW  1.90821492927058770002e-10

HIL_WIDE void hil_exp16(const double *restrict x, double *restrict result) {
    for (int k = 0; k < HIL_SIXTEEN; k++) {
        const double shifted = x[k] * LOG2E + SHIFT;
        const double whole = shifted - SHIFT;
        const double r = (x[k] - whole * LN2_HIGH) - whole * LN2_LOW; /* |r| <= ln(2)/2 */
        double p = 1.0 / 479001600.0;
        p = p * r + 1.0 / 39916800.0;
        p = p * r + 1.0 / 3628800.0;
        p = p * r + 1.0 / 362880.0;
        p = p * r + 1.0 / 40320.0;
        p = p * r + 1.0 / 5040.0;
        p = p * r + 1.0 / 720.0;
        p = p * r + 1.0 / 120.0;
        p = p * r + 1.0 / 24.0;
        p = p * r + 1.0 / 6.0;
        p = p * r + 0.5;
        p = 1.0 + (r + r * r * p);
        uint64_t exponent, bits;
        memcpy(&exponent, &shifted, sizeof exponent);
        memcpy(&bits, &p, sizeof bits);
        bits += exponent << 52;
        memcpy(&result[k], &bits, sizeof bits);
    }
}

HIL_WIDE void hil_log16(const double *restrict x, double *restrict result) {
    const uint64_t middle = 0x3FE6A09E667F3BCDu; /* sqrt(1/2): the mantissa is brought into [0.707, 1.414) */
    const uint64_t magic = 0x4330000000000000u;  /* 2^52 */
    for (int k = 0; k < HIL_SIXTEEN; k++) {
        uint64_t bits, raised;
        memcpy(&bits, &x[k], sizeof bits);
        raised = (bits - middle + 0x3FF0000000000000u) >> 52; /* exponent + 1023 */
        const uint64_t pattern = raised | magic;
        double exponent;
        memcpy(&exponent, &pattern, sizeof exponent);
        exponent = exponent - (4503599627370496.0 + 1023.0);
        bits -= (raised - 1023u) << 52;
        double m;
        memcpy(&m, &bits, sizeof m);
        const double f = (m - 1.0) / (m + 1.0);
        const double g = f * f;
        double p = 2.0 / 21.0;
        p = p * g + 2.0 / 19.0;
        p = p * g + 2.0 / 17.0;
        p = p * g + 2.0 / 15.0;
        p = p * g + 2.0 / 13.0;
        p = p * g + 2.0 / 11.0;
        p = p * g + 2.0 / 9.0;
        p = p * g + 2.0 / 7.0;
        p = p * g + 2.0 / 5.0;
        p = p * g + 2.0 / 3.0;
        result[k] = exponent * LN2_HIGH + (2.0 * f + (f * g * p + exponent * LN2_LOW));
    }
}

HIL_WIDE void hil_sincos8(const double *restrict x, double *restrict sine, double *restrict cosine) {
    for (int k = 0; k < HIL_SIXTEEN / 2; k++) {
        const double g = x[k] * x[k];
        double s = -1.0 / 121645100408832000.0;
        s = s * g + 1.0 / 355687428096000.0;
        s = s * g - 1.0 / 1307674368000.0;
        s = s * g + 1.0 / 6227020800.0;
        s = s * g - 1.0 / 39916800.0;
        s = s * g + 1.0 / 362880.0;
        s = s * g - 1.0 / 5040.0;
        s = s * g + 1.0 / 120.0;
        s = s * g - 1.0 / 6.0;
        sine[k] = x[k] + x[k] * g * s;
        double c = 1.0 / 2432902008176640000.0;
        c = c * g - 1.0 / 6402373705728000.0;
        c = c * g + 1.0 / 20922789888000.0;
        c = c * g - 1.0 / 87178291200.0;
        c = c * g + 1.0 / 479001600.0;
        c = c * g - 1.0 / 3628800.0;
        c = c * g + 1.0 / 40320.0;
        c = c * g - 1.0 / 720.0;
        c = c * g + 1.0 / 24.0;
        cosine[k] = 1.0 - g * (0.5 - g * c);
    }
}

HIL_WIDE double hil_sum16(const double *x) {
    double part[8];
    for (int k = 0; k < 8; k++) {
        part[k] = x[k] + x[k + 8];
    }
    for (int k = 0; k < 4; k++) {
        part[k] += part[k + 4];
    }
    return (part[0] + part[2]) + (part[1] + part[3]);
}
