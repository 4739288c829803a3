#include "dynamic.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "pendulum.h"
#include "rolling.h"

enum { DRIVE = 0, SHELL = 1, RATE = 2 };

typedef struct {
    int base;
    const hil_additions *additions;
    const hil_drive_record *drive;
    int count;
    const double *values;
} model;

/* Values of this moment: parameters, and the inputs at `share` of the way through the interval after `sample`. */
static void look(const model *m, int sample, double share, double *v) {
    const hil_drive_record *d = m->drive;
    memcpy(v, m->values, sizeof(double) * (size_t)m->count);
    const int next = sample + 1 < d->samples ? sample + 1 : sample;
    v[HIL_ROLE_TIME] = d->time[sample] + share * (d->time[next] - d->time[sample]);
    for (int i = 0; i < d->inputs; i++) {
        const double from = d->input[sample * d->inputs + i];
        v[d->slot[i]] = from + share * (d->input[next * d->inputs + i] - from);
    }
}

static void take_roles(double *v, const double *state, int coordinate) {
    v[HIL_ROLE_ANGLE] = state[coordinate];
    v[HIL_ROLE_OMEGA] = state[RATE + coordinate];
    v[HIL_ROLE_ACCELERATION] = 0.0;
}

static double cmr(const model *m, double *v, const double *state, double *accelerations) {
    const double *mass = &v[HIL_ROLES + 3];
    v[HIL_ROLE_SPEED] = v[HIL_ROLES] * state[RATE + SHELL];
    v[HIL_ROLE_SLIP] = 0.0;
    v[HIL_ROLE_LOAD] = (mass[0] + mass[1] + mass[2]) * v[HIL_ROLES + 9];
    take_roles(v, state, SHELL);
    hil_additions_change(m->additions, 1, v);
    double inertia[2];
    const double ground = hil_additions_torque(m->additions, 1, v, &inertia[0]);
    take_roles(v, state, DRIVE);
    hil_additions_change(m->additions, 0, v);
    const double robot_torque = hil_additions_torque(m->additions, 0, v, &inertia[1]);
    hil_robot robot;
    memcpy(&robot, &v[HIL_ROLES], sizeof robot);
    const hil_rolling_load load = {v[HIL_ROLE_VOLTAGE], v[HIL_DYNAMIC_F_O], 0.0, v[HIL_DYNAMIC_SMOOTHING]};
    const hil_rolling_state s = {state[SHELL], state[DRIVE], state[RATE + SHELL], state[RATE + DRIVE]};
    const hil_rolling_torques t = hil_rolling_evaluate(&robot, &load, &s);
    const double torque[2] = {-t.resistance - ground,
                              robot.radius / robot.drive_radius * t.motor - t.internal_friction - robot_torque};
    double found[2];
    hil_rolling_respond(&robot, &s, torque, inertia, found);
    accelerations[DRIVE] = found[1];
    accelerations[SHELL] = found[0];
    return t.motor / robot.torque_constant;
}

static double pendulum(const model *m, double *v, const double *state, double joint_acceleration,
                       double *accelerations) {
    hil_pendulum p;
    memcpy(&p, &v[HIL_ROLES], sizeof p);
    v[HIL_ROLE_SPEED] = p.radius * state[RATE + SHELL] * (1.0 - p.slip);
    v[HIL_ROLE_SLIP] = p.slip;
    v[HIL_ROLE_LOAD] = (p.shell_mass + p.frame_mass + p.bob_mass) * p.gravity;
    take_roles(v, state, SHELL);
    hil_additions_change(m->additions, 1, v);
    hil_pendulum_around around = {0.0, 0.0};
    around.ground = hil_additions_torque(m->additions, 1, v, &around.ground_inertia);
    take_roles(v, state, DRIVE);
    hil_additions_change(m->additions, 0, v);
    double joint_inertia;
    const double joint = hil_additions_torque(m->additions, 0, v, &joint_inertia);
    memcpy(&p, &v[HIL_ROLES], sizeof p);
    const hil_pendulum_state s = {state[DRIVE] - state[SHELL], state[SHELL], state[RATE + DRIVE] - state[RATE + SHELL],
                                  state[RATE + SHELL]};
    double torque;
    hil_pendulum_driven(&p, &around, &s, joint_acceleration, &accelerations[SHELL], &torque);
    accelerations[DRIVE] = joint_acceleration;
    return torque + joint + joint_inertia * joint_acceleration;
}

