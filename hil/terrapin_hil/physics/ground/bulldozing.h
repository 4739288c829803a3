/* Sand that a sphere or a wheel pushes ahead of itself, for any depth of its lowest point.
 *
 *     R_c = int (0.67 c K_l z + 1/2 gamma K_g z^2) dx      over the width that is below the surface
 *
 * Li et al. 2024, Eq. 8, in closed form: z = sqrt(R^2 - x^2) - (R - depth) under a sphere, the depth under all of a
 * wheel. Deeper than the soil was measured to, it is an extrapolation.
 */
#ifndef HIL_BULLDOZING_H
#define HIL_BULLDOZING_H

typedef struct {
    double radius;     /* [m] */
    double width;      /* of a wheel [m]; 0: a sphere */
    double cohesive;   /* 0.67 c K_l [Pa] */
    double frictional; /* gamma K_g [N/m^3] */
} hil_bulldozing;

/* R_c [N] at a depth [m]; below 0 none, beyond the axle that at the axle. */
double hil_bulldozing_resistance(const hil_bulldozing *sand, double depth);

#endif
