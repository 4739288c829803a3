/* The rolling robots as models of measurements: integrated over the samples of a run, with effects switched on.
 *
 * cmr: pure rolling (rolling.h); in: voltage. pendulum_sphere: pendulum.h, the joint's rate commanded; in: joint rate.
 * Inputs are linear between samples. For the car see vehicle.h.
 */
#ifndef HIL_DYNAMIC_H
#define HIL_DYNAMIC_H

#include "ode.h"
#include "program.h"

enum { HIL_DYNAMIC_CMR = 0, HIL_DYNAMIC_PENDULUM = 1 };

/* Parameters from slot HIL_ROLES on: for cmr those of hil_robot in its order, then f_o and the smoothing of sgn
 * [rad/s]; for pendulum_sphere those of
 * hil_pendulum. Further slots are the effects' own. */
enum {
    HIL_DYNAMIC_F_O = HIL_ROLES + 19,
    HIL_DYNAMIC_SMOOTHING = HIL_ROLES + 20,
    HIL_DYNAMIC_VALUES = 160,
    HIL_DYNAMIC_COLUMNS = HIL_ODE_COLUMNS
};

/* A record: the state, its second derivatives, then the current [A] (cmr) or the driving torque [N m]. State of cmr:
 * alpha (drive), beta (shell), their rates. Of pendulum_sphere: psi (joint), theta (shell), their rates. */
enum { HIL_DYNAMIC_STATE = 4, HIL_DYNAMIC_CHANNEL = 6, HIL_DYNAMIC_RECORD = 7 };

/* What drives a run: `inputs` columns (samples x inputs), each into its slot. Rising times [s]. */
typedef struct {
    int samples;
    const double *time;
    int inputs;
    const int *slot;
    const double *input;
} hil_drive_record;

/* Runs from `start` at the first sample on, by steps of flow.h that keep the error of each within 1e-8. `values` (count
 * <= HIL_DYNAMIC_VALUES) holds parameters and constants at their slots. `values` and `start` have a row for the run
 * itself and one for each of `columns` (at most HIL_DYNAMIC_COLUMNS) neighbours; with `shape`, samples x columns and
 * linear between samples, for one neighbour, whose values differ so many times as much in each column.
 *
 * record: samples x HIL_DYNAMIC_RECORD. change, columns x samples x HIL_DYNAMIC_RECORD: what a neighbour's record has
 * more than the run's, to first order in the states. Rows after a failure stay as they were. */
hil_ode_end hil_dynamic_follow(int base, const hil_additions *additions, const hil_drive_record *drive, int count,
                               const double *values, const double *start, int columns, const double *shape,
                               double *record, double *change);

/* Swing phi [rad], between -pi/2 and pi/2, at which the motion of `start` (rates of shell and drive or joint) goes on
 * with the swing at rest at the first sample; the nearest there is where none does. */
double hil_dynamic_steady_swing(int base, const hil_additions *additions, const hil_drive_record *drive, int count,
                                const double *values, const double *start);

#endif
