#define _GNU_SOURCE /* O_CLOEXEC, pread, pwrite */

#include "flash_file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#define PAGE       TERRAPIN_FLASH_FILE_PAGE
#define SIZE       (2U * PAGE)
#define PIECE      512U
#define WRITE_SIZE 4U /* as on the chip */

static bool inside(uint32_t offset, uint32_t size) {
    return (offset <= SIZE) && (size <= (SIZE - offset));
}

static bool put(const terrapin_flash_file *file, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    return pwrite(file->descriptor, bytes, size, (off_t)offset) == (ssize_t)size;
}

static bool read_bytes(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    const terrapin_flash_file *file = context;
    return inside(offset, size) && (pread(file->descriptor, bytes, size, (off_t)offset) == (ssize_t)size);
}

static bool erase_area(void *context, terrapin_flash_area area) {
    uint8_t erased[PIECE];
    bool good = inside(area.offset, area.size) && ((area.offset % PAGE) == 0U) && ((area.size % PAGE) == 0U);
    memset(erased, 0xFF, sizeof erased);
    for (uint32_t at = 0U; good && (at < area.size); at += PIECE) {
        good = put(context, area.offset + at, erased, PIECE);
    }
    return good;
}

/* A write clears bits and sets none, as flash does. */
static bool write_bytes(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    uint8_t unit[WRITE_SIZE] = {0};
    bool good = inside(offset, size) && ((offset % WRITE_SIZE) == 0U) && ((size % WRITE_SIZE) == 0U);
    for (uint32_t at = 0U; good && (at < size); at += WRITE_SIZE) {
        good = read_bytes(context, offset + at, unit, WRITE_SIZE);
        for (uint32_t i = 0U; i < WRITE_SIZE; i++) {
            unit[i] &= bytes[at + i];
        }
        good = good && put(context, offset + at, unit, WRITE_SIZE);
    }
    return good;
}

static int prepare(terrapin_flash_file *file) {
    struct stat about;
    if (flock(file->descriptor, LOCK_EX | LOCK_NB) != 0) { /* one controller a file */
        return errno;
    }
    if (fstat(file->descriptor, &about) != 0) {
        return errno;
    }
    if (!S_ISREG(about.st_mode) || ((about.st_size != 0) && (about.st_size != (off_t)SIZE))) {
        return EINVAL;
    }
    if ((about.st_size == 0) && !erase_area(file, (terrapin_flash_area){.offset = 0U, .size = SIZE})) {
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
    const int result = prepare(file);
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
