#include "sensors.h"

#include <math.h>
#include <string.h>

#include "extremes.h"

#define TWO_PI   6.28318530717958647692
#define ADC_FULL 4095.0

void hil_sensors_start(hil_sensor_state *state, uint64_t seed) {
    memset(state, 0, sizeof *state);
    for (int i = 0; i < HIL_CHANNELS; i++) {
        state->random[i] = hil_random_split(seed, (uint64_t)i);
    }
}

void hil_sensors_push(hil_sensor_state *state, const double *values) {
    state->tick++;
    if (state->tick == 1) { /* before the start everything stood as it stands at the start */
        for (int i = 0; i <= HIL_MAX_DELAY; i++) {
            memcpy(state->past[i], values, sizeof state->past[i]);
        }
    }
    memcpy(state->past[state->tick & HIL_MAX_DELAY], values, sizeof state->past[0]);
}

static double delayed(const hil_sensors *sensors, const hil_sensor_state *state, int channel) {
    return state->past[(state->tick - (uint32_t)sensors->delay[channel]) & HIL_MAX_DELAY][channel];
}

static double normal(hil_sensor_state *state, int channel, double rms) {
    return rms > 0.0 ? rms * hil_random_normal(&state->random[channel]) : 0.0;
}

uint16_t hil_adc_read(const hil_sensors *sensors, hil_sensor_state *state, int i) {
    const hil_adc *adc = &sensors->adc[i];
    const int channel = HIL_CURRENT + i;
    const double ideal = adc->zero + delayed(sensors, state, channel) * (1.0 + adc->gain_error) / adc->lsb;
    double code = ideal + adc->offset + normal(state, channel, adc->noise);
    if (adc->inl != 0.0) {
        code += adc->inl * sin(TWO_PI * adc->inl_cycles * ideal / ADC_FULL);
    }
    return (uint16_t)lrint(smaller(larger(code, 0.0), ADC_FULL));
}

/* floor(), which without SSE4.1 is a dozen instructions more. */
static inline int32_t floored(double value) {
    const int32_t towards_zero = (int32_t)value;
    return towards_zero - ((double)towards_zero > value ? 1 : 0);
}

uint16_t hil_encoder_read(const hil_sensors *sensors, hil_sensor_state *state, int i, double loss) {
    const hil_encoder *encoder = &sensors->encoder[i];
    const int channel = HIL_MOTOR + i;
    double angle = delayed(sensors, state, channel);
    if (encoder->play > 0.0) {
        const double half = 0.5 * encoder->play;
        state->followed[i] = smaller(larger(state->followed[i], angle - half), angle + half);
        angle = state->followed[i];
    }
    if (encoder->misalignment != 0.0) {
        angle += encoder->misalignment * sin(angle + encoder->phase);
    }
    const int32_t count = floored(angle * encoder->counts_per_turn / TWO_PI);
    const double probability = encoder->loss + loss;
    if (loss >= HIL_REVERSED) {
        state->lost[i] += 2 * (count - state->count[i]);
    } else if (probability > 0.0) {
        const int32_t sign = count >= state->count[i] ? 1 : -1;
        for (int32_t c = state->count[i]; c != count; c += sign) {
            if (hil_random_uniform(&state->random[channel]) < probability) {
                state->lost[i] += sign;
            }
        }
    }
    state->count[i] = count;
    return (uint16_t)(uint32_t)(count - state->lost[i]);
}

int16_t hil_digital_read(const hil_sensors *sensors, hil_sensor_state *state, int i) {
    const hil_digital *digital = &sensors->digital[i];
    if (!digital->present) {
        return 0;
    }
    const int channel = HIL_SWING_ANGLE + i;
    const double value = delayed(sensors, state, channel) + digital->offset + normal(state, channel, digital->noise);
    const double raw = rint(value / digital->resolution);
    return (int16_t)smaller(larger(raw, -digital->largest - 1.0), digital->largest);
}
