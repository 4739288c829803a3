#include "slipping.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "body.h"
#include "extremes.h"
#include "rolling.h"

enum { DRIVE = 0, SHELL = 1, AXLE = 2, RATE = 3, CHANNEL_OUT = 6 };

#define STATES HIL_SLIPPING_STATE

enum { PARTS = 64 }; /* of a step whose middle is not found: a power of 2 */

static const double LONGEST = 2e-3;    /* [s] of a step, whose error is 1e-4 of what a run scatters */
static const double BOUND = 1e9;       /* of a state, in its unit */
static const double DIFFERENCE = 1e-6; /* of a state, for derivatives */
static const double CLOSE = 1e-11;     /* Newton's last step, in the states' units */

typedef struct {
    const hil_slipping_run *run;
    int row; /* of values and tables */
} model;

/* Values of this moment: parameters, and the inputs at `share` of the way through the interval after `sample`. */
static void look(const model *m, int sample, double share, double *v) {
    const hil_slipping_run *d = m->run;
    memcpy(v, &d->values[(ptrdiff_t)m->row * d->count], sizeof(double) * (size_t)d->count);
    const int next = sample + 1 < d->samples ? sample + 1 : sample;
    v[HIL_ROLE_TIME] = d->time[sample] + share * (d->time[next] - d->time[sample]);
    for (int i = 0; i < d->inputs; i++) {
        const double from = d->input[(ptrdiff_t)sample * d->inputs + i];
        v[d->slot[i]] = from + share * (d->input[(ptrdiff_t)next * d->inputs + i] - from);
    }
}

/* Of the commanded rate, which is linear between samples. */
static double joint_acceleration(const hil_slipping_run *d, int sample) {
    for (int i = 0; i < d->inputs && sample + 1 < d->samples; i++) {
        if (d->slot[i] == HIL_ROLE_JOINT_RATE) {
            const double *at = &d->input[(ptrdiff_t)sample * d->inputs + i];
            return (at[d->inputs] - at[0]) / (d->time[sample + 1] - d->time[sample]);
        }
    }
    return 0.0;
}

/* The body of the values. The sphere's joint is the drive of a robot whose drive wheel has no mass. */
static hil_robot robot_of(const model *m, const double *v) {
    const double *p = &v[HIL_ROLES];
    hil_robot robot;
    if (m->run->body == HIL_SLIPPING_CYLINDER) {
        memcpy(&robot, p, sizeof robot);
        return robot;
    }
    memset(&robot, 0, sizeof robot);
    robot.radius = robot.drive_radius = p[0];
    robot.shell_mass = p[1] + p[2];
    robot.body_mass = p[3];
    robot.arm = p[4];
    robot.shell_inertia = p[5];
    robot.body_inertia = p[6] + p[7];
    robot.gravity = p[8];
    robot.viscous = p[9];
    return robot;
}

static double smoothing_of(const model *m, const double *v) {
    return v[m->run->body == HIL_SLIPPING_CYLINDER ? HIL_SLIPPING_SMOOTHING : HIL_SLIPPING_SPHERE_SMOOTHING];
}

/* Adds what the ground does to the axle and the shell. */
static void add_ground(const model *m, const double *v, const hil_robot *robot, const double *rate, double load,
                       double *force) {
    const double smoothing = smoothing_of(m, v);
    const double floor = robot->radius * smoothing;
    const double rim = robot->radius * rate[HIL_BETA];
    const double axle = rate[HIL_X];
    if (m->run->grip != NULL) {
        double unused;
        const hil_grip grip = hil_grip_at(m->run->grip[m->row], load, rim, axle, floor);
        const double thrust = hil_grip_value(&grip, HIL_THRUST, rim - axle, &unused);
        const double compaction = hil_grip_value(&grip, HIL_COMPACTION, rim - axle, &unused);
        force[HIL_X] += thrust - compaction * tanh(axle / floor);
        force[HIL_BETA] -= robot->radius * thrust + hil_grip_value(&grip, HIL_LEVER, rim - axle, &unused);
    } else {
        const double slip = hil_slip(rim, axle, floor);
        const double traction = v[HIL_SLIPPING_MU] * load * copysign(-expm1(-fabs(slip) / v[HIL_SLIPPING_S_K]), slip);
        force[HIL_X] += traction;
        force[HIL_BETA] -= robot->radius * (traction + v[HIL_SLIPPING_F_O] * load * tanh(rate[HIL_BETA] / smoothing));
    }
}

