/* Bytes from one writer to one reader, of which one may be an interrupt. Bounded: what does not fit is refused and
 * counted, nothing is overwritten. */
#ifndef TERRAPIN_RING_H
#define TERRAPIN_RING_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    uint8_t *bytes;
    uint32_t size;          /* a power of two */
    volatile uint32_t head; /* bytes ever written; the writer's */
    volatile uint32_t tail; /* bytes ever read; the reader's */
    volatile uint32_t lost; /* bytes refused; wraps */
} ring;

void ring_init(ring *r, uint8_t *bytes, uint32_t size);
uint32_t ring_used(const ring *r);
uint32_t ring_free(const ring *r);
/* False, and counted, when there is no room. */
bool ring_put(ring *r, uint8_t byte);
/* All bytes or none of them, so that a line is never cut; false, and counted, when there is no room. */
bool ring_put_all(ring *r, const uint8_t *bytes, uint32_t length);
/* False when it is empty. */
bool ring_take(ring *r, uint8_t *byte);

#endif
