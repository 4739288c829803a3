/* Where things stand in the flash of the STM32F405: bytes from its start. Sectors 0 to 6 of DS8626.
 *
 *     0x00000  16 kB   boot loader, of which the last 64 bytes are the link key's (link/seal.h)
 *     0x04000  2 x 16  parameter store
 *     0x0C000  16 kB   boot records, first page
 *     0x10000  64 kB   boot records, second page
 *     0x20000  128 kB  slot A
 *     0x40000  128 kB  slot B
 */
#ifndef TERRAPIN_LAYOUT_H
#define TERRAPIN_LAYOUT_H

#define TERRAPIN_LAYOUT_BASE           0x08000000U /* where the processor sees the start of flash */
#define TERRAPIN_LAYOUT_LINK_KEY       0x03FC0U
#define TERRAPIN_LAYOUT_RECORDS_0      0x0C000U
#define TERRAPIN_LAYOUT_RECORDS_SIZE_0 0x04000U
#define TERRAPIN_LAYOUT_RECORDS_1      0x10000U
#define TERRAPIN_LAYOUT_RECORDS_SIZE_1 0x10000U
#define TERRAPIN_LAYOUT_SLOT_A         0x20000U
#define TERRAPIN_LAYOUT_SLOT_B         0x40000U
#define TERRAPIN_LAYOUT_SLOT_SIZE      0x20000U
#define TERRAPIN_LAYOUT_HEADER_SIZE    0x200U /* before the vectors, whose table is aligned to as much */

#endif
