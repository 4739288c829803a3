/* memcpy and memset of the boot loader, byte by byte: the library's are quicker and take 400 bytes more, of 16 kB. */
#include <stddef.h>

void *memcpy(void *restrict to, const void *restrict from, size_t size);
void *memset(void *to, int value, size_t size);

void *memcpy(void *restrict to, const void *restrict from, size_t size) {
    unsigned char *out = to;
    const unsigned char *in = from;
    while (size > 0U) {
        size--;
        out[size] = in[size];
    }
    return to;
}

void *memset(void *to, int value, size_t size) {
    unsigned char *out = to;
    while (size > 0U) {
        size--;
        out[size] = (unsigned char)value;
    }
    return to;
}
