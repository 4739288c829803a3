#include "dynamic.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "flow.h"
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
    v[HIL_ROLE_SWING] = state[DRIVE] - state[SHELL];
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

/* A run and its neighbours, of which each has a row of values; what states and neighbours change of the channel, where
 * the derivatives were last asked for. */
typedef struct {
    model run;
    int columns;
    double channel_by_state[HIL_DYNAMIC_STATE];
    double channel_by[HIL_DYNAMIC_COLUMNS];
} neighbourhood;

static const double RELATIVE = 1e-9;                                            /* tolerance of a step */
static const double BOUND = 1e9;                                                /* rad, rad/s */
static const double ABSOLUTE[HIL_DYNAMIC_STATE] = {1e-11, 1e-11, 1e-10, 1e-10}; /* rad, rad/s: of 0.1 and 1 */
static const double NEAR[HIL_DYNAMIC_STATE] = {1e-7, 1e-7, 1e-7, 1e-7};         /* steps of difference quotients */

/* Rates and channel: found[0 .. 3], found[4]. */
static void all_rates(const model *m, int sample, double share, const double *state, double *found) {
    found[0] = state[2];
    found[1] = state[3];
    found[4] = rates(m, sample, share, state, &found[2]);
}

static void flow_rates(void *law, int sample, double share, const double *state, double *found) {
    const neighbourhood *n = law;
    double all[HIL_DYNAMIC_STATE + 1];
    all_rates(&n->run, sample, share, state, all);
    memcpy(found, all, sizeof(double) * HIL_DYNAMIC_STATE);
}

static void flow_derive(void *law, int sample, double share, const double *state, hil_around *found) {
    neighbourhood *n = law;
    double here[HIL_DYNAMIC_STATE + 1];
    double there[HIL_DYNAMIC_STATE + 1];
    double at[HIL_DYNAMIC_STATE];
    all_rates(&n->run, sample, share, state, here);
    memcpy(at, state, sizeof at);
    for (int i = 0; i < HIL_DYNAMIC_STATE; i++) {
        at[i] = state[i] + NEAR[i];
        const double step = at[i] - state[i];
        all_rates(&n->run, sample, share, at, there);
        at[i] = state[i];
        for (int s = 0; s < HIL_DYNAMIC_STATE; s++) {
            found->a[s][i] = (there[s] - here[s]) / step;
        }
        n->channel_by_state[i] = (there[HIL_DYNAMIC_STATE] - here[HIL_DYNAMIC_STATE]) / step;
    }
    model other = n->run;
    for (int c = 0; c < n->columns; c++) {
        other.values += other.count;
        all_rates(&other, sample, share, state, there);
        for (int s = 0; s < HIL_DYNAMIC_STATE; s++) {
            found->b[s][c] = there[s] - here[s];
        }
        n->channel_by[c] = there[HIL_DYNAMIC_STATE] - here[HIL_DYNAMIC_STATE];
    }
}

/* The rows of a sample: the run's record, and what the neighbours change. */
static void note(const neighbourhood *n, const hil_flow *flow, int sample, const hil_way *way, double *record,
                 double *change) {
    double *row = &record[(ptrdiff_t)sample * HIL_DYNAMIC_RECORD];
    memcpy(row, way->state, sizeof(double) * HIL_DYNAMIC_STATE);
    row[HIL_DYNAMIC_CHANNEL] = rates(&n->run, sample, 0.0, way->state, &row[HIL_DYNAMIC_STATE]);
    const hil_around *here = &way->point[0];
    for (int c = 0; c < flow->columns; c++) {
        double *more = &change[((ptrdiff_t)c * n->run.drive->samples + sample) * HIL_DYNAMIC_RECORD];
        more[HIL_DYNAMIC_STATE] = here->b[RATE][c];
        more[HIL_DYNAMIC_STATE + 1] = here->b[RATE + 1][c];
        more[HIL_DYNAMIC_CHANNEL] = flow->shape != NULL
                                        ? n->channel_by[0] * flow->shape[(ptrdiff_t)sample * flow->columns + c]
                                        : n->channel_by[c];
        for (int s = 0; s < HIL_DYNAMIC_STATE; s++) {
            more[s] = way->by[s][c];
            more[HIL_DYNAMIC_STATE] += here->a[RATE][s] * more[s];
            more[HIL_DYNAMIC_STATE + 1] += here->a[RATE + 1][s] * more[s];
            more[HIL_DYNAMIC_CHANNEL] += n->channel_by_state[s] * more[s];
        }
    }
}

hil_ode_end hil_dynamic_follow(int base, const hil_additions *additions, const hil_drive_record *drive, int count,
                               const double *values, const double *start, int columns, const double *shape,
                               double *record, double *change) {
    assert(count <= HIL_DYNAMIC_VALUES && columns <= HIL_DYNAMIC_COLUMNS);
    neighbourhood n = {{base, additions, drive, count, values}, shape != NULL ? 1 : columns, {0.0}, {0.0}};
    const int jumps = base == HIL_DYNAMIC_PENDULUM; /* the joint's acceleration does */
    const hil_flow flow = {HIL_DYNAMIC_STATE, columns,     drive->time, RELATIVE, ABSOLUTE, BOUND, jumps, &n,
                           flow_rates,        flow_derive, NULL,        NULL,     shape};
    hil_way way;
    hil_flow_begin(&flow, start, &way);
    for (int c = 0; c < columns; c++) {
        const double *other = &start[(ptrdiff_t)(shape != NULL ? 1 : c + 1) * HIL_DYNAMIC_STATE];
        for (int s = 0; s < HIL_DYNAMIC_STATE; s++) {
            way.by[s][c] = (other[s] - start[s]) * (shape != NULL ? shape[c] : 1.0);
        }
    }
    way.step = drive->samples > 1 ? drive->time[1] - drive->time[0] : 0.0;
    way.left = HIL_ODE_MEAN_STEPS * drive->samples;
    if (columns > 0) {
        hil_flow_arrive(&flow, 0, &way);
    }
    note(&n, &flow, 0, &way, record, change);
    for (int k = 0; k + 1 < drive->samples; k++) {
        const hil_ode_end end = hil_flow_interval(&flow, k, &way);
        if (end.kind != HIL_ODE_DONE) {
            return end;
        }
        if (columns > 0) {
            hil_flow_arrive(&flow, k + 1, &way);
        }
        note(&n, &flow, k + 1, &way, record, change);
    }
    return (hil_ode_end){HIL_ODE_DONE, 0, 0.0, 0};
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
