/* hil_path_at for inner loops: inlined, what the caller does not use of the ground costs nothing. */
#ifndef HIL_PATH_H
#define HIL_PATH_H

#include <stddef.h>

#include "ground.h"

static inline double hil_blend(double from, double to, double share) {
    return from + share * (to - from);
}

static inline hil_ground hil_path_inlined(const hil_path *path, double x) {
    int i = 0;
    while (i + 1 < path->count && x >= path->segment[i + 1].start) {
        i++;
    }
    const hil_segment *here = &path->segment[i];
    hil_ground ground = {here->terrain, here->slope, 0.0, i, 0.0};
    const double into = x - here->start;
    if (i > 0 && into < here->transition) {
        const hil_segment *last = &path->segment[i - 1];
        const double t = into / here->transition;
        const double share = t * t * (3.0 - 2.0 * t);
        ground.terrain.f_o = hil_blend(last->terrain.f_o, here->terrain.f_o, share);
        ground.terrain.f_s = hil_blend(last->terrain.f_s, here->terrain.f_s, share);
        ground.terrain.mu = hil_blend(last->terrain.mu, here->terrain.mu, share);
        ground.terrain.s_k = hil_blend(last->terrain.s_k, here->terrain.s_k, share);
        ground.terrain.softness = hil_blend(last->terrain.softness, here->terrain.softness, share);
        ground.share_of_last = 1.0 - share;
        ground.slope = hil_blend(last->slope, here->slope, share);
        ground.curvature = (here->slope - last->slope) * 6.0 * t * (1.0 - t) / here->transition;
    }
    return ground;
}

/* The contact model's table there, or both of a transition between two; a NULL table where the ground is a terrain. */
static inline hil_grip hil_path_grip(const hil_path *path, const hil_ground *ground, double load, double rim_speed,
                                     double axle_speed, double floor) {
    const hil_grip_table *here = path->segment[ground->segment].contact;
    hil_grip grip = hil_grip_at(here, load, rim_speed, axle_speed, floor);
    if (ground->share_of_last > 0.0 && ground->segment > 0) {
        const hil_grip_table *last = path->segment[ground->segment - 1].contact;
        grip.last = last;
        grip.share_of_last = last != here && last != NULL ? ground->share_of_last : 0.0;
    }
    return grip;
}

#endif
