#include "flow.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { STAGES = HIL_FLOW_STAGES, STATES = HIL_FLOW_STATES, COLUMNS = HIL_ODE_COLUMNS, MOST_PARTS = 100, BLOCK = 4 };

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

/* A step of the derivatives goes at most so far, relative to the fastest motion: the error is below 1e-5 of it. */
static const double FAR = 0.25;

void hil_flow_begin(const hil_flow *f, const double *state, hil_way *w) {
    memcpy(w->state, state, sizeof(double) * (size_t)f->states);
    for (int s = 0; s < f->states && f->columns > 0; s++) {
        memset(w->by[s], 0, sizeof w->by[s]);
    }
    w->known = 0;
}

/* How fast the derivatives move [1/s]: the root of the largest row sum of a a, which hardly depends on units. */
static double pace(const hil_flow *f, const hil_around *p) {
    const int n = f->states;
    double most = 0.0;
    for (int i = 0; i < n; i++) {
        double row = 0.0;
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) {
                sum += p->a[i][k] * p->a[k][j];
            }
            row += f->size != NULL ? fabs(sum) * f->size[j] / f->size[i] : fabs(sum);
        }
        most = fmax(most, row);
    }
    return sqrt(most);
}

/* Columns in whole blocks. */
static int whole_blocks(int columns) {
    return (columns + BLOCK - 1) / BLOCK * BLOCK;
}

/* The law's derivatives, its one column spread over the shapes where there are any; up to a whole block, nothing. */
static void derive(const hil_flow *f, int sample, double share, const double *state, hil_around *found) {
    f->derive(f->law, sample, share, state, found);
    for (int s = 0; s < f->states; s++) {
        for (int c = f->columns; c < whole_blocks(f->columns); c++) {
            found->b[s][c] = 0.0;
        }
    }
    if (f->shape == NULL) {
        return;
    }
    const double *here = &f->shape[(ptrdiff_t)sample * f->columns];
    const double *next = share > 0.0 ? here + f->columns : here;
    for (int s = 0; s < f->states; s++) {
        const double unit = found->b[s][0];
        for (int c = 0; c < f->columns; c++) {
            found->b[s][c] = unit * (here[c] + share * (next[c] - here[c]));
        }
    }
}

/* The parabola through three points at 0, 1/2 and 1, at `share`. */
static void between(const hil_around point[3], int n, int columns, double share, hil_around *found) {
    const double first = (1.0 - share) * (1.0 - 2.0 * share);
    const double middle = 4.0 * share * (1.0 - share);
    const double last = share * (2.0 * share - 1.0);
    for (int s = 0; s < n; s++) {
        for (int i = 0; i < n; i++) {
            found->a[s][i] = first * point[0].a[s][i] + middle * point[1].a[s][i] + last * point[2].a[s][i];
        }
        for (int c = 0; c < whole_blocks(columns); c++) {
            found->b[s][c] = first * point[0].b[s][c] + middle * point[1].b[s][c] + last * point[2].b[s][c];
        }
    }
}

/* found = a (by + h rate) + b, BLOCK columns at a time */
static void follow(const hil_around *p, int n, int columns, double by[STATES][COLUMNS], double h,
                   double rate[STATES][COLUMNS], double found[STATES][COLUMNS]) {
    for (int first = 0; first < columns; first += BLOCK) {
        double at[STATES][BLOCK];
        for (int s = 0; s < n; s++) {
            for (int c = 0; c < BLOCK; c++) {
                at[s][c] = by[s][first + c] + h * rate[s][first + c];
            }
        }
        for (int s = 0; s < n; s++) {
            double sum[BLOCK];
            memcpy(sum, &p->b[s][first], sizeof sum);
            for (int i = 0; i < n; i++) {
                const double times = p->a[s][i];
                if (times != 0.0) {
                    for (int c = 0; c < BLOCK; c++) {
                        sum[c] += times * at[i][c];
                    }
                }
            }
            memcpy(&found[s][first], sum, sizeof sum);
        }
    }
}

/* Takes the derivatives through a step of length h, of whose path the three points are known: Runge and Kutta's method
 * of order 4, in as many parts as the fastest motion needs. */
static void carry(const hil_flow *f, hil_way *w, double h) {
    const int n = f->states;
    const double parts = ceil(fmin(fmax(h * pace(f, &w->point[1]) / FAR, 1.0), MOST_PARTS)); /* NaN: 1 */
    const double part = h / parts;
    double k[4][STATES][COLUMNS];
    hil_around more[3];
    const hil_around *p[3] = {&w->point[0], &w->point[1], &w->point[2]};
    for (int i = 0; i < (int)parts; i++) {
        if (parts > 1.0) { /* each begins where the last one ended */
            hil_around *end = &more[i % 2];
            between(w->point, n, f->columns, (i + 0.5) / parts, &more[2]);
            between(w->point, n, f->columns, (i + 1.0) / parts, end);
            p[0] = i == 0 ? &w->point[0] : &more[(i + 1) % 2];
            p[1] = &more[2];
            p[2] = end;
        }
        follow(p[0], n, f->columns, w->by, 0.0, w->by, k[0]);
        follow(p[1], n, f->columns, w->by, 0.5 * part, k[0], k[1]);
        follow(p[1], n, f->columns, w->by, 0.5 * part, k[1], k[2]);
        follow(p[2], n, f->columns, w->by, part, k[2], k[3]);
        for (int s = 0; s < n; s++) {
            for (int c = 0; c < f->columns; c++) {
                w->by[s][c] += part / 6.0 * (k[0][s][c] + 2.0 * (k[1][s][c] + k[2][s][c]) + k[3][s][c]);
            }
        }
    }
}

