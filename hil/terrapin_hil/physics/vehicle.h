/* Five degrees of freedom of a car that drives straight on soft soil (Vella et al. 2024, Eqs. 1-4): torque in, wheel
 * speeds out.
 *
 *     m a_x = sum F_x - B V^2                      (1)      J_w omega' = T - M_y per wheel                      (2)
 *     F_z = m g b/(2 L) - m a_x h/(2 L) in front, m g a/(2 L) + m a_x h/(2 L) behind    (3, with the 1/2 that the print
 * lacks) T_front = T_rear F_z,front / F_z,rear        (4)      F' = max(|V|, |R_e omega|, v0)/lambda (F_steady - F) for
 * F_x and M_y Left and right wheels are equal, so one wheel of each axle is computed. RK4, fixed step; after each step
 * V and omega are held at >= 0, wheel loads are held at >= load_floor. Derivatives are exact for this scheme where no
 * clamp switches.
 */
#ifndef HIL_VEHICLE_H
#define HIL_VEHICLE_H

#include "program.h"
#include "tyre.h"

typedef struct {
    double mass;              /* m [kg] */
    double gravity;           /* [m/s^2] */
    double drag;              /* B [N s^2/m^2] */
    double front_distance;    /* a, front axle to the centre of gravity [m] */
    double rear_distance;     /* b [m] */
    double height;            /* h of the centre of gravity [m] */
    double wheel_inertia;     /* J_w [kg m^2] */
    double relaxation_length; /* lambda [m] */
    double speed_floor;       /* v0: regularises slip and relaxation at standstill [m/s] */
    double load_floor;        /* least wheel load [N] */
} hil_vehicle;

/* Columns of a record. */
enum {
    HIL_VEHICLE_SPEED = 0,  /* V [m/s] */
    HIL_VEHICLE_OMEGA = 1,  /* front, rear [rad/s] */
    HIL_VEHICLE_FORCE = 3,  /* F_x, relaxed [N] */
    HIL_VEHICLE_TORQUE = 5, /* M_y, relaxed [N m] */
    HIL_VEHICLE_SINKAGE = 7 /* z of the last contact that was solved [m] */
};
#define HIL_VEHICLE_STATE  7
#define HIL_VEHICLE_RECORD 9
#define HIL_VEHICLE_SOIL   5

/* Where a run stopped: time [s], axle (0 front, 1 rear), wheel load [N], slip, and the longest step allowed there [s].
 */
typedef struct {
    double time;
    int axle;
    double load;
    double slip;
    double longest_step;
} hil_vehicle_failure;

/* Effects on a run: terms, and a table of `count` values (at most HIL_VEHICLE_VALUES) in which the car's numbers stand
 * from slot HIL_ROLES on, the tyre's and the soil's after them, then whatever the terms use; `inputs` columns of
 * `input` (samples x inputs) go into their slots, linear between samples.
 *
 * Terms that change a parameter act on each axle with its own wheel's roles (omega, angle, slip, load, pass: the rear
 * wheels roll in the front wheels' ruts; speed held above speed_floor) and on the car with those of the rear axle and
 * its whole weight as load. A torque at the ground resists the car by torque / tyre radius, one in the drive each
 * wheel.
 */
typedef struct {
    const hil_additions *additions;
    int count;
    const double *values;
    int inputs;
    const int *slot;
    const double *input;
} hil_vehicle_effects;

enum {
    HIL_VEHICLE_CAR = HIL_ROLES,
    HIL_VEHICLE_TYRE = HIL_ROLES + 10,
    HIL_VEHICLE_GROUND = HIL_ROLES + 15,
    HIL_VEHICLE_VALUES = 160
};

/* `samples` records at k * period, from standstill or rolling without slip at `start` [rad/s]; torque [N m] of one rear
 * half shaft at these instants, linear between them; `substeps` steps a sample. record: samples x 9. sensitivity:
 * samples x 9 x 5, derivatives by the soil's five numbers (0 for the sinkages), or NULL; they do not know of effects,
 * which then must be NULL too. Returns HIL_TYRE_OK, or what failed, with *failure set; record is then incomplete. A
 * step is too long where it exceeds half the relaxation time. */
int hil_vehicle_run(const hil_vehicle *vehicle, const hil_tyre *tyre, const hil_tyre_soil *soil, int samples,
                    double period, int substeps, const double *torque, double start, const hil_vehicle_effects *effects,
                    double *record, double *sensitivity, hil_vehicle_failure *failure);

/* The same car over `time` (samples, rising), by steps of flow.h that keep the error of each within 1e-7, with what
 * neighbouring values change. `effects` has a row of values for the run and one for each of `columns` (at most
 * HIL_ODE_COLUMNS) neighbours; its terms may be none. With `shape`, samples x columns and linear between samples, there
 * is one neighbour, whose values differ so many times as much in each column. record as above; change, columns x
 * samples x 9: what a neighbour's record has more than the run's, to first order (0 for the sinkages). Rows after a
 * failure stay as they were. */
int hil_vehicle_follow(const hil_vehicle_effects *effects, int samples, const double *time, const double *torque,
                       double start, int columns, const double *shape, double *record, double *change);

#endif
