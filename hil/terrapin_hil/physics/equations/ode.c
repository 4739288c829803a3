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

enum { CELLS = HIL_ODE_STATES * (1 + HIL_ODE_COLUMNS) };

/* What is integrated: the states, then their derivatives (states x columns) by the first states or what else the
 * columns stand for. */
typedef struct {
    const hil_ode *ode;
    const hil_ode_drive *drive;
    const double *values;
    int columns;
    int free;   /* of the columns: by the free parameters; these follow `states` others */
    int target; /* -1, or the state to whose derivative the last two columns add */
} model;

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

/* Value of formula `which`; row (columns) receives its derivatives, by the chain rule from those of the states. */
static double formula(const model *m, int which, const double *v, const double *cells, double *row) {
    const hil_ode *ode = m->ode;
    const hil_instruction *code = &ode->code[ode->begin[which]];
    if (m->columns == 0) {
        return hil_program_run(code, ode->count[which], ode->smoothing, v);
    }
    double gradient[HIL_ODE_VALUES];
    memset(gradient, 0, sizeof(double) * (size_t)ode->values);
    const double value = hil_program_gradient(code, ode->count[which], ode->smoothing, v, gradient);
    for (int c = 0; c < m->columns; c++) {
        row[c] = 0.0;
    }
    for (int s = 0; s < ode->states; s++) {
        const double by = gradient[1 + s];
        if (by != 0.0) {
            const double *of = &cells[ode->states + s * m->columns];
            for (int c = 0; c < m->columns; c++) {
                row[c] += by * of[c];
            }
        }
    }
    for (int p = 0; p < m->free; p++) {
        row[ode->states + p] += gradient[ode->free_slot[p]];
    }
    return value;
}

static void rates(const model *m, int sample, double share, double *v, const double *cells, double *found) {
    const int n = m->ode->states;
    memset(found, 0, sizeof(double) * (size_t)(n * (1 + m->columns)));
    look(m, sample, sample + 1, share, cells, v);
    for (int s = 0; s < n; s++) {
        found[s] = formula(m, s, v, cells, &found[n + s * m->columns]);
    }
    if (m->target >= 0) {
        double *row = &found[n + m->target * m->columns];
        row[m->columns - 2] += 1.0 - share;
        row[m->columns - 1] += share;
    }
}

/* Takes the cells through the interval after `sample`; *step is the step that is tried first, and the one to try next.
 */
static hil_ode_end interval(const model *m, int sample, double *v, double *cells, double *step) {
    const hil_ode *ode = m->ode;
    const double begin = m->drive->time[sample];
    const double span = m->drive->time[sample + 1] - begin;
    const int count = ode->states * (1 + m->columns);
    double k[STAGES][CELLS];
    double at[CELLS];
    double done = 0.0; /* share of the interval */
    hil_ode_end end = {HIL_ODE_STIFF, 0, begin};
    rates(m, sample, 0.0, v, cells, k[0]);
    for (int steps = 0; steps < HIL_ODE_MOST_STEPS; steps++) {
        const int last = *step >= (1.0 - done) * span * (1.0 - 1e-12);
        const double h = last ? (1.0 - done) * span : *step;
        for (int stage = 1; stage < STAGES; stage++) {
            double sum[CELLS];
            for (int i = 0; i < count; i++) {
                sum[i] = WEIGHT[stage][0] * k[0][i];
            }
            for (int j = 1; j < stage; j++) {
                for (int i = 0; i < count; i++) {
                    sum[i] += WEIGHT[stage][j] * k[j][i];
                }
            }
            for (int i = 0; i < count; i++) {
                at[i] = cells[i] + h * sum[i];
            }
            rates(m, sample, done + SHARE[stage] * h / span, v, at, k[stage]);
        }
        double worst = 0.0;
        end.time = begin + done * span;
        for (int s = 0; s < ode->states; s++) {
            double error = 0.0;
            for (int j = 0; j < STAGES; j++) {
                error += ERROR[j] * k[j][s];
            }
            const double size = fmax(fabs(cells[s]), fabs(at[s]));
            const double ratio = fabs(h * error) / (ode->absolute[s] + ode->relative * size);
            if (!(ratio <= worst)) { /* not a number counts as too large */
                worst = isfinite(ratio) ? ratio : 1e6;
                end.state = s;
            }
        }
        if (worst <= 1.0) {
            memcpy(cells, at, sizeof(double) * (size_t)count);
            memcpy(k[0], k[STAGES - 1], sizeof(double) * (size_t)count);
            for (int s = 0; s < ode->states; s++) {
                if (!(fabs(cells[s]) <= ode->bound)) {
                    return (hil_ode_end){HIL_ODE_UNBOUNDED, s, end.time};
                }
            }
            if (last) {
                *step = fmax(*step, h) * fmin(4.0, 0.9 * pow(fmax(worst, 1e-6), -0.2));
                return (hil_ode_end){HIL_ODE_DONE, 0, begin + span};
            }
            done += h / span;
        }
        *step = h * fmax(0.1, fmin(4.0, 0.9 * pow(fmax(worst, 1e-6), -0.2)));
        if (!(*step > 1e-12 * span)) { /* no smooth solution goes on from here: it runs off, or has no number */
            end.kind = HIL_ODE_UNBOUNDED;
            return end;
        }
    }
    return end;
}

