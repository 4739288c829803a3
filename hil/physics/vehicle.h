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

/* `samples` records at k * period from standstill; torque [N m] of one rear half shaft at these instants, linear
 * between them; `substeps` steps a sample. record: samples x 9. sensitivity: samples x 9 x 5, derivatives by the soil's
 * five numbers (0 for the sinkages), or NULL. Returns HIL_TYRE_OK, or what failed, with *failure set; record is then
 * incomplete. A step is too long where it exceeds half the relaxation time. */
int hil_vehicle_run(const hil_vehicle *vehicle, const hil_tyre *tyre, const hil_tyre_soil *soil, int samples,
                    double period, int substeps, const double *torque, double *record, double *sensitivity,
                    hil_vehicle_failure *failure);

#endif
