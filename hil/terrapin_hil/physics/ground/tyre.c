#include "tyre.h"

#include "sixteen.h"

#include <math.h>
#include <stddef.h>

enum { NODES = HIL_SIXTEEN, HALF = NODES / 2, ITERATIONS = 60, GEOMETRY = 3, SOIL = 5 };

/* Gauss-Legendre on [-1, 1], n = 16: the positive abscissas (Abramowitz & Stegun, table 25.4), shares of the length at
 * which the nodes lie, and weights, both in rising order. */
static const double abscissa[HALF] = {0.095012509837637440, 0.281603550779258913, 0.458016777657227386,
                                      0.617876244402643748, 0.755404408355003034, 0.865631202387831744,
                                      0.944575023073232576, 0.989400934991649933};
static const double share[NODES] = {
    0.005299532504175034, 0.027712488463383712, 0.067184398806084128, 0.122297795822498483,
    0.191061877798678126, 0.270991611171386307, 0.359198224610370543, 0.452493745081181280,
    0.547506254918818720, 0.640801775389629457, 0.729008388828613693, 0.808938122201321874,
    0.877702204177501517, 0.932815601193915872, 0.972287511536616288, 0.994700467495824966};
static const double weight[NODES] = {
    0.027152459411754095, 0.062253523938647893, 0.095158511682492785, 0.124628971255533872,
    0.149595988816576732, 0.169156519395002538, 0.182603415044923589, 0.189450610455068496,
    0.189450610455068496, 0.182603415044923589, 0.169156519395002538, 0.149595988816576732,
    0.124628971255533872, 0.095158511682492785, 0.062253523938647893, 0.027152459411754095};

/* Angles of one evaluation and their derivatives by sinkage, deflection and slip. */
typedef struct {
    double radius; /* R* */
    double ratio;  /* z / R* = 1 - cos th_f */
    double front;  /* th_f */
    double middle; /* th_m */
    double rear;   /* th_r */
    double front_sine;
    double front_cosine;
    double radius_by[GEOMETRY];
    double front_by[GEOMETRY];
    double middle_by[GEOMETRY];
    double rear_by[GEOMETRY];
} arc;

/* One side of th_m, its nodes in rising order, with the normal stress there. */
typedef struct {
    double start;
    double end;
    const double *start_by;
    const double *end_by;
    double angle[NODES];
    double sine[NODES];
    double cosine[NODES];
    double stress[NODES];
    double logarithm[NODES];           /* ln(R* (cos th - cos th_f)), of the mirrored angle behind th_m */
    double stress_by[GEOMETRY][NODES]; /* d ln sigma */
} side;

/* Sums before the factor b R*: int(tau cos - sigma sin), int(sigma cos + tau sin), int tau. */
typedef struct {
    double sum[3];
    double by[3][HIL_TYRE_COLUMNS];
} sums;

static arc arc_of(const hil_tyre *tyre, double z, double d, double slip) {
    arc a;
    const double ratio = z * z / (tyre->radius * (z + d)); /* z / R* */
    const double ratio_by_z = ratio * (2.0 / z - 1.0 / (z + d));
    const double ratio_by_d = -ratio / (z + d);
    a.ratio = ratio;
    a.radius = tyre->radius * (1.0 + d / z);
    a.radius_by[HIL_TYRE_BY_Z] = -tyre->radius * d / (z * z);
    a.radius_by[HIL_TYRE_BY_DEFLECTION] = tyre->radius / z;
    a.radius_by[HIL_TYRE_BY_SLIP] = 0.0;
    a.front_cosine = 1.0 - ratio;
    a.front_sine = sqrt(ratio * (2.0 - ratio));
    a.front = atan2(a.front_sine, a.front_cosine); /* acos(1 - ratio), accurate for small ratios */
    a.front_by[HIL_TYRE_BY_Z] = ratio_by_z / a.front_sine;
    a.front_by[HIL_TYRE_BY_DEFLECTION] = ratio_by_d / a.front_sine;
    a.front_by[HIL_TYRE_BY_SLIP] = 0.0;
    const double plain = tyre->angle_share + tyre->angle_slip * fabs(slip);
    const double part = fmin(plain, 0.95);
    const double part_rate = plain < 0.95 ? copysign(tyre->angle_slip, slip) : 0.0;
    const double chord = sqrt(2.0 * tyre->radius * d) / a.radius;
    const double chord_slope = chord < 0.9 ? -1.0 / sqrt(1.0 - chord * chord) : 0.0;
    a.middle = part * a.front;
    a.rear = -asin(fmin(0.9, chord));
    for (int q = 0; q < GEOMETRY; q++) {
        const double own = q == HIL_TYRE_BY_DEFLECTION ? 0.5 * chord / d : 0.0;
        a.rear_by[q] = chord_slope * (own - chord * a.radius_by[q] / a.radius);
        a.middle_by[q] = part * a.front_by[q] + (q == HIL_TYRE_BY_SLIP ? part_rate * a.front : 0.0);
    }
    return a;
}

