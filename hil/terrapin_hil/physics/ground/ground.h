/* The ground along the path: terrain and slope by segments, and the default law of resistance and traction.
 *
 * Resistance is Reina et al. (2006), Table 1: C_r = (f_o + f_s omega^2) R W cos(slope), passive. Net traction is of
 * Janosi type [our assumption, since no published set agrees with Table 1]:
 *     H(s) = mu W cos(slope) sgn(s) (1 - exp(-|s| / s_k)),   s = (R omega - v) / max(|R omega|, |v|)
 * Digging in [our assumption, dimensionless]: on soft ground a rut of depth d in 0..1 grows with slipped distance
 * beyond a slip and is left behind by moving: d' = |R omega - v| / dig_length * max(|s| - dig_slip, 0) (1 - d) - |v| /
 * leave_length * d Its wall resists the axle passively with a force of at most rut_friction d W, set-valued at
 * standstill.
 * On a contact model's ground the rut is a depth d [m] beyond the sinkage, and no slip is needed to begin it [our
 * assumption]: d' = (slip_depth |R omega - v| - d |v|) / ell, ell = sqrt(z (2 R - z)) the contact's length at the
 * sinkage z. Rolling steadily d = slip_depth s / (1 - s). It deepens what is pushed ahead: R_c(z + d).
 */
#ifndef HIL_GROUND_H
#define HIL_GROUND_H

#include "grip.h"

enum { HIL_MAX_SEGMENTS = 16 };

typedef struct {
    double f_o;
    double f_s;      /* [s^2/rad^2] */
    double mu;       /* greatest net traction over load */
    double s_k;      /* slip scale of the traction */
    double softness; /* 0: never digs in, 1: as above */
} hil_terrain;

typedef struct {
    double start;      /* x at which the segment begins [m]; the first reaches back without end */
    double transition; /* length over which terrain and slope pass over smoothly, from `start` on [m] */
    double slope;      /* [rad], uphill positive */
    hil_terrain terrain;
    const hil_grip_table *contact; /* instead of terrain and rut: a contact model (grip.h); else NULL */
} hil_segment;

typedef struct {
    int count; /* 1 to HIL_MAX_SEGMENTS, by rising start */
    hil_segment segment[HIL_MAX_SEGMENTS];
    double dig_length;   /* [m] */
    double leave_length; /* [m] */
    double dig_slip;     /* the slip beyond which it digs in */
    double rut_friction; /* [1] */
    double slip_depth;   /* with a contact model [m]; 0: slipping digs nothing */
} hil_path;

typedef struct {
    hil_terrain terrain;
    double slope;     /* [rad] */
    double curvature; /* d slope / dx [rad/m] */
    int segment;
    double share_of_last; /* of the segment before, within a transition; else 0 */
} hil_ground;

/* What lies under the axle at x. */
hil_ground hil_path_at(const hil_path *path, double x);

/* Slip from rim speed R omega and axle speed v, with the denominator held above `floor` [m/s]. */
double hil_slip(double rim_speed, double axle_speed, double floor);

#endif
