#include "imu_bus.h"

#include "boards/selected.h"
#include "pins.h"
#include "imu.h"
#include "spi.h"

static const pin select_pin = BOARD_IMU_SELECT;

static void choose(bool on) {
    pin_write(GPIO(select_pin.port), &select_pin, !on);
}

void imu_bus_open(void) {
    choose(false);
    pin_setup(GPIO(select_pin.port), &select_pin);
}

bool imu_exchange(uint8_t address, uint8_t *bytes, uint32_t count) {
    uint8_t unused = 0U;
    choose(true);
    bool good = spi_byte(SPI1, address, &unused);
    for (uint32_t i = 0U; good && (i < count); i++) {
        good = spi_byte(SPI1, bytes[i], &bytes[i]);
    }
    choose(false);
    return good;
}
