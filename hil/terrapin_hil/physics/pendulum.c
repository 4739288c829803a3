#include "pendulum.h"

#include <math.h>

/* Row 1 and 2 as m[0] theta'' + m[1] phi'' + rest = T: m11, m12, m22, and the two rests. */
typedef struct {
    double m11;
    double m12;
    double m22;
    double shell;
    double pendulum;
} rows;

static rows rows_of(const hil_pendulum *p, const hil_pendulum_around *around, const hil_pendulum_state *s) {
    const double arm = p->radius * p->bob_mass * p->length;
    const double mass = p->shell_mass + p->frame_mass + p->bob_mass;
    const double lean = s->swing - p->slope;
    const double joint_rate = s->swing_rate + s->angle_rate;
    const double normal = mass * p->gravity * cos(p->slope);
    rows r;
    r.m11 = mass * p->radius * p->radius + p->shell_inertia + around->ground_inertia;
    r.m12 = arm * cos(lean);
    r.m22 = p->bob_mass * p->length * p->length + p->frame_inertia + p->bob_inertia;
    r.shell = -arm * sin(lean) * s->swing_rate * s->swing_rate + p->radius * mass * p->gravity * sin(p->slope) +
              p->f_o * p->radius * normal * tanh(s->angle_rate / p->smoothing) +
              p->shell_share * p->viscous * joint_rate + around->ground;
    r.pendulum = p->bob_mass * p->gravity * p->length * sin(s->swing) + p->viscous * joint_rate;
    return r;
}

double hil_pendulum_driven(const hil_pendulum *pendulum, const hil_pendulum_around *around,
                           const hil_pendulum_state *state, double joint_acceleration, double *angle_acceleration,
                           double *torque) {
    const rows r = rows_of(pendulum, around, state);
    /* The difference of the rows, with theta'' = psi'' - phi''. */
    const double swing_acceleration =
        ((r.m11 - r.m12) * joint_acceleration + r.shell - r.pendulum) / (r.m11 - 2.0 * r.m12 + r.m22);
    *angle_acceleration = joint_acceleration - swing_acceleration;
    *torque = r.m12 * *angle_acceleration + r.m22 * swing_acceleration + r.pendulum;
    return swing_acceleration;
}

void hil_pendulum_free(const hil_pendulum *pendulum, const hil_pendulum_around *around, const hil_pendulum_state *state,
                       double torque, double *accelerations) {
    const rows r = rows_of(pendulum, around, state);
    const double on_shell = torque - r.shell;
    const double on_pendulum = torque - r.pendulum;
    const double determinant = r.m11 * r.m22 - r.m12 * r.m12;
    accelerations[0] = (r.m11 * on_pendulum - r.m12 * on_shell) / determinant;
    accelerations[1] = (r.m22 * on_shell - r.m12 * on_pendulum) / determinant;
}

double hil_pendulum_energy(const hil_pendulum *pendulum, const hil_pendulum_state *state) {
    const hil_pendulum_around level = {0.0, 0.0};
    const rows r = rows_of(pendulum, &level, state);
    return 0.5 * r.m11 * state->angle_rate * state->angle_rate + r.m12 * state->angle_rate * state->swing_rate +
           0.5 * r.m22 * state->swing_rate * state->swing_rate +
           pendulum->bob_mass * pendulum->gravity * pendulum->length * (1.0 - cos(state->swing));
}
