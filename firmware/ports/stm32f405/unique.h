/* Which chip this is. */
#ifndef TERRAPIN_UNIQUE_H
#define TERRAPIN_UNIQUE_H

#include <stdint.h>

/* The 96 bits of the chip's unique number (RM0090, 39.1) folded to 32 by a CRC-32; 0 where there is none. */
uint32_t unique_number(void);

#endif