/* The derivatives through an accepted step of length h to the state `at`; `from`, `to`: shares of the interval. */
static void step_by(const hil_flow *f, int sample, hil_way *w, double h, double from, double to, const double *at) {
    const int n = f->states;
    double middle[STATES];
    for (int s = 0; s < n; s++) {
        double sum = 0.0;
        for (int j = 0; j < STAGES; j++) {
            sum += HALF[j] * w->rate[j][s];
        }
        middle[s] = w->state[s] + h * sum;
    }
    derive(f, sample, 0.5 * (from + to), middle, &w->point[1]);
    derive(f, sample, to, at, &w->point[2]);
    carry(f, w, h);
    w->point[0] = w->point[2];
}

/* The state after a step of length h from `done`, a share of the interval; the rates of all its stages but the first.
 */
static void try_step(const hil_flow *f, int sample, hil_way *w, double h, double done, double span, double *at) {
    for (int stage = 1; stage < STAGES; stage++) {
        for (int s = 0; s < f->states; s++) {
            double sum = 0.0;
            for (int j = 0; j < stage; j++) {
                sum += WEIGHT[stage][j] * w->rate[j][s];
            }
            at[s] = w->state[s] + h * sum;
        }
        f->rates(f->law, sample, done + SHARE[stage] * h / span, at, w->rate[stage]);
    }
}

/* Largest error of the step of length h to `at`, as a share of what is allowed, and the state that has it. */
static double worst_of(const hil_flow *f, const hil_way *w, double h, const double *at, int *which) {
    double worst = 0.0;
    for (int s = 0; s < f->states; s++) {
        double error = 0.0;
        for (int j = 0; j < STAGES; j++) {
            error += ERROR[j] * w->rate[j][s];
        }
        const double size = fmax(fabs(w->state[s]), fabs(at[s]));
        const double ratio = fabs(h * error) / (f->absolute[s] + f->relative * size);
        if (!(ratio <= worst)) { /* not a number counts as too large */
            worst = isfinite(ratio) ? ratio : 1e6;
            *which = s;
        }
    }
    return worst;
}

/* Rates and derivatives at the way's state. */
static void look_around(const hil_flow *f, int sample, double share, hil_way *w) {
    f->rates(f->law, sample, share, w->state, w->rate[0]);
    if (f->columns > 0) {
        derive(f, sample, share, w->state, &w->point[0]);
    }
    w->known = 1;
}

void hil_flow_arrive(const hil_flow *f, int sample, hil_way *w) {
    if (!w->known) {
        look_around(f, sample, 0.0, w);
    }
}

hil_ode_end hil_flow_interval(const hil_flow *f, int sample, hil_way *w) {
    const double begin = f->time[sample];
    const double span = f->time[sample + 1] - begin;
    double at[STATES];
    double done = 0.0; /* share of the interval */
    hil_ode_end end = {HIL_ODE_STIFF, 0, begin, 0};
    hil_flow_arrive(f, sample, w);
    for (int steps = 0; steps < HIL_ODE_MOST_STEPS && w->left > 0; steps++, w->left--) {
        const int last = w->step >= (1.0 - done) * span * (1.0 - 1e-12);
        const double h = last ? (1.0 - done) * span : w->step;
        try_step(f, sample, w, h, done, span, at);
        end.time = begin + done * span;
        const double worst = worst_of(f, w, h, at, &end.state);
        const double change = fmin(4.0, 0.9 * pow(fmax(worst, 1e-6), -0.2));
        if (worst <= 1.0) {
            if (f->columns > 0) {
                step_by(f, sample, w, h, done, last ? 1.0 : done + h / span, at);
            }
            memcpy(w->state, at, sizeof(double) * (size_t)f->states);
            memcpy(w->rate[0], w->rate[STAGES - 1], sizeof(double) * (size_t)f->states);
            if (f->settle != NULL && f->settle(f->law, w->state, w->by)) {
                look_around(f, sample, last ? 1.0 : done + h / span, w);
            }
            for (int s = 0; s < f->states; s++) {
                if (!(fabs(w->state[s]) <= f->bound)) {
                    return (hil_ode_end){HIL_ODE_UNBOUNDED, s, end.time, 0};
                }
            }
            if (last) {
                w->known = !f->jumps;
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
