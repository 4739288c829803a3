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

/* Derivative of one(op, x), whose value is y. */
static double slope(int op, double x, double y, double smoothing) {
    switch (op) {
    case HIL_OP_NEGATE:
        return -1.0;
    case HIL_OP_ABS:
        return x < 0.0 ? -1.0 : 1.0;
    case HIL_OP_SIGN:
        return smoothing > 0.0 ? (1.0 - y * y) / smoothing : 0.0;
    case HIL_OP_SQRT:
        return x > 0.0 ? 0.5 / y : 0.0;
    case HIL_OP_EXP:
        return y;
    case HIL_OP_LOG:
        return 1.0 / x;
    case HIL_OP_SIN:
        return cos(x);
    case HIL_OP_COS:
        return -sin(x);
    case HIL_OP_TAN:
        return 1.0 + y * y;
    default:
        return 1.0 - y * y;
    }
}

/* Derivatives of two(op, x, y), whose value is z, by x and by y; by y not where y is a `number` of the formula. */
static void slopes(int op, double x, double y, double z, int number, double *by) {
    by[0] = 0.0;
    by[1] = 0.0;
    switch (op) {
    case HIL_OP_ADD:
        by[0] = 1.0;
        by[1] = 1.0;
        break;
    case HIL_OP_SUBTRACT:
        by[0] = 1.0;
        by[1] = -1.0;
        break;
    case HIL_OP_MULTIPLY:
        by[0] = y;
        by[1] = x;
        break;
    case HIL_OP_DIVIDE:
        by[0] = 1.0 / y;
        by[1] = -z / y;
        break;
    case HIL_OP_POWER:
        by[0] = y == 2.0 ? 2.0 * x : y == 3.0 ? 3.0 * x * x : x == 0.0 && y < 1.0 ? 0.0 : y * pow(x, y - 1.0);
        by[1] = x > 0.0 && !number ? z * log(x) : 0.0;
        break;
    case HIL_OP_MINIMUM:
        by[x <= y ? 0 : 1] = 1.0;
        break;
    case HIL_OP_MAXIMUM:
        by[x >= y ? 0 : 1] = 1.0;
        break;
    default: /* comparisons */
        break;
    }
}

double hil_program_gradient(const hil_instruction *code, int count, double smoothing, const double *values,
                            double *gradient) {
    assert(count > 0 && count <= HIL_PROGRAM_LENGTH);
    double value[HIL_PROGRAM_LENGTH];
    double by[HIL_PROGRAM_LENGTH][2];
    int from[HIL_PROGRAM_LENGTH][2]; /* instructions that gave the arguments */
    int stack[HIL_PROGRAM_DEPTH];
    int depth = 0;
    for (int i = 0; i < count; i++) {
        const hil_instruction *now = &code[i];
        if (now->op == HIL_OP_NUMBER || now->op == HIL_OP_VALUE) {
            assert(depth < HIL_PROGRAM_DEPTH);
            value[i] = now->op == HIL_OP_NUMBER ? now->number : values[now->slot];
            depth++;
        } else if (now->op >= HIL_OP_NEGATE) {
            assert(depth >= 1);
            from[i][0] = stack[depth - 1];
            const double x = value[from[i][0]];
            value[i] = one(now->op, x, smoothing);
            by[i][0] = slope(now->op, x, value[i], smoothing);
        } else {
            assert(depth >= 2);
            depth--;
            from[i][0] = stack[depth - 1];
            from[i][1] = stack[depth];
            const double x = value[from[i][0]];
            const double y = value[from[i][1]];
            value[i] = two(now->op, x, y);
            slopes(now->op, x, y, value[i], code[from[i][1]].op == HIL_OP_NUMBER, by[i]);
        }
        stack[depth - 1] = i;
    }
    assert(depth == 1);
    double weight[HIL_PROGRAM_LENGTH]; /* of the result by what an instruction gave: one other took each */
    weight[count - 1] = 1.0;
    for (int i = count - 1; i >= 0; i--) {
        const int op = code[i].op;
        if (op == HIL_OP_VALUE) {
            gradient[code[i].slot] += weight[i];
        } else if (op != HIL_OP_NUMBER) {
            weight[from[i][0]] = weight[i] * by[i][0];
            if (op < HIL_OP_NEGATE) {
                weight[from[i][1]] = weight[i] * by[i][1];
            }
        }
    }
    return value[count - 1];
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
