/* Faults that a scenario injects over time. */
#ifndef HIL_FAULTS_H
#define HIL_FAULTS_H

#include <stdbool.h>

enum {
    HIL_FAULT_STUCK = 0,           /* `channel` keeps its last reading */
    HIL_FAULT_FORCED = 1,          /* `channel`, an ADC, reads the code `value` */
    HIL_FAULT_ABSENT = 2,          /* `channel`, a digital one, is no longer valid */
    HIL_FAULT_LOST_COUNTS = 3,     /* `channel`, an encoder, loses a count with probability `value` */
    HIL_FAULT_ESTOP = 4,           /* emergency stop pressed, or its wire broken: the input reads the same */
    HIL_FAULT_SUPPLY = 5,          /* supply voltage is `value` [V] */
    HIL_FAULT_COMMAND_SILENCE = 6, /* no COMMAND frames */
    HIL_FAULT_LINK_SILENCE = 7,    /* no frames at all: the controller does not step, the bridge holds its duty */
    HIL_FAULT_REVERSED = 8,        /* `channel`, an encoder, counts backwards from now on */
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

/* First active fault of a kind (and channel, unless -1), or NULL. */
const hil_fault *hil_fault_active(const hil_faults *faults, int kind, int channel, double time);

#endif
