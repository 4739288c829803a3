/* The flash memory as the parameter store and the boot loader see it: a driver is one number and three functions.
 *
 * Offsets count bytes from the start of the chip's flash. Erased bytes read 0xFF; a write can only clear bits, and
 * only whole units of `write_size` that are aligned to it. Power may fail in any call: a sector whose erase was cut,
 * and a unit whose write was cut, may read as anything afterwards; every other byte is as it was. Nothing here blocks
 * for ever: a driver gives up after the time that its chip's data sheet states, and says so.
 *
 * Users: store/parameters.h, boot/. Drivers: ports/stm32f405/flash.c, store/flash_emulated.h (tests, with power cuts).
 */
#ifndef TERRAPIN_FLASH_H
#define TERRAPIN_FLASH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A region that is erased as a whole by one call: one or more sectors of the chip. */
typedef struct {
    uint32_t offset; /* bytes from the start of flash */
    uint32_t size;   /* bytes */
} terrapin_flash_area;

typedef struct {
    void *context;       /* the driver's own, passed back to it */
    uint32_t write_size; /* bytes of the smallest write: 4 on STM32F405, a power of two, at most 16 */

    /* Erase every sector of an area. False: refused by the chip, timed out, or outside of the areas it serves. */
    bool (*erase)(void *context, terrapin_flash_area area);
    /* Write `size` bytes (a multiple of write_size) at an aligned offset into erased units. False as above. */
    bool (*write)(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size);
    /* Read; false when the range is outside. */
    bool (*read)(void *context, uint32_t offset, uint8_t *bytes, uint32_t size);
} terrapin_flash;

#ifdef __cplusplus
}
#endif
#endif
