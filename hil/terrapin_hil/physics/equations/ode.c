#include "ode.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

enum { STAGES = 7 };

static const double SHARE[STAGES] = {0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0};
static const double WEIGHT[STAGES][STAGES - 1] = {
    {0.0},
    {0.2},
    {3.0 / 40.0, 9.0 / 40.0},
    {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
    {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
    {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
    {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0},
};
static const double ERROR[STAGES] = {71.0 / 57600.0,      0.0,          -71.0 / 16695.0, 71.0 / 1920.0,
                                     -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0};

/* Share of the increment by each stage after half a step, of order 4 (Shampine, Math. Comp. 46, 1986, 135-150). */
static const double HALF[STAGES] = {
    0.5 * 6025192743.0 / 30085553152.0,     0.0,
    0.5 * 51252292925.0 / 65400821598.0,    0.5 * -2691868925.0 / 45128329728.0,
    0.5 * 187940372067.0 / 1594534317056.0, 0.5 * -1776094331.0 / 19743644256.0,
    0.5 * 11237099.0 / 235043384.0,
};

enum { STATES = HIL_ODE_STATES, COLUMNS = HIL_ODE_COLUMNS, MOST_PARTS = 100 };

/* A step of the derivatives goes at most so far, relative to the fastest motion: the error is below 1e-5 of it. */
static const double FAR = 0.25;

/* Derivatives of the states (states x columns) by the first states or what else the columns stand for follow the
 * states: S' = a S + b. */
typedef struct {
    const hil_ode *ode;
    const hil_ode_drive *drive;
    int columns;
    int free;   /* of the columns: by the free parameters; these follow `states` others */
    int target; /* -1, or the state to whose derivative the last two columns add */
} model;

/* Derivatives of the rates at one point, by the states and directly by what the columns stand for. */
typedef struct {
    double a[STATES][STATES];
    double b[STATES][COLUMNS];
} around_point;

/* A solution on its way. `known`: whether rate[0] and point[0] are those of the present state; a next step begins where
 * the last one ended. `step` [s] is the one to try next. */
typedef struct {
    double v[HIL_ODE_VALUES];
    double state[STATES];
    double by[STATES][COLUMNS];
    double rate[STAGES][STATES];
    around_point point[3]; /* at the begin, in the middle and at the end of a step */
    double step;
    int known;
    int left; /* steps that the stretch may still take */
} way;

/* Values at `share` of the way through the interval between a sample and the next. */
static void look(const model *m, int sample, int next, double share, const double *state, double *v) {
    const hil_ode_drive *d = m->drive;
    v[0] = d->time[sample] + share * (d->time[next] - d->time[sample]);
    memcpy(&v[1], state, sizeof(double) * (size_t)m->ode->states);
    for (int i = 0; i < d->inputs; i++) {
        const double from = d->input[(ptrdiff_t)sample * d->inputs + i];
        const double to = d->input[(ptrdiff_t)next * d->inputs + i];
        v[d->slot[i]] = m->ode->held ? from : from + share * (to - from);
    }
}

/* Value of formula `which`, and its derivatives by all values. */
static double gradient_of(const model *m, int which, const double *v, double *gradient) {
    const hil_ode *ode = m->ode;
    memset(gradient, 0, sizeof(double) * (size_t)ode->values);
    return hil_program_gradient(&ode->code[ode->begin[which]], ode->count[which], ode->smoothing, v, gradient);
}

static void rates(const model *m, int sample, double share, const double *state, double *v, double *found) {
    const hil_ode *ode = m->ode;
    look(m, sample, sample + 1, share, state, v);
    for (int s = 0; s < ode->states; s++) {
        found[s] = hil_program_run(&ode->code[ode->begin[s]], ode->count[s], ode->smoothing, v);
    }
}

static void derive(const model *m, int sample, double share, const double *state, double *v, around_point *found) {
    const int n = m->ode->states;
    double gradient[HIL_ODE_VALUES];
    look(m, sample, sample + 1, share, state, v);
    for (int s = 0; s < n; s++) {
        (void)gradient_of(m, s, v, gradient);
        memcpy(found->a[s], &gradient[1], sizeof(double) * (size_t)n);
        memset(found->b[s], 0, sizeof(double) * (size_t)m->columns);
        for (int p = 0; p < m->free; p++) {
            found->b[s][n + p] = gradient[m->ode->free_slot[p]];
        }
    }
    if (m->target >= 0) {
        found->b[m->target][m->columns - 2] = 1.0 - share;
        found->b[m->target][m->columns - 1] = share;
    }
}

/* How fast the derivatives move [1/s]: the root of the largest row sum of a a, which hardly depends on units. */
static double pace(const around_point *p, int n) {
    double most = 0.0;
    for (int i = 0; i < n; i++) {
        double row = 0.0;
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) {
                sum += p->a[i][k] * p->a[k][j];
            }
            row += fabs(sum);
        }
        most = fmax(most, row);
    }
    return sqrt(most);
}

/* The parabola through three points at 0, 1/2 and 1, at `share`. */
static void between(const around_point point[3], int n, int columns, double share, around_point *found) {
    const double first = (1.0 - share) * (1.0 - 2.0 * share);
    const double middle = 4.0 * share * (1.0 - share);
    const double last = share * (2.0 * share - 1.0);
    for (int s = 0; s < n; s++) {
        for (int i = 0; i < n; i++) {
            found->a[s][i] = first * point[0].a[s][i] + middle * point[1].a[s][i] + last * point[2].a[s][i];
        }
        for (int c = 0; c < columns; c++) {
            found->b[s][c] = first * point[0].b[s][c] + middle * point[1].b[s][c] + last * point[2].b[s][c];
        }
    }
}

/* found = a (by + h rate) + b */
static void follow(const around_point *p, int n, int columns, double by[STATES][COLUMNS], double h,
                   double rate[STATES][COLUMNS], double found[STATES][COLUMNS]) {
    double at[STATES][COLUMNS];
    for (int s = 0; s < n; s++) {
        for (int c = 0; c < columns; c++) {
            at[s][c] = by[s][c] + h * rate[s][c];
        }
    }
    for (int s = 0; s < n; s++) {
        memcpy(found[s], p->b[s], sizeof(double) * (size_t)columns);
        for (int i = 0; i < n; i++) {
            const double times = p->a[s][i];
            if (times != 0.0) {
                for (int c = 0; c < columns; c++) {
                    found[s][c] += times * at[i][c];
                }
            }
        }
    }
}

/* Takes the derivatives through a step of length h, of whose path the three points are known: Runge and Kutta's method
 * of order 4, in as many parts as the fastest motion needs. */
static void carry(const model *m, way *w, double h) {
    const int n = m->ode->states;
    const double parts = ceil(fmin(fmax(h * pace(&w->point[1], n) / FAR, 1.0), MOST_PARTS)); /* NaN: 1 */
    const double part = h / parts;
    double k[4][STATES][COLUMNS];
    around_point more[3];
    const around_point *p = w->point;
    for (int i = 0; i < (int)parts; i++) {
        for (int j = 0; parts > 1.0 && j < 3; j++) {
            between(w->point, n, m->columns, (i + 0.5 * j) / parts, &more[j]);
            p = more;
        }
        follow(&p[0], n, m->columns, w->by, 0.0, w->by, k[0]);
        follow(&p[1], n, m->columns, w->by, 0.5 * part, k[0], k[1]);
        follow(&p[1], n, m->columns, w->by, 0.5 * part, k[1], k[2]);
        follow(&p[2], n, m->columns, w->by, part, k[2], k[3]);
        for (int s = 0; s < n; s++) {
            for (int c = 0; c < m->columns; c++) {
                w->by[s][c] += part / 6.0 * (k[0][s][c] + 2.0 * (k[1][s][c] + k[2][s][c]) + k[3][s][c]);
            }
        }
    }
}

/* The derivatives through an accepted step of length h to the state `at`; `from`, `to`: shares of the interval. */
static void step_by(const model *m, int sample, way *w, double h, double from, double to, const double *at) {
    const int n = m->ode->states;
    double middle[STATES];
    for (int s = 0; s < n; s++) {
        double sum = 0.0;
        for (int j = 0; j < STAGES; j++) {
            sum += HALF[j] * w->rate[j][s];
        }
        middle[s] = w->state[s] + h * sum;
    }
    derive(m, sample, 0.5 * (from + to), middle, w->v, &w->point[1]);
    derive(m, sample, to, at, w->v, &w->point[2]);
    carry(m, w, h);
    w->point[0] = w->point[2];
}

/* The state after a step of length h from `done`, a share of the interval; the rates of all its stages but the first.
 */
static void try_step(const model *m, int sample, way *w, double h, double done, double span, double *at) {
    for (int stage = 1; stage < STAGES; stage++) {
        for (int s = 0; s < m->ode->states; s++) {
            double sum = 0.0;
            for (int j = 0; j < stage; j++) {
                sum += WEIGHT[stage][j] * w->rate[j][s];
            }
            at[s] = w->state[s] + h * sum;
        }
        rates(m, sample, done + SHARE[stage] * h / span, at, w->v, w->rate[stage]);
    }
}

/* Largest error of the step of length h to `at`, as a share of what is allowed, and the state that has it. */
static double worst_of(const model *m, const way *w, double h, const double *at, int *which) {
    const hil_ode *ode = m->ode;
    double worst = 0.0;
    for (int s = 0; s < ode->states; s++) {
        double error = 0.0;
        for (int j = 0; j < STAGES; j++) {
            error += ERROR[j] * w->rate[j][s];
        }
        const double size = fmax(fabs(w->state[s]), fabs(at[s]));
        const double ratio = fabs(h * error) / (ode->absolute[s] + ode->relative * size);
        if (!(ratio <= worst)) { /* not a number counts as too large */
            worst = isfinite(ratio) ? ratio : 1e6;
            *which = s;
        }
    }
    return worst;
}

/* Goes through the interval after `sample`. */
static hil_ode_end interval(const model *m, int sample, way *w) {
    const hil_ode *ode = m->ode;
    const double begin = m->drive->time[sample];
    const double span = m->drive->time[sample + 1] - begin;
    double at[STATES];
    double done = 0.0; /* share of the interval */
    hil_ode_end end = {HIL_ODE_STIFF, 0, begin, 0};
    if (!w->known || ode->held) { /* an input that is held jumps at the sample */
        rates(m, sample, 0.0, w->state, w->v, w->rate[0]);
        if (m->columns > 0) {
            derive(m, sample, 0.0, w->state, w->v, &w->point[0]);
        }
        w->known = 1;
    }
    for (int steps = 0; steps < HIL_ODE_MOST_STEPS && w->left > 0; steps++, w->left--) {
        const int last = w->step >= (1.0 - done) * span * (1.0 - 1e-12);
        const double h = last ? (1.0 - done) * span : w->step;
        try_step(m, sample, w, h, done, span, at);
        end.time = begin + done * span;
        const double worst = worst_of(m, w, h, at, &end.state);
        const double change = fmin(4.0, 0.9 * pow(fmax(worst, 1e-6), -0.2));
        if (worst <= 1.0) {
            if (m->columns > 0) {
                step_by(m, sample, w, h, done, last ? 1.0 : done + h / span, at);
            }
            memcpy(w->state, at, sizeof(double) * (size_t)ode->states);
            memcpy(w->rate[0], w->rate[STAGES - 1], sizeof(double) * (size_t)ode->states);
            for (int s = 0; s < ode->states; s++) {
                if (!(fabs(w->state[s]) <= ode->bound)) {
                    return (hil_ode_end){HIL_ODE_UNBOUNDED, s, end.time, 0};
                }
            }
            if (last) {
                w->step = fmax(w->step, h) * change;
                return (hil_ode_end){HIL_ODE_DONE, 0, begin + span, 0};
            }
            done += h / span;
        }
        w->step = h * fmax(0.1, change);
        if (!(w->step > 1e-12 * span)) { /* no smooth solution goes on from here: it runs off, or has no number */
            end.kind = HIL_ODE_UNBOUNDED;
            return end;
        }
    }
    return end;
}

/* A way that begins at a state, with its derivatives by itself. */
static void begin_at(const model *m, const double *state, way *w) {
    const int n = m->ode->states;
    memcpy(w->state, state, sizeof(double) * (size_t)n);
    for (int s = 0; s < n && m->columns > 0; s++) {
        memset(w->by[s], 0, sizeof w->by[s]);
        w->by[s][s] = 1.0;
    }
    w->known = 0;
}

/* One channel at the way's state; row (columns) receives its derivatives, by the chain rule from those of the states.
 */
static double channel_of(const model *m, int which, way *w, double *row) {
    const hil_ode *ode = m->ode;
    const int formula = ode->states + which;
    if (m->columns == 0) {
        return hil_program_run(&ode->code[ode->begin[formula]], ode->count[formula], ode->smoothing, w->v);
    }
    double gradient[HIL_ODE_VALUES];
    const double value = gradient_of(m, formula, w->v, gradient);
    memset(row, 0, sizeof(double) * (size_t)m->columns);
    for (int s = 0; s < ode->states; s++) {
        for (int c = 0; gradient[1 + s] != 0.0 && c < m->columns; c++) {
            row[c] += gradient[1 + s] * w->by[s][c];
        }
    }
    for (int p = 0; p < m->free; p++) {
        row[ode->states + p] += gradient[ode->free_slot[p]];
    }
    return value;
}

/* One stretch, from the way's state on. */
static hil_ode_end stretch(const model *m, int begin, int after, way *w, double *state, double *channel,
                           double *slope) {
    const int n = m->ode->states;
    const int channels = m->ode->channels;
    double unused[COLUMNS];
    w->step = after - begin > 1 ? m->drive->time[begin + 1] - m->drive->time[begin] : 0.0;
    for (int k = begin; k < after; k++) {
        memcpy(&state[(ptrdiff_t)k * n], w->state, sizeof(double) * (size_t)n);
        look(m, k, k, 0.0, w->state, w->v);
        for (int c = 0; c < channels; c++) {
            const ptrdiff_t place = (ptrdiff_t)k * channels + c;
            channel[place] = channel_of(m, c, w, slope != NULL ? &slope[place * m->columns] : unused);
        }
        if (k + 1 < after) {
            const hil_ode_end end = interval(m, k, w);
            if (end.kind != HIL_ODE_DONE) {
                return end;
            }
        }
    }
    return (hil_ode_end){HIL_ODE_DONE, 0, 0.0, 0};
}

void hil_ode_run(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *start,
                 const unsigned char *wanted, double *state, double *channel, double *slope, hil_ode_end *end) {
    const model m = {ode, drive, slope != NULL ? ode->states + ode->free : 0, slope != NULL ? ode->free : 0, -1};
    assert(ode->states >= 1 && ode->states <= STATES && m.columns <= COLUMNS && ode->values <= HIL_ODE_VALUES);
    way w;
    memcpy(w.v, values, sizeof(double) * (size_t)ode->values);
    for (int i = 0; i < drive->stretches; i++) {
        if (wanted[i] != 0) {
            begin_at(&m, &start[(ptrdiff_t)i * ode->states], &w);
            const int most = HIL_ODE_MEAN_STEPS * (drive->begin[i + 1] - drive->begin[i]);
            w.left = most;
            end[i] = stretch(&m, drive->begin[i], drive->begin[i + 1], &w, state, channel, slope);
            end[i].steps = most - w.left;
        }
    }
}

/* The neighbourhood after one sample, and (unless it is the `last` of its stretch) on the interval after it. */
static hil_ode_end around(const model *m, int k, int last, way *w, const double *state, double *record,
                          double *output) {
    const int n = m->ode->states;
    const model plain = {m->ode, m->drive, n, 0, -1};
    begin_at(m, &state[(ptrdiff_t)k * n], w);
    w->left = HIL_ODE_MOST_STEPS;
    look(m, k, k, 0.0, w->state, w->v);
    for (int c = 0; c < m->ode->channels; c++) {
        (void)channel_of(&plain, c, w, &output[((ptrdiff_t)k * m->ode->channels + c) * n]);
    }
    if (last) {
        return (hil_ode_end){HIL_ODE_DONE, 0, 0.0, 0};
    }
    const hil_ode_end end = interval(m, k, w);
    for (int s = 0; s < n; s++) {
        memcpy(&record[((ptrdiff_t)k * n + s) * m->columns], w->by[s], sizeof(double) * (size_t)m->columns);
    }
    return end;
}

hil_ode_end hil_ode_linear(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *state,
                           int target, double *record, double *output) {
    assert(ode->states >= 1 && ode->states <= STATES && ode->values <= HIL_ODE_VALUES);
    const model m = {ode, drive, ode->states + 2, 0, target};
    way w;
    memcpy(w.v, values, sizeof(double) * (size_t)ode->values);
    for (int i = 0; i < drive->stretches; i++) {
        const int begin = drive->begin[i];
        const int after = drive->begin[i + 1];
        w.step = after - begin > 1 ? drive->time[begin + 1] - drive->time[begin] : 0.0;
        for (int k = begin; k < after; k++) {
            const hil_ode_end end = around(&m, k, k + 1 == after, &w, state, record, output);
            if (end.kind != HIL_ODE_DONE) {
                return end;
            }
        }
    }
    return (hil_ode_end){HIL_ODE_DONE, 0, 0.0, 0};
}

void hil_ode_respond(const hil_ode *ode, const hil_ode_drive *drive, const double *record, const double *output,
                     const double *addition, double *channel) {
    const int n = ode->states;
    for (int part = 0; part < drive->stretches; part++) {
        double at[HIL_ODE_STATES] = {0.0};
        double next[HIL_ODE_STATES] = {0.0};
        for (int k = drive->begin[part]; k < drive->begin[part + 1]; k++) {
            for (int c = 0; c < ode->channels; c++) {
                const double *by = &output[((ptrdiff_t)k * ode->channels + c) * n];
                double sum = 0.0;
                for (int s = 0; s < n; s++) {
                    sum += by[s] * at[s];
                }
                channel[(ptrdiff_t)k * ode->channels + c] = sum;
            }
            if (k + 1 < drive->begin[part + 1]) {
                for (int s = 0; s < n; s++) {
                    const double *by = &record[((ptrdiff_t)k * n + s) * (n + 2)];
                    next[s] = by[n] * addition[k] + by[n + 1] * addition[k + 1];
                    for (int i = 0; i < n; i++) {
                        next[s] += by[i] * at[i];
                    }
                }
                memcpy(at, next, sizeof at);
            }
        }
    }
}
