#include "dynamic.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "flow.h"
#include "moves.h"
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

/* Of the commanded rate, which is linear between samples. */
static double joint_acceleration(const model *m, int sample) {
    const hil_drive_record *d = m->drive;
    double found = 0.0;
    for (int i = 0; i < d->inputs && sample + 1 < d->samples; i++) {
        if (d->slot[i] == HIL_ROLE_JOINT_RATE) {
            found = (d->input[(sample + 1) * d->inputs + i] - d->input[sample * d->inputs + i]) /
                    (d->time[sample + 1] - d->time[sample]);
        }
    }
    return found;
}

/* Second derivatives of the state, and the channel. */
static double rates(const model *m, int sample, double share, const double *state, double *accelerations) {
    double v[HIL_DYNAMIC_VALUES];
    look(m, sample, share, v);
    if (m->base == HIL_DYNAMIC_CMR) {
        return cmr(m, v, state, accelerations);
    }
    return pendulum(m, v, state, joint_acceleration(m, sample), accelerations);
}

/* A run and its neighbours, of which each has a row of values; what states and neighbours change of the channel, where
 * the derivatives were last asked for. */
typedef struct {
    model run;
    int columns;
    double channel_by_state[HIL_DYNAMIC_STATE];
    double channel_by[HIL_DYNAMIC_COLUMNS];
    hil_moves moves;
} neighbourhood;

static const double RELATIVE = 1e-9;                                            /* tolerance of a step */
static const double BOUND = 1e9;                                                /* rad, rad/s */
static const double ABSOLUTE[HIL_DYNAMIC_STATE] = {1e-11, 1e-11, 1e-10, 1e-10}; /* rad, rad/s: of 0.1 and 1 */

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

/* Takes the roles' moves along with take_roles. */
static void move_roles(hil_moves *moves, int coordinate) {
    hil_moves_row(moves, HIL_ROLE_ANGLE)[coordinate] = 1.0;
    hil_moves_row(moves, HIL_ROLE_OMEGA)[RATE + coordinate] = 1.0;
    double *swing = hil_moves_row(moves, HIL_ROLE_SWING);
    swing[DRIVE] = 1.0;
    swing[SHELL] = -1.0;
}

/* The load's moves, of what carries the masses (from a slot on) and gravity. */
static void move_load(hil_moves *moves, const double *v, int mass, int gravity) {
    double *load = hil_moves_row(moves, HIL_ROLE_LOAD);
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        hil_moves_add(moves, mass + i, v[gravity], load);
        sum += v[mass + i];
    }
    hil_moves_add(moves, gravity, sum, load);
}

/* sum += what the parameters from HIL_ROLES on move, `by` their derivatives. */
static void add_parameters(const hil_moves *moves, const double *by, int count, double *sum) {
    for (int i = 0; i < count; i++) {
        hil_moves_add(moves, HIL_ROLES + i, by[i], sum);
    }
}

static void add_scaled(const hil_moves *moves, double times, const double *row, double *sum) {
    for (int c = 0; c < moves->width; c++) {
        sum[c] += times * row[c];
    }
}

