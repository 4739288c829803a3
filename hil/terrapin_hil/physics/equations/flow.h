/* Differential equations of any law, x' = f(t, x), over the samples of a run, with what follows the states: columns
 * S' = a S + b, exact derivatives or small changes.
 *
 * Dormand and Prince's method of order 5 with its embedded error of order 4 (J. Comp. Appl. Math. 6, 1980, 19-26), its
 * step controlled within each interval between samples and never across one, for inputs have corners there. The
 * columns follow each accepted step by Runge and Kutta's method of order 4, along the law's derivatives at its ends and
 * in its middle; where the motion is faster than the step, in parts.
 */
#ifndef HIL_FLOW_H
#define HIL_FLOW_H

#include "ode.h"

enum { HIL_FLOW_STATES = 10, HIL_FLOW_STAGES = 7 };

/* Derivatives of the rates at one point: by the states, and what the columns add. */
typedef struct {
    double a[HIL_FLOW_STATES][HIL_FLOW_STATES];
    double b[HIL_FLOW_STATES][HIL_ODE_COLUMNS];
} hil_around;

/* A law over `time`. `rates` and `derive` look at `share` of the way from a sample to the next. `settle`, or NULL, may
 * move a state where an accepted step has left it (a clamp) and says whether it did. */
typedef struct {
    int states;  /* at most HIL_FLOW_STATES */
    int columns; /* at most HIL_ODE_COLUMNS; 0: the states alone */
    const double *time;
    double relative;        /* tolerance of a step */
    const double *absolute; /* the same, for each state */
    double bound;           /* a state beyond it has left all bounds */
    int jumps;              /* the rates jump at samples */
    void *law;
    void (*rates)(void *law, int sample, double share, const double *state, double *found);
    void (*derive)(void *law, int sample, double share, const double *state, hil_around *found);
    int (*settle)(void *law, double *state, double by[HIL_FLOW_STATES][HIL_ODE_COLUMNS]);
    const double *size;  /* of each state, where they differ by units; or NULL */
    const double *shape; /* samples x columns, linear between samples, or NULL: with it the law derives one column, and
                            column c is that one times shape c */
} hil_flow;

/* A solution on its way. `known`: whether rate[0] and point[0] are those of the present state; a next step begins where
 * the last one ended. `step` [s] is the one to try next. */
typedef struct {
    double state[HIL_FLOW_STATES];
    double by[HIL_FLOW_STATES][HIL_ODE_COLUMNS];
    double rate[HIL_FLOW_STAGES][HIL_FLOW_STATES];
    hil_around point[3]; /* at the begin, in the middle and at the end of a step */
    double step;
    int known;
    int left; /* steps that the stretch may still take */
} hil_way;

/* Begins at a state, with columns that are 0. */
void hil_flow_begin(const hil_flow *flow, const double *state, hil_way *way);

/* Rates and derivatives at the sample that the way has reached, in rate[0] and point[0], for the interval after it;
 * they are those of the step that ended there, unless the rates jump. */
void hil_flow_arrive(const hil_flow *flow, int sample, hil_way *way);

/* Goes through the interval after `sample`. */
hil_ode_end hil_flow_interval(const hil_flow *flow, int sample, hil_way *way);

#endif
