#include "body.h"

#include <math.h>
#include <string.h>

#include "extremes.h"
#include "impulses.h"
#include "path.h"

#define GONE 1e-9 /* a rut shallower than this is left behind: without an end it would fall to denormal numbers */

static inline void matrices(const hil_robot *robot, const hil_robot_derived *d, const hil_ground *ground,
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

typedef struct {
    double robot[HIL_EFFECT_TARGETS];
    double ground[HIL_EFFECT_TARGETS];
} effect_sums;

static void evaluate_effects(const hil_effects *effects, const hil_surroundings *around, const hil_body *body,
                             const double *position, const double *rate, const hil_ground *ground, double radius,
                             const hil_grip *grip, effect_sums *sum) {
    double values[HIL_ROLES];
    values[HIL_ROLE_TIME] = around->time;
    values[HIL_ROLE_SLIP] = hil_slip(radius * rate[HIL_BETA], rate[HIL_X], HIL_SLIP_FLOOR);
    values[HIL_ROLE_SPEED] = rate[HIL_X];
    values[HIL_ROLE_LOAD] = body->load;
    values[HIL_ROLE_SLOPE] = ground->slope;
    values[HIL_ROLE_TEMPERATURE] = around->temperature;
    values[HIL_ROLE_VOLTAGE] = around->drive.enabled ? around->drive.duty * around->drive.supply : 0.0;
    values[HIL_ROLE_PASS] = around->pass;
    values[HIL_ROLE_MOISTURE] = around->moisture;
    values[HIL_ROLE_OMEGA] = rate[HIL_ALPHA];
    values[HIL_ROLE_ANGLE] = position[HIL_ALPHA];
    values[HIL_ROLE_SWING] = position[HIL_ALPHA] - position[HIL_BETA];
    values[HIL_ROLE_DIRECTION] = 1.0;
    values[HIL_ROLE_BULLDOZING] = 0.0;
    if (grip != NULL) {
        double unused;
        const double slip_speed = radius * rate[HIL_BETA] - rate[HIL_X];
        const double depth = hil_grip_value(grip, HIL_SINKAGE, slip_speed, &unused) + body->dug;
        values[HIL_ROLE_DIRECTION] = copysign(1.0, grip->direction);
        values[HIL_ROLE_BULLDOZING] = hil_grip_bulldozing(grip, depth);
    }
    hil_effects_sum(effects, 0, values, sum->robot);
    values[HIL_ROLE_SPEED] = rate[HIL_X];
    values[HIL_ROLE_OMEGA] = rate[HIL_BETA];
    values[HIL_ROLE_ANGLE] = position[HIL_BETA];
    hil_effects_sum(effects, 1, values, sum->ground);
}

/* On a contact model's ground; implicit in the depth, which stays at or above 0 for any step. */
static void dig_by_slipping(const hil_path *path, double radius, double rim, double axle, double dt, hil_body *body) {
    const double length = sqrt(body->sinkage * (2.0 * radius - body->sinkage));
    const double grown = body->dug + dt * path->slip_depth * fabs(rim - axle) / length;
    body->dug = grown / (1.0 + dt * fabs(axle) / length);
}

static void dig(const hil_path *path, double softness, double rim, double axle, double dt, hil_body *body) {
    const double beyond = fabs(rim - axle) - path->dig_slip * larger(fabs(rim), fabs(axle));
    if (body->rut == 0.0 && (softness == 0.0 || beyond <= 0.0)) {
        return;
    }
    const double slip = fabs(hil_slip(rim, axle, HIL_SLIP_FLOOR));
    const double grow = softness * fabs(rim - axle) / path->dig_length * larger(slip - path->dig_slip, 0.0);
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
    const hil_ground ground = hil_path_inlined(path, position[HIL_X]);
    hil_impulses c;
    double force[3];
    matrices(robot, d, &ground, position, rate, c.mass, force);
    body->load = ground.slope == 0.0 ? d->weight : d->weight * cos(ground.slope);
    const bool soft = path->segment[ground.segment].contact != NULL;
    hil_grip grip = {NULL, 0.0, 0.0, 1.0, NULL, 0.0};
    if (soft) {
        grip = hil_path_grip(path, &ground, body->load, robot->radius * rate[HIL_BETA], rate[HIL_X], HIL_SLIP_FLOOR);
    }
    effect_sums e;
    memset(&e, 0, sizeof e);
    if (effects->count > 0) {
        evaluate_effects(effects, around, body, position, rate, &ground, robot->radius, soft ? &grip : NULL, &e);
    }

    hil_drive drive = around->drive;
    drive.torque_constant *= 1.0 + e.robot[HIL_EFFECT_TORQUE_CONSTANT];
    drive.armature_resistance *= 1.0 + e.robot[HIL_EFFECT_ARMATURE_RESISTANCE];
    const double motor = drive.torque_constant * hil_motor_current(&drive, d->gear, rate[HIL_ALPHA]);
    const double smooth_friction =
        robot->viscous * (1.0 + e.robot[HIL_EFFECT_VISCOUS]) * rate[HIL_ALPHA] + e.robot[HIL_EFFECT_ACTIVE];
    hil_robot geared = *robot;
    geared.gear_efficiency *= 1.0 + e.robot[HIL_EFFECT_GEAR_EFFICIENCY];
    const hil_geared passed = hil_gear_passes(&geared, d->gear * motor, rate[HIL_ALPHA]);
    force[HIL_ALPHA] += passed.middle - smooth_friction;
    force[HIL_BETA] -= e.ground[HIL_EFFECT_ACTIVE];

    if (around->carried) {
        hil_invert2(c.mass, c.inverse);
        const double pull = (around->carriage_speed - body->rate[HIL_X]) / dt;
        force[HIL_BETA] -= c.mass[HIL_BETA][HIL_X] * pull;
        force[HIL_ALPHA] -= c.mass[HIL_ALPHA][HIL_X] * pull;
    } else {
        hil_invert3(c.mass, c.inverse);
    }
    double lever = 0.0, resistance = 0.0, unused;
    c.grip = NULL;
    if (soft) {
        lever = hil_grip_value(&grip, HIL_LEVER, robot->radius * rate[HIL_BETA] - rate[HIL_X], &unused);
        force[HIL_BETA] -= lever;
        c.grip = &grip;
        c.dt = dt;
    }
    const double coefficient =
        ground.terrain.f_o * (1.0 + e.ground[HIL_EFFECT_F_O]) + ground.terrain.f_s * rate[HIL_BETA] * rate[HIL_BETA];
    c.bound[HIL_X] = around->carried ? 0.0 : dt * path->rut_friction * body->rut * d->weight;
    if (soft) {
        resistance = hil_grip_value(&grip, HIL_COMPACTION, robot->radius * rate[HIL_BETA] - rate[HIL_X], &unused);
        resistance += larger(e.ground[HIL_EFFECT_DRAG], 0.0);
        c.bound[HIL_X] = around->carried ? 0.0 : dt * larger(resistance, 0.0);
    }
    const double of_ground = c.bound[HIL_X];
    if (!around->carried) {
        c.bound[HIL_X] += dt * around->tow;
    }
    c.bound[HIL_BETA] = dt * larger(coefficient * robot->radius * body->load + e.ground[HIL_EFFECT_PASSIVE], 0.0);
    c.bound[HIL_ALPHA] =
        dt *
        (larger(robot->coulomb * (1.0 + e.robot[HIL_EFFECT_COULOMB]) + e.robot[HIL_EFFECT_PASSIVE], 0.0) + passed.half);
    for (int i = 0; i < 3; i++) {
        c.base[i] = body->rate[i];
        c.smooth[i] = dt * force[i];
    }
    if (around->carried) {
        c.base[HIL_X] = around->carriage_speed;
    }
    c.radius = robot->radius;
    c.traction = dt * body->traction;
    c.strength = dt * ground.terrain.mu * body->load;
    c.slip_scale =
        ground.terrain.s_k * larger(HIL_SLIP_FLOOR, larger(fabs(robot->radius * rate[HIL_BETA]), fabs(rate[HIL_X])));
    hil_impulses_solve(&c, body->rate);

    const double per_dt = 1.0 / dt;
    body->traction = c.traction * per_dt;
    for (int i = 0; i < 3; i++) {
        body->position[i] += 0.5 * dt * (body->rate[i] + c.velocity[i]);
        body->acceleration[i] = (c.velocity[i] - body->rate[i]) * per_dt;
        body->rate[i] = c.velocity[i];
        body->friction[i] = -c.friction[i] * per_dt;
    }
    if (soft) { /* net traction H = F - X; the rest of the contact's torque is the resistance C_r = T - R H */
        const double moving = smaller(larger(around->carriage_speed / 1e-3, -1.0), 1.0);
        const double share = c.bound[HIL_X] > 0.0 ? of_ground / c.bound[HIL_X] : 1.0; /* the tow is no traction */
        const double held = around->carried ? resistance * moving : share * body->friction[HIL_X];
        body->traction -= held;
        body->friction[HIL_BETA] += lever + robot->radius * held;
        if (fabs(grip.direction) >= 1.0) {
            body->sinkage = hil_grip_value(&grip, HIL_SINKAGE, robot->radius * rate[HIL_BETA] - rate[HIL_X], &unused);
        }
    }
    body->carriage_force = 0.0;
    if (around->carried) {
        body->carriage_force = c.mass[0][0] * body->acceleration[0] + c.mass[0][1] * body->acceleration[1] +
                               c.mass[0][2] * body->acceleration[2] - force[HIL_X] - body->traction;
    }
    body->internal_friction = smooth_friction + body->friction[HIL_ALPHA] + (d->gear * motor - passed.middle);
    body->ground_torque = e.ground[HIL_EFFECT_ACTIVE];
    body->current = hil_motor_current(&drive, d->gear, body->rate[HIL_ALPHA]);
    body->motor_torque = drive.torque_constant * body->current;
    if (soft && path->slip_depth > 0.0) {
        dig_by_slipping(path, robot->radius, robot->radius * body->rate[HIL_BETA], body->rate[HIL_X], dt, body);
    }
    dig(path, ground.terrain.softness, robot->radius * body->rate[HIL_BETA], body->rate[HIL_X], dt, body);
}