static void solve(int unknowns, double mass[3][3], double *force) {
    for (int i = 0; i < unknowns; i++) { /* positive definite: no pivots needed */
        for (int k = i + 1; k < unknowns; k++) {
            const double share = mass[k][i] / mass[i][i];
            for (int j = i; j < unknowns; j++) {
                mass[k][j] -= share * mass[i][j];
            }
            force[k] -= share * force[i];
        }
    }
    for (int i = unknowns - 1; i >= 0; i--) {
        for (int j = i + 1; j < unknowns; j++) {
            force[i] -= mass[i][j] * force[j];
        }
        force[i] /= mass[i][i];
    }
}

static void take_roles(double *v, const double *state, int coordinate) {
    v[HIL_ROLE_ANGLE] = state[coordinate];
    v[HIL_ROLE_OMEGA] = state[RATE + coordinate];
    v[HIL_ROLE_ACCELERATION] = 0.0;
    v[HIL_ROLE_SWING] = state[DRIVE] - state[SHELL];
}

/* found: the rates of the state, then the channel. */
static void rates(const model *m, int sample, double share, const double *state, double *found) {
    double v[HIL_SLIPPING_VALUES];
    look(m, sample, share, v);
    hil_robot robot = robot_of(m, v);
    const double slope = v[HIL_ROLE_SLOPE];
    const double floor = robot.radius * smoothing_of(m, v);
    v[HIL_ROLE_SPEED] = state[RATE + AXLE];
    v[HIL_ROLE_SLIP] = hil_slip(robot.radius * state[RATE + SHELL], state[RATE + AXLE], floor);
    v[HIL_ROLE_LOAD] = hil_robot_derive(&robot).weight * cos(slope);
    take_roles(v, state, SHELL);
    hil_additions_change(m->run->additions, 1, v);
    double inertia[2];
    const double on_shell = hil_additions_torque(m->run->additions, 1, v, &inertia[0]);
    take_roles(v, state, DRIVE);
    hil_additions_change(m->run->additions, 0, v);
    const double in_drive = hil_additions_torque(m->run->additions, 0, v, &inertia[1]);
    robot = robot_of(m, v);

    const double position[3] = {state[AXLE], state[SHELL], state[DRIVE]};
    const double rate[3] = {state[RATE + AXLE], state[RATE + SHELL], state[RATE + DRIVE]};
    const hil_ground ground = {.slope = slope};
    double mass[3][3], force[3];
    hil_body_matrices(&robot, &ground, position, rate, &mass[0][0], force);
    mass[HIL_BETA][HIL_BETA] += inertia[0];
    mass[HIL_ALPHA][HIL_ALPHA] += inertia[1];
    force[HIL_BETA] -= on_shell;
    force[HIL_ALPHA] -= in_drive;
    add_ground(m, v, &robot, rate, v[HIL_ROLE_LOAD], force);
    memcpy(found, &state[RATE], sizeof(double) * RATE);
    if (m->run->body == HIL_SLIPPING_CYLINDER) {
        const hil_rolling_load load = {v[HIL_ROLE_VOLTAGE], 0.0, 0.0, v[HIL_SLIPPING_SMOOTHING]};
        const hil_rolling_state s = {state[SHELL], state[DRIVE], state[RATE + SHELL], state[RATE + DRIVE]};
        const hil_rolling_torques t = hil_rolling_evaluate(&robot, &load, &s);
        force[HIL_ALPHA] += robot.radius / robot.drive_radius * t.motor - t.internal_friction;
        solve(3, mass, force);
        found[RATE + DRIVE] = force[HIL_ALPHA];
        found[CHANNEL_OUT] = t.motor / robot.torque_constant;
    } else {
        const double acceleration = joint_acceleration(m->run, sample);
        const double held[3] = {mass[HIL_ALPHA][HIL_X], mass[HIL_ALPHA][HIL_BETA], mass[HIL_ALPHA][HIL_ALPHA]};
        force[HIL_X] -= held[0] * acceleration;
        force[HIL_BETA] -= held[1] * acceleration;
        solve(2, mass, force);
        found[RATE + DRIVE] = acceleration;
        found[CHANNEL_OUT] = held[0] * force[HIL_X] + held[1] * force[HIL_BETA] + held[2] * acceleration -
                             force[HIL_ALPHA] + robot.viscous * state[RATE + DRIVE];
    }
    found[RATE + SHELL] = force[HIL_BETA];
    found[RATE + AXLE] = force[HIL_X];
}