/* Second derivatives of the state, and the channel. */
static double rates(const model *m, int sample, double share, const double *state, double *accelerations) {
    double v[HIL_DYNAMIC_VALUES];
    look(m, sample, share, v);
    if (m->base == HIL_DYNAMIC_CMR) {
        return cmr(m, v, state, accelerations);
    }
    const hil_drive_record *d = m->drive;
    double joint_acceleration = 0.0; /* of the commanded rate, which is linear between samples */
    for (int i = 0; i < d->inputs && sample + 1 < d->samples; i++) {
        if (d->slot[i] == HIL_ROLE_JOINT_RATE) {
            joint_acceleration = (d->input[(sample + 1) * d->inputs + i] - d->input[sample * d->inputs + i]) /
                                 (d->time[sample + 1] - d->time[sample]);
        }
    }
    return pendulum(m, v, state, joint_acceleration, accelerations);
}

static void step(const model *m, int sample, double share, double part, double h, double *state) {
    double k[4][4];
    double at[4];
    memcpy(at, state, sizeof at);
    for (int stage = 0; stage < 4; stage++) {
        if (stage > 0) {
            const double reach = stage == 3 ? h : 0.5 * h;
            for (int i = 0; i < HIL_DYNAMIC_STATE; i++) {
                at[i] = state[i] + reach * k[stage - 1][i];
            }
        }
        k[stage][0] = at[2];
        k[stage][1] = at[3];
        const double into = share + part * (stage == 0 ? 0.0 : stage == 3 ? 1.0 : 0.5);
        (void)rates(m, sample, into, at, &k[stage][2]);
    }
    for (int i = 0; i < HIL_DYNAMIC_STATE; i++) {
        state[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
    }
}

void hil_dynamic_run(int base, const hil_additions *additions, const hil_drive_record *drive, int count,
                     const double *values, const double *start, double longest_step, double *record) {
    assert(count <= HIL_DYNAMIC_VALUES && longest_step > 0.0);
    const model m = {base, additions, drive, count, values};
    double state[HIL_DYNAMIC_STATE];
    memcpy(state, start, sizeof state);
    for (int k = 0; k < drive->samples; k++) {
        double *row = &record[(ptrdiff_t)k * HIL_DYNAMIC_RECORD];
        memcpy(row, state, sizeof state);
        row[HIL_DYNAMIC_CHANNEL] = rates(&m, k, 0.0, state, &row[HIL_DYNAMIC_STATE]);
        if (k + 1 < drive->samples) {
            const double span = drive->time[k + 1] - drive->time[k];
            const int steps = (int)ceil(span / longest_step - 1e-9);
            const int parts = steps < 1 ? 1 : steps;
            for (int i = 0; i < parts; i++) {
                step(&m, k, (double)i / parts, 1.0 / parts, span / parts, state);
            }
        }
    }
}

double hil_dynamic_steady_swing(int base, const hil_additions *additions, const hil_drive_record *drive, int count,
                                const double *values, const double *start) {
    assert(count <= HIL_DYNAMIC_VALUES);
    const model m = {base, additions, drive, count, values};
    double low = -1.5707963267948966;
    double high = -low;
    for (int i = 0; i < 60; i++) { /* the more the bob leans forward, the more it swings back */
        const double swing = 0.5 * (low + high);
        double state[HIL_DYNAMIC_STATE];
        double accelerations[2];
        memcpy(state, start, sizeof state);
        state[DRIVE] = state[SHELL] + swing;
        (void)rates(&m, 0, 0.0, state, accelerations);
        if (accelerations[DRIVE] - accelerations[SHELL] > 0.0) {
            low = swing;
        } else {
            high = swing;
        }
    }
    return 0.5 * (low + high);
}
