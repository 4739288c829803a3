#include "rolling.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

typedef struct {
    double m11;
    double m12;
    double m22;
} rolling_inertia;

static rolling_inertia inertia_of(const hil_robot *robot, const hil_robot_derived *d, double swing) {
    const double coupling = robot->radius * d->imbalance * cos(swing);
    rolling_inertia m;
    m.m11 = robot->radius * robot->radius * d->mass + robot->shell_inertia + d->swing_inertia + robot->drive_inertia -
            2.0 * coupling;
    m.m12 = robot->drive_inertia * d->roll + coupling - d->swing_inertia;
    m.m22 = d->swing_inertia + robot->drive_inertia * d->roll * d->roll;
    return m;
}

hil_rolling_torques hil_rolling_evaluate(const hil_robot *robot, const hil_rolling_load *load,
                                         const hil_rolling_state *state) {
    const hil_robot_derived d = hil_robot_derive(robot);
    const double back_emf = robot->torque_constant * d.gear * state->alpha_rate;
    const double coefficient = load->f_o + load->f_s * state->beta_rate * state->beta_rate;
    hil_rolling_torques t;
    t.motor = robot->torque_constant / robot->armature_resistance * (load->voltage - back_emf);
    const double direction = tanh(state->alpha_rate / load->smoothing);
    const hil_geared passed = hil_gear_passes(robot, d.gear * t.motor, state->alpha_rate);
    const double lost = d.gear * t.motor - (passed.middle - passed.half * direction);
    t.internal_friction = robot->coulomb * direction + robot->viscous * state->alpha_rate + lost;
    t.resistance = coefficient * robot->radius * d.weight * tanh(state->beta_rate / load->smoothing);
    return t;
}

void hil_rolling_respond(const hil_robot *robot, const hil_rolling_state *state, const double *torque,
                         const double *inertia, double *accelerations) {
    const hil_robot_derived d = hil_robot_derive(robot);
    const double swing = state->alpha - state->beta;
    const double swing_rate = state->alpha_rate - state->beta_rate;
    const rolling_inertia m = inertia_of(robot, &d, swing);
    const double m11 = m.m11 + inertia[0];
    const double m22 = m.m22 + inertia[1];
    const double gravity_torque = robot->gravity * d.imbalance * sin(swing);
    const double centrifugal = robot->radius * d.imbalance * sin(swing) * swing_rate * swing_rate;
    const double q1 = torque[0] + gravity_torque + centrifugal;
    const double q2 = torque[1] - gravity_torque;
    /* C12 = -C11 turns the two rate products into one with swing_rate squared, on the first row only. */
    const double determinant = m11 * m22 - m.m12 * m.m12;
    accelerations[0] = (m22 * q1 - m.m12 * q2) / determinant;
    accelerations[1] = (m11 * q2 - m.m12 * q1) / determinant;
}

/* The motor's torque behind its gear, on alpha, by the inputs: into `by`. Its own torque T = (R/r) C_m comes first. */
static void passed_by(const hil_rolling_inputs *at, const hil_robot_derived *d, double direction, double rise,
                      double gear_by, hil_rolling_inputs *by) {
    const hil_robot *robot = &at->robot;
    const double rate = at->state.alpha_rate;
    const double conductance = d->gear / robot->armature_resistance;
    const double emf = robot->torque_constant * d->gear * rate;
    const double torque = robot->torque_constant * conductance * (at->load.voltage - emf);
    const double ahead = torque - robot->motor_viscous * rate - robot->motor_coulomb;
    const double astern = torque - robot->motor_viscous * rate + robot->motor_coulomb;
    const double driving = robot->gear_efficiency;
    const double driven = driving * robot->driven_ratio;
    const double low_by = ahead > 0.0 ? driving : 1.0 / driven;
    const double high_by = astern < 0.0 ? driving : 1.0 / driven;
    const double low = ahead * low_by;
    const double high = astern * high_by;
    const double forward = 0.5 * (1.0 + direction);
    const double backward = 0.5 * (1.0 - direction);
    const double all = forward * low_by + backward * high_by; /* by T */
    by->load.voltage += all * robot->torque_constant * conductance;
    by->robot.torque_constant += all * conductance * (at->load.voltage - 2.0 * emf);
    by->robot.armature_resistance -= all * torque / robot->armature_resistance;
    by->state.alpha_rate -=
        all * (robot->torque_constant * robot->torque_constant * d->gear * conductance + robot->motor_viscous);
    by->robot.motor_viscous -= all * rate;
    by->robot.motor_coulomb += backward * high_by - forward * low_by;
    by->robot.gear_efficiency +=
        (forward * (ahead > 0.0 ? low : -low) + backward * (astern < 0.0 ? high : -high)) / driving;
    by->robot.driven_ratio -=
        (forward * (ahead > 0.0 ? 0.0 : low) + backward * (astern < 0.0 ? 0.0 : high)) / robot->driven_ratio;
    by->state.alpha_rate += 0.5 * (low - high) * rise;
    by->load.smoothing -= 0.5 * (low - high) * rise * rate / at->load.smoothing;
    const double by_gear = all * robot->torque_constant / robot->armature_resistance * (at->load.voltage - 2.0 * emf);
    by->robot.radius += by_gear * gear_by;
    by->robot.drive_radius -= by_gear * gear_by * d->gear;
}

