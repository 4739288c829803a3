#include "swing.h"

#include "integer.h"

/* One code of the gyroscope is 2000/32768 degrees/s, in a tick 728.2 of 2^-32 turns; 1 rad is 683565276 of these. What
 * the accelerometer misses comes as 2^27 a radian, 5.093 units a code. */
#define RATE_UNITS       728
#define CENTIRAD_S_UNITS 6836                      /* 1 unit a tick is 1/6836 of 0.01 rad/s */
#define DRAW             393                       /* 2000 ticks over 5.093 units a code: 2 s */
#define DRAW_FAST        3                         /* 16 ms */
#define LEARN_Q16        48                        /* (1 / (2 * 2 s))^2: as fast as it may be without ringing */
#define BIAS_MOST_Q16    (32 * RATE_UNITS * 65536) /* 2 degrees/s: four times the chip's typical error */

static void restart(swing *s) {
    s->angle = 0U;
    s->bias_q16 = 0;
    s->aligned = 0U;
}

/* The rate, in the same units. */
static int32_t update(swing *s) {
    const int32_t forward = imu_along(&s->chip, IMU_ACCELERATION, s->forward);
    const int32_t up = imu_along(&s->chip, IMU_ACCELERATION, s->up);
    const int32_t rate = (imu_along(&s->chip, IMU_RATE, s->right) * RATE_UNITS) - (s->bias_q16 / 65536);
    s->angle += (uint32_t)rate;
    /* The sine of what is missing, times g: of a vector of two 16-bit numbers, below 2^31. */
    const int32_t missing = (forward * integer_cosine(s->angle)) - (up * integer_sine(s->angle));
    if (s->aligned < SWING_ALIGN_TICKS) {
        s->aligned++;
        s->angle += (uint32_t)(missing / DRAW_FAST);
    } else {
        s->angle += (uint32_t)(missing / DRAW);
        s->bias_q16 = integer_clamp(s->bias_q16 - (missing / LEARN_Q16), -BIAS_MOST_Q16, BIAS_MOST_Q16);
    }
    return rate;
}

bool swing_sense(swing *s, terrapin_inputs *inputs) {
    const bool fresh = imu_tick(&s->chip);
    if (!imu_running(&s->chip)) {
        restart(s);
    } else if (fresh) {
        /* at most 32768 * 728 + 23296 units, 35 rad/s: both fit 16 bits */
        inputs->swing_rate_centirad_s = (int16_t)(update(s) / CENTIRAD_S_UNITS);
        inputs->swing_angle_mrad = (int16_t)(((int64_t)(int32_t)s->angle * 6283) / 0x100000000);
    } else {
        /* one sample did not come */
    }
    inputs->swing_valid = fresh && (s->aligned >= SWING_ALIGN_TICKS);
    return imu_running(&s->chip);
}
