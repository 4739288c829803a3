/* memcpy and memset for the boot loader's sector, where the C library's quick ones take 470 bytes. What the compiler
 * makes of structures is copied with them, too. */
#include <stdint.h>
#include <string.h>

void *memcpy(void *restrict to, const void *restrict from, size_t count) {
    volatile uint8_t *target = (volatile uint8_t *)to; /* or the compiler makes a call of memcpy of this loop */
    const uint8_t *source = (const uint8_t *)from;
    for (size_t i = 0U; i < count; i++) {
        target[i] = source[i];
    }
    return to;
}

void *memset(void *to, int value, size_t count) {
    volatile uint8_t *target = (volatile uint8_t *)to;
    for (size_t i = 0U; i < count; i++) {
        target[i] = (uint8_t)value;
    }
    return to;
}
