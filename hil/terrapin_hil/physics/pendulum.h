/* A sphere that is driven by a pendulum inside it (Li et al. 2024, Eq. 11), rolling straight on a slope gamma.
 *
 * Coordinates: theta [rad] of the shell, phi [rad] of the pendulum from the vertical, bob forward (uphill) positive;
 * the joint between them has turned by psi = theta + phi, and T [N m] acts there.
 *
 *     (a R^2) theta'' + R m3 l cos(phi - g) phi'' - R m3 l sin(phi - g) phi'^2 + R M g sin g + C sgn(theta')
 *         + [mu psi'] = T,          a = m1 + m2 + m3 + I1/R^2,   C = f_o R M g cos g
 *     R m3 l cos(phi - g) theta'' + (m3 l^2 + I2 + I3) phi'' + m3 g l sin(phi) + mu psi' = T
 *
 * The bracket is missing in the print: with it friction in the joint is internal, as it must be. The paper has 5/3 m1
 * for m1 + I1/R^2, a thin shell. f_o is mu' where that is a number, mu'/R where it is a length. sgn is tanh(theta' /
 * smoothing).
 */
#ifndef HIL_PENDULUM_H
#define HIL_PENDULUM_H

typedef struct {
    double radius;        /* R [m] */
    double shell_mass;    /* m1 [kg] */
    double frame_mass;    /* m2 */
    double bob_mass;      /* m3 */
    double length;        /* l [m] */
    double shell_inertia; /* I1 [kg m^2] */
    double frame_inertia; /* I2 */
    double bob_inertia;   /* I3 */
    double gravity;       /* [m/s^2] */
    double viscous;       /* mu of the joint [N m s] */
    double shell_share;   /* of the joint's friction that the shell feels: 1, or 0 as printed */
    double f_o;           /* rolling friction: C = f_o R M g cos g */
    double slip;          /* steady slip of the shell on soft ground: v = R theta' (1 - slip) */
    double slope;         /* gamma of the ground [rad] */
    double smoothing;     /* [rad/s] */
} hil_pendulum;

/* Motion: phi, theta [rad], their rates [rad/s]. */
typedef struct {
    double swing;
    double angle;
    double swing_rate;
    double angle_rate;
} hil_pendulum_state;

/* Extra torques [N m]: `ground` resists the shell, and grows by `ground_inertia` [kg m^2] times theta''. */
typedef struct {
    double ground;
    double ground_inertia;
} hil_pendulum_around;

/* phi'' when the joint is made to turn with psi'' [rad/s^2]; *angle_acceleration is theta'' = psi'' - phi'', *torque
 * the T [N m] which that takes. */
double hil_pendulum_driven(const hil_pendulum *pendulum, const hil_pendulum_around *around,
                           const hil_pendulum_state *state, double joint_acceleration, double *angle_acceleration,
                           double *torque);

/* Everything that a driven motion depends on, but the joint's acceleration. */
typedef struct {
    hil_pendulum pendulum;
    hil_pendulum_around around;
    hil_pendulum_state state;
} hil_pendulum_inputs;

/* Derivatives of theta'' and T of hil_pendulum_driven by all inputs, each at the input's own place. */
void hil_pendulum_gradient(const hil_pendulum_inputs *at, double joint_acceleration, hil_pendulum_inputs by[2]);

/* accelerations[0] = phi'', [1] = theta'' under a torque T [N m] at the joint. */
void hil_pendulum_free(const hil_pendulum *pendulum, const hil_pendulum_around *around, const hil_pendulum_state *state,
                       double torque, double *accelerations);

/* Mechanical energy without that of height [J], zero at rest with the bob below. */
double hil_pendulum_energy(const hil_pendulum *pendulum, const hil_pendulum_state *state);

#endif