/* What cmr() answers, along all directions: the accelerations of drive and shell, and the channel. */
static void cmr_by(const model *m, double *v, const double *state, hil_moves *moves, double by[3][HIL_MOVES_WIDTH]) {
    double ground_by[HIL_MOVES_WIDTH], ground_inertia_by[HIL_MOVES_WIDTH];
    double drive_by[HIL_MOVES_WIDTH], drive_inertia_by[HIL_MOVES_WIDTH];
    double ground_inertia, drive_inertia;
    const double *mass = &v[HIL_ROLES + 3];
    double *speed = hil_moves_row(moves, HIL_ROLE_SPEED);
    speed[RATE + SHELL] = v[HIL_ROLES];
    hil_moves_add(moves, HIL_ROLES, state[RATE + SHELL], speed);
    v[HIL_ROLE_SPEED] = v[HIL_ROLES] * state[RATE + SHELL];
    v[HIL_ROLE_SLIP] = 0.0;
    v[HIL_ROLE_LOAD] = (mass[0] + mass[1] + mass[2]) * v[HIL_ROLES + 9];
    move_load(moves, v, HIL_ROLES + 3, HIL_ROLES + 9);
    take_roles(v, state, SHELL);
    move_roles(moves, SHELL);
    hil_moves_change(m->additions, 1, v, moves);
    const double ground = hil_moves_torque(m->additions, 1, v, moves, &ground_inertia, ground_by, ground_inertia_by);
    take_roles(v, state, DRIVE);
    move_roles(moves, DRIVE);
    hil_moves_change(m->additions, 0, v, moves);
    const double drive = hil_moves_torque(m->additions, 0, v, moves, &drive_inertia, drive_by, drive_inertia_by);

    hil_rolling_inputs at = {
        .load = {v[HIL_ROLE_VOLTAGE], v[HIL_DYNAMIC_F_O], 0.0, v[HIL_DYNAMIC_SMOOTHING]},
        .state = {state[SHELL], state[DRIVE], state[RATE + SHELL], state[RATE + DRIVE]},
        .inertia = {ground_inertia, drive_inertia},
    };
    memcpy(&at.robot, &v[HIL_ROLES], sizeof at.robot);
    const hil_rolling_torques t = hil_rolling_evaluate(&at.robot, &at.load, &at.state);
    at.torque[0] = -t.resistance - ground;
    at.torque[1] = at.robot.radius / at.robot.drive_radius * t.motor - t.internal_friction - drive;
    double found[2];
    hil_rolling_respond(&at.robot, &at.state, at.torque, at.inertia, found);
    hil_rolling_inputs inputs_by[3];
    hil_rolling_gradient(&at, found, inputs_by);
    const int order[3] = {SHELL, DRIVE, 2};
    for (int k = 0; k < 3; k++) {
        const hil_rolling_inputs *one = &inputs_by[k];
        double *sum = by[order[k]];
        memset(sum, 0, sizeof(double) * (size_t)moves->width);
        add_parameters(moves, (const double *)&one->robot, (int)(sizeof one->robot / sizeof(double)), sum);
        hil_moves_add(moves, HIL_DYNAMIC_F_O, one->load.f_o, sum);
        hil_moves_add(moves, HIL_DYNAMIC_SMOOTHING, one->load.smoothing, sum);
        hil_moves_add(moves, HIL_ROLE_VOLTAGE, one->load.voltage, sum);
        sum[SHELL] += one->state.beta;
        sum[DRIVE] += one->state.alpha;
        sum[RATE + SHELL] += one->state.beta_rate;
        sum[RATE + DRIVE] += one->state.alpha_rate;
        add_scaled(moves, -one->torque[0], ground_by, sum);
        add_scaled(moves, -one->torque[1], drive_by, sum);
        add_scaled(moves, one->inertia[0], ground_inertia_by, sum);
        add_scaled(moves, one->inertia[1], drive_inertia_by, sum);
    }
}

