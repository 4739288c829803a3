/* Differential equations of the user's own: x' = f(t, x, inputs, parameters), channels y = h(...), both as formulas
 * (program.h), with exact derivatives by forward sensitivities.
 *
 * flow.h integrates.
 */
#ifndef HIL_ODE_H
#define HIL_ODE_H

#include "program.h"

enum { HIL_ODE_STATES = 8, HIL_ODE_COLUMNS = 64, HIL_ODE_VALUES = 256 };

/* Steps between two samples, and on average over a stretch. */
enum { HIL_ODE_MOST_STEPS = 2000, HIL_ODE_MEAN_STEPS = 200 };

/* Slots of the values: 0 is the time, 1 .. states the states, the others as the caller likes. */
typedef struct {
    int states;   /* at most HIL_ODE_STATES */
    int channels; /* measured quantities */
    int values;   /* slots in all, at most HIL_ODE_VALUES */
    int free;     /* parameters to take derivatives by; states + free is at most HIL_ODE_COLUMNS */
    const int *free_slot;
    const hil_instruction *code;
    const int *begin; /* of each formula: the states' derivatives, then the channels */
    const int *count;
    double smoothing;       /* of sign() */
    double relative;        /* tolerance of a step */
    const double *absolute; /* the same, for each state */
    double bound;           /* a state beyond it has left all bounds */
    int held;               /* inputs hold their value until the next sample; else they are linear between samples */
} hil_ode;

/* Samples in stretches: stretch i has those from begin[i] up to begin[i + 1], and a start of its own. */
typedef struct {
    int stretches;
    const int *begin;   /* stretches + 1 */
    const double *time; /* of each sample, rising within a stretch */
    int inputs;
    const int *slot;
    const double *input; /* samples x inputs */
} hil_ode_drive;

/* How a stretch ended. */
enum { HIL_ODE_DONE, HIL_ODE_UNBOUNDED, HIL_ODE_STIFF };

typedef struct {
    int kind;
    int state;   /* the one that left its bounds, or whose error kept the steps small */
    double time; /* when */
    int steps;   /* that were tried */
} hil_ode_end;

/* Integrates each stretch for which `wanted` (stretches) is not 0 from its row of `start` (stretches x states) at its
 * first sample on; end (stretches) says how. `values` holds parameters and constants at their slots.
 *
 * state: samples x states. channel: samples x channels. slope, or NULL: samples x channels x (states + free), the
 * channels' derivatives by the stretch's start and by the free parameters. What lies after a failure, or in a stretch
 * that is not wanted, is left as it was. */
void hil_ode_run(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *start,
                 const unsigned char *wanted, double *state, double *channel, double *slope, hil_ode_end *end);

/* What additions to the derivative of one state change, near a solution: `record`, samples x states x (states + 2),
 * has for each interval after a sample the states' change by the states at its begin, and by an addition to the
 * derivative of `target` of 1 at its begin that falls to 0 at its end, and of one that rises from 0 to 1. `output`,
 * samples x channels x states, has the channels' derivatives by the states. `state` comes from hil_ode_run. How the
 * first stretch ended that has no such neighbourhood; HIL_ODE_DONE if all have one. */
hil_ode_end hil_ode_linear(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *state,
                           int target, double *record, double *output);

/* channel (samples x channels) changes by an addition (samples, linear between) to the derivative that `record` and
 * `output` were made for; the starts stay. */
void hil_ode_respond(const hil_ode *ode, const hil_ode_drive *drive, const double *record, const double *output,
                     const double *addition, double *channel);

#endif
