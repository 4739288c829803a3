/* What the compiler calls to copy and clear structs: the library's are quick and take 470 bytes, which the boot loader's
 * 16 kB do not have. Compiled so that these loops are not taken for calls of themselves (boot_stm32f405.cmake). */
#include <stddef.h>

void *memcpy(void *restrict to, const void *restrict from, size_t size);
void *memset(void *to, int value, size_t size);

void *memcpy(void *restrict to, const void *restrict from, size_t size) {
    unsigned char *bytes = to;
    const unsigned char *source = from;
    for (size_t i = 0U; i < size; i++) {
        bytes[i] = source[i];
    }
    return to;
}

void *memset(void *to, int value, size_t size) {
    unsigned char *bytes = to;
    for (size_t i = 0U; i < size; i++) {
        bytes[i] = (unsigned char)value;
    }
    return to;
}
