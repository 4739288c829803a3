#include "faults.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "extremes.h"

const hil_fault *hil_fault_active(const hil_faults *faults, int kind, int channel, double time) {
    for (int i = 0; i < faults->count; i++) {
        const hil_fault *fault = &faults->fault[i];
        if (fault->kind == kind && (channel < 0 || fault->channel == channel) && time >= fault->begin &&
            time < fault->end) {
            return fault;
        }
    }
    return NULL;
}

enum { STREAM = 100 }; /* of the random numbers; those of the sensors are below */

void hil_faults_start(hil_fault_memory *memory, uint64_t seed) {
    memset(memory, 0, sizeof *memory);
    for (int i = 0; i < HIL_CHANNELS; i++) {
        memory->random[i] = hil_random_split(seed, (uint64_t)STREAM + (uint64_t)i);
    }
}

static bool is_encoder(int channel) {
    return channel == HIL_MOTOR || channel == HIL_WHEEL;
}

int32_t hil_fault_reading(const hil_faults *faults, hil_fault_memory *memory, int channel, int32_t reading,
                          int32_t zero, int32_t low, int32_t high, int every, double time) {
    const bool counts = is_encoder(channel);
    int32_t *past = memory->past[channel];
    const uint32_t number = memory->readings[channel]++;
    const int32_t before = past[(number - 1U) & HIL_FAULT_LATEST];
    const int32_t step = counts && number > 0U ? (int16_t)(uint16_t)(uint32_t)(reading - before) : 0;
    const int32_t whole = counts && number > 0U ? before + step : reading;
    past[number & HIL_FAULT_LATEST] = whole;
    double told = whole;
    const hil_fault *fault = hil_fault_active(faults, HIL_FAULT_SCALED, channel, time);
    if (fault != NULL && counts) {
        memory->beside[channel] += (int32_t)lrint((fault->value - 1.0) * step);
    } else if (fault != NULL) {
        told = zero + fault->value * (told - zero);
    }
    fault = hil_fault_active(faults, HIL_FAULT_DELAYED, channel, time);
    if (fault != NULL) {
        const uint32_t late = (uint32_t)lrint(smaller(fault->value * 1e3 / every, HIL_FAULT_LATEST));
        told = past[(number - (late < number ? late : number)) & HIL_FAULT_LATEST];
    }
    fault = hil_fault_active(faults, HIL_FAULT_MIRRORED, channel, time);
    if (fault != NULL) {
        told = 2.0 * zero - told;
    }
    fault = hil_fault_active(faults, HIL_FAULT_DRIFT, channel, time);
    if (fault != NULL) {
        told += fault->value * (time - fault->begin);
    }
    fault = hil_fault_active(faults, HIL_FAULT_NOISY, channel, time);
    if (fault != NULL) {
        told += fault->value * hil_random_normal(&memory->random[channel]);
    }
    fault = hil_fault_active(faults, HIL_FAULT_INTERMITTENT, channel, time);
    if (fault != NULL && fmod(time - fault->begin, fault->value) < 0.5 * fault->value) {
        memory->beside[channel] -= step;
        told = counts ? told : memory->told[channel];
    }
    fault = hil_fault_active(faults, HIL_FAULT_FORCED, channel, time);
    if (fault != NULL) {
        told = fault->value;
    } else {
        told += memory->beside[channel];
    }
    const double held = counts ? told : smaller(larger(told, low), high);
    if (hil_fault_active(faults, HIL_FAULT_STUCK, channel, time) == NULL) {
        memory->told[channel] = (int32_t)lrint(held);
    }
    return memory->told[channel];
}
