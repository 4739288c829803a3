#include "semihosting.h"

#define SYS_OPEN          0x01U
#define SYS_WRITE         0x05U
#define SYS_READ          0x06U
#define SYS_GET_CMDLINE   0x15U
#define SYS_EXIT_EXTENDED 0x20U
#define MODE_READ_BINARY  1U /* fopen's "rb" */
#define MODE_WRITE_BINARY 5U /* "wb" */
#define APPLICATION_EXIT  0x20026U

/* Operation in r0, address of its arguments in r1, result in r0. */
static int32_t call(uint32_t operation, const void *arguments) {
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return (int32_t)r0;
}

static uint32_t word(const void *pointer) {
    return (uint32_t)(uintptr_t)pointer;
}

int32_t semihosting_open(const char *path, int writing) {
    uint32_t length = 0;
    while (path[length] != '\0') {
        length++;
    }
    const uint32_t arguments[3] = {word(path), (writing != 0) ? MODE_WRITE_BINARY : MODE_READ_BINARY, length};
    return call(SYS_OPEN, arguments);
}

size_t semihosting_read(int32_t handle, uint8_t *bytes, size_t length) {
    const uint32_t arguments[3] = {(uint32_t)handle, word(bytes), (uint32_t)length};
    const int32_t unread = call(SYS_READ, arguments);
    return ((unread < 0) || ((uint32_t)unread > length)) ? 0U : (length - (uint32_t)unread);
}

int semihosting_write(int32_t handle, const uint8_t *bytes, size_t length) {
    const uint32_t arguments[3] = {(uint32_t)handle, word(bytes), (uint32_t)length};
    return (call(SYS_WRITE, arguments) == 0) ? 0 : -1;
}

int semihosting_command_line(char *text, size_t size) {
    uint32_t arguments[2] = {word(text), (uint32_t)size};
    return (call(SYS_GET_CMDLINE, arguments) == 0) ? 0 : -1;
}

_Noreturn void semihosting_exit(int status) {
    const uint32_t arguments[2] = {APPLICATION_EXIT, (uint32_t)status};
    (void)call(SYS_EXIT_EXTENDED, arguments);
    for (;;) {
    }
}
