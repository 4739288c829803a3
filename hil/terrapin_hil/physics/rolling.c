#include "rolling.h"

#include <math.h>

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
