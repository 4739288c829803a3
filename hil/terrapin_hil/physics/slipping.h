/* A rolling body on ground that slips, as a model of measurements: body.h's three coordinates, integrated over the
 * samples of a run with effects switched on. Smooth friction (tanh), so that derivatives exist; inputs are linear
 * between samples.
 *
 * cylinder: hil_robot under a voltage, on the ground of ground.h (f_o, mu, s_k). sphere: Li et al. (2024), Eq. 11 with
 * the ground's forces of Eqs. 4 to 6 at the slip of each instant, as the paper says to combine them; the joint's rate
 * is commanded. Slip is (R omega - v) / max(|R omega|, |v|, R smoothing).
 */
#ifndef HIL_SLIPPING_H
#define HIL_SLIPPING_H

#include "ground.h"
#include "ode.h"
#include "program.h"

enum { HIL_SLIPPING_CYLINDER = 0, HIL_SLIPPING_SPHERE = 1 };

/* Parameters from slot HIL_ROLES on. Cylinder: those of hil_robot in its order, then these. */
enum {
    HIL_SLIPPING_F_O = HIL_ROLES + 19,
    HIL_SLIPPING_SMOOTHING = HIL_ROLES + 20, /* of sgn [rad/s] */
    HIL_SLIPPING_MU = HIL_ROLES + 21,
    HIL_SLIPPING_S_K = HIL_ROLES + 22,
    HIL_SLIPPING_VALUES = 160
};

/* Sphere: radius, masses of shell, frame and bob, length, inertias of the three, gravity, viscous friction of the
 * joint, smoothing. Of its soil the tables know. */
enum { HIL_SLIPPING_SPHERE_SMOOTHING = HIL_ROLES + 10 };

/* State: alpha (drive or joint), beta (shell) [rad], x [m], their rates. A record: the state, the second derivatives,
 * then the current [A] (cylinder) or the driving torque [N m]. */
enum { HIL_SLIPPING_STATE = 6, HIL_SLIPPING_CHANNEL = 9, HIL_SLIPPING_RECORD = 10 };

/* What drives a run: `inputs` columns (samples x inputs), each into its slot. Rising times [s]. */
typedef struct {
    int body;
    const hil_additions *additions;
    int samples;
    const double *time;
    int inputs;
    const int *slot;
    const double *input;
    int count;                         /* of the values of a table, at most HIL_SLIPPING_VALUES */
    const double *values;              /* of the run, then of its neighbours */
    const hil_grip_table *const *grip; /* for each of them, on the sphere's ground; else NULL */
} hil_slipping_run;

enum { HIL_SLIPPING_MOST_STEPS = 2000 }; /* between two samples */

/* From `start` (a row for the run and one for each neighbour) at the first sample on; `columns`, `shape`, `record` and
 * `change` as hil_dynamic_follow has them. The neighbours' derivatives are differences at one state. Steps of the
 * implicit midpoint, at most 2 ms: at standstill slip is far faster than any sample. Returns the samples that were
 * reached; rows after them stay as they were. */
int hil_slipping_follow(const hil_slipping_run *run, const double *start, int columns, const double *shape,
                        double *record, double *change);

/* Moves the swing and the travelling speed of `start`, whose shell and drive turn at one rate, to where the motion goes
 * on steadily at the first sample: the nearest there is where none does. `row` is that of the table. */
void hil_slipping_settle(const hil_slipping_run *run, int row, double *start);

#endif
