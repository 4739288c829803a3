/* Pure rolling: x = R beta holds exactly. Two degrees of freedom (beta, alpha), smooth tanh friction, RK4.
 *
 * Source: Reina et al. (2006) Eqs. 3-8, with the corrections that Lagrange's equations demand: a sum in M22, the lost
 * parentheses in h1 and h2, the relative rate in the back-EMF. Kept for reference: the simulator's own ground is
 * body.h.
 */
#ifndef HIL_ROLLING_H
#define HIL_ROLLING_H

#include "robot.h"

typedef struct {
    double beta;
    double alpha;
    double beta_rate;
    double alpha_rate;
} hil_rolling_state;

typedef struct {
    double voltage;   /* at the motor [V] */
    double f_o;       /* rolling resistance coefficient */
    double f_s;       /* its rise with speed squared [s^2/rad^2] */
    double smoothing; /* sign(w) is tanh(w / smoothing) [rad/s] */
} hil_rolling_load;

/* Torques of one state [N m]. */
typedef struct {
    double motor;             /* C_m at the drive wheel */
    double internal_friction; /* C_o, what the gear loses among it */
    double resistance;        /* C_r */
} hil_rolling_torques;

hil_rolling_torques hil_rolling_evaluate(const hil_robot *robot, const hil_rolling_load *load,
                                         const hil_rolling_state *state);

/* Accelerations under torques on beta and alpha (gravity and the swing's own come on top), with `inertia` [kg m^2]
 * added to the two coordinates. */
void hil_rolling_respond(const hil_robot *robot, const hil_rolling_state *state, const double *torque,
                         const double *inertia, double *accelerations);

/* Everything that a motion depends on. `torque` on beta and alpha adds to what the robot itself has there. */
typedef struct {
    hil_robot robot;
    hil_rolling_load load;
    hil_rolling_state state;
    double torque[2];
    double inertia[2];
} hil_rolling_inputs;

/* Derivatives of both accelerations and of the motor's current [A] by all inputs, each at the input's own place. The
 * accelerations are those at the inputs. */
void hil_rolling_gradient(const hil_rolling_inputs *at, const double *accelerations, hil_rolling_inputs by[3]);

/* accelerations[0] = beta_dd, [1] = alpha_dd [rad/s^2]. */
void hil_rolling_accelerations(const hil_robot *robot, const hil_rolling_load *load, const hil_rolling_state *state,
                               double *accelerations);

/* `steps` steps of classical RK4, each of `dt` seconds; error O(dt^4). */
void hil_rolling_run(const hil_robot *robot, const hil_rolling_load *load, double dt, int steps,
                     hil_rolling_state *state);

/* Mechanical energy [J], zero at rest with the bob below. */
double hil_rolling_energy(const hil_robot *robot, const hil_rolling_state *state);

/* dP/dt [N m] for given accelerations; P = (M11 + M12) beta_dot + (M12 + M22) alpha_dot. Exactly equal to
 * (R/r) C_m - C_o - C_r, at any time, because energy depends on alpha - beta only. */
double hil_rolling_momentum_rate(const hil_robot *robot, const hil_rolling_state *state, const double *accelerations);

#endif