/* What `by` has of a row by imbalance m*, the swing's inertia and the roll goes to the constants that they follow from.
 */
static void spread(const hil_robot *robot, double imbalance, double swing, double roll, hil_robot *by) {
    const double offset = robot->radius - robot->drive_radius;
    const double by_offset = imbalance * robot->drive_mass + 2.0 * swing * robot->drive_mass * offset;
    const double by_roll = roll / robot->drive_radius;
    by->radius += by_offset + by_roll;
    by->drive_radius -= by_offset + by_roll * robot->radius / robot->drive_radius;
    by->drive_mass += imbalance * offset + swing * offset * offset;
    by->body_mass += imbalance * robot->arm + swing * robot->arm * robot->arm;
    by->arm += imbalance * robot->body_mass + 2.0 * swing * robot->body_mass * robot->arm;
    by->body_inertia += swing;
}

void hil_rolling_gradient(const hil_rolling_inputs *at, const double *accelerations, hil_rolling_inputs by[3]) {
    const hil_robot *robot = &at->robot;
    const hil_rolling_state *s = &at->state;
    const hil_robot_derived d = hil_robot_derive(robot);
    const double swing_rate = s->alpha_rate - s->beta_rate;
    const double sine = sin(s->alpha - s->beta);
    const double cosine = cos(s->alpha - s->beta);
    const double a = accelerations[0];
    const double b = accelerations[1];
    const double rolls = tanh(s->beta_rate / at->load.smoothing);
    const double rolls_rise = (1.0 - rolls * rolls) / at->load.smoothing;
    const double turns = tanh(s->alpha_rate / at->load.smoothing);
    const double turns_rise = (1.0 - turns * turns) / at->load.smoothing;
    const double coefficient = at->load.f_o + at->load.f_s * s->beta_rate * s->beta_rate;
    const double gear_by = 1.0 / robot->drive_radius; /* of R/r by R; by r that times -R/r */
    memset(by, 0, 3 * sizeof *by);

    /* What each row of M a = q lacks at these accelerations, by the inputs: the shell's, */
    hil_rolling_inputs *row = &by[0];
    const double resists = -robot->radius * d.weight * rolls; /* by the coefficient */
    const double swings = 2.0 * robot->radius * d.imbalance * sine * swing_rate;
    const double leans = d.imbalance * (cosine * (robot->gravity + robot->radius * swing_rate * swing_rate) +
                                        robot->radius * sine * (b - 2.0 * a));
    row->load.f_o = resists;
    row->load.f_s = resists * s->beta_rate * s->beta_rate;
    row->load.smoothing = coefficient * robot->radius * d.weight * rolls_rise * s->beta_rate / at->load.smoothing;
    row->state.beta_rate =
        resists * 2.0 * at->load.f_s * s->beta_rate - coefficient * robot->radius * d.weight * rolls_rise - swings;
    row->state.alpha_rate = swings;
    row->state.alpha = leans;
    row->state.beta = -leans;
    row->robot.gravity = -coefficient * robot->radius * d.mass * rolls + d.imbalance * sine;
    row->robot.radius = coefficient * resists / robot->radius - 2.0 * robot->radius * d.mass * a +
                        d.imbalance * (sine * swing_rate * swing_rate + cosine * (2.0 * a - b));
    row->robot.drive_inertia = -a - d.roll * b;
    row->robot.shell_inertia = -a;
    row->torque[0] = 1.0;
    row->inertia[0] = -a;
    const double by_mass = coefficient * resists / d.mass - robot->radius * robot->radius * a;
    row->robot.shell_mass = row->robot.body_mass = row->robot.drive_mass = by_mass;
    spread(robot,
           sine * (robot->gravity + robot->radius * swing_rate * swing_rate) + robot->radius * cosine * (2.0 * a - b),
           b - a, -robot->drive_inertia * b, &row->robot);

    /* and that of the drive. */
    row = &by[1];
    const double back = d.imbalance * (robot->radius * sine * a - robot->gravity * cosine);
    passed_by(at, &d, turns, turns_rise, gear_by, row);
    row->robot.coulomb = -turns;
    row->robot.viscous = -s->alpha_rate;
    row->state.alpha_rate -= robot->coulomb * turns_rise + robot->viscous;
    row->load.smoothing += robot->coulomb * turns_rise * s->alpha_rate / at->load.smoothing;
    row->state.alpha = back;
    row->state.beta = -back;
    row->robot.gravity = -d.imbalance * sine;
    row->robot.radius -= d.imbalance * cosine * a;
    row->robot.drive_inertia = -d.roll * (a + d.roll * b);
    row->torque[1] = 1.0;
    row->inertia[1] = -b;
    spread(robot, -robot->gravity * sine - robot->radius * cosine * a, a - b,
           -robot->drive_inertia * (a + 2.0 * d.roll * b), &row->robot);

    const rolling_inertia m = inertia_of(robot, &d, s->alpha - s->beta);
    const double m11 = m.m11 + at->inertia[0];
    const double m22 = m.m22 + at->inertia[1];
    const double determinant = m11 * m22 - m.m12 * m.m12;
    double *first = (double *)&by[0];
    double *second = (double *)&by[1];
    for (size_t i = 0; i < sizeof *by / sizeof(double); i++) {
        const double shell = first[i];
        first[i] = (m22 * shell - m.m12 * second[i]) / determinant;
        second[i] = (m11 * second[i] - m.m12 * shell) / determinant;
    }

    row = &by[2];
    const double emf_by = robot->torque_constant * d.gear;
    const double current = (at->load.voltage - emf_by * s->alpha_rate) / robot->armature_resistance;
    const double by_gear = -robot->torque_constant * s->alpha_rate / robot->armature_resistance;
    row->load.voltage = 1.0 / robot->armature_resistance;
    row->robot.torque_constant = -d.gear * s->alpha_rate / robot->armature_resistance;
    row->robot.armature_resistance = -current / robot->armature_resistance;
    row->state.alpha_rate = -emf_by / robot->armature_resistance;
    row->robot.radius = by_gear * gear_by;
    row->robot.drive_radius = -by_gear * gear_by * d.gear;
}

