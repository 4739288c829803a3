#include "grip.h"

#include <math.h>
#include <stddef.h>

#include "extremes.h"

#define RAMP 1e-3 /* [m/s], within which the direction passes over */

hil_grip hil_grip_at(const hil_grip_table *table, double load, double rim_speed, double axle_speed, double floor) {
    const double faster = fabs(rim_speed) >= fabs(axle_speed) ? rim_speed : axle_speed;
    const double direction = smaller(larger(faster / RAMP, -1.0), 1.0);
    const hil_grip grip = {table, load, direction, larger(floor, fabs(faster)), NULL, 0.0};
    return grip;
}

/* Value and derivative by slip in one row, for a shell that rolls forwards. */
static double in_row(const hil_grip_table *table, int row, int value, double slip, double *derivative) {
    const double place = 0.5 * (slip + 1.0) * (table->slips - 1);
    const int left = (int)larger(smaller(floor(place), table->slips - 2.0), 0.0);
    const double step = 2.0 / (table->slips - 1);
    const double *at = &table->row[(((ptrdiff_t)row * table->slips + left) * HIL_GRIP_VALUES + value) * 2];
    const double *next = at + (ptrdiff_t)HIL_GRIP_VALUES * 2;
    const double t = place - left, rise = next[0] - at[0];
    const double a = at[1] * step - rise, b = rise - next[1] * step;
    *derivative = (rise + (1.0 - 2.0 * t) * (a * (1.0 - t) + b * t) + t * (1.0 - t) * (b - a)) / step;
    return at[0] + t * rise + t * (1.0 - t) * (a * (1.0 - t) + b * t);
}

static double in_table(const hil_grip *grip, const hil_grip_table *table, int value, double slip, double *derivative) {
    const double bounded = smaller(larger(slip, -1.0), 1.0);
    const double place = table->loads > 1 ? (grip->load - table->load_low) / table->load_step : 0.0;
    const int row = (int)larger(smaller(floor(place), table->loads - 2.0), 0.0);
    double found = in_row(table, row, value, bounded, derivative);
    if (table->loads > 1) {
        const double share = smaller(larger(place - row, 0.0), 1.0);
        double other_derivative;
        const double other = in_row(table, row + 1, value, bounded, &other_derivative);
        found += share * (other - found);
        *derivative += share * (other_derivative - *derivative);
    }
    if (bounded != slip) {
        *derivative = 0.0;
    }
    return found;
}

static double forwards(const hil_grip *grip, int value, double slip, double *derivative) {
    double found = in_table(grip, grip->table, value, slip, derivative);
    if (grip->share_of_last > 0.0) {
        double last_derivative;
        const double last = in_table(grip, grip->last, value, slip, &last_derivative);
        found += grip->share_of_last * (last - found);
        *derivative += grip->share_of_last * (last_derivative - *derivative);
    }
    return found;
}

double hil_grip_value(const hil_grip *grip, int value, double slip_speed, double *derivative) {
    const double slip = slip_speed / grip->scale;
    const double ahead = 0.5 * (1.0 + grip->direction);
    const double mirror = value == HIL_THRUST || value == HIL_LEVER ? -1.0 : 1.0;
    double slope = 0.0, back_slope = 0.0, sum = 0.0;
    if (ahead > 0.0) {
        sum = ahead * forwards(grip, value, slip, &slope);
    }
    if (ahead < 1.0) {
        sum += (1.0 - ahead) * mirror * forwards(grip, value, -slip, &back_slope);
    }
    *derivative = (ahead * slope - (1.0 - ahead) * mirror * back_slope) / grip->scale;
    return sum;
}

double hil_grip_bulldozing(const hil_grip *grip, double depth) {
    double found = hil_bulldozing_resistance(&grip->table->bulldozing, depth);
    if (grip->share_of_last > 0.0) {
        found += grip->share_of_last * (hil_bulldozing_resistance(&grip->last->bulldozing, depth) - found);
    }
    return found;
}
