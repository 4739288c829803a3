/* Sensors: from the plant's truth to what the controller reads.
 *
 * A value first waits its channel's delay (whole ticks), then passes through the channel's own model. Each channel
 * draws from its own random stream.
 */
#ifndef HIL_SENSORS_H
#define HIL_SENSORS_H

#include <stdbool.h>
#include <stdint.h>

#include "random.h"

enum {
    HIL_CURRENT = 0,      /* ADC [A] */
    HIL_SUPPLY = 1,       /* ADC [V] */
    HIL_TEMPERATURE = 2,  /* ADC [degC] */
    HIL_MOTOR = 3,        /* encoder [rad] of the drive wheel relative to the inner body */
    HIL_WHEEL = 4,        /* encoder [rad] of the trailing wheel on the ground */
    HIL_SWING_ANGLE = 5,  /* digital [rad] */
    HIL_SWING_RATE = 6,   /* digital [rad/s] */
    HIL_PITCH = 7,        /* digital [rad] */
    HIL_GROUND_SPEED = 8, /* digital [m/s] */
    HIL_CHANNELS = 9,
    HIL_ADCS = 3,
    HIL_ENCODERS = 2,
    HIL_DIGITALS = 4,
    HIL_MAX_DELAY = 63
};

/* 12-bit converter: code = zero + value (1 + gain_error) / lsb + offset + inl sin(2 pi inl_cycles x) + noise, rounded
 * to nearest and clipped to 0..4095, with x the share of full scale. inl_cycles = 0.5 is a bow, 1 an S. */
typedef struct {
    double lsb;        /* [unit per code] */
    double zero;       /* code of value 0 */
    double offset;     /* [codes] */
    double gain_error; /* relative */
    double inl;        /* peak [codes] */
    double inl_cycles;
    double noise; /* rms [codes]; half a code dithers the rounding away */
} hil_adc;

/* Incremental encoder, 16-bit counter that wraps. It follows its shaft through a gap of `play`; misalignment errs by
 * misalignment * sin(angle + phase). */
typedef struct {
    double counts_per_turn;
    double misalignment; /* [rad] */
    double phase;        /* [rad] */
    double loss;         /* probability that a count is lost */
    double play;         /* [rad] */
} hil_encoder;

/* A number from a chip that measures and sends it: value + offset + noise, rounded to the resolution. */
typedef struct {
    bool present;
    double resolution; /* [unit per bit] */
    double offset;     /* [unit] */
    double noise;      /* rms [unit] */
    double largest;    /* greatest raw magnitude that its signal carries */
} hil_digital;

typedef struct {
    hil_adc adc[HIL_ADCS];
    hil_encoder encoder[HIL_ENCODERS];
    hil_digital digital[HIL_DIGITALS];
    int delay[HIL_CHANNELS]; /* ticks, 0 to HIL_MAX_DELAY */
} hil_sensors;

typedef struct {
    double past[HIL_MAX_DELAY + 1][HIL_CHANNELS];
    hil_random random[HIL_CHANNELS];
    int32_t count[HIL_ENCODERS]; /* ideal count so far */
    int32_t lost[HIL_ENCODERS];
    double followed[HIL_ENCODERS]; /* where within its gap the encoder stands [rad] */
    uint32_t tick;
} hil_sensor_state;

void hil_sensors_start(hil_sensor_state *state, uint64_t seed);

/* Takes the true values of a tick in; call once a tick, before reading. */
void hil_sensors_push(hil_sensor_state *state, const double *values);

/* Reads channel HIL_CURRENT + i. */
uint16_t hil_adc_read(const hil_sensors *sensors, hil_sensor_state *state, int i);

/* Reads channel HIL_MOTOR + i; `loss` adds to the encoder's own. HIL_REVERSED as loss: each count is lost twice. */
#define HIL_REVERSED 2.0
uint16_t hil_encoder_read(const hil_sensors *sensors, hil_sensor_state *state, int i, double loss);

/* Reads channel HIL_SWING_ANGLE + i, as a raw signed number. */
int16_t hil_digital_read(const hil_sensors *sensors, hil_sensor_state *state, int i);

#endif
