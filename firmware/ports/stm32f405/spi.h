/* SPI1 as the master of one chip, mode 3, 8 bits a word. A byte that does not come is waited for only so long. */
#ifndef TERRAPIN_SPI_H
#define TERRAPIN_SPI_H

#include "registers.h"

#define SPI_TRIES 64U /* 512 cycles of the core; a byte takes 128, or 64 without the crystal */

/* At an eighth of the peripheral's bus: 10.5 MHz, or 2 MHz without the crystal. */
void spi_open(spi_registers *spi);

/* Send a byte, and what came meanwhile into *in; false when nothing did. */
bool spi_byte(spi_registers *spi, uint8_t out, uint8_t *in);

#endif
