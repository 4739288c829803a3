#include "pendulum.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

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

void hil_pendulum_gradient(const hil_pendulum_inputs *at, double joint_acceleration, hil_pendulum_inputs by[2]) {
    const hil_pendulum *p = &at->pendulum;
    const hil_pendulum_state *s = &at->state;
    const rows r = rows_of(p, &at->around, s);
    const double whole = r.m11 - 2.0 * r.m12 + r.m22;
    const double swings = ((r.m11 - r.m12) * joint_acceleration + r.shell - r.pendulum) / whole; /* phi'' */
    const double turns = joint_acceleration - swings;                                            /* theta'' */
    const double mass = p->shell_mass + p->frame_mass + p->bob_mass;
    const double arm = p->radius * p->bob_mass * p->length;
    const double sine = sin(s->swing - p->slope);
    const double cosine = cos(s->swing - p->slope);
    const double joint_rate = s->swing_rate + s->angle_rate;
    const double rolls = tanh(s->angle_rate / p->smoothing);
    const double rise = (1.0 - rolls * rolls) / p->smoothing;
    const double carried = p->radius * mass * p->gravity; /* R M g */
    const double share = sin(p->slope) + p->f_o * cos(p->slope) * rolls;
    const double weight = p->bob_mass * p->gravity * p->length;

    /* m11 theta'' + m12 phi'' + shell and m12 theta'' + m22 phi'' + pendulum, by the inputs at these accelerations */
    memset(by, 0, 2 * sizeof *by);
    hil_pendulum_inputs *row = &by[0];
    const double by_arm = cosine * swings - sine * s->swing_rate * s->swing_rate;
    const double by_lean = -arm * (sine * swings + cosine * s->swing_rate * s->swing_rate);
    const double by_mass = p->radius * p->radius * turns + p->radius * p->gravity * share;
    row->pendulum.radius =
        2.0 * mass * p->radius * turns + mass * p->gravity * share + by_arm * p->bob_mass * p->length;
    row->pendulum.shell_mass = row->pendulum.frame_mass = by_mass;
    row->pendulum.bob_mass = by_mass + by_arm * p->radius * p->length;
    row->pendulum.length = by_arm * p->radius * p->bob_mass;
    row->pendulum.shell_inertia = turns;
    row->pendulum.gravity = p->radius * mass * share;
    row->pendulum.viscous = p->shell_share * joint_rate;
    row->pendulum.shell_share = p->viscous * joint_rate;
    row->pendulum.f_o = carried * cos(p->slope) * rolls;
    row->pendulum.slope = carried * (cos(p->slope) - p->f_o * sin(p->slope) * rolls) - by_lean;
    row->pendulum.smoothing = -p->f_o * carried * cos(p->slope) * rise * s->angle_rate / p->smoothing;
    row->around.ground = 1.0;
    row->around.ground_inertia = turns;
    row->state.swing = by_lean;
    row->state.swing_rate = -2.0 * arm * sine * s->swing_rate + p->shell_share * p->viscous;
    row->state.angle_rate = p->f_o * carried * cos(p->slope) * rise + p->shell_share * p->viscous;

    row = &by[1];
    const double by_sine = sin(s->swing);
    row->pendulum.radius = p->bob_mass * p->length * cosine * turns;
    row->pendulum.bob_mass =
        p->radius * p->length * cosine * turns + p->length * p->length * swings + p->gravity * p->length * by_sine;
    row->pendulum.length = p->radius * p->bob_mass * cosine * turns + 2.0 * p->bob_mass * p->length * swings +
                           p->bob_mass * p->gravity * by_sine;
    row->pendulum.frame_inertia = row->pendulum.bob_inertia = swings;
    row->pendulum.gravity = p->bob_mass * p->length * by_sine;
    row->pendulum.viscous = joint_rate;
    row->pendulum.slope = arm * sine * turns;
    row->state.swing = weight * cos(s->swing) - arm * sine * turns;
    row->state.swing_rate = row->state.angle_rate = p->viscous;

    double *shell = (double *)&by[0];
    double *joint = (double *)&by[1];
    for (size_t i = 0; i < sizeof *by / sizeof(double); i++) {
        const double faster = (shell[i] - joint[i]) / whole; /* phi'' */
        joint[i] += (r.m22 - r.m12) * faster;
        shell[i] = -faster;
    }
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
