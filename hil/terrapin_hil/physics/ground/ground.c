#include "ground.h"

#include <math.h>

#include "extremes.h"

static double blend(double from, double to, double share) {
    return from + share * (to - from);
}

hil_ground hil_path_at(const hil_path *path, double x) {
    int i = 0;
    while (i + 1 < path->count && x >= path->segment[i + 1].start) {
        i++;
    }
    const hil_segment *here = &path->segment[i];
    hil_ground ground = {here->terrain, here->slope, 0.0, i};
    const double into = x - here->start;
    if (i > 0 && into < here->transition) {
        const hil_segment *last = &path->segment[i - 1];
        const double t = into / here->transition;
        const double share = t * t * (3.0 - 2.0 * t);
        ground.terrain.f_o = blend(last->terrain.f_o, here->terrain.f_o, share);
        ground.terrain.f_s = blend(last->terrain.f_s, here->terrain.f_s, share);
        ground.terrain.mu = blend(last->terrain.mu, here->terrain.mu, share);
        ground.terrain.s_k = blend(last->terrain.s_k, here->terrain.s_k, share);
        ground.terrain.softness = blend(last->terrain.softness, here->terrain.softness, share);
        ground.slope = blend(last->slope, here->slope, share);
        ground.curvature = (here->slope - last->slope) * 6.0 * t * (1.0 - t) / here->transition;
    }
    return ground;
}

double hil_slip(double rim_speed, double axle_speed, double floor) {
    const double scale = larger(floor, larger(fabs(rim_speed), fabs(axle_speed)));
    return (rim_speed - axle_speed) / scale;
}