/* A run and its neighbours: derivatives of the rates and the channel at one point, by the states and by what each
 * neighbour's values are more. */
typedef struct {
    model run;
    int columns; /* of neighbours; 1 where `shape` has many of one */
    double by_state[STATES + 1][STATES];
    double by[STATES + 1][HIL_ODE_COLUMNS];
} neighbourhood;

static void by_states(neighbourhood *n, int sample, double share, const double *state) {
    double low[STATES + 1], high[STATES + 1], moved[STATES];
    for (int j = 0; j < STATES; j++) {
        const double step = DIFFERENCE * larger(fabs(state[j]), 1e-2);
        memcpy(moved, state, sizeof moved);
        moved[j] = state[j] - step;
        rates(&n->run, sample, share, moved, low);
        moved[j] = state[j] + step;
        rates(&n->run, sample, share, moved, high);
        for (int i = 0; i <= STATES; i++) {
            n->by_state[i][j] = (high[i] - low[i]) / (2.0 * step);
        }
    }
}

static void by_neighbours(neighbourhood *n, int sample, double share, const double *state) {
    double here[STATES + 1], there[STATES + 1];
    rates(&n->run, sample, share, state, here);
    for (int c = 0; c < n->columns; c++) {
        const model other = {n->run.run, c + 1};
        rates(&other, sample, share, state, there);
        for (int i = 0; i <= STATES; i++) {
            n->by[i][c] = there[i] - here[i];
        }
    }
}

/* I - half by_state, factored with its rows exchanged as `order` says. 0 where it has no inverse. */
static int factor(const neighbourhood *n, double half, double lower[STATES][STATES], int *order) {
    for (int i = 0; i < STATES; i++) {
        order[i] = i;
        for (int j = 0; j < STATES; j++) {
            lower[i][j] = (i == j ? 1.0 : 0.0) - half * n->by_state[i][j];
        }
    }
    for (int i = 0; i < STATES; i++) {
        int best = i;
        for (int k = i + 1; k < STATES; k++) {
            best = fabs(lower[order[k]][i]) > fabs(lower[order[best]][i]) ? k : best;
        }
        const int row = order[best];
        order[best] = order[i];
        order[i] = row;
        if (!(fabs(lower[row][i]) > 0.0)) {
            return 0;
        }
        for (int k = i + 1; k < STATES; k++) {
            double *under = lower[order[k]];
            under[i] /= lower[row][i];
            for (int j = i + 1; j < STATES; j++) {
                under[j] -= under[i] * lower[row][j];
            }
        }
    }
    return 1;
}

