/* A NOR flash in memory, behind the driver's interface: for tests and for the boot loader on a host.
 *
 *     static const uint32_t sectors[] = {16384, 16384};
 *     terrapin_flash_emulated_init(&memory, bytes, sectors, 2, 4);       bytes: 32768 of them, contents kept
 *     const terrapin_flash flash = terrapin_flash_emulated_driver(&memory);
 *     memory.cut_at = 17;                                                power fails in the 18th operation
 *     ... the code under test ...
 *     terrapin_flash_emulated_power_on(&memory);                         contents as the cut left them
 *
 * One operation is the write of one unit or the erase of one sector: every point at which power can fail. Once it has
 * failed every call is refused until power is on again, so that nothing reaches the memory after the cut.
 */
#ifndef TERRAPIN_FLASH_EMULATED_H
#define TERRAPIN_FLASH_EMULATED_H

#include "flash.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_FLASH_EMULATED_NEVER 0xFFFFFFFFU
#define TERRAPIN_FLASH_F405_SECTORS   12U
#define TERRAPIN_FLASH_F405_SIZE      1048576U

/* What the operation leaves behind in which power fails. */
typedef enum {
    TERRAPIN_FLASH_CUT_BEFORE = 0, /* nothing of it */
    TERRAPIN_FLASH_CUT_AFTER = 1,  /* all of it, but the caller never learns */
    TERRAPIN_FLASH_CUT_TORN = 2,   /* write: some of the bits that it clears; erase: some of the bits that it sets */
    TERRAPIN_FLASH_CUT_PART = 3,   /* erase: its first half is done; write: its first half */
    TERRAPIN_FLASH_CUT_NOISE = 4   /* anything at all in what it touched */
} terrapin_flash_cut;

typedef struct {
    uint8_t *bytes; /* the caller's, `size` of them */
    uint32_t size;
    const uint32_t *sectors; /* sizes in bytes, from offset 0 on; their sum is `size` */
    uint32_t sector_count;
    uint32_t write_size;
    uint32_t operations;      /* begun so far: unit writes and sector erases; the caller may set it to 0 */
    uint32_t cut_at;          /* power fails in the operation of this number, NEVER by default */
    terrapin_flash_cut cut;   /* BEFORE by default */
    uint32_t random;          /* state of the generator behind TORN and NOISE; not 0 */
    bool off;                 /* power has failed */
    uint32_t misuse;          /* calls outside, unaligned, or into units that are not erased: refused */
    uint64_t busy_us;         /* time that an STM32F405 (32-bit wide, 2.7 to 3.6 V) takes: typical of DS8626 */
    uint64_t busy_longest_us; /* and its maximum */
} terrapin_flash_emulated;

/* The sectors of an STM32F405: 4 of 16 kB, 1 of 64 kB, 7 of 128 kB. The first seven hold boot loader to slot B. */
extern const uint32_t terrapin_flash_f405_sectors[TERRAPIN_FLASH_F405_SECTORS];

/* All counters 0, power on, no cut. Contents stay. `sectors` and `bytes` must outlive it. */
void terrapin_flash_emulated_init(terrapin_flash_emulated *memory, uint8_t *bytes, const uint32_t *sectors,
                                  uint32_t sector_count, uint32_t write_size);
terrapin_flash terrapin_flash_emulated_driver(terrapin_flash_emulated *memory);
/* Power on again and no further cut; contents and counters stay. */
void terrapin_flash_emulated_power_on(terrapin_flash_emulated *memory);

#ifdef __cplusplus
}
#endif
#endif