/* Nodes by the addition theorem: one sine and cosine serve the two nodes at equal distance from the centre. */
HIL_WIDE static void place(double start, double end, side *s) {
    const double half = 0.5 * (end - start);
    const double centre = 0.5 * (end + start);
    const double centre_sine = sin(centre);
    const double centre_cosine = cos(centre);
    double offset[HALF], sine[HALF], cosine[HALF];
    s->start = start;
    s->end = end;
    for (int k = 0; k < HALF; k++) {
        offset[k] = half * abscissa[k];
    }
    hil_sincos8(offset, sine, cosine);
    for (int k = 0; k < HALF; k++) {
        s->angle[HALF + k] = centre + offset[k];
        s->sine[HALF + k] = centre_sine * cosine[k] + centre_cosine * sine[k];
        s->cosine[HALF + k] = centre_cosine * cosine[k] - centre_sine * sine[k];
    }
    for (int k = 0; k < HALF; k++) {
        s->angle[HALF - 1 - k] = centre - offset[k];
        s->sine[HALF - 1 - k] = centre_sine * cosine[k] - centre_cosine * sine[k];
        s->cosine[HALF - 1 - k] = centre_cosine * cosine[k] + centre_sine * sine[k];
    }
}

/* Normal stress ahead of th_m, and behind it, where it is the same read backwards. */
HIL_WIDE static void press(const arc *a, const hil_tyre_soil *soil, int directions, side *front, side *rear) {
    double depth[NODES], inverse[NODES], power[NODES];
    for (int k = 0; k < NODES; k++) {
        /* cos th - cos th_f without its cancellation at small angles: (z/R*) - (1 - cos th) */
        const double drop = a->ratio - front->sine[k] * front->sine[k] / (1.0 + front->cosine[k]);
        inverse[k] = 1.0 / drop;
        depth[k] = a->radius * drop;
    }
    hil_log16(depth, front->logarithm);
    for (int k = 0; k < NODES; k++) {
        power[k] = soil->exponent * front->logarithm[k];
    }
    hil_exp16(power, front->stress);
    for (int k = 0; k < NODES; k++) {
        front->stress[k] *= soil->stiffness;
    }
    for (int q = 0; q < directions; q++) {
        const double stretch = a->radius_by[q] / a->radius;
        const double edge = a->front_sine * a->front_by[q];
        for (int k = 0; k < NODES; k++) {
            const double angle_by = a->middle_by[q] + share[k] * (a->front_by[q] - a->middle_by[q]);
            front->stress_by[q][k] = soil->exponent * (stretch + (edge - front->sine[k] * angle_by) * inverse[k]);
        }
        for (int k = 0; k < NODES; k++) {
            rear->stress_by[q][k] = front->stress_by[q][NODES - 1 - k];
        }
    }
    for (int k = 0; k < NODES; k++) {
        rear->stress[k] = front->stress[NODES - 1 - k];
        rear->logarithm[k] = front->logarithm[NODES - 1 - k];
    }
}

