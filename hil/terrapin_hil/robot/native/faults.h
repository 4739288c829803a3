/* Faults that a scenario injects over time. */
#ifndef HIL_FAULTS_H
#define HIL_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "random.h"
#include "sensors.h"

enum {
    HIL_FAULT_STUCK = 0,           /* `channel` keeps its last reading */
    HIL_FAULT_FORCED = 1,          /* `channel` reads the raw number `value` */
    HIL_FAULT_ABSENT = 2,          /* `channel`, a digital one, is no longer valid */
    HIL_FAULT_LOST_COUNTS = 3,     /* `channel`, an encoder, loses a count with probability `value` */
    HIL_FAULT_ESTOP = 4,           /* emergency stop pressed, or its wire broken: the input reads the same */
    HIL_FAULT_SUPPLY = 5,          /* supply voltage is `value` [V] */
    HIL_FAULT_COMMAND_SILENCE = 6, /* no COMMAND frames */
    HIL_FAULT_LINK_SILENCE = 7,    /* no frames at all: the controller does not step, the bridge holds its duty */
    HIL_FAULT_REVERSED = 8,        /* `channel`, an encoder, counts backwards from now on */
    /* Of `channel`, in raw numbers (codes, counts, steps of the resolution) from the zero of a converter: */
    HIL_FAULT_DRIFT = 9,    /* it gains `value` a second */
    HIL_FAULT_SCALED = 10,  /* it reads `value` times as much; an encoder from where it stands */
    HIL_FAULT_DELAYED = 11, /* it comes `value` [s] late, at most HIL_FAULT_LATEST readings */
    HIL_FAULT_NOISY = 12,   /* noise of rms `value` comes on top */
    HIL_FAULT_INTERMITTENT =
        13,                  /* for the first half of every `value` [s] it keeps its reading; an encoder loses counts */
    HIL_FAULT_MIRRORED = 14, /* it reads the negative; of an encoder see HIL_FAULT_REVERSED */
    HIL_FAULT_LATEST = 255,
    HIL_MAX_FAULTS = 16
};

/* Active from `begin` (included) to `end` (excluded) [s]. */
typedef struct {
    int kind;
    int channel;
    double value;
    double begin;
    double end;
} hil_fault;

typedef struct {
    int count;
    hil_fault fault[HIL_MAX_FAULTS];
} hil_faults;

/* What the faults of channels remember. */
typedef struct {
    int32_t past[HIL_CHANNELS][HIL_FAULT_LATEST + 1]; /* readings, encoders unwrapped */
    uint32_t readings[HIL_CHANNELS];
    int32_t beside[HIL_CHANNELS]; /* what an encoder has told beyond its count */
    int32_t told[HIL_CHANNELS];
    hil_random random[HIL_CHANNELS];
} hil_fault_memory;

void hil_faults_start(hil_fault_memory *memory, uint64_t seed);

/* What `channel` says where it measures `reading`, between `low` and `high`; `every`: ms from one reading to the next.
 * An encoder's reading is its 16-bit count, which wraps. */
int32_t hil_fault_reading(const hil_faults *faults, hil_fault_memory *memory, int channel, int32_t reading,
                          int32_t zero, int32_t low, int32_t high, int every, double time);

/* First active fault of a kind (and channel, unless -1), or NULL. */
const hil_fault *hil_fault_active(const hil_faults *faults, int kind, int channel, double time);

#endif
