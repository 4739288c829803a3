/* A file as flash: what the host's controller keeps its parameters, its node number and a STOP_ALL in.
 *
 * Two pages of parameters, then one with the node number: a file of two pages, from before there was one, is grown.
 * Offsets count from the file's start, erased bytes are 0xFF. A file that does not exist is made, all of it erased. It
 * outlives the process, ended in whatever way. Of a power loss of the host the header flash.h holds as of the chip's:
 * an erase, and whatever was read back after a write, is on the disk (fdatasync).
 */
#ifndef TERRAPIN_FLASH_FILE_H
#define TERRAPIN_FLASH_FILE_H

#include "flash.h"
#include "terrapin.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_FLASH_FILE_PAGE 16384U /* bytes; there are three */

typedef struct {
    int descriptor;
    bool unsynced;        /* something was written that may not be on the disk yet */
    terrapin_flash flash; /* its context is this struct: it must not move */
    terrapin_flash_area pages[2];
} terrapin_flash_file;

/* Open or make the file. 0, or the errno of what failed; EINVAL for a file of another length. */
TERRAPIN_API int terrapin_flash_file_open(terrapin_flash_file *file, const char *path);
TERRAPIN_API void terrapin_flash_file_close(terrapin_flash_file *file);

/* The node number that the file keeps; 0 when none was ever stored. */
TERRAPIN_API uint8_t terrapin_flash_file_node(const terrapin_flash_file *file);

/* Keep another; false when the file cannot be written, and the old one stands. What terrapin_identity.store may be,
 * with the file as its context. */
TERRAPIN_API bool terrapin_flash_file_set_node(void *file, uint8_t node);

/* STOP_ALL held when the file was used last, and whether it holds now, for the next start. Kept in whatever way the
 * process ends, at once; not over a loss of the host's power. */
TERRAPIN_API bool terrapin_flash_file_stopped(const terrapin_flash_file *file);
TERRAPIN_API void terrapin_flash_file_set_stopped(terrapin_flash_file *file, bool stopped);

#ifdef __cplusplus
}
#endif
#endif
