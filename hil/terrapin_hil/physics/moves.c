#include "moves.h"

#include <assert.h>
#include <stddef.h>
#include <string.h>

void hil_moves_begin(hil_moves *m, int states, int columns, int count, const double *values) {
    assert(count <= HIL_MOVES_SLOTS && states + columns <= HIL_MOVES_WIDTH);
    m->states = states;
    m->width = states + columns;
    m->base = m->rows = 0;
    for (int slot = 0; slot < HIL_MOVES_SLOTS; slot++) {
        m->row[slot] = -1;
        for (int c = 0; c < columns && slot < count; c++) {
            const double more = values[(ptrdiff_t)(c + 1) * count + slot] - values[slot];
            if (more != 0.0) { /* or no number */
                double *row = m->row[slot] < 0 ? hil_moves_row(m, slot) : m->by[m->row[slot]];
                row[states + c] = more;
            }
        }
    }
    m->base = m->rows;
    memcpy(m->first, m->row, sizeof m->first);
}

void hil_moves_hold(hil_moves *m, int slot) {
    m->first[slot] = m->row[slot] = -1;
}

void hil_moves_again(hil_moves *m) {
    m->rows = m->base;
    memcpy(m->row, m->first, sizeof m->row);
}

double *hil_moves_row(hil_moves *m, int slot) {
    if (m->row[slot] < m->base || m->row[slot] < 0) {
        assert(m->rows < 2 * HIL_MOVES_SLOTS);
        m->row[slot] = m->rows++;
    }
    double *row = m->by[m->row[slot]];
    memset(row, 0, sizeof(double) * (size_t)m->width);
    return row;
}

void hil_moves_add(const hil_moves *m, int slot, double times, double *sum) {
    if (m->row[slot] < 0 || times == 0.0) {
        return;
    }
    const double *row = m->by[m->row[slot]];
    for (int c = 0; c < m->width; c++) {
        sum[c] += times * row[c];
    }
}

/* Value of a term's formula; sum (width) += times its moves. */
static double moved(const hil_additions *additions, const hil_term *term, const double *values, const hil_moves *m,
                    double times, double *sum) {
    const hil_instruction *code = &additions->code[term->begin];
    double gradient[HIL_MOVES_SLOTS]; /* of the formula's slots alone */
    for (int i = 0; i < term->count; i++) {
        if (code[i].op == HIL_OP_VALUE) {
            gradient[code[i].slot] = 0.0;
        }
    }
    const double value = hil_program_gradient(code, term->count, additions->smoothing, values, gradient);
    for (int i = 0; i < term->count; i++) {
        if (code[i].op == HIL_OP_VALUE) {
            hil_moves_add(m, code[i].slot, times * gradient[code[i].slot], sum);
            gradient[code[i].slot] = 0.0; /* a slot that stands there twice counts once */
        }
    }
    return value;
}

void hil_moves_change(const hil_additions *additions, int ground, double *values, hil_moves *m) {
    double more[HIL_MOVES_WIDTH];
    for (int i = 0; i < additions->count; i++) {
        const hil_term *term = &additions->term[i];
        if (term->ground != ground || term->kind == HIL_TERM_TORQUE) {
            continue;
        }
        const double was = values[term->slot];
        memset(more, 0, sizeof(double) * (size_t)m->width);
        const int adds = term->kind == HIL_TERM_ADD;
        const double e = moved(additions, term, values, m, adds ? 1.0 : was, more);
        hil_moves_add(m, term->slot, adds ? 1.0 : 1.0 + e, more);
        memcpy(hil_moves_row(m, term->slot), more, sizeof(double) * (size_t)m->width);
        values[term->slot] = adds ? was + e : was * (1.0 + e);
    }
}

double hil_moves_torque(const hil_additions *additions, int ground, double *values, const hil_moves *m, double *inertia,
                        double *torque_by, double *inertia_by) {
    double sum = 0.0;
    *inertia = 0.0;
    memset(torque_by, 0, sizeof(double) * (size_t)m->width);
    memset(inertia_by, 0, sizeof(double) * (size_t)m->width);
    for (int i = 0; i < additions->count; i++) {
        const hil_term *term = &additions->term[i];
        if (term->ground != ground || term->kind != HIL_TERM_TORQUE) {
            continue;
        }
        values[HIL_ROLE_ACCELERATION] = 0.0;
        const double still = moved(additions, term, values, m, 1.0, torque_by);
        sum += still;
        if (term->inertial) {
            (void)moved(additions, term, values, m, -1.0, inertia_by);
            values[HIL_ROLE_ACCELERATION] = 1.0;
            *inertia += moved(additions, term, values, m, 1.0, inertia_by) - still;
        }
    }
    return sum;
}
