#include "spi.h"

#include "wait.h"

#define AN_EIGHTH 2U

void spi_open(spi_registers *spi) {
    spi->CR1 = 0U;
    spi->CR2 = 0U;
    spi->CR1 = SPI_CR1_CPHA | SPI_CR1_CPOL | SPI_CR1_MSTR | (AN_EIGHTH << SPI_CR1_BR) | SPI_CR1_SSM | SPI_CR1_SSI;
    spi->CR1 |= SPI_CR1_SPE;
}

bool spi_byte(spi_registers *spi, uint8_t out, uint8_t *in) {
    TERRAPIN_PUT(spi->DR, out);
    const bool came = wait_for(&spi->SR, SPI_SR_RXNE, SPI_SR_RXNE, SPI_TRIES);
    *in = (uint8_t)spi->DR;
    return came;
}
