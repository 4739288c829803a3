#define _GNU_SOURCE /* O_CLOEXEC, pread, pwrite, fdatasync */

#include "flash_file.h"
#include "terrapin_interface.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#define WRITE_SIZE 4U /* as on the chip */
#define PAGE       TERRAPIN_FLASH_FILE_PAGE
#define NODE_PAGE  (2U * PAGE) /* where it begins */
#define SIZE       (3U * PAGE)
#define STOP_UNIT  (SIZE - WRITE_SIZE) /* behind the node numbers */
#define PIECE      512U

static bool inside(uint32_t offset, uint32_t size) {
    return (offset <= SIZE) && (size <= (SIZE - offset));
}

static bool put(terrapin_flash_file *file, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    file->unsynced = true;
    return pwrite(file->descriptor, bytes, size, (off_t)offset) == (ssize_t)size;
}

static bool get(const terrapin_flash_file *file, uint32_t offset, uint8_t *bytes, uint32_t size) {
    return pread(file->descriptor, bytes, size, (off_t)offset) == (ssize_t)size;
}

/* What was written is on the disk. */
static bool sync_file(terrapin_flash_file *file) {
    if (file->unsynced && (fdatasync(file->descriptor) == 0)) {
        file->unsynced = false;
    }
    return !file->unsynced;
}

/* What is read back stays, whatever happens to the power: so a store that verifies its set waits for the disk once a
 * set, not once a unit. */
static bool read_bytes(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    terrapin_flash_file *file = context;
    return inside(offset, size) && sync_file(file) && get(file, offset, bytes, size);
}

/* What was written before is on the disk before, the erase itself after. */
static bool erase_area(void *context, terrapin_flash_area area) {
    terrapin_flash_file *file = context;
    uint8_t erased[PIECE];
    bool good =
        inside(area.offset, area.size) && ((area.offset % PAGE) == 0U) && ((area.size % PAGE) == 0U) && sync_file(file);
    memset(erased, 0xFF, sizeof erased);
    for (uint32_t at = 0U; good && (at < area.size); at += PIECE) {
        good = put(file, area.offset + at, erased, PIECE);
    }
    return good && sync_file(file);
}

/* A write clears bits and sets none, as flash does. */
static bool write_bytes(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    terrapin_flash_file *file = context;
    uint8_t unit[WRITE_SIZE] = {0};
    bool good = inside(offset, size) && ((offset % WRITE_SIZE) == 0U) && ((size % WRITE_SIZE) == 0U);
    for (uint32_t at = 0U; good && (at < size); at += WRITE_SIZE) {
        good = get(file, offset + at, unit, WRITE_SIZE);
        for (uint32_t i = 0U; i < WRITE_SIZE; i++) {
            unit[i] &= bytes[at + i];
        }
        good = good && put(file, offset + at, unit, WRITE_SIZE);
    }
    return good;
}

/* A new file's name is on the disk as well. */
static bool sync_folder(const char *path) {
    char copy[PATH_MAX];
    if (strlen(path) >= sizeof copy) {
        errno = ENAMETOOLONG;
        return false;
    }
    (void)memcpy(copy, path, strlen(path) + 1U);
    const int folder = open(dirname(copy), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const bool good = (folder >= 0) && (fsync(folder) == 0);
    if (folder >= 0) {
        const int reason = errno;
        (void)close(folder);
        errno = reason;
    }
    return good;
}

static int prepare(terrapin_flash_file *file, const char *path) {
    struct stat about;
    if (flock(file->descriptor, LOCK_EX | LOCK_NB) != 0) { /* one controller a file */
        return errno;
    }
    if (fstat(file->descriptor, &about) != 0) {
        return errno;
    }
    const bool parameters_only = (about.st_size >= (off_t)NODE_PAGE) && (about.st_size < (off_t)SIZE);
    if (!S_ISREG(about.st_mode) || ((about.st_size != 0) && (about.st_size != (off_t)SIZE) && !parameters_only)) {
        return EINVAL;
    }
    if ((about.st_size == 0) &&
        !(erase_area(file, (terrapin_flash_area){.offset = 0U, .size = SIZE}) && sync_folder(path))) {
        const int reason = (errno != 0) ? errno : EIO;
        (void)ftruncate(file->descriptor, 0); /* a part of a flash is none; an empty file is made whole next time */
        return reason;
    }
    if (parameters_only && !erase_area(file, (terrapin_flash_area){.offset = NODE_PAGE, .size = PAGE})) {
        return (errno != 0) ? errno : EIO;
    }
    return 0;
}

int terrapin_flash_file_open(terrapin_flash_file *file, const char *path) {
    memset(file, 0, sizeof *file);
    file->flash = (terrapin_flash){
        .context = file, .write_size = WRITE_SIZE, .erase = erase_area, .write = write_bytes, .read = read_bytes};
    file->pages[0] = (terrapin_flash_area){.offset = 0U, .size = PAGE};
    file->pages[1] = (terrapin_flash_area){.offset = PAGE, .size = PAGE};
    errno = 0;
    file->descriptor = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0644);
    if (file->descriptor < 0) {
        return errno;
    }
    const int result = prepare(file, path);
    if (result != 0) {
        terrapin_flash_file_close(file);
    }
    return result;
}

