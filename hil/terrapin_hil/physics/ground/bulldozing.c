#include "bulldozing.h"

#include <math.h>

#include "extremes.h"

double hil_bulldozing_resistance(const hil_bulldozing *sand, double depth) {
    const double radius = sand->radius;
    const double z = larger(smaller(depth, radius), 0.0);
    if (sand->width > 0.0) {
        return sand->width * z * (sand->cohesive + 0.5 * sand->frictional * z);
    }
    const double axle = radius - z;                /* above the surface */
    const double half = sqrt(z * (radius + axle)); /* of the width */
    const double sector = radius * radius * acos(axle / radius);
    const double first = sector - axle * half;
    const double second = radius * radius * half - half * half * half / 3.0 - axle * sector;
    return sand->cohesive * first + sand->frictional * second;
}
