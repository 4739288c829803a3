/* An encoder's 16-bit count, divided: one with more counts than the controller's formats hold gives it every n-th. */
#ifndef TERRAPIN_ENCODER_COUNT_H
#define TERRAPIN_ENCODER_COUNT_H

#include <stdint.h>

typedef struct {
    uint16_t last;  /* the encoder's own count, as last read; wraps */
    uint16_t count; /* the divided one; wraps */
    int32_t rest;   /* own counts since then, 0 to divider - 1 */
} encoder_count;

/* The divided count, rounded down. Between two calls the encoder turns by less than 2^15 counts. `divider`: 1 or more.
 */
static inline uint16_t encoder_divided(encoder_count *encoder, uint16_t own, int32_t divider) {
    const uint16_t step = (uint16_t)(own - encoder->last);
    const int32_t sum = encoder->rest + ((step < 0x8000U) ? (int32_t)step : ((int32_t)step - 0x10000));
    const int32_t least = (sum < 0) ? (sum - (divider - 1)) : sum;
    const int32_t whole = least / divider;
    encoder->last = own;
    encoder->rest = sum - (whole * divider);
    encoder->count = (uint16_t)(encoder->count + (uint32_t)whole);
    return encoder->count;
}

#endif
