/* Arithmetic modulo p = 2^255 - 19, as the curve of Ed25519 needs it.
 *
 * An element is eight 32-bit limbs, the least first: any number below 2^256 that is congruent to it. Results may stand
 * where arguments stood. All of it works on public data: time depends on the values.
 */
#ifndef TERRAPIN_FIELD_H
#define TERRAPIN_FIELD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    uint32_t limb[8];
} field;

void field_add(field *sum, const field *a, const field *b);
void field_subtract(field *difference, const field *a, const field *b);
void field_multiply(field *product, const field *a, const field *b);
/* 1/a, and 0 for 0. */
void field_invert(field *inverse, const field *a);
/* a^((p - 5) / 8): what a square root is made of. */
void field_root_power(field *result, const field *a);
bool field_equal(const field *a, const field *b);

/* 32 bytes, the least first. The top bit is left out; false when the rest is not below p. */
bool field_decode(field *a, const uint8_t bytes[32]);
void field_encode(uint8_t bytes[32], const field *a);

#endif
