#include "body.h"

#include <math.h>
#include <string.h>

#include "extremes.h"

enum { ATTEMPTS = 8, SWEEPS = 100, NEWTON = 60 };

#define GONE 1e-9 /* a rut shallower than this is left behind: without an end it would fall to denormal numbers */

/* Impulses of one step. Direction of the traction: (1, -R, 0). */
typedef struct {
    double mass[3][3];
    double inverse[3][3]; /* of the mass matrix; zero where a coordinate is imposed */
    double free[3];       /* velocities at the end of the step without friction and traction */
    double bound[3];      /* greatest magnitudes of the dry frictions */
    double friction[3];
    double traction;
    double velocity[3]; /* at the end of the step */
    double radius;
    double strength; /* greatest traction impulse */
    double scale;    /* slip speed at which the traction has grown to 63 % */
} contact;

static double clamp(double value, double bound) {
    return smaller(larger(value, -bound), bound);
}

static void matrices(const hil_robot *robot, const hil_robot_derived *d, const hil_ground *ground,
                     const double *position, const double *rate, double mass[3][3], double *force) {
    const double swing = position[HIL_ALPHA] - position[HIL_BETA];
    const double swing_rate = rate[HIL_ALPHA] - rate[HIL_BETA];
    const double sine = sin(swing);
    const double cosine = cos(swing);
    const double slope_sine = ground->slope == 0.0 ? 0.0 : sin(ground->slope);
    const double slope_cosine = ground->slope == 0.0 ? 1.0 : cos(ground->slope);
    const double along = d->imbalance * (cosine * slope_cosine + sine * slope_sine);
    const double across = d->imbalance * (sine * slope_cosine - cosine * slope_sine);
    mass[0][0] = d->mass;
    mass[0][1] = mass[1][0] = -along;
    mass[0][2] = mass[2][0] = along;
    mass[1][1] = robot->shell_inertia + d->swing_inertia + robot->drive_inertia;
    mass[1][2] = mass[2][1] = robot->drive_inertia * d->roll - d->swing_inertia;
    mass[2][2] = d->swing_inertia + robot->drive_inertia * d->roll * d->roll;
    const double restoring =
        robot->gravity * d->imbalance * sine + across * ground->curvature * rate[HIL_X] * rate[HIL_X];
    force[HIL_X] = across * swing_rate * swing_rate - d->weight * slope_sine;
    force[HIL_BETA] = restoring;
    force[HIL_ALPHA] = -restoring;
}

void hil_body_matrices(const hil_robot *robot, const hil_ground *ground, const double *position, const double *rate,
                       double *mass, double *force) {
    const hil_robot_derived d = hil_robot_derive(robot);
    double m[3][3];
    matrices(robot, &d, ground, position, rate, m, force);
    memcpy(mass, m, sizeof m);
}

static void invert3(double m[3][3], double inverse[3][3]) {
    const double a = m[1][1] * m[2][2] - m[1][2] * m[1][2];
    const double b = m[0][2] * m[1][2] - m[0][1] * m[2][2];
    const double c = m[0][1] * m[1][2] - m[0][2] * m[1][1];
    const double scale = 1.0 / (m[0][0] * a + m[0][1] * b + m[0][2] * c);
    inverse[0][0] = a * scale;
    inverse[0][1] = inverse[1][0] = b * scale;
    inverse[0][2] = inverse[2][0] = c * scale;
    inverse[1][1] = (m[0][0] * m[2][2] - m[0][2] * m[0][2]) * scale;
    inverse[1][2] = inverse[2][1] = (m[0][1] * m[0][2] - m[0][0] * m[1][2]) * scale;
    inverse[2][2] = (m[0][0] * m[1][1] - m[0][1] * m[0][1]) * scale;
}

/* With x imposed only beta and alpha answer to impulses: the row and column of x are zero. */
static void invert2(double m[3][3], double inverse[3][3]) {
    const double scale = 1.0 / (m[1][1] * m[2][2] - m[1][2] * m[1][2]);
    memset(inverse, 0, 9 * sizeof(double));
    inverse[1][1] = m[2][2] * scale;
    inverse[2][2] = m[1][1] * scale;
    inverse[1][2] = inverse[2][1] = -m[1][2] * scale;
}

