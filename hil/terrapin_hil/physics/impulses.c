#include "impulses.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "extremes.h"

enum { X = 0, BETA = 1, ALPHA = 2, COORDINATES = 3 };
enum { ATTEMPTS = 8, SWEEPS = 100, NEWTON = 60 };

static inline double row(const double *a, const double *b) {
    return a[X] * b[X] + a[BETA] * b[BETA] + a[ALPHA] * b[ALPHA];
}

static inline double clamp(double value, double bound) {
    return smaller(larger(value, -bound), bound);
}

void hil_invert3(const double m[3][3], double inverse[3][3]) {
    const double a = m[1][1] * m[2][2] - m[1][2] * m[1][2];
    const double b = m[0][2] * m[1][2] - m[0][1] * m[2][2];
    const double c = m[0][1] * m[1][2] - m[0][2] * m[1][1];
    const double scale = 1.0 / (m[0][0] * a + m[0][1] * b + m[0][2] * c);
    inverse[0][0] = a * scale;
    inverse[0][1] = inverse[1][0] = b * scale;
    inverse[0][2] = inverse[2][0] = c * scale;
    inverse[1][1] = (m[0][0] * m[2][2] - m[0][2] * m[0][2]) * scale;
    inverse[1][2] = inverse[2][1] = (m[0][1] * m[0][2] - m[0][0] * m[1][2]) * scale;
    inverse[2][2] = (m[0][0] * m[1][1] - m[0][1] * m[0][1]) * scale;
}

void hil_invert2(const double m[3][3], double inverse[3][3]) {
    const double scale = 1.0 / (m[1][1] * m[2][2] - m[1][2] * m[1][2]);
    memset(inverse, 0, 9 * sizeof(double));
    inverse[1][1] = m[2][2] * scale;
    inverse[2][2] = m[1][1] * scale;
    inverse[1][2] = inverse[2][1] = -m[1][2] * scale;
}

/* Solves w + k (1 - exp(-w / scale)) = w_free for the slip speed w between 0 and w_free >= 0: the left side is concave
 * and rising, so that Newton's steps from the left of the root rise to it and never pass it. */
static double slip_speed(double w_free, double k, double scale, double guess) {
    const double per_scale = 1.0 / scale;
    double w = larger(smaller(guess, w_free), larger(w_free - k, 0.0));
    for (int i = 0; i < NEWTON; i++) {
        const double decay = exp(-w * per_scale);
        const double step = (w_free - w - k * (1.0 - decay)) / (1.0 + k * decay * per_scale);
        w = smaller(larger(w + step, 0.0), w_free);
        if (fabs(step) <= 1e-6 * scale) { /* Newton leaves less than step^2 / (2 scale) */
            break;
        }
    }
    return w;
}

/* The same for a contact model's thrust: solves w + compliance dt F(w) = w_free by Newton's method in a bracket. The
 * left side rises with w. */
static double thrust_impulse(const hil_impulses *s, double w_free, double compliance, double guess) {
    double slope;
    double w = compliance > 0.0 ? guess : w_free;
    const double k = compliance * s->dt;
    double low = -INFINITY;
    double high = INFINITY;
    for (int i = 0; i < NEWTON && compliance > 0.0; i++) {
        const double miss = w + k * hil_grip_value(s->grip, HIL_THRUST, w, &slope) - w_free;
        if (miss < 0.0) {
            low = w;
        } else {
            high = w;
        }
        const double next = w - miss / (1.0 + k * larger(slope, 0.0));
        if (fabs(next - w) <= 1e-9 * s->grip->scale) {
            w = next;
            break;
        }
        w = next > low && next < high ? next : 0.5 * (low + high);
    }
    return s->dt * hil_grip_value(s->grip, HIL_THRUST, w, &slope);
}

/* Traction impulse when the slip speed would be w_free without it and falls by `compliance` for each unit of it. */
static double traction_impulse(const hil_impulses *s, double w_free, double compliance, double guess) {
    if (s->grip != NULL) {
        return thrust_impulse(s, w_free, compliance, guess);
    }
    const double k = compliance * s->strength;
    const double size = fabs(w_free);
    if (k < 1e-9 * s->slip_scale) { /* held by frictions: the slip does not answer to the traction */
        return copysign(s->strength * (1.0 - exp(-size / s->slip_scale)), w_free);
    }
    const double found = slip_speed(size, k, s->slip_scale, fabs(guess));
    return copysign((size - found) / compliance, w_free);
}