/* The same of pendulum(). */
static void pendulum_by(const model *m, double *v, const double *state, double joint_acceleration, hil_moves *moves,
                        double by[3][HIL_MOVES_WIDTH]) {
    double ground_by[HIL_MOVES_WIDTH], ground_inertia_by[HIL_MOVES_WIDTH];
    double joint_by[HIL_MOVES_WIDTH], joint_inertia_by[HIL_MOVES_WIDTH];
    hil_pendulum_inputs at, inputs_by[2];
    double joint_inertia;
    memcpy(&at.pendulum, &v[HIL_ROLES], sizeof at.pendulum);
    const double grip = 1.0 - at.pendulum.slip;
    const double turns = state[RATE + SHELL];
    const int slip = HIL_ROLES + (int)(offsetof(hil_pendulum, slip) / sizeof(double));
    double *speed = hil_moves_row(moves, HIL_ROLE_SPEED);
    speed[RATE + SHELL] = at.pendulum.radius * grip;
    hil_moves_add(moves, HIL_ROLES, turns * grip, speed);
    hil_moves_add(moves, slip, -turns * at.pendulum.radius, speed);
    hil_moves_add(moves, slip, 1.0, hil_moves_row(moves, HIL_ROLE_SLIP));
    v[HIL_ROLE_SPEED] = at.pendulum.radius * turns * grip;
    v[HIL_ROLE_SLIP] = at.pendulum.slip;
    v[HIL_ROLE_LOAD] = (at.pendulum.shell_mass + at.pendulum.frame_mass + at.pendulum.bob_mass) * at.pendulum.gravity;
    move_load(moves, v, HIL_ROLES + 1, HIL_ROLES + (int)(offsetof(hil_pendulum, gravity) / sizeof(double)));
    take_roles(v, state, SHELL);
    move_roles(moves, SHELL);
    hil_moves_change(m->additions, 1, v, moves);
    at.around.ground =
        hil_moves_torque(m->additions, 1, v, moves, &at.around.ground_inertia, ground_by, ground_inertia_by);
    take_roles(v, state, DRIVE);
    move_roles(moves, DRIVE);
    hil_moves_change(m->additions, 0, v, moves);
    (void)hil_moves_torque(m->additions, 0, v, moves, &joint_inertia, joint_by, joint_inertia_by);
    memcpy(&at.pendulum, &v[HIL_ROLES], sizeof at.pendulum);
    at.state = (hil_pendulum_state){state[DRIVE] - state[SHELL], state[SHELL], state[RATE + DRIVE] - turns, turns};
    hil_pendulum_gradient(&at, joint_acceleration, inputs_by);
    const int order[2] = {SHELL, 2};
    memset(by[DRIVE], 0, sizeof(double) * (size_t)moves->width); /* the joint is commanded */
    for (int k = 0; k < 2; k++) {
        const hil_pendulum_inputs *one = &inputs_by[k];
        double *sum = by[order[k]];
        memset(sum, 0, sizeof(double) * (size_t)moves->width);
        add_parameters(moves, (const double *)&one->pendulum, (int)(sizeof one->pendulum / sizeof(double)), sum);
        sum[DRIVE] += one->state.swing;
        sum[SHELL] += one->state.angle - one->state.swing;
        sum[RATE + DRIVE] += one->state.swing_rate;
        sum[RATE + SHELL] += one->state.angle_rate - one->state.swing_rate;
        add_scaled(moves, one->around.ground, ground_by, sum);
        add_scaled(moves, one->around.ground_inertia, ground_inertia_by, sum);
    }
    add_scaled(moves, 1.0, joint_by, by[2]);
    add_scaled(moves, joint_acceleration, joint_inertia_by, by[2]);
}

static void flow_derive(void *law, int sample, double share, const double *state, hil_around *found) {
    neighbourhood *n = law;
    double v[HIL_DYNAMIC_VALUES];
    double by[3][HIL_MOVES_WIDTH];
    look(&n->run, sample, share, v);
    hil_moves_again(&n->moves);
    if (n->run.base == HIL_DYNAMIC_CMR) {
        cmr_by(&n->run, v, state, &n->moves, by);
    } else {
        pendulum_by(&n->run, v, state, joint_acceleration(&n->run, sample), &n->moves, by);
    }
    for (int i = 0; i < HIL_DYNAMIC_STATE; i++) {
        found->a[DRIVE][i] = i == RATE + DRIVE ? 1.0 : 0.0;
        found->a[SHELL][i] = i == RATE + SHELL ? 1.0 : 0.0;
        found->a[RATE + DRIVE][i] = by[DRIVE][i];
        found->a[RATE + SHELL][i] = by[SHELL][i];
        n->channel_by_state[i] = by[2][i];
    }
    for (int c = 0; c < n->columns; c++) {
        found->b[DRIVE][c] = found->b[SHELL][c] = 0.0;
        found->b[RATE + DRIVE][c] = by[DRIVE][HIL_DYNAMIC_STATE + c];
        found->b[RATE + SHELL][c] = by[SHELL][HIL_DYNAMIC_STATE + c];
        n->channel_by[c] = by[2][HIL_DYNAMIC_STATE + c];
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
    neighbourhood n;
    n.run = (model){base, additions, drive, count, values};
    n.columns = shape != NULL ? 1 : columns;
    hil_moves_begin(&n.moves, HIL_DYNAMIC_STATE, n.columns, count, values);
    hil_moves_hold(&n.moves, HIL_ROLE_TIME);
    for (int i = 0; i < drive->inputs; i++) {
        hil_moves_hold(&n.moves, drive->slot[i]);
    }
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