/* Solves w + k (1 - exp(-w / scale)) = w_free for the slip speed w between 0 and w_free >= 0: the left side is concave
 * and rising, so that Newton's steps from the left of the root rise to it and never pass it. */
static double slip_speed(double w_free, double k, double scale, double guess) {
    double w = larger(smaller(guess, w_free), larger(w_free - k, 0.0));
    for (int i = 0; i < NEWTON; i++) {
        const double decay = exp(-w / scale);
        const double step = (w_free - w - k * (1.0 - decay)) / (1.0 + k * decay / scale);
        w = smaller(larger(w + step, 0.0), w_free);
        if (fabs(step) <= 1e-6 * scale) { /* Newton leaves less than step^2 / (2 scale) */
            break;
        }
    }
    return w;
}

/* Traction impulse when the slip speed would be w_free without it and falls by `compliance` for each unit of it. */
static double traction_impulse(const contact *c, double w_free, double compliance, double guess, double *w) {
    const double k = compliance * c->strength;
    const double size = fabs(w_free);
    if (k < 1e-9 * c->scale) { /* held by frictions: the slip does not answer to the traction */
        *w = w_free;
        return copysign(c->strength * (1.0 - exp(-size / c->scale)), w_free);
    }
    const double found = slip_speed(size, k, c->scale, fabs(guess));
    *w = copysign(found, w_free);
    return copysign((size - found) / compliance, w_free);
}

/* Velocities and traction when the coordinates in `stuck` stand still and the other frictions are as given. Each stuck
 * coordinate is eliminated from the response of the velocities (a Schur complement); then one scalar equation is left.
 */
static void solve_with(contact *c, const bool *stuck, double slip_guess) {
    double response[3][3];
    double velocity[3];
    double pull[3]; /* change of the velocities by a unit traction impulse */
    for (int i = 0; i < 3; i++) {
        velocity[i] = c->free[i];
        pull[i] = c->inverse[i][HIL_X] - c->radius * c->inverse[i][HIL_BETA];
        for (int j = 0; j < 3; j++) {
            response[i][j] = c->inverse[i][j];
            velocity[i] += stuck[j] ? 0.0 : c->inverse[i][j] * c->friction[j];
        }
    }
    for (int i = 0; i < 3; i++) {
        if (!stuck[i]) {
            continue;
        }
        const double pivot = 1.0 / response[i][i];
        for (int j = 0; j < 3; j++) {
            const double share = response[j][i] * pivot;
            if (j == i) {
                continue;
            }
            velocity[j] -= share * velocity[i];
            pull[j] -= share * pull[i];
            for (int k = 0; k < 3; k++) {
                response[j][k] -= share * response[i][k];
            }
        }
        velocity[i] = 0.0;
        pull[i] = 0.0;
        for (int j = 0; j < 3; j++) {
            response[i][j] = response[j][i] = 0.0;
        }
    }
    const double w_free = c->radius * velocity[HIL_BETA] - velocity[HIL_X];
    const double compliance = pull[HIL_X] - c->radius * pull[HIL_BETA];
    double w;
    c->traction = traction_impulse(c, w_free, compliance, slip_guess, &w);
    for (int i = 0; i < 3; i++) {
        c->velocity[i] = velocity[i] + pull[i] * c->traction;
    }
    for (int i = 0; i < 3; i++) { /* what the stuck frictions must have been: momentum that is still missing */
        if (stuck[i]) {
            double missing = i == HIL_X ? -c->traction : (i == HIL_BETA ? c->radius * c->traction : 0.0);
            for (int j = 0; j < 3; j++) {
                missing += c->mass[i][j] * (c->velocity[j] - c->free[j]);
            }
            c->friction[i] = missing;
        }
    }
}

