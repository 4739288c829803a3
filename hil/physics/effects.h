/* Effects that a scenario adds to the plant, compiled from their one-line expressions (hil/physics/effects).
 *
 * A function is called once a step with the state as roles and writes every term that it owns. `passive` is the level
 * of a friction (the function evaluates it at the magnitude of the rate, and never at 0, where sign(0) = 0 would lose
 * the stiction), `active` a torque that resists when positive; parameter terms are relative: the parameter is
 * multiplied by 1 + term.
 */
#ifndef HIL_EFFECTS_H
#define HIL_EFFECTS_H

typedef struct {
    double time;  /* [s] */
    double omega; /* rate on which the effect acts: alpha_dot inside the robot, beta_dot on the ground [rad/s] */
    double angle; /* [rad] */
    double slip;
    double speed;       /* axle [m/s] */
    double load;        /* normal to the ground [N] */
    double slope;       /* [rad] */
    double temperature; /* winding [degC] */
    double voltage;     /* at the motor [V] */
    double pass;
    double moisture;
} hil_roles;

typedef struct {
    double passive; /* [N m] */
    double active;  /* [N m] */
    double torque_constant;
    double armature_resistance;
    double coulomb;
    double viscous;
    double f_o;
} hil_terms;

typedef void (*hil_effect_function)(const hil_roles *roles, hil_terms *terms);

/* The two functions of a compiled set of effects. */
void hil_effect_robot(const hil_roles *roles, hil_terms *terms);
void hil_effect_ground(const hil_roles *roles, hil_terms *terms);

/* Either may be NULL. `inertial` says that some active term depends (linearly) on the acceleration, which then joins
 * the mass matrix instead of being taken from the step before. */
typedef struct {
    hil_effect_function robot;
    hil_effect_function ground;
    int robot_inertial;
    int ground_inertial;
} hil_effects;

#endif
