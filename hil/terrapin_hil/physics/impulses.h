/* What the ground and dry friction do to the body within one step: three bounded friction impulses and the traction. */
#ifndef HIL_IMPULSES_H
#define HIL_IMPULSES_H

#include "grip.h"

/* One step's problem and its solution. Coordinates are x, beta, alpha; the traction acts along (1, -R, 0). */
typedef struct {
    double mass[3][3];
    double inverse[3][3]; /* of the mass matrix; rows and columns of an imposed coordinate are zero */
    double base[3];       /* velocities without any impulse: those before the step, or as imposed */
    double smooth[3];     /* impulses of the smooth forces */
    double bound[3];      /* greatest magnitudes of the dry frictions */
    double radius;
    double strength;      /* greatest traction impulse */
    double slip_scale;    /* slip speed R beta' - x' at which the traction has grown to 63 % */
    const hil_grip *grip; /* instead of these two: a contact model; else NULL */
    double dt;            /* for it [s] */
    /* the solution */
    double friction[3];
    double traction;
    double velocity[3];
} hil_impulses;

/* Solves for frictions, traction and velocities. `rate` is that before the step: what stood still exactly is guessed to
 * stick, what moved to slide on; a guess that contradicts itself is mended, and should that not end, projected
 * Gauss-Seidel decides. A coordinate that sticks ends with a velocity of exactly 0. Bounded work. */
void hil_impulses_solve(hil_impulses *step, const double *rate);

/* Inverse of a symmetric positive definite 3 x 3 matrix. */
void hil_invert3(const double m[3][3], double inverse[3][3]);

/* The same with the first coordinate imposed: its row and column are zero. */
void hil_invert2(const double m[3][3], double inverse[3][3]);

#endif