/* Projected Gauss-Seidel over the three frictions and the traction: converges slowly, but always. */
static void solve_by_sweeps(contact *c) {
    double pull[3];
    for (int i = 0; i < 3; i++) {
        pull[i] = c->inverse[i][HIL_X] - c->radius * c->inverse[i][HIL_BETA];
        c->friction[i] = clamp(c->friction[i], c->bound[i]);
    }
    const double compliance = pull[HIL_X] - c->radius * pull[HIL_BETA];
    for (int i = 0; i < 3; i++) {
        c->velocity[i] = c->free[i] + pull[i] * c->traction;
        for (int j = 0; j < 3; j++) {
            c->velocity[i] += c->inverse[i][j] * c->friction[j];
        }
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        for (int i = 0; i < 3; i++) {
            if (c->bound[i] > 0.0 && c->inverse[i][i] > 0.0) {
                const double wanted = clamp(c->friction[i] - c->velocity[i] / c->inverse[i][i], c->bound[i]);
                const double change = wanted - c->friction[i];
                c->friction[i] = wanted;
                for (int j = 0; j < 3; j++) {
                    c->velocity[j] += c->inverse[j][i] * change;
                }
            }
        }
        double w = c->radius * c->velocity[HIL_BETA] - c->velocity[HIL_X];
        const double traction = traction_impulse(c, w + compliance * c->traction, compliance, w, &w);
        for (int j = 0; j < 3; j++) {
            c->velocity[j] += pull[j] * (traction - c->traction);
        }
        c->traction = traction;
    }
}

/* Finds frictions and traction. The first guess is that what stood still does so further and what moved slides on; a
 * guess that contradicts itself is mended and tried again. `rate` and `slip_guess` are those before the step. */
static void solve_contact(contact *c, const double *rate, double slip_guess) {
    bool stuck[3];
    for (int i = 0; i < 3; i++) {
        stuck[i] = rate[i] == 0.0 && c->bound[i] > 0.0;
        c->friction[i] = -copysign(c->bound[i], rate[i]);
    }
    for (int attempt = 0; attempt < ATTEMPTS; attempt++) {
        solve_with(c, stuck, slip_guess);
        bool consistent = true;
        for (int i = 0; i < 3; i++) {
            if (stuck[i] && fabs(c->friction[i]) > c->bound[i]) {
                c->friction[i] = clamp(c->friction[i], c->bound[i]);
                stuck[i] = false;
                consistent = false;
            } else if (!stuck[i] && c->friction[i] * c->velocity[i] > 0.0) { /* it would push */
                stuck[i] = true;
                consistent = false;
            }
        }
        if (consistent) {
            return;
        }
    }
    solve_by_sweeps(c);
}

typedef struct {
    hil_terms robot;
    hil_terms ground;
} effect_sum;

static effect_sum evaluate_effects(const hil_effects *effects, const hil_surroundings *around, const hil_body *body,
                                   const double *position, const double *rate, const hil_ground *ground,
                                   double radius) {
    effect_sum sum;
    memset(&sum, 0, sizeof sum);
    if (effects->robot == NULL && effects->ground == NULL) {
        return sum;
    }
    hil_roles roles;
    roles.time = around->time;
    roles.slip = hil_slip(radius * rate[HIL_BETA], rate[HIL_X], HIL_SLIP_FLOOR);
    roles.speed = rate[HIL_X];
    roles.load = body->load;
    roles.slope = ground->slope;
    roles.temperature = around->temperature;
    roles.voltage = around->drive.enabled ? around->drive.duty * around->drive.supply : 0.0;
    roles.pass = around->pass;
    roles.moisture = around->moisture;
    if (effects->robot != NULL) {
        roles.omega = rate[HIL_ALPHA];
        roles.angle = position[HIL_ALPHA];
        effects->robot(&roles, &sum.robot);
    }
    if (effects->ground != NULL) {
        roles.omega = rate[HIL_BETA];
        roles.angle = position[HIL_BETA];
        effects->ground(&roles, &sum.ground);
    }
    return sum;
}

static void dig(const hil_path *path, double softness, double rim, double axle, double dt, hil_body *body) {
    const double beyond = fabs(rim - axle) - 0.5 * larger(fabs(rim), fabs(axle));
    if (body->rut == 0.0 && (softness == 0.0 || beyond <= 0.0)) {
        return;
    }
    const double slip = fabs(hil_slip(rim, axle, HIL_SLIP_FLOOR));
    const double grow = softness * fabs(rim - axle) / path->dig_length * larger(slip - 0.5, 0.0);
    const double leave = fabs(axle) / path->leave_length;
    /* Implicit in the depth: stays in 0..1 for any step. */
    const double depth = (body->rut + dt * grow) / (1.0 + dt * (grow + leave));
    body->rut = grow == 0.0 && depth < GONE ? 0.0 : depth;
}