void terrapin_flash_file_close(terrapin_flash_file *file) {
    if (file->descriptor >= 0) {
        (void)close(file->descriptor);
        file->descriptor = -1;
    }
}

/* The page of the node number is a row of units, the newest whole one of which counts: 'N', the number, what it is not,
 * and a zero. A unit that was torn is none. */
static bool unit_of(const uint8_t unit[WRITE_SIZE], uint8_t *node) {
    const bool good =
        (unit[0] == (uint8_t)'N') && (unit[1] < TERRAPIN_NODES) && ((unit[1] ^ unit[2]) == 0xFF) && (unit[3] == 0U);
    if (good) {
        *node = unit[1];
    }
    return good;
}

/* The number that counts, and the offset of the first unit that was never written: STOP_UNIT when there is none. */
static uint32_t find_node(const terrapin_flash_file *file, uint8_t *node) {
    static const uint8_t erased[WRITE_SIZE] = {0xFF, 0xFF, 0xFF, 0xFF};
    uint8_t unit[WRITE_SIZE];
    uint32_t next = STOP_UNIT;
    *node = 0U;
    for (uint32_t at = NODE_PAGE; (next == STOP_UNIT) && (at < STOP_UNIT); at += WRITE_SIZE) {
        if (!get(file, at, unit, WRITE_SIZE)) {
            return STOP_UNIT;
        }
        if (!unit_of(unit, node) && (memcmp(unit, erased, WRITE_SIZE) == 0)) {
            next = at;
        }
    }
    return next;
}

uint8_t terrapin_flash_file_node(const terrapin_flash_file *file) {
    uint8_t node = 0U;
    (void)find_node(file, &node);
    return node;
}

bool terrapin_flash_file_set_node(void *file, uint8_t node) {
    terrapin_flash_file *own = file;
    uint8_t stored = 0U;
    const uint32_t next = find_node(own, &stored);
    if (stored == node) {
        return true;
    }
    const uint8_t unit[WRITE_SIZE] = {(uint8_t)'N', node, (uint8_t)(node ^ 0xFFU), 0U};
    return (next < STOP_UNIT) && put(own, next, unit, WRITE_SIZE) && sync_file(own);
}

static const uint8_t stop_unit[WRITE_SIZE] = {(uint8_t)'S', (uint8_t)'T', (uint8_t)'O', (uint8_t)'P'};

bool terrapin_flash_file_stopped(const terrapin_flash_file *file) {
    uint8_t unit[WRITE_SIZE];
    return get(file, STOP_UNIT, unit, WRITE_SIZE) && (memcmp(unit, stop_unit, WRITE_SIZE) == 0);
}

/* No flash: it is written over as often as it changes, and waits for no disk. */
void terrapin_flash_file_set_stopped(terrapin_flash_file *file, bool stopped) {
    static const uint8_t goes[WRITE_SIZE] = {0xFF, 0xFF, 0xFF, 0xFF};
    (void)put(file, STOP_UNIT, stopped ? stop_unit : goes, WRITE_SIZE);
}
