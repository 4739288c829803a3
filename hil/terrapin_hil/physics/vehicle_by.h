/* The exact derivatives of the car's rates (vehicle.h), by its state and along neighbours.
 */
#ifndef HIL_VEHICLE_BY_H
#define HIL_VEHICLE_BY_H

#include "moves.h"
#include "vehicle.h"

/* Where they are asked for: `share` of the way from a sample to the next, with the torque of a rear half shaft [N m]
 * there, the wheels' angles [rad], and the sinkages that carry the wheels' loads [m]. */
typedef struct {
    const hil_vehicle_effects *effects;
    int sample;
    double share;
    double torque;
    const double *state;   /* HIL_VEHICLE_STATE */
    const double *angle;   /* front, rear */
    const double *sinkage; /* front, rear */
} hil_vehicle_point;

/* by: of each rate of the state, its moves; directions are the states, the two angles, then the columns of `moves`.
 * apart (columns) is set where a neighbour's tyre is another one, of which the contact's derivatives do not tell. */
void hil_vehicle_derive(const hil_vehicle_point *point, hil_moves *moves, double by[HIL_VEHICLE_STATE][HIL_MOVES_WIDTH],
                        unsigned char *apart);

#endif