/* The three weighted sums of stresses `normal` and `tangential` at the nodes of a side. */
HIL_WIDE static void weigh(const side *s, const double *normal, const double *tangential, double *sum) {
    double force[NODES], load[NODES], torque[NODES];
    for (int k = 0; k < NODES; k++) {
        force[k] = weight[k] * (tangential[k] * s->cosine[k] - normal[k] * s->sine[k]);
        load[k] = weight[k] * (normal[k] * s->cosine[k] + tangential[k] * s->sine[k]);
        torque[k] = weight[k] * tangential[k];
    }
    sum[0] = hil_sum16(force);
    sum[1] = hil_sum16(load);
    sum[2] = hil_sum16(torque);
}

HIL_WIDE static void add_side(const side *s, const arc *a, const hil_tyre_soil *soil, double slip, double tangent,
                              int columns, unsigned soil_wanted, sums *total) {
    const double ratio = 1.0 - slip; /* V / (R_e omega) */
    const double inverse = 1.0 / soil->shear_modulus;
    const double half = 0.5 * (s->end - s->start);
    double shear[NODES], decay[NODES], left[NODES], mobilised[NODES], tau[NODES], tau_rate[NODES];
    double sum[3], by[3];
    for (int k = 0; k < NODES; k++) {
        shear[k] = a->radius * ((a->front - s->angle[k]) - ratio * (a->front_sine - s->sine[k]));
        const double exponent = -fabs(shear[k]) * inverse;
        decay[k] = exponent < -700.0 ? -700.0 : exponent;
    }
    hil_exp16(decay, left);
    for (int k = 0; k < NODES; k++) {
        const double strength = soil->cohesion + s->stress[k] * tangent;
        mobilised[k] = copysign(1.0 - left[k], shear[k]);
        tau[k] = mobilised[k] * strength;
        tau_rate[k] = strength * left[k] * inverse; /* d tau / d j */
    }
    weigh(s, s->stress, tau, sum);
    for (int r = 0; r < 3; r++) {
        total->sum[r] += half * sum[r];
    }
    const int directions = columns < GEOMETRY ? columns : GEOMETRY;
    for (int q = 0; q < directions; q++) {
        const double stretch = a->radius_by[q] / a->radius;
        const double ratio_by = q == HIL_TYRE_BY_SLIP ? -1.0 : 0.0;
        const double edge = a->front_by[q] * (1.0 - ratio * a->front_cosine) - ratio_by * a->front_sine;
        const double start_by = s->start_by[q];
        const double length_by = s->end_by[q] - s->start_by[q];
        double tau_by[NODES], across[NODES], along[NODES];
        for (int k = 0; k < NODES; k++) {
            const double angle_by = start_by + share[k] * length_by;
            const double turn = angle_by * (1.0 - ratio * s->cosine[k]) - ratio_by * s->sine[k];
            const double stress_by = s->stress[k] * s->stress_by[q][k];
            const double shear_by = shear[k] * stretch + a->radius * (edge - turn);
            tau_by[k] = mobilised[k] * tangent * stress_by + tau_rate[k] * shear_by;
            across[k] = tau_by[k] - s->stress[k] * angle_by; /* what the turning of the node adds */
            along[k] = stress_by + tau[k] * angle_by;
        }
        weigh(s, along, across, by);
        for (int k = 0; k < NODES; k++) {
            tau_by[k] *= weight[k];
        }
        by[2] = hil_sum16(tau_by);
        for (int r = 0; r < 3; r++) {
            total->by[r][q] += half * by[r] + 0.5 * length_by * sum[r];
        }
    }
    if (columns < HIL_TYRE_COLUMNS || soil_wanted == 0U) {
        return;
    }
    const double secant = 1.0 + tangent * tangent;
    double normal[SOIL][NODES], tangential[SOIL][NODES];
    for (int k = 0; k < NODES; k++) {
        normal[0][k] = s->stress[k] / soil->stiffness;
        normal[1][k] = s->stress[k] * s->logarithm[k];
        normal[2][k] = normal[3][k] = normal[4][k] = 0.0;
        tangential[0][k] = mobilised[k] * tangent * normal[0][k];
        tangential[1][k] = mobilised[k] * tangent * normal[1][k];
        tangential[2][k] = mobilised[k];
        tangential[3][k] = mobilised[k] * s->stress[k] * secant;
        tangential[4][k] = -tau_rate[k] * shear[k] * inverse;
    }
    for (int p = 0; p < SOIL; p++) {
        if ((soil_wanted & (1U << (unsigned)p)) == 0U) {
            continue;
        }
        weigh(s, normal[p], tangential[p], by);
        for (int r = 0; r < 3; r++) {
            total->by[r][HIL_TYRE_BY_SOIL + p] += half * by[r];
        }
    }
}