void hil_body_step(const hil_robot *robot, const hil_robot_derived *d, const hil_path *path, const hil_effects *effects,
                   const hil_surroundings *around, double dt, hil_body *body) {
    double position[3];
    double rate[3];
    for (int i = 0; i < 3; i++) {
        rate[i] = body->rate[i] + 0.5 * dt * body->acceleration[i];
        position[i] = body->position[i] + 0.5 * dt * body->rate[i];
    }
    const hil_ground ground = hil_path_at(path, position[HIL_X]);
    contact c;
    double force[3];
    matrices(robot, d, &ground, position, rate, c.mass, force);
    body->load = ground.slope == 0.0 ? d->weight : d->weight * cos(ground.slope);
    const effect_sum e = evaluate_effects(effects, around, body, position, rate, &ground, robot->radius);

    hil_drive drive = around->drive;
    drive.torque_constant *= 1.0 + e.robot.torque_constant;
    drive.armature_resistance *= 1.0 + e.robot.armature_resistance;
    const double motor = drive.torque_constant * hil_motor_current(&drive, d->gear, rate[HIL_ALPHA]);
    const double smooth_friction = robot->viscous * (1.0 + e.robot.viscous) * rate[HIL_ALPHA] + e.robot.active;
    force[HIL_ALPHA] += d->gear * motor - smooth_friction;
    force[HIL_BETA] -= e.ground.active;

    if (around->carried) {
        invert2(c.mass, c.inverse);
        const double pull = (around->carriage_speed - body->rate[HIL_X]) / dt;
        force[HIL_BETA] -= c.mass[HIL_BETA][HIL_X] * pull;
        force[HIL_ALPHA] -= c.mass[HIL_ALPHA][HIL_X] * pull;
    } else {
        invert3(c.mass, c.inverse);
    }
    const double coefficient =
        ground.terrain.f_o * (1.0 + e.ground.f_o) + ground.terrain.f_s * rate[HIL_BETA] * rate[HIL_BETA];
    c.bound[HIL_X] = around->carried ? 0.0 : dt * path->rut_friction * body->rut * d->weight;
    c.bound[HIL_BETA] = dt * larger(coefficient * robot->radius * body->load + e.ground.passive, 0.0);
    c.bound[HIL_ALPHA] = dt * larger(robot->coulomb * (1.0 + e.robot.coulomb) + e.robot.passive, 0.0);
    for (int i = 0; i < 3; i++) {
        c.free[i] =
            body->rate[i] + dt * (c.inverse[i][0] * force[0] + c.inverse[i][1] * force[1] + c.inverse[i][2] * force[2]);
    }
    if (around->carried) {
        c.free[HIL_X] = around->carriage_speed;
    }
    c.radius = robot->radius;
    c.traction = dt * body->traction;
    c.strength = dt * ground.terrain.mu * body->load;
    c.scale =
        ground.terrain.s_k * larger(HIL_SLIP_FLOOR, larger(fabs(robot->radius * rate[HIL_BETA]), fabs(rate[HIL_X])));
    solve_contact(&c, body->rate, robot->radius * body->rate[HIL_BETA] - body->rate[HIL_X]);

    const double per_dt = 1.0 / dt;
    body->traction = c.traction * per_dt;
    for (int i = 0; i < 3; i++) {
        body->position[i] += 0.5 * dt * (body->rate[i] + c.velocity[i]);
        body->acceleration[i] = (c.velocity[i] - body->rate[i]) * per_dt;
        body->rate[i] = c.velocity[i];
        body->friction[i] = -c.friction[i] * per_dt;
    }
    body->carriage_force = 0.0;
    if (around->carried) {
        body->carriage_force = c.mass[0][0] * body->acceleration[0] + c.mass[0][1] * body->acceleration[1] +
                               c.mass[0][2] * body->acceleration[2] - force[HIL_X] - body->traction;
    }
    body->internal_friction = smooth_friction + body->friction[HIL_ALPHA];
    body->ground_torque = e.ground.active;
    body->current = hil_motor_current(&drive, d->gear, body->rate[HIL_ALPHA]);
    body->motor_torque = drive.torque_constant * body->current;
    dig(path, ground.terrain.softness, robot->radius * body->rate[HIL_BETA], body->rate[HIL_X], dt, body);
}
