#include "contact.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "disc.h"
#include "stack.h"

enum { OUTPUTS = 3, ITERATIONS = 80 };

#define SHALLOWEST 1e-7

static void roll(int stress, const hil_contact_point *point, double entry, int derivatives,
                 hil_contact_forces *forces) {
    static const hil_disc_change by[3] = {{0.0, 1.0, 0.0, 0.0}, {0.0, 0.0, -1.0, 0.0}, {1.0, 0.0, 0.0, 0.0}};
    const hil_disc disc = hil_disc_of(point, point->radius, entry, sin(entry), cos(entry), 1.0 - point->slip);
    const hil_disc_soil soil = hil_disc_soil_of(point);
    hil_disc_forces found;
    (stress == HIL_LINEAR ? hil_disc_linear : hil_disc_full)(&disc, &soil, derivatives, &found);
    memset(forces, 0, derivatives ? sizeof *forces : sizeof forces->value);
    hil_disc_add(point, &disc, &found, point->width, by, derivatives, forces);
    for (int o = 0; derivatives && o < OUTPUTS; o++) {
        forces->derivative[o][HIL_BY_WIDTH] = found.value[o];
    }
}

void hil_contact_evaluate(int shape, int stress, const hil_contact_point *point, double entry, int derivatives,
                          hil_contact_forces *forces) {
    (shape == HIL_WHEEL ? roll : hil_stack_evaluate)(stress, point, entry, derivatives, forces);
}

/* ln of the entry angle from the law for small loads, without shear: W = shape K z^n width_or_so I, z = R th^2 / 2. */
static double first_guess(int shape, const hil_contact_point *p, double load) {
    const double n = p->exponent;
    const double mean = pow(0.62, n); /* of (1 - v^2)^n, for a theta_m near theta_1 / 3 */
    double factor = p->stiffness * mean * pow(0.5 * p->radius, n) * p->radius;
    if (shape == HIL_WHEEL) {
        return log(load / (factor * p->width)) / (2.0 * n + 1.0);
    }
    /* across the discs: int cos^(2n+2) u du over the half width, both sides */
    factor *= 2.0 * p->radius * 0.5 * sqrt(3.14159265358979324) * tgamma(n + 1.5) / tgamma(n + 2.0);
    return log(load / factor) / (2.0 * n + 2.0);
}

static int usable(const hil_contact_point *p, double load) {
    /* a sum of numbers that are not all finite is not finite */
    const double sum = p->slip + p->width + p->exponent + p->cohesion + p->friction_angle + p->peak_share +
                       p->peak_slip + p->recovery + p->stiffness + p->radius + p->shear_modulus;
    return load > 0.0 && isfinite(load) && isfinite(sum) && p->stiffness >= 0.0 && p->radius > 0.0 &&
           p->shear_modulus > 0.0;
}

int hil_contact_solve(int shape, int stress, const hil_contact_point *point, double load, double *entry,
                      hil_contact_forces *forces) {
    const double top = log(HIL_CONTACT_STEEPEST);
    double low = log(SHALLOWEST), high = top;
    const double wanted = usable(point, load) ? log(load) : NAN;
    double power = 2.0 * point->exponent + (shape == HIL_WHEEL ? 1.0 : 2.0); /* d ln(force) / d ln(angle) */
    double x = *entry > 0.0 ? log(*entry) : isnan(wanted) ? top : first_guess(shape, point, load);
    double last_x = NAN, last_y = NAN, y = NAN;
    int topped = 0;
    if (isnan(wanted)) {
        *entry = NAN;
        forces->value[0] = forces->value[1] = forces->value[2] = NAN;
        return HIL_CONTACT_BAD_INPUT;
    }
    x = fmin(fmax(x, low), top);
    for (int i = 0; i < ITERATIONS; i++) {
        *entry = x >= top ? HIL_CONTACT_STEEPEST : exp(x);
        hil_contact_evaluate(shape, stress, point, *entry, 0, forces);
        y = log(fmax(forces->value[HIL_VERTICAL], 1e-300)) - wanted;
        if (fabs(y) < 1e-12 || isnan(y)) {
            break;
        }
        if (x >= top) {
            if (y < 0.0) {
                return HIL_CONTACT_TOO_HEAVY;
            }
            topped = 1;
        }
        if (y < 0.0) {
            low = fmax(low, x);
        } else {
            high = fmin(high, x);
        }
        const double secant = (y - last_y) / (x - last_x);
        if (fabs(x - last_x) > 1e-9 && secant > 0.3 && secant < 60.0) {
            power = secant;
        }
        last_x = x;
        last_y = y;
        x -= y / power;
        if (!(x > low && x < high)) {
            x = high >= top && !topped ? top : 0.5 * (low + high);
        }
        if (high - low < 1e-15) {
            break;
        }
    }
    if (!(fabs(y) < 1e-9)) {
        *entry = NAN;
        return HIL_CONTACT_NOT_CONVERGED;
    }
    return HIL_CONTACT_OK;
}

int hil_contact_points(int shape, int stress, int count, const hil_contact_point *points, const double *load,
                       double *entry, double *value, double *derivative, int *status) {
    int failed = 0;
    for (int i = 0; i < count; i++) {
        hil_contact_forces forces;
        if (load != NULL) {
            status[i] = hil_contact_solve(shape, stress, &points[i], load[i], &entry[i], &forces);
            failed += status[i] != HIL_CONTACT_OK;
        }
        if (load == NULL || derivative != NULL) {
            hil_contact_evaluate(shape, stress, &points[i], entry[i], derivative != NULL, &forces);
        }
        for (int o = 0; o < OUTPUTS; o++) {
            value[(ptrdiff_t)3 * i + o] = forces.value[o];
            for (int c = 0; derivative != NULL && c < HIL_CONTACT_COLUMNS; c++) {
                derivative[((ptrdiff_t)3 * i + o) * HIL_CONTACT_COLUMNS + c] = forces.derivative[o][c];
            }
        }
    }
    return failed;
}