/* Takes the stuck coordinates out of the response of the velocities, one by one (a Schur complement). */
static void eliminate(const hil_impulses *s, const bool *stuck, double *velocity, double *pull) {
    double response[3][3];
    memcpy(response, s->inverse, sizeof response);
    for (int i = 0; i < COORDINATES; i++) {
        if (!stuck[i]) {
            continue;
        }
        const double pivot = 1.0 / response[i][i];
        for (int j = 0; j < COORDINATES; j++) {
            const double share = j == i ? 0.0 : response[j][i] * pivot;
            velocity[j] -= share * velocity[i];
            pull[j] -= share * pull[i];
            for (int k = 0; k < COORDINATES; k++) {
                response[j][k] -= share * response[i][k];
            }
        }
        velocity[i] = 0.0;
        pull[i] = 0.0;
        for (int j = 0; j < COORDINATES; j++) {
            response[i][j] = response[j][i] = 0.0;
        }
    }
}

/* Velocities, traction and the frictions that hold, when the coordinates in `stuck` stand still and the other frictions
 * are as they are. */
static void solve_with(hil_impulses *s, const bool *stuck, double guess) {
    const bool any = stuck[X] || stuck[BETA] || stuck[ALPHA];
    double given[3];
    double velocity[3];
    double pull[3]; /* change of the velocities by a unit traction impulse */
    for (int i = 0; i < COORDINATES; i++) {
        given[i] = stuck[i] ? s->smooth[i] : s->smooth[i] + s->friction[i];
    }
    for (int i = 0; i < COORDINATES; i++) {
        velocity[i] = s->base[i] + row(s->inverse[i], given);
        pull[i] = s->inverse[i][X] - s->radius * s->inverse[i][BETA];
    }
    if (any) {
        eliminate(s, stuck, velocity, pull);
    }
    const double compliance = pull[X] - s->radius * pull[BETA];
    s->traction = traction_impulse(s, s->radius * velocity[BETA] - velocity[X], compliance, guess);
    for (int i = 0; i < COORDINATES; i++) {
        s->velocity[i] = velocity[i] + pull[i] * s->traction;
    }
    if (any) { /* what holds is the momentum that is still missing */
        const double gained[3] = {s->velocity[X] - s->base[X], s->velocity[BETA] - s->base[BETA],
                                  s->velocity[ALPHA] - s->base[ALPHA]};
        const double lever[3] = {1.0, -s->radius, 0.0};
        for (int i = 0; i < COORDINATES; i++) {
            if (stuck[i]) {
                s->friction[i] = row(s->mass[i], gained) - s->smooth[i] - lever[i] * s->traction;
            }
        }
    }
}

/* Projected Gauss-Seidel over the three frictions and the traction: converges slowly, but always. */
static void solve_by_sweeps(hil_impulses *s) {
    double pull[3];
    double sum[3];
    for (int i = 0; i < COORDINATES; i++) {
        pull[i] = s->inverse[i][X] - s->radius * s->inverse[i][BETA];
        s->friction[i] = clamp(s->friction[i], s->bound[i]);
        sum[i] = s->smooth[i] + s->friction[i];
    }
    const double compliance = pull[X] - s->radius * pull[BETA];
    for (int i = 0; i < COORDINATES; i++) {
        s->velocity[i] = s->base[i] + row(s->inverse[i], sum) + pull[i] * s->traction;
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        for (int i = 0; i < COORDINATES; i++) {
            if (s->bound[i] > 0.0 && s->inverse[i][i] > 0.0) {
                const double wanted = clamp(s->friction[i] - s->velocity[i] / s->inverse[i][i], s->bound[i]);
                const double change = wanted - s->friction[i];
                s->friction[i] = wanted;
                for (int j = 0; j < COORDINATES; j++) {
                    s->velocity[j] += s->inverse[j][i] * change;
                }
            }
        }
        const double w = s->radius * s->velocity[BETA] - s->velocity[X];
        const double traction = traction_impulse(s, w + compliance * s->traction, compliance, w);
        for (int j = 0; j < COORDINATES; j++) {
            s->velocity[j] += pull[j] * (traction - s->traction);
        }
        s->traction = traction;
    }
}

void hil_impulses_solve(hil_impulses *s, const double *rate) {
    const double guess = s->radius * rate[BETA] - rate[X];
    bool stuck[3];
    for (int i = 0; i < COORDINATES; i++) {
        stuck[i] = rate[i] == 0.0 && s->bound[i] > 0.0;
        s->friction[i] = -copysign(s->bound[i], rate[i]);
    }
    for (int attempt = 0; attempt < ATTEMPTS; attempt++) {
        solve_with(s, stuck, guess);
        bool consistent = true;
        for (int i = 0; i < COORDINATES; i++) {
            if (stuck[i] && fabs(s->friction[i]) > s->bound[i]) {
                s->friction[i] = clamp(s->friction[i], s->bound[i]);
                stuck[i] = false;
                consistent = false;
            } else if (!stuck[i] && s->friction[i] * s->velocity[i] > 0.0) { /* it would push */
                stuck[i] = true;
                consistent = false;
            }
        }
        if (consistent) {
            return;
        }
    }
    solve_by_sweeps(s);
}
