/* The cylindrical mobile robot: its constants and its drive (Reina et al. 2006, as corrected).
 *
 * Coordinates: x [m] of the axle along the ground, beta [rad] of the shell, alpha [rad] of the inner body with its
 * drive wheel, phi = alpha - beta the swing angle from the vertical, bob forward positive. SI units throughout.
 */
#ifndef HIL_ROBOT_H
#define HIL_ROBOT_H

#include <stdbool.h>

typedef struct {
    double radius;              /* R, shell */
    double drive_radius;        /* r, drive wheel, which rolls inside the shell */
    double arm;                 /* h, axle to the centre of the inner body */
    double shell_mass;          /* m_c */
    double body_mass;           /* m_a */
    double drive_mass;          /* m_r */
    double shell_inertia;       /* I_c [kg m^2] */
    double body_inertia;        /* I_a */
    double drive_inertia;       /* I_r */
    double gravity;             /* g */
    double torque_constant;     /* K_e = K_t [N m/A = V s/rad] at the drive wheel, gear included */
    double armature_resistance; /* R_e [ohm] at the reference temperature */
    double resistance_slope;    /* rise of the armature resistance with temperature [1/K] */
    double coulomb;             /* A [N m], internal friction on alpha_dot */
    double viscous;             /* B [N m s/rad] */
    double gear_efficiency;     /* eta, above 0 and at most 1: share of the torque that the motor's side hands on, */
    double driven_ratio;        /* and the share that comes through when the load drives, over this one */
    double motor_coulomb;       /* dry friction before the gear, as a torque on alpha [N m], */
    double motor_viscous;       /* and viscous friction there [N m s/rad] */
} hil_robot;

/* What follows from the constants alone. */
typedef struct {
    double mass;          /* all of it */
    double weight;        /* W [N] */
    double imbalance;     /* m* = (R - r) m_r + h m_a [kg m] */
    double swing_inertia; /* I_a + m_a h^2 + m_r (R - r)^2 */
    double gear;          /* R / r */
    double roll;          /* (R - r) / r: absolute turns of the drive wheel for one of alpha */
} hil_robot_derived;

hil_robot_derived hil_robot_derive(const hil_robot *robot);

/* Electrical state of the drive during one step. */
typedef struct {
    bool enabled;               /* false: bridge open, no current */
    double duty;                /* -1 to 1 */
    double supply;              /* open-circuit supply voltage [V] */
    double supply_resistance;   /* [ohm] */
    double armature_resistance; /* at the present temperature [ohm] */
    double torque_constant;     /* as it is now [N m/A] */
} hil_drive;

/* Motor current [A]. The supply sags by its internal resistance times duty times this current. The back-EMF comes from
 * the relative rate (R/r) alpha_dot, the rate against which the motor works. */
double hil_motor_current(const hil_drive *drive, double gear, double alpha_rate);

/* What the gear makes of the motor's torque on alpha. It loses a share of what it passes on: of positive motion the
 * torque behind it is `middle - half`, of negative motion `middle + half`, at rest anything between: a dry friction
 * that grows with the load. The rotor's own inertia counts as behind the gear. */
typedef struct {
    double middle; /* [N m] */
    double half;   /* [N m], never negative */
} hil_geared;

/* `torque` is (R/r) C_m [N m], `alpha_rate` the rate for the viscous friction before the gear [rad/s]. */
hil_geared hil_gear_passes(const hil_robot *robot, double torque, double alpha_rate);

#endif
