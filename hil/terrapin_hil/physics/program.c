#include "program.h"

#include <assert.h>
#include <math.h>

static double one(int op, double x, double smoothing) {
    switch (op) {
    case HIL_OP_NEGATE:
        return -x;
    case HIL_OP_ABS:
        return fabs(x);
    case HIL_OP_SIGN:
        return smoothing > 0.0 ? tanh(x / smoothing) : (double)(x > 0.0) - (double)(x < 0.0);
    case HIL_OP_SQRT:
        return sqrt(x);
    case HIL_OP_EXP:
        return exp(x);
    case HIL_OP_LOG:
        return log(x);
    case HIL_OP_SIN:
        return sin(x);
    case HIL_OP_COS:
        return cos(x);
    case HIL_OP_TAN:
        return tan(x);
    default:
        return tanh(x);
    }
}

static double two(int op, double x, double y) {
    switch (op) {
    case HIL_OP_ADD:
        return x + y;
    case HIL_OP_SUBTRACT:
        return x - y;
    case HIL_OP_MULTIPLY:
        return x * y;
    case HIL_OP_DIVIDE:
        return x / y;
    case HIL_OP_POWER:
        return y == 2.0 ? x * x : pow(x, y);
    case HIL_OP_LESS:
        return x < y;
    case HIL_OP_LESS_EQUAL:
        return x <= y;
    case HIL_OP_GREATER:
        return x > y;
    case HIL_OP_GREATER_EQUAL:
        return x >= y;
    case HIL_OP_EQUAL:
        return x == y;
    case HIL_OP_NOT_EQUAL:
        return x != y;
    case HIL_OP_MINIMUM:
        return fmin(x, y);
    default:
        return fmax(x, y);
    }
}

double hil_program_run(const hil_instruction *code, int count, double smoothing, const double *values) {
    double stack[HIL_PROGRAM_DEPTH];
    int depth = 0;
    for (int i = 0; i < count; i++) {
        const hil_instruction *now = &code[i];
        if (now->op == HIL_OP_NUMBER || now->op == HIL_OP_VALUE) {
            assert(depth < HIL_PROGRAM_DEPTH);
            stack[depth++] = now->op == HIL_OP_NUMBER ? now->number : values[now->slot];
        } else if (now->op >= HIL_OP_NEGATE) {
            assert(depth >= 1);
            stack[depth - 1] = one(now->op, stack[depth - 1], smoothing);
        } else {
            assert(depth >= 2);
            depth--;
            stack[depth - 1] = two(now->op, stack[depth - 1], stack[depth]);
        }
    }
    assert(depth == 1);
    return stack[0];
}

void hil_additions_change(const hil_additions *additions, int ground, double *values) {
    for (int i = 0; i < additions->count; i++) {
        const hil_term *term = &additions->term[i];
        if (term->ground != ground || term->kind == HIL_TERM_TORQUE) {
            continue;
        }
        const double e = hil_program_run(&additions->code[term->begin], term->count, additions->smoothing, values);
        if (term->kind == HIL_TERM_ADD) {
            values[term->slot] += e;
        } else {
            values[term->slot] *= 1.0 + e;
        }
    }
}

double hil_additions_torque(const hil_additions *additions, int ground, double *values, double *inertia) {
    double sum = 0.0;
    *inertia = 0.0;
    for (int i = 0; i < additions->count; i++) {
        const hil_term *term = &additions->term[i];
        if (term->ground != ground || term->kind != HIL_TERM_TORQUE) {
            continue;
        }
        const hil_instruction *code = &additions->code[term->begin];
        values[HIL_ROLE_ACCELERATION] = 0.0;
        const double still = hil_program_run(code, term->count, additions->smoothing, values);
        sum += still;
        if (term->inertial) {
            values[HIL_ROLE_ACCELERATION] = 1.0;
            *inertia += hil_program_run(code, term->count, additions->smoothing, values) - still;
        }
    }
    return sum;
}
