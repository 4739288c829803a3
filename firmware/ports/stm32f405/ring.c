#include "ring.h"

#include <stdatomic.h>

void ring_init(ring *r, uint8_t *bytes, uint32_t size) {
    r->bytes = bytes;
    r->size = size;
    r->head = 0U;
    r->tail = 0U;
    r->lost = 0U;
}

uint32_t ring_used(const ring *r) {
    return r->head - r->tail;
}

uint32_t ring_free(const ring *r) {
    return r->size - ring_used(r);
}

bool ring_put(ring *r, uint8_t byte) {
    return ring_put_all(r, &byte, 1U);
}

bool ring_put_all(ring *r, const uint8_t *bytes, uint32_t length) {
    if (length > ring_free(r)) {
        r->lost += length;
        return false;
    }
    const uint32_t head = r->head;
    for (uint32_t i = 0; i < length; i++) {
        r->bytes[(head + i) & (r->size - 1U)] = bytes[i];
    }
    atomic_signal_fence(memory_order_release); /* the compiler may move plain accesses over volatile ones */
    r->head = head + length;                   /* last: from here on the reader sees them */
    return true;
}

bool ring_take(ring *r, uint8_t *byte) {
    const uint32_t tail = r->tail;
    if (tail == r->head) {
        return false;
    }
    *byte = r->bytes[tail & (r->size - 1U)];
    atomic_signal_fence(memory_order_acq_rel);
    r->tail = tail + 1U;
    return true;
}