static void substitute(double lower[STATES][STATES], const int *order, const double *right, double *found) {
    for (int i = 0; i < STATES; i++) {
        found[i] = right[order[i]];
        for (int j = 0; j < i; j++) {
            found[i] -= lower[order[i]][j] * found[j];
        }
    }
    for (int i = STATES - 1; i >= 0; i--) {
        for (int j = i + 1; j < STATES; j++) {
            found[i] -= lower[order[i]][j] * found[j];
        }
        found[i] /= lower[order[i]][i];
    }
}

/* The implicit midpoint's middle state, by Newton's method, its matrix left in `lower`. 0 where that finds none. */
static int middle(neighbourhood *n, int sample, double share, double half, const double *state, double *mid,
                  double lower[STATES][STATES], int *order) {
    memcpy(mid, state, sizeof(double) * STATES);
    for (int turn = 0; turn < 12; turn++) {
        if (turn == 0 || turn > 4) { /* the first matrix does for a few */
            by_states(n, sample, share, mid);
            if (!factor(n, half, lower, order)) {
                return 0;
            }
        }
        double here[STATES + 1], short_by[STATES], more[STATES], largest = 0.0;
        rates(&n->run, sample, share, mid, here);
        for (int i = 0; i < STATES; i++) {
            short_by[i] = state[i] + half * here[i] - mid[i];
        }
        substitute(lower, order, short_by, more);
        for (int i = 0; i < STATES; i++) {
            mid[i] += more[i];
            largest = larger(largest, fabs(more[i]) / larger(1.0, fabs(mid[i])));
        }
        if (!(largest < BOUND)) {
            return 0;
        }
        if (largest < CLOSE) {
            return 1;
        }
    }
    return 0;
}

typedef struct {
    double state[STATES];
    double by[STATES][HIL_ODE_COLUMNS];
} way;

/* One step from `share` to `share` + `part` of the interval after a sample, of `length` [s]. 0, and nothing is changed,
 * where no middle is found. A-stable: slip is far faster than a step at standstill. */
static int advance(neighbourhood *n, int sample, double share, double part, double length, const double *shape,
                   int columns, way *w) {
    double mid[STATES], lower[STATES][STATES];
    int order[STATES];
    const double half = 0.5 * part * length, at = share + 0.5 * part;
    if (!middle(n, sample, at, half, w->state, mid, lower, order)) {
        return 0;
    }
    if (columns > 0) {
        by_states(n, sample, at, mid);
        by_neighbours(n, sample, at, mid);
        if (!factor(n, half, lower, order)) {
            return 0;
        }
        for (int c = 0; c < columns; c++) {
            double right[STATES], found[STATES];
            double times = 1.0;
            if (shape != NULL) {
                const double from = shape[(ptrdiff_t)sample * columns + c];
                times = from + at * (shape[(ptrdiff_t)(sample + 1) * columns + c] - from);
            }
            for (int i = 0; i < STATES; i++) {
                right[i] = w->by[i][c] + half * times * n->by[i][shape != NULL ? 0 : c];
            }
            substitute(lower, order, right, found);
            for (int i = 0; i < STATES; i++) {
                w->by[i][c] = 2.0 * found[i] - w->by[i][c];
            }
        }
    }
    for (int i = 0; i < STATES; i++) {
        w->state[i] = 2.0 * mid[i] - w->state[i];
    }
    return 1;
}

/* The same in shorter steps, down to a PARTS-th, where it has to be. */
static int advance_over(neighbourhood *n, int sample, double share, double part, double length, const double *shape,
                        int columns, way *w) {
    int left = PARTS;
    int size = PARTS;
    while (left > 0) {
        const double from = share + part * (PARTS - left) / PARTS;
        if (advance(n, sample, from, part * size / PARTS, length, shape, columns, w)) {
            left -= size;
        } else {
            size /= 2;
            if (size == 0) {
                return 0;
            }
        }
    }
    return 1;
}

