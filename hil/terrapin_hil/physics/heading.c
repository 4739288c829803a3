#include "heading.h"

#include <math.h>

void hil_heading_advance(double travelled, double from, double to, double *path) {
    const double half = 0.5 * (to - from);
    const double chord = fabs(half) < 1e-4 ? travelled * (1.0 - half * half / 6.0) : travelled * sin(half) / half;
    path[0] += chord * cos(from + half);
    path[1] += chord * sin(from + half);
}
