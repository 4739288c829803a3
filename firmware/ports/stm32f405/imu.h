/* An ICM-42688-P (TDK InvenSense, DS-000347): accelerations and turn rates, a thousand times a second.
 *
 * One call a tick, which exchanges a few bytes and waits for nothing: the chip's own times are ticks. A chip that is
 * not there, is another one, forgot its settings, answers nothing, or says the same all the time is reset and asked
 * again ten times a second. The bus is the port's: imu_exchange.
 */
#ifndef TERRAPIN_IMU_H
#define TERRAPIN_IMU_H

#include <stdbool.h>
#include <stdint.h>

#define IMU_WORDS       6U
#define IMU_G           4096 /* codes of the acceleration of gravity: +-8 g are 16 bits */
#define IMU_START_TICKS 50U  /* the gyroscopes need 45 ms */
#define IMU_RETRY_TICKS 100U
#define IMU_STUCK_TICKS 20U /* the noise alone changes one of six words with every sample */
#define IMU_BAD_TICKS   5U  /* samples in a row that did not come, until the chip is reset */

typedef struct {
    uint8_t phase;
    uint8_t wait;  /* ticks left before it goes on */
    uint8_t bad;   /* samples in a row that did not come */
    uint8_t stuck; /* that were those before */
    int16_t sample[IMU_WORDS];
} imu;

/* One of the chip's axes, or the other way along it. */
typedef struct {
    uint8_t axis; /* 0 is x */
    int8_t sign;  /* 1 or -1 */
} imu_axis;

/* The port's bus: the chip is selected, `address` sent, then each of the bytes, in whose place comes what the chip
 * sends meanwhile. False when the bus does not answer. */
bool imu_exchange(uint8_t address, uint8_t *bytes, uint32_t count);

/* One tick; true when a new sample is there. */
bool imu_tick(imu *chip);
/* Whether it is set up and answers: false from the first tick of a reset on. */
bool imu_running(const imu *chip);

/* Of the sample: IMU_G a g, and 2000/32768 degrees/s, turning to the right about the axis. */
int32_t imu_along(const imu *chip, uint32_t quantity, imu_axis axis);
#define IMU_ACCELERATION 0U
#define IMU_RATE         3U

#endif