/* The rows of a sample: the run's record, and what the neighbours change. */
static void note(neighbourhood *n, int sample, const way *w, const double *shape, int columns, double *record,
                 double *change) {
    double *row = &record[(ptrdiff_t)sample * HIL_SLIPPING_RECORD];
    double all[STATES + 1];
    rates(&n->run, sample, 0.0, w->state, all);
    memcpy(row, w->state, sizeof(double) * STATES);
    memcpy(&row[STATES], &all[RATE], sizeof(double) * (RATE + 1));
    if (columns > 0) {
        by_states(n, sample, 0.0, w->state);
        by_neighbours(n, sample, 0.0, w->state);
    }
    for (int c = 0; c < columns; c++) {
        double *more = &change[((ptrdiff_t)c * n->run.run->samples + sample) * HIL_SLIPPING_RECORD];
        const double times = shape != NULL ? shape[(ptrdiff_t)sample * columns + c] : 1.0;
        for (int s = 0; s < STATES; s++) {
            more[s] = w->by[s][c];
        }
        for (int k = 0; k <= RATE; k++) { /* accelerations, then the channel */
            double sum = times * n->by[RATE + k][shape != NULL ? 0 : c];
            for (int s = 0; s < STATES; s++) {
                sum += n->by_state[RATE + k][s] * w->by[s][c];
            }
            more[STATES + k] = sum;
        }
    }
}

int hil_slipping_follow(const hil_slipping_run *run, const double *start, int columns, const double *shape,
                        double *record, double *change) {
    assert(run->count <= HIL_SLIPPING_VALUES && columns <= HIL_ODE_COLUMNS);
    neighbourhood n = {.run = {run, 0}, .columns = shape != NULL ? 1 : columns};
    way w;
    memcpy(w.state, start, sizeof w.state);
    for (int c = 0; c < columns; c++) {
        const double *other = &start[(ptrdiff_t)(shape != NULL ? 1 : c + 1) * STATES];
        for (int s = 0; s < STATES; s++) {
            w.by[s][c] = (other[s] - start[s]) * (shape != NULL ? shape[c] : 1.0);
        }
    }
    note(&n, 0, &w, shape, columns, record, change);
    for (int k = 0; k + 1 < run->samples; k++) {
        const double length = run->time[k + 1] - run->time[k];
        const int steps = (int)smaller(larger(ceil(length / LONGEST - 1e-9), 1.0), HIL_SLIPPING_MOST_STEPS);
        for (int i = 0; i < steps; i++) {
            if (!advance_over(&n, k, (double)i / steps, 1.0 / steps, length, shape, columns, &w)) {
                return k;
            }
        }
        note(&n, k + 1, &w, shape, columns, record, change);
    }
    return run->samples;
}

/* Sets the axle's speed such that it keeps it, at the swing of the state. */
static void settle_axle(const model *m, double *state, double *found) {
    double v[HIL_SLIPPING_VALUES];
    look(m, 0, 0.0, v);
    const double rim = robot_of(m, v).radius * state[RATE + SHELL];
    double low = -1.0, high = 1.0; /* slip: the more, the faster the axle becomes */
    for (int i = 0; i < 50; i++) {
        const double slip = 0.5 * (low + high);
        state[RATE + AXLE] = slip >= 0.0 ? rim * (1.0 - slip) : rim / (1.0 + slip);
        rates(m, 0, 0.0, state, found);
        if (found[RATE + AXLE] * rim > 0.0) {
            high = slip;
        } else {
            low = slip;
        }
    }
}

void hil_slipping_settle(const hil_slipping_run *run, int row, double *start) {
    const model m = {run, row};
    const double shell = start[SHELL];
    double low = -1.5707963267948966;
    double high = -low;
    double found[HIL_SLIPPING_STATE + 1];
    for (int i = 0; i < 50; i++) { /* the more the bob leans forward, the more it swings back */
        const double swing = 0.5 * (low + high);
        start[DRIVE] = shell + swing;
        settle_axle(&m, start, found);
        if (found[RATE + DRIVE] - found[RATE + SHELL] > 0.0) {
            low = swing;
        } else {
            high = swing;
        }
    }
}