void hil_tyre_evaluate(const hil_tyre *tyre, const hil_tyre_soil *soil, double sinkage, double deflection, double slip,
                       int columns, hil_tyre_contact *contact) {
    hil_tyre_evaluate_by(tyre, soil, sinkage, deflection, slip, columns, HIL_TYRE_ALL_SOIL, contact);
}

void hil_tyre_evaluate_by(const hil_tyre *tyre, const hil_tyre_soil *soil, double sinkage, double deflection,
                          double slip, int columns, unsigned soil_wanted, hil_tyre_contact *contact) {
    const arc a = arc_of(tyre, sinkage, deflection, slip);
    const double tangent = tan(soil->friction_angle);
    side front, rear;
    sums total = {{0.0}, {{0.0}}};
    front.start_by = rear.end_by = a.middle_by;
    front.end_by = a.front_by;
    rear.start_by = a.rear_by;
    place(a.middle, a.front, &front);
    place(a.rear, a.middle, &rear);
    press(&a, soil, columns < GEOMETRY ? columns : GEOMETRY, &front, &rear);
    add_side(&rear, &a, soil, slip, tangent, columns, soil_wanted, &total);
    add_side(&front, &a, soil, slip, tangent, columns, soil_wanted, &total);
    contact->effective_radius = tyre->radius - deflection / 3.0;
    for (int r = 0; r < 3; r++) {
        const double arm = r == HIL_TYRE_TORQUE ? contact->effective_radius : 1.0;
        const double scale = tyre->width * a.radius * arm;
        contact->value[r] = scale * total.sum[r];
        for (int q = 0; q < columns; q++) {
            const double stretch = q < GEOMETRY ? a.radius_by[q] / a.radius : 0.0;
            contact->derivative[r][q] = scale * (total.by[r][q] + stretch * total.sum[r]);
        }
    }
    if (columns > HIL_TYRE_BY_DEFLECTION) {
        contact->derivative[HIL_TYRE_TORQUE][HIL_TYRE_BY_DEFLECTION] -=
            contact->value[HIL_TYRE_TORQUE] / (3.0 * contact->effective_radius);
    }
}

double hil_tyre_deepest(const hil_tyre *tyre, double deflection) {
    return 0.5 * (tyre->radius + sqrt(tyre->radius * (tyre->radius + 4.0 * deflection)));
}

