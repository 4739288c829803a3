/* terrapin-bootloader: the boot loader as a process that speaks SLCAN on a pseudo-terminal, over a flash in a file.
 *
 *     terrapin-bootloader [--unhealthy] [--motor-on] [--node N] FLASH [LINK]
 *
 * FLASH is the first 384 kB of the chip's flash (made, erased, when absent); LINK a name for the pseudo-terminal, whose
 * path is printed. Each reset says on standard error what was started. What was started behaves as the application
 * does: it serves updates and confirms itself, unless --unhealthy; --motor-on: it says that its motor is on; --node:
 * the node number is stored first. It serves any number of peers and ends on SIGTERM or SIGINT.
 */
#define _GNU_SOURCE /* posix_openpt, ptsname_r, cfmakeraw */

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "boot_key.h"
#include "flash_emulated.h"
#include "serial.h"

#define SECTORS 7U /* of the F405: up to slot B */

typedef struct {
    terrapin_flash_emulated memory;
    terrapin_flash flash;
    terrapin_boot boot;
    terrapin_boot_serial serial;
    bool healthy;
    bool motor_on; /* of the application; the boot loader has none */
} loader;

static volatile sig_atomic_t stopped;

static void on_signal(int number) {
    stopped = number;
}

static int fail(const char *what, const char *name) {
    (void)fprintf(stderr, "terrapin-bootloader: %s %s: %s\n", what, name, strerror(errno));
    return -1;
}

/* The file's bytes, shared with it; NULL when that cannot be (said why). */
static uint8_t *map(const char *path, size_t size) {
    const int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    struct stat info;
    if ((fd < 0) || (fstat(fd, &info) != 0)) {
        (void)fail("cannot open", path);
        return NULL;
    }
    const bool fresh = info.st_size == 0;
    if (!fresh && ((size_t)info.st_size != size)) {
        (void)fprintf(stderr, "terrapin-bootloader: %s: %ld bytes, expected %zu\n", path, (long)info.st_size, size);
        (void)close(fd);
        return NULL;
    }
    void *bytes = MAP_FAILED;
    if (!fresh || (ftruncate(fd, (off_t)size) == 0)) {
        bytes = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    }
    (void)close(fd);
    if (bytes == MAP_FAILED) {
        (void)fail("cannot map", path);
        return NULL;
    }
    if (fresh) {
        (void)memset(bytes, 0xFF, size);
    }
    return bytes;
}

/* A raw pty whose other end stays open here, so that peers may come and go. The master, or -1 (said why). */
static int open_pty(const char *link) {
    char path[128];
    struct termios settings;
    const int master = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    if ((master < 0) || (grantpt(master) != 0) || (unlockpt(master) != 0) ||
        (ptsname_r(master, path, sizeof path) != 0)) {
        return fail("cannot make", "a pseudo-terminal");
    }
    const int slave = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if ((slave < 0) || (tcgetattr(slave, &settings) != 0)) {
        return fail("cannot open", path);
    }
    cfmakeraw(&settings);
    if (tcsetattr(slave, TCSANOW, &settings) != 0) {
        return fail("cannot set", path);
    }
    if ((link != NULL) && (symlink(path, link) != 0)) {
        return fail("cannot link", link);
    }
    (void)printf("%s\n", (link != NULL) ? link : path);
    return (fflush(stdout) == 0) ? master : fail("cannot print", path);
}

static void start(loader *l, bool stay) {
    terrapin_boot_choice choice = {0};
    if (!stay) {
        terrapin_boot_choose(&l->boot, &choice);
    }
    if (choice.slot == 0U) {
        (void)fprintf(stderr, "terrapin-bootloader: stays\n");
    } else {
        const terrapin_image_version v = choice.image.version;
        const bool confirmed = l->healthy && terrapin_boot_confirm(&l->boot, choice.slot);
        (void)fprintf(stderr, "terrapin-bootloader: started slot %c, version %u.%u.%u+%lu, %s\n",
                      'A' + (choice.slot - 1), v.major, v.minor, v.revision, (unsigned long)v.build,
                      confirmed ? "confirmed" : "not confirmed");
    }
    terrapin_boot_serial_init(&l->serial, &l->boot, choice.slot);
}

