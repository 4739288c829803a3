/* The rolling body on ground that slips: three degrees of freedom (x, beta, alpha), set-valued dry friction.
 *
 *     T = 1/2 m x'^2 + 1/2 I_c beta'^2 + 1/2 I_r (beta' + (R-r)/r alpha')^2 + 1/2 S phi'^2 + m* x' phi' cos(phi -
 * slope) V = g m* (1 - cos phi) + g m height(x),        phi = alpha - beta,  S = I_a + m_a h^2 + m_r (R-r)^2 Forces: x:
 * H - weight's share - rut - carriage; beta: -C_r - R H; alpha: (R/r) C_m - C_o. Constrained to x = R beta this is the
 * pure rolling of rolling.h. The torque on the shell at the contact is T = C_r + R H.
 *
 * Method: velocity-level time stepping (Moreau 1988). Smooth forces at the extrapolated middle of the step, the stiff
 * traction H implicitly, and the three dry frictions as impulses bounded by friction times step: at standstill they
 * take whatever value keeps the rate at zero. Which of them do is guessed from the step before and mended until nothing
 * contradicts it; should that not end, projected Gauss-Seidel does. First order at the instants where a
 * friction switches or the slip is stiff, second order in between; one step never adds energy through friction.
 */
#ifndef HIL_BODY_H
#define HIL_BODY_H

#include "effects.h"
#include "ground.h"
#include "robot.h"

enum { HIL_X = 0, HIL_BETA = 1, HIL_ALPHA = 2 };

typedef struct {
    double position[3]; /* x [m], beta, alpha [rad] */
    double rate[3];
    double acceleration[3];   /* of the last step; predicts the middle of the next */
    double friction[3];       /* rut [N], C_r [N m], dry part of C_o [N m]: positive when it resists positive motion */
    double traction;          /* H [N] */
    double carriage_force;    /* that the carriage exerts on the axle, along x [N] */
    double internal_friction; /* C_o as a whole [N m] */
    double current;           /* motor, at the end of the step [A] */
    double motor_torque;      /* C_m [N m] */
    double rut;               /* depth d, 0..1 */
    double dug;               /* on a contact model's ground: depth of the rut beyond the sinkage [m] */
    double load;              /* normal to the ground [N] */
    double ground_torque;     /* active effects on the shell [N m], part of the contact torque */
    double sinkage;           /* on a contact model's ground [m], else 0 */
} hil_body;

/* What acts from outside during one step. */
typedef struct {
    hil_drive drive;
    double tow;         /* load that the axle tows: a dry friction [N] */
    double temperature; /* winding [degC] */
    double time;        /* at the start of the step [s] */
    double pass;
    double moisture;
    bool carried;          /* the axle's speed is imposed */
    double carriage_speed; /* at the end of the step [m/s] */
} hil_surroundings;

/* Advances `body` by dt [s]. Bounded work. */
void hil_body_step(const hil_robot *robot, const hil_robot_derived *derived, const hil_path *path,
                   const hil_effects *effects, const hil_surroundings *around, double dt, hil_body *body);

/* Mass matrix (row by row) and smooth generalised forces without drive, friction and traction, for tests. */
void hil_body_matrices(const hil_robot *robot, const hil_ground *ground, const double *position, const double *rate,
                       double *mass, double *force);

/* Denominator of the slip is held above this [m/s]: below it the contact creeps instead of slipping. */
#define HIL_SLIP_FLOOR 1e-4

#endif