/* One stretch, from `cells` on. */
static hil_ode_end stretch(const model *m, int begin, int after, double *cells, double *state, double *channel,
                           double *slope) {
    const hil_ode *ode = m->ode;
    const int n = ode->states;
    double v[HIL_ODE_VALUES];
    double unused[HIL_ODE_COLUMNS];
    memcpy(v, m->values, sizeof(double) * (size_t)ode->values);
    double step = after - begin > 1 ? m->drive->time[begin + 1] - m->drive->time[begin] : 0.0;
    for (int k = begin; k < after; k++) {
        memcpy(&state[(ptrdiff_t)k * n], cells, sizeof(double) * (size_t)n);
        look(m, k, k, 0.0, cells, v);
        for (int c = 0; c < ode->channels; c++) {
            const ptrdiff_t place = (ptrdiff_t)k * ode->channels + c;
            channel[place] = formula(m, n + c, v, cells, slope != NULL ? &slope[place * m->columns] : unused);
        }
        if (k + 1 < after) {
            const hil_ode_end end = interval(m, k, v, cells, &step);
            if (end.kind != HIL_ODE_DONE) {
                return end;
            }
        }
    }
    return (hil_ode_end){HIL_ODE_DONE, 0, 0.0};
}

void hil_ode_run(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *start,
                 const unsigned char *wanted, double *state, double *channel, double *slope, hil_ode_end *end) {
    const model m = {ode, drive, values, slope != NULL ? ode->states + ode->free : 0, slope != NULL ? ode->free : 0,
                     -1};
    assert(ode->states >= 1 && ode->states <= HIL_ODE_STATES && m.columns <= HIL_ODE_COLUMNS &&
           ode->values <= HIL_ODE_VALUES);
    const int n = ode->states;
    for (int i = 0; i < drive->stretches; i++) {
        if (wanted[i] == 0) {
            continue;
        }
        double cells[CELLS] = {0.0};
        memcpy(cells, &start[(ptrdiff_t)i * n], sizeof(double) * (size_t)n);
        for (int s = 0; s < n && m.columns > 0; s++) {
            cells[n + s * m.columns + s] = 1.0;
        }
        end[i] = stretch(&m, drive->begin[i], drive->begin[i + 1], cells, state, channel, slope);
    }
}

/* The neighbourhood after one sample, and (unless it is the `last` of its stretch) on the interval after it. */
static hil_ode_end around(const model *m, int k, int last, double *v, double *step, const double *state, double *record,
                          double *output) {
    const int n = m->ode->states;
    const model plain = {m->ode, m->drive, m->values, n, 0, -1};
    double cells[CELLS];
    hil_ode_end end = {HIL_ODE_DONE, 0, 0.0};
    for (int pass = 0; pass < 2 - last; pass++) {
        const model *use = pass == 0 ? &plain : m;
        memset(cells, 0, sizeof cells);
        memcpy(cells, &state[(ptrdiff_t)k * n], sizeof(double) * (size_t)n);
        for (int s = 0; s < n; s++) {
            cells[n + s * use->columns + s] = 1.0;
        }
        if (pass == 0) {
            look(use, k, k, 0.0, cells, v);
            for (int c = 0; c < m->ode->channels; c++) {
                (void)formula(use, n + c, v, cells, &output[((ptrdiff_t)k * m->ode->channels + c) * n]);
            }
        } else {
            end = interval(use, k, v, cells, step);
            memcpy(&record[(ptrdiff_t)k * n * m->columns], &cells[n], sizeof(double) * (size_t)(n * m->columns));
        }
    }
    return end;
}

hil_ode_end hil_ode_linear(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *state,
                           int target, double *record, double *output) {
    assert(ode->states >= 1 && ode->states <= HIL_ODE_STATES && ode->values <= HIL_ODE_VALUES);
    const model m = {ode, drive, values, ode->states + 2, 0, target};
    double v[HIL_ODE_VALUES];
    memcpy(v, values, sizeof(double) * (size_t)ode->values);
    for (int i = 0; i < drive->stretches; i++) {
        const int begin = drive->begin[i];
        const int after = drive->begin[i + 1];
        double step = after - begin > 1 ? drive->time[begin + 1] - drive->time[begin] : 0.0;
        for (int k = begin; k < after; k++) {
            const hil_ode_end end = around(&m, k, k + 1 == after, v, &step, state, record, output);
            if (end.kind != HIL_ODE_DONE) {
                return end;
            }
        }
    }
    return (hil_ode_end){HIL_ODE_DONE, 0, 0.0};
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
