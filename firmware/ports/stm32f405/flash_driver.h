/* The chip's own flash memory behind store/flash.h: 12 sectors of 16, 64 and 128 kB (RM0090, table 5).
 *
 * The processor stands still while a sector that shares its bank is erased or written (all of an STM32F405's does): up
 * to 0.5 s for 16 kB, 1.1 s for 64 kB, 2 s for 128 kB (DS8626, table 40, 32 bits at a time). The caller has the motor
 * off by then and gives the watchdog time (watchdog.h).
 */
#ifndef TERRAPIN_FLASH_DRIVER_H
#define TERRAPIN_FLASH_DRIVER_H

#include "flash.h"
#include "registers.h"

typedef struct {
    flash_registers *registers;
    uint8_t *memory;            /* where offset 0 is: FLASH_MEMORY */
    terrapin_flash_area serves; /* whole sectors; what lies outside is refused, for reading as well */
} flash_driver;

/* The interface to the sectors of `serves`; *driver is kept by the caller as long as the interface is used. */
terrapin_flash flash_open(flash_driver *driver, flash_registers *registers, uint8_t *memory,
                          terrapin_flash_area serves);

/* Number of the sector that begins at an offset; -1 when none does. */
int32_t flash_sector_at(uint32_t offset);
/* Bytes of a sector, 0 to 11. */
uint32_t flash_sector_size(uint32_t sector);

#endif
