#include "ode.h"

#include <assert.h>
#include <stddef.h>
#include <string.h>

#include "flow.h"

enum { COLUMNS = HIL_ODE_COLUMNS };

/* Formulas on samples. Columns are by the first states or whatever else they stand for. */
typedef struct {
    const hil_ode *ode;
    const hil_ode_drive *drive;
    int columns;
    int free;   /* of the columns: by the free parameters; these follow `states` others */
    int target; /* -1, or the state to whose derivative the last two columns add */
    double v[HIL_ODE_VALUES];
} model;

/* Values at `share` of the way through the interval between a sample and the next. */
static void look(model *m, int sample, int next, double share, const double *state) {
    double *v = m->v;
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
static double gradient_of(const model *m, int which, double *gradient) {
    const hil_ode *ode = m->ode;
    memset(gradient, 0, sizeof(double) * (size_t)ode->values);
    return hil_program_gradient(&ode->code[ode->begin[which]], ode->count[which], ode->smoothing, m->v, gradient);
}

static void rates(void *law, int sample, double share, const double *state, double *found) {
    model *m = law;
    const hil_ode *ode = m->ode;
    look(m, sample, sample + 1, share, state);
    for (int s = 0; s < ode->states; s++) {
        found[s] = hil_program_run(&ode->code[ode->begin[s]], ode->count[s], ode->smoothing, m->v);
    }
}

static void derive(void *law, int sample, double share, const double *state, hil_around *found) {
    model *m = law;
    const int n = m->ode->states;
    double gradient[HIL_ODE_VALUES];
    look(m, sample, sample + 1, share, state);
    for (int s = 0; s < n; s++) {
        (void)gradient_of(m, s, gradient);
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

/* What integrates a model. */
static hil_flow flow_of(model *m) {
    const hil_ode *ode = m->ode;
    return (hil_flow){ode->states, m->columns, m->drive->time, ode->relative, ode->absolute, ode->bound, ode->held,
                      m,           rates,      derive,         NULL,          NULL,          NULL};
}

/* A way that begins at a state, with its derivatives by itself. */
static void begin_at(const hil_flow *flow, const double *state, hil_way *w) {
    hil_flow_begin(flow, state, w);
    for (int s = 0; s < flow->states && flow->columns > 0; s++) {
        w->by[s][s] = 1.0;
    }
}

/* One channel at the way's state; row (columns) receives its derivatives, by the chain rule from those of the states.
 */
static double channel_of(model *m, int which, const hil_way *w, int columns, double *row) {
    const hil_ode *ode = m->ode;
    const int formula = ode->states + which;
    if (columns == 0) {
        return hil_program_run(&ode->code[ode->begin[formula]], ode->count[formula], ode->smoothing, m->v);
    }
    double gradient[HIL_ODE_VALUES];
    const double value = gradient_of(m, formula, gradient);
    memset(row, 0, sizeof(double) * (size_t)columns);
    for (int s = 0; s < ode->states; s++) {
        for (int c = 0; gradient[1 + s] != 0.0 && c < columns; c++) {
            row[c] += gradient[1 + s] * w->by[s][c];
        }
    }
    for (int p = 0; p < m->free; p++) {
        row[ode->states + p] += gradient[ode->free_slot[p]];
    }
    return value;
}

/* One stretch, from the way's state on. */
static hil_ode_end stretch(model *m, int begin, int after, hil_way *w, double *state, double *channel, double *slope) {
    const int n = m->ode->states;
    const int channels = m->ode->channels;
    const hil_flow flow = flow_of(m);
    double unused[COLUMNS];
    w->step = after - begin > 1 ? m->drive->time[begin + 1] - m->drive->time[begin] : 0.0;
    for (int k = begin; k < after; k++) {
        memcpy(&state[(ptrdiff_t)k * n], w->state, sizeof(double) * (size_t)n);
        look(m, k, k, 0.0, w->state);
        for (int c = 0; c < channels; c++) {
            const ptrdiff_t place = (ptrdiff_t)k * channels + c;
            channel[place] = channel_of(m, c, w, m->columns, slope != NULL ? &slope[place * m->columns] : unused);
        }
        if (k + 1 < after) {
            const hil_ode_end end = hil_flow_interval(&flow, k, w);
            if (end.kind != HIL_ODE_DONE) {
                return end;
            }
        }
    }
    return (hil_ode_end){HIL_ODE_DONE, 0, 0.0, 0};
}

void hil_ode_run(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *start,
                 const unsigned char *wanted, double *state, double *channel, double *slope, hil_ode_end *end) {
    model m = {ode, drive, slope != NULL ? ode->states + ode->free : 0, slope != NULL ? ode->free : 0, -1, {0.0}};
    const hil_flow flow = flow_of(&m);
    assert(ode->states >= 1 && ode->states <= HIL_ODE_STATES && m.columns <= COLUMNS && ode->values <= HIL_ODE_VALUES);
    hil_way w;
    memcpy(m.v, values, sizeof(double) * (size_t)ode->values);
    for (int i = 0; i < drive->stretches; i++) {
        if (wanted[i] != 0) {
            begin_at(&flow, &start[(ptrdiff_t)i * ode->states], &w);
            const int most = HIL_ODE_MEAN_STEPS * (drive->begin[i + 1] - drive->begin[i]);
            w.left = most;
            end[i] = stretch(&m, drive->begin[i], drive->begin[i + 1], &w, state, channel, slope);
            end[i].steps = most - w.left;
        }
    }
}

/* The neighbourhood after one sample, and (unless it is the `last` of its stretch) on the interval after it. */
static hil_ode_end around(model *m, int k, int last, hil_way *w, const double *state, double *record, double *output) {
    const int n = m->ode->states;
    const hil_flow flow = flow_of(m);
    begin_at(&flow, &state[(ptrdiff_t)k * n], w);
    w->left = HIL_ODE_MOST_STEPS;
    look(m, k, k, 0.0, w->state);
    for (int c = 0; c < m->ode->channels; c++) {
        (void)channel_of(m, c, w, n, &output[((ptrdiff_t)k * m->ode->channels + c) * n]);
    }
    if (last) {
        return (hil_ode_end){HIL_ODE_DONE, 0, 0.0, 0};
    }
    const hil_ode_end end = hil_flow_interval(&flow, k, w);
    for (int s = 0; s < n; s++) {
        memcpy(&record[((ptrdiff_t)k * n + s) * m->columns], w->by[s], sizeof(double) * (size_t)m->columns);
    }
    return end;
}

hil_ode_end hil_ode_linear(const hil_ode *ode, const hil_ode_drive *drive, const double *values, const double *state,
                           int target, double *record, double *output) {
    assert(ode->states >= 1 && ode->states <= HIL_ODE_STATES && ode->values <= HIL_ODE_VALUES);
    model m = {ode, drive, ode->states + 2, 0, target, {0.0}};
    hil_way w;
    memcpy(m.v, values, sizeof(double) * (size_t)ode->values);
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
