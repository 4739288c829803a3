#include "effects.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#define SMALLEST_RATE 1e-9

void hil_effects_sum(const hil_effects *effects, int ground, double *values, double sum[HIL_EFFECT_TARGETS]) {
    memset(sum, 0, HIL_EFFECT_TARGETS * sizeof *sum);
    const double omega = values[HIL_ROLE_OMEGA];
    const double speed = values[HIL_ROLE_SPEED];
    const double slip = values[HIL_ROLE_SLIP];
    for (int i = 0; i < effects->count; i++) {
        const hil_effect *effect = &effects->effect[i];
        if (effect->ground != ground) {
            continue;
        }
        const bool drag = effect->target == HIL_EFFECT_DRAG;
        const bool passive = drag || effect->target == HIL_EFFECT_PASSIVE;
        values[HIL_ROLE_SLIP] = drag ? values[HIL_ROLE_DIRECTION] * slip : slip;
        values[HIL_ROLE_OMEGA] = passive ? fmax(fabs(omega), SMALLEST_RATE) : omega;
        values[HIL_ROLE_SPEED] = passive ? fmax(fabs(speed), SMALLEST_RATE) : speed;
        sum[effect->target] += hil_program_run(&effects->code[effect->begin], effect->count, 0.0, values);
    }
}
