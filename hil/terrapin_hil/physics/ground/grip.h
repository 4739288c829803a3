/* Ground as a contact model has it: forces on the shell from tables over load and slip, made when a run starts.
 *
 * The integrals of contact.h at load equilibrium give, for a shell that rolls forwards, the soil's thrust F = int tau
 * cos, its compaction resistance X = int sigma sin, the torque T and the sinkage z. Drawbar pull is F - X. In the plant
 * F is the traction (implicit in the slip, along x and -R beta), X a dry friction on the axle, set-valued at rest, and
 * T - R F a small torque on the shell. Slip is the plant's (R omega - v) / max(|R omega|, |v|); the integrals take v =
 * R omega (1 - i), so that braking s = i / (1 - i).
 * The tables are for forward rolling and mirrored for backward; which it is, is the direction of the faster of rim and
 * axle, passing over within +-1 mm/s. Sinkage is always that of equilibrium at the present load and slip, and stays as
 * it is at rest: the ground has no memory of a rut that was left [our simplification].
 */
#ifndef HIL_GRIP_H
#define HIL_GRIP_H

#include "bulldozing.h"

enum { HIL_THRUST = 0, HIL_COMPACTION = 1, HIL_LEVER = 2, HIL_SINKAGE = 3, HIL_GRIP_VALUES = 4 };

/* Cubic Hermite in slip, linear in load. */
typedef struct {
    int loads;                 /* rows, 1 or more */
    int slips;                 /* nodes from -1 to 1, equally spaced */
    double load_low;           /* of the first row [N] */
    double load_step;          /* [N] */
    const double *row;         /* loads x slips x HIL_GRIP_VALUES x (value, derivative by slip) */
    hil_bulldozing bulldozing; /* of this soil; both strengths 0 where nothing is pushed ahead */
} hil_grip_table;

/* The table in one step of the plant, or two tables where one soil passes over into the next. */
typedef struct {
    const hil_grip_table *table;
    double load;      /* [N] */
    double direction; /* -1 backwards to 1 forwards */
    double scale;     /* slip speed over slip [m/s] */
    const hil_grip_table *last;
    double share_of_last; /* 0: `table` alone */
} hil_grip;

/* What rim R omega and axle v see, the denominator of the slip held above `floor` [m/s]. */
hil_grip hil_grip_at(const hil_grip_table *table, double load, double rim_speed, double axle_speed, double floor);

/* One of the values at a slip speed R omega - v [m/s], signed along x (compaction and sinkage: their size), and its
 * derivative by the slip speed. */
double hil_grip_value(const hil_grip *grip, int value, double slip_speed, double *derivative);

/* Bulldozing resistance [N] of the soil, or of both in their shares, at a depth [m]. */
double hil_grip_bulldozing(const hil_grip *grip, double depth);

#endif
