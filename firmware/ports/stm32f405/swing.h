/* The swing of the inner body, from an IMU on it: the gyroscope's rate summed up, drawn to where the accelerometer sees
 * the vertical, with the gyroscope's zero learnt from what is drawn (Mahony, Hamel and Pflimlin 2008, in one
 * dimension). It is drawn slowly, over 2 s, since in between the accelerometer sees the axle's acceleration as well.
 * The closer the chip sits to the axle, the less it sees of the swing's own.
 */
#ifndef TERRAPIN_SWING_H
#define TERRAPIN_SWING_H

#include "imu.h"
#include "terrapin.h"

#define SWING_ALIGN_TICKS 128U /* in which it is drawn over 16 ms, and not valid yet: they end with the self test */

typedef struct {
    imu chip;
    imu_axis forward; /* of the inner body at rest; up is away from the bob, right is forward cross up, the axle */
    imu_axis up;
    imu_axis right;
    uint32_t angle;   /* bob forward positive, one turn = 2^32 */
    int32_t bias_q16; /* the gyroscope's zero, of the same a tick */
    uint16_t aligned; /* ticks, up to SWING_ALIGN_TICKS */
} swing;

/* One tick: swing angle and rate, and whether they are valid. False while the chip does not answer. */
bool swing_sense(swing *s, terrapin_inputs *inputs);

#endif
