#include "imu.h"

enum { PHASE_RESET = 0, PHASE_SET_UP = 1, PHASE_RUN = 2 };

/* DS-000347, 14: registers of bank 0. */
#define DEVICE_CONFIG  0x11U
#define SOFT_RESET     0x01U /* takes 1 ms */
#define ACCEL_DATA_X1  0x1FU /* then y and z and the three rates, each with its high byte first */
#define INTF_CONFIG0   0x4CU
#define NO_I2C         0x33U /* else noise on the lines could begin it; big-endian, as after the reset */
#define PWR_MGMT0      0x4EU
#define GYRO_CONFIG0   0x4FU
#define ACCEL_CONFIG0  0x50U
#define WHO_AM_I       0x75U
#define ICM_42688_P    0x47U
#define LOW_NOISE      0x0FU /* both sensors; no register may be written for 0.2 ms */
#define RATE_2000_1KHZ 0x06U
#define ACCEL_8G_1KHZ  0x26U
#define TO_READ        0x80U /* of an address */
#define RESET_TICKS    2U

/* On to a phase when all is good, after some ticks; else from the beginning, later. */
static void go_or_reset(imu *chip, bool good, uint8_t phase, uint8_t wait) {
    chip->phase = good ? phase : (uint8_t)PHASE_RESET;
    chip->wait = good ? wait : (uint8_t)IMU_RETRY_TICKS;
}

static bool imu_read(uint8_t first, uint8_t *bytes, uint32_t count) {
    return imu_exchange((uint8_t)(first | TO_READ), bytes, count);
}

static bool imu_write(uint8_t at, uint8_t value) {
    uint8_t byte = value;
    return imu_exchange(at, &byte, 1U);
}

/* Each is read back: another scale would be another swing. */
static bool set_up(void) {
    static const uint8_t settings[][2] = {
        {INTF_CONFIG0, NO_I2C}, {GYRO_CONFIG0, RATE_2000_1KHZ}, {ACCEL_CONFIG0, ACCEL_8G_1KHZ}, {PWR_MGMT0, LOW_NOISE}};
    uint8_t found = 0U;
    bool good = imu_read(WHO_AM_I, &found, 1U) && (found == ICM_42688_P);
    for (uint32_t i = 0U; good && (i < (sizeof settings / sizeof settings[0])); i++) {
        good = imu_write(settings[i][0], settings[i][1]) && imu_read(settings[i][0], &found, 1U) &&
               (found == settings[i][1]);
    }
    return good;
}

/* -32768 is what a sensor says that is not on, as after a reset. */
static bool take_sample(imu *chip) {
    uint8_t bytes[2U * IMU_WORDS] = {0U};
    bool good = imu_read(ACCEL_DATA_X1, bytes, sizeof bytes);
    bool same = true;
    for (uint32_t i = 0U; i < IMU_WORDS; i++) {
        const int16_t value = (int16_t)(uint16_t)(((uint32_t)bytes[2U * i] << 8U) | bytes[(2U * i) + 1U]);
        good = good && (value != INT16_MIN);
        same = same && (value == chip->sample[i]);
        chip->sample[i] = value;
    }
    chip->bad = good ? 0U : (uint8_t)(chip->bad + 1U);
    chip->stuck = same ? (uint8_t)(chip->stuck + 1U) : 0U;
    return good && (chip->stuck < IMU_STUCK_TICKS);
}

bool imu_tick(imu *chip) {
    bool fresh = false;
    if (chip->wait > 0U) {
        chip->wait--;
        return false;
    }
    switch (chip->phase) {
    case PHASE_RESET:
        (void)imu_write(DEVICE_CONFIG, SOFT_RESET); /* a bus that is dead shows in the next phase */
        chip->bad = 0U;
        chip->stuck = 0U;
        go_or_reset(chip, true, PHASE_SET_UP, RESET_TICKS);
        break;
    case PHASE_SET_UP:
        go_or_reset(chip, set_up(), PHASE_RUN, (uint8_t)IMU_START_TICKS);
        break;
    case PHASE_RUN:
    default:
        fresh = take_sample(chip);
        go_or_reset(chip, (chip->bad < IMU_BAD_TICKS) && (chip->stuck < IMU_STUCK_TICKS), PHASE_RUN, 0U);
        break;
    }
    return fresh;
}

bool imu_running(const imu *chip) {
    return chip->phase == (uint8_t)PHASE_RUN;
}

int32_t imu_along(const imu *chip, uint32_t quantity, imu_axis axis) {
    return axis.sign * chip->sample[quantity + axis.axis];
}