void hil_rolling_accelerations(const hil_robot *robot, const hil_rolling_load *load, const hil_rolling_state *state,
                               double *accelerations) {
    const hil_rolling_torques t = hil_rolling_evaluate(robot, load, state);
    const double torque[2] = {-t.resistance, robot->radius / robot->drive_radius * t.motor - t.internal_friction};
    const double nothing[2] = {0.0, 0.0};
    hil_rolling_respond(robot, state, torque, nothing, accelerations);
}

typedef struct {
    double v[4];
} slope4;

static slope4 slope_at(const hil_robot *robot, const hil_rolling_load *load, const hil_rolling_state *state,
                       const slope4 *k, double h) {
    const hil_rolling_state s = {state->beta + h * k->v[0], state->alpha + h * k->v[1], state->beta_rate + h * k->v[2],
                                 state->alpha_rate + h * k->v[3]};
    slope4 result = {{s.beta_rate, s.alpha_rate, 0.0, 0.0}};
    hil_rolling_accelerations(robot, load, &s, &result.v[2]);
    return result;
}

void hil_rolling_run(const hil_robot *robot, const hil_rolling_load *load, double dt, int steps,
                     hil_rolling_state *state) {
    const slope4 zero = {{0.0, 0.0, 0.0, 0.0}};
    for (int i = 0; i < steps; i++) {
        const slope4 k1 = slope_at(robot, load, state, &zero, 0.0);
        const slope4 k2 = slope_at(robot, load, state, &k1, 0.5 * dt);
        const slope4 k3 = slope_at(robot, load, state, &k2, 0.5 * dt);
        const slope4 k4 = slope_at(robot, load, state, &k3, dt);
        double change[4];
        for (int j = 0; j < 4; j++) {
            change[j] = dt / 6.0 * (k1.v[j] + 2.0 * k2.v[j] + 2.0 * k3.v[j] + k4.v[j]);
        }
        state->beta += change[0];
        state->alpha += change[1];
        state->beta_rate += change[2];
        state->alpha_rate += change[3];
    }
}

double hil_rolling_energy(const hil_robot *robot, const hil_rolling_state *state) {
    const hil_robot_derived d = hil_robot_derive(robot);
    const double swing = state->alpha - state->beta;
    const rolling_inertia m = inertia_of(robot, &d, swing);
    const double kinetic = 0.5 * m.m11 * state->beta_rate * state->beta_rate +
                           m.m12 * state->beta_rate * state->alpha_rate +
                           0.5 * m.m22 * state->alpha_rate * state->alpha_rate;
    return kinetic + robot->gravity * d.imbalance * (1.0 - cos(swing));
}

double hil_rolling_momentum_rate(const hil_robot *robot, const hil_rolling_state *state, const double *accelerations) {
    const hil_robot_derived d = hil_robot_derive(robot);
    const double swing = state->alpha - state->beta;
    const double swing_rate = state->alpha_rate - state->beta_rate;
    const rolling_inertia m = inertia_of(robot, &d, swing);
    return (m.m11 + m.m12) * accelerations[0] + (m.m12 + m.m22) * accelerations[1] -
           robot->radius * d.imbalance * sin(swing) * swing_rate * swing_rate;
}