int hil_tyre_equilibrium(const hil_tyre *tyre, const hil_tyre_soil *soil, double load, double slip, int columns,
                         double *sinkage, hil_tyre_contact *contact) {
    const double deflection = load / tyre->stiffness;
    const double deepest = hil_tyre_deepest(tyre, deflection);
    double low = 0.0;
    double high = deepest;
    double z = *sinkage;
    if (!(load > 0.0) || !isfinite(load) || !isfinite(slip) || !isfinite(z)) {
        return HIL_TYRE_BAD_INPUT;
    }
    if (deflection >= tyre->radius) {
        return HIL_TYRE_TOO_HEAVY;
    }
    if (!(z > 0.0 && z < deepest)) {
        z = 0.1 * deepest;
    }
    for (int i = 0; i < ITERATIONS; i++) {
        hil_tyre_evaluate(tyre, soil, z, deflection, slip, columns, contact);
        const double miss = contact->value[HIL_TYRE_LOAD] - load;
        const double slope = contact->derivative[HIL_TYRE_LOAD][HIL_TYRE_BY_Z];
        const double step = -miss / slope;
        if (!isfinite(miss)) {
            return HIL_TYRE_BAD_INPUT;
        }
        if (fabs(miss) <= 1e-9 * load) {
            *sinkage = z;
            return HIL_TYRE_OK;
        }
        /* F_z is about a power of z: the miss after this step is below (step/z)^2 of the load, 4e-12. So the step is
         * taken on the tangent, and an evaluation saved; most calls in a smooth simulation end here. */
        if (slope > 0.0 && fabs(step) < 2e-6 * z && z + step < deepest) {
            for (int r = 0; r < 3; r++) {
                contact->value[r] += step * contact->derivative[r][HIL_TYRE_BY_Z];
            }
            *sinkage = z + step;
            return HIL_TYRE_OK;
        }
        if (miss < 0.0) {
            low = z;
        } else {
            high = z;
        }
        z += step;
        if (!(slope > 0.0) || !(z > low && z < high)) {
            if (high >= deepest) { /* nothing yet has carried the load */
                hil_tyre_evaluate(tyre, soil, deepest, deflection, slip, 1, contact);
                if (!(contact->value[HIL_TYRE_LOAD] >= load)) {
                    return HIL_TYRE_TOO_HEAVY;
                }
            }
            z = 0.5 * (low + high);
        }
    }
    return HIL_TYRE_NOT_CONVERGED;
}

double hil_tyre_slip(double axle, double rim, double floor, double *by_axle, double *by_rim) {
    const double reference = rim >= axle ? rim : axle;
    const double scale = fmax(reference, floor);
    const double slip = (rim - axle) / scale;
    *by_axle = -1.0 / scale;
    *by_rim = 1.0 / scale;
    if (reference > floor) {
        *(rim >= axle ? by_rim : by_axle) -= slip / scale;
    }
    if (rim >= axle) {
        return slip;
    }
    /* A rim that stands still or, within a step, turns back is at the limit too. */
    const double turned = 1.0 + slip + 1e-9;
    if (turned <= 1.0 / 3.0) {
        *by_axle = *by_rim = 0.0;
        return -2.0;
    }
    *by_axle /= turned * turned;
    *by_rim /= turned * turned;
    return 1.0 - 1.0 / turned;
}

int hil_tyre_points(const hil_tyre *tyre, const hil_tyre_soil *soils, int soil_stride, int count, int solve,
                    const double *load, const double *slip, double *sinkage, double *value, double *geometry,
                    double *derivative, int *status) {
    const int columns = derivative == NULL ? 1 : HIL_TYRE_COLUMNS;
    for (int i = 0; i < count; i++) {
        const hil_tyre_soil *soil = &soils[(ptrdiff_t)i * soil_stride];
        hil_tyre_contact contact;
        *status = HIL_TYRE_OK;
        if (solve) {
            *status = hil_tyre_equilibrium(tyre, soil, load[i], slip[i], columns, &sinkage[i], &contact);
            if (*status != HIL_TYRE_OK) {
                return i;
            }
        } else {
            hil_tyre_evaluate(tyre, soil, sinkage[i], load[i] / tyre->stiffness, slip[i], columns, &contact);
        }
        for (int r = 0; r < 3; r++) {
            value[3 * i + r] = contact.value[r];
        }
        /* from the sinkage itself: the last step may have been taken on the tangent */
        double *const row = &geometry[(ptrdiff_t)i * 3];
        row[0] = tyre->radius * (1.0 + load[i] / (tyre->stiffness * sinkage[i]));
        row[1] = acos(fmax(0.0, 1.0 - sinkage[i] / row[0]));
        row[2] = contact.effective_radius;
        for (int r = 0; derivative != NULL && r < 3; r++) {
            for (int q = 0; q < HIL_TYRE_COLUMNS; q++) {
                derivative[(ptrdiff_t)(3 * i + r) * HIL_TYRE_COLUMNS + q] = contact.derivative[r][q];
            }
        }
    }
    return count;
}