static bool send_all(int fd, const uint8_t *bytes, size_t length) {
    size_t sent = 0;
    while ((sent < length) && (stopped == 0)) {
        const ssize_t n = write(fd, &bytes[sent], length - sent);
        if ((n < 0) && (errno != EINTR)) {
            return false;
        }
        sent += (n > 0) ? (size_t)n : 0U;
    }
    return true;
}

static uint32_t now_ms(void) {
    struct timespec now = {0};
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000U + (uint64_t)now.tv_nsec / 1000000U);
}

static int serve(loader *l, int fd) {
    uint8_t in[512];
    uint8_t answer[TERRAPIN_BOOT_SERIAL_ANSWER_MAX];
    while (stopped == 0) {
        const ssize_t n = read(fd, in, sizeof in);
        if ((n < 0) && (errno != EINTR)) {
            return fail("cannot read", "the pseudo-terminal");
        }
        l->serial.update.now_ms = now_ms();
        for (ssize_t i = 0; i < n; i++) {
            const bool motor_on = l->motor_on && (l->serial.update.running != 0U);
            const uint32_t length = terrapin_boot_serial_take(&l->serial, in[i], motor_on, answer);
            if (!send_all(fd, answer, length)) {
                return fail("cannot write", "the pseudo-terminal");
            }
            if (l->serial.update.reset) {
                start(l, l->serial.update.stay);
            }
        }
    }
    return 0;
}

static int usage(int status) {
    (void)fprintf((status == 0) ? stdout : stderr,
                  "usage: terrapin-bootloader [--unhealthy] [--motor-on] [--node N] FLASH [LINK]\n"
                  "The boot loader over a flash in the file FLASH, on a new pseudo-terminal whose path is printed.\n"
                  "--unhealthy: what it starts does not confirm itself; --motor-on: and says that its motor is on;\n"
                  "--node: store this number, 0 to 7, first.\n"
                  "Example: terrapin-bootloader /tmp/flash.bin /tmp/terrapin\n");
    return status;
}

int main(int argc, char **argv) {
    static loader l = {.healthy = true, .boot = {.keys = terrapin_boot_keys, .key_ids = TERRAPIN_BOOT_KEY_IDS}};
    const struct sigaction action = {.sa_handler = on_signal};
    int at = 1;
    int node = -1; /* as it is stored */
    for (; (at < argc) && (argv[at][0] == '-'); at++) {
        if (strcmp(argv[at], "--unhealthy") == 0) {
            l.healthy = false;
        } else if (strcmp(argv[at], "--motor-on") == 0) {
            l.motor_on = true;
        } else if ((strcmp(argv[at], "--node") == 0) && ((at + 1) < argc) && (strlen(argv[at + 1]) == 1U) &&
                   (argv[at + 1][0] >= '0') && (argv[at + 1][0] < (char)('0' + (int)TERRAPIN_NODES))) {
            at++;
            node = argv[at][0] - '0';
        } else {
            return usage((strcmp(argv[at], "--help") == 0) ? 0 : 2);
        }
    }
    if ((argc - at < 1) || (argc - at > 2)) {
        return usage(2);
    }
    size_t size = 0;
    for (size_t i = 0; i < SECTORS; i++) {
        size += terrapin_flash_f405_sectors[i];
    }
    uint8_t *bytes = map(argv[at], size);
    if ((bytes == NULL) || (sigaction(SIGTERM, &action, NULL) != 0) || (sigaction(SIGINT, &action, NULL) != 0)) {
        return 1;
    }
    const char *link = ((argc - at) == 2) ? argv[at + 1] : NULL;
    terrapin_flash_emulated_init(&l.memory, bytes, terrapin_flash_f405_sectors, SECTORS, 4U);
    l.flash = terrapin_flash_emulated_driver(&l.memory);
    l.boot.flash = &l.flash;
    l.boot.release = TERRAPIN_BOOT_RELEASE;
    if ((node >= 0) && !terrapin_records_set_node(&l.flash, (uint8_t)node)) {
        return (fail("cannot store", "the node number") == 0) ? 0 : 1;
    }
    start(&l, false);
    const int fd = open_pty(link);
    const int result = (fd < 0) ? -1 : serve(&l, fd);
    if (link != NULL) {
        (void)unlink(link);
    }
    return (result == 0) ? 0 : 1;
}
