#include "ground.h"

#include <math.h>

#include "extremes.h"
#include "path.h"

hil_ground hil_path_at(const hil_path *path, double x) {
    return hil_path_inlined(path, x);
}

double hil_slip(double rim_speed, double axle_speed, double floor) {
    const double scale = larger(floor, larger(fabs(rim_speed), fabs(axle_speed)));
    return (rim_speed - axle_speed) / scale;
}
