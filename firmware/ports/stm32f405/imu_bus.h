/* The wires to the IMU: SPI1 and the board's select pin. imu_exchange (imu.h) goes over them. */
#ifndef TERRAPIN_IMU_BUS_H
#define TERRAPIN_IMU_BUS_H

/* The select pin, at rest. */
void imu_bus_open(void);

#endif
