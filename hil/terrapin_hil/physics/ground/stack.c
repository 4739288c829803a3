#include "stack.h"

#include <math.h>
#include <string.h>

enum { OUTPUTS = 3, WHOLE = 12, PART = 8, BREAKS = 6 };

#define QUARTER 1.5707963267948966

/* Gauss-Legendre on [0, 1], n = 12 and n = 8. */
static const double whole_share[WHOLE] = {0.009219682876640375, 0.047941371814762572, 0.115048662902847656,
                                          0.206341022856691276, 0.316084250500909903, 0.437383295744265542,
                                          0.562616704255734458, 0.683915749499090097, 0.793658977143308724,
                                          0.884951337097152344, 0.952058628185237428, 0.990780317123359625};
static const double whole_weight[WHOLE] = {0.023587668193255914, 0.053469662997659215, 0.080039164271673113,
                                           0.101583713361532961, 0.116746268269177404, 0.124573522906701393,
                                           0.124573522906701393, 0.116746268269177404, 0.101583713361532961,
                                           0.080039164271673113, 0.053469662997659215, 0.023587668193255914};
static const double part_share[PART] = {0.019855071751231884, 0.101666761293186636, 0.237233795041835505,
                                        0.408282678752175110, 0.591717321247824946, 0.762766204958164495,
                                        0.898333238706813364, 0.980144928248768088};
static const double part_weight[PART] = {0.050614268145188129, 0.111190517226687241, 0.156853322938943635,
                                         0.181341891689180995, 0.181341891689180995, 0.156853322938943635,
                                         0.111190517226687241, 0.050614268145188129};

static double peak_share(const hil_contact_point *point, double rolled) {
    return point->peak_share + point->peak_slip * (1.0 - rolled);
}

static int free_share(double share) {
    return share > 0.0 && share < 1.0;
}

hil_disc hil_disc_of(const hil_contact_point *point, double radius, double entry, double sine, double cosine,
                     double rolled) {
    const double share = fmin(fmax(peak_share(point, rolled), 0.0), 1.0);
    const hil_disc disc = {radius, entry, share * entry, -point->recovery * entry, rolled, sine, cosine};
    return disc;
}

hil_disc_soil hil_disc_soil_of(const hil_contact_point *point) {
    const hil_disc_soil soil = {point->stiffness, point->exponent, point->cohesion, tan(point->friction_angle),
                                point->shear_modulus};
    return soil;
}

void hil_disc_add(const hil_contact_point *point, const hil_disc *disc, const hil_disc_forces *forces, double weight,
                  const hil_disc_change by[3], int derivatives, hil_contact_forces *sum) {
    static const int moved[3] = {HIL_BY_ENTRY, HIL_BY_SLIP, HIL_BY_RADIUS};
    for (int o = 0; o < OUTPUTS; o++) {
        sum->value[o] += weight * forces->value[o];
    }
    if (!derivatives) {
        return;
    }
    const double plain = peak_share(point, disc->rolled);
    const double share = fmin(fmax(plain, 0.0), 1.0);
    const double follows = free_share(plain) ? disc->entry : 0.0;
    const double tangent = tan(point->friction_angle);
    for (int o = 0; o < OUTPUTS; o++) {
        const double *d = forces->derivative[o];
        double *total = sum->derivative[o];
        for (int c = 0; c < 3; c++) {
            const hil_disc_change *m = &by[c];
            const double peak = share * m->entry - follows * point->peak_slip * m->rolled;
            total[moved[c]] += weight * (d[HIL_DISC_BY_RADIUS] * m->radius + d[HIL_DISC_BY_ENTRY] * m->entry +
                                         d[HIL_DISC_BY_PEAK] * peak - d[HIL_DISC_BY_EXIT] * point->recovery * m->entry +
                                         d[HIL_DISC_BY_ROLLED] * m->rolled + forces->value[o] * m->weight);
        }
        total[HIL_BY_STIFFNESS] += weight * d[HIL_DISC_BY_STIFFNESS];
        total[HIL_BY_EXPONENT] += weight * d[HIL_DISC_BY_EXPONENT];
        total[HIL_BY_COHESION] += weight * d[HIL_DISC_BY_COHESION];
        total[HIL_BY_FRICTION_ANGLE] += weight * d[HIL_DISC_BY_TANGENT] * (1.0 + tangent * tangent);
        total[HIL_BY_SHEAR_MODULUS] += weight * d[HIL_DISC_BY_MODULUS];
        total[HIL_BY_PEAK_SHARE] += weight * d[HIL_DISC_BY_PEAK] * follows;
        total[HIL_BY_PEAK_SLIP] += weight * d[HIL_DISC_BY_PEAK] * follows * (1.0 - disc->rolled);
        total[HIL_BY_RECOVERY] -= weight * d[HIL_DISC_BY_EXIT] * disc->entry;
    }
}

/* The sphere at an entry angle; u says which disc, y = sin^2 u. */
typedef struct {
    const hil_contact_point *point;
    double entry, sine, cosine;
} ball;

/* rolled * (mean of cos between an angle and theta_x1) - 1: positive where the soil is sheared backwards there. The
 * angle is `share` theta_x1, or theta_m where share is above 1. Rises with y. */
static double backwards(const ball *b, double share, double y) {
    const double r = sqrt(1.0 - b->sine * b->sine * y);
    const double entry = atan2(b->sine * sqrt(1.0 - y), b->cosine);
    const double rolled = (1.0 - b->point->slip) / r;
    const double chosen = share > 1.0 ? fmin(fmax(peak_share(b->point, rolled), 0.0), 1.0) : share;
    const double half = 0.5 * (1.0 - chosen) * entry;
    const double mean = half > 1e-9 ? cos(0.5 * (1.0 + chosen) * entry) * sin(half) / half : cos(entry);
    return rolled * mean - 1.0;
}

/* y in (0, 1) where `backwards` is zero, or 0 for none: the Illinois method. An inexact break costs accuracy only. */
static double turning_point(const ball *b, double share) {
    double low = 0.0, high = 1.0, y = 0.0;
    double f_low = backwards(b, share, low), f_high = backwards(b, share, high);
    if (!(f_low < 0.0 && f_high > 0.0)) {
        return 0.0;
    }
    int last = 0;
    for (int i = 0; i < 12; i++) {
        y = (low * f_high - high * f_low) / (f_high - f_low);
        const double f = backwards(b, share, y);
        if (fabs(f) < 1e-12) {
            break;
        }
        if (f < 0.0) {
            low = y;
            f_low = f;
            f_high *= last < 0 ? 0.5 : 1.0;
            last = -1;
        } else {
            high = y;
            f_high = f;
            f_low *= last > 0 ? 0.5 : 1.0;
            last = 1;
        }
    }
    return y;
}

static int insert(double *breaks, int count, double y) {
    if (!(y > 1e-9 && y < 1.0 - 1e-9)) {
        return count;
    }
    const double u = asin(sqrt(y));
    int at = count;
    while (at > 0 && breaks[at - 1] > u) {
        breaks[at] = breaks[at - 1];
        at--;
    }
    breaks[at] = u;
    return count + 1;
}

/* Where, across the sphere, kinks enter or leave the discs: angles u in rising order. */
static int find_breaks(const ball *b, int stress, double *breaks) {
    const hil_contact_point *p = b->point;
    const double square = b->sine * b->sine;
    const double rim = (1.0 - p->slip) / b->cosine; /* rolled there */
    int count = 0;
    for (int end = 0; end < 2 && p->peak_slip != 0.0; end++) { /* theta_m meets an end of its range */
        const double rolled = 1.0 - (end - p->peak_share) / p->peak_slip;
        const double r = (1.0 - p->slip) / rolled;
        count = insert(breaks, count, (1.0 - r * r) / square);
    }
    if (rim <= 1.0 || (1.0 - p->slip) * b->cosine >= 1.0) {
        return count; /* all discs shear forwards, or all backwards */
    }
    count = insert(breaks, count, turning_point(b, 2.0));
    if (stress == HIL_LINEAR) {
        return count;
    }
    count = insert(breaks, count, turning_point(b, -p->recovery));
    if (p->recovery > 0.5) {
        count = insert(breaks, count, turning_point(b, -0.5)); /* two reversals are born */
    }
    return insert(breaks, count, (1.0 - (1.0 - p->slip) * b->cosine) / square);
}

static void add_disc(const ball *b, int stress, const hil_disc_soil *soil, double u, double du, int derivatives,
                     hil_contact_forces *sum) {
    const hil_contact_point *p = b->point;
    const double sine = sin(u), cosine = cos(u);
    const double radius = p->radius * sqrt(b->cosine * b->cosine + b->sine * b->sine * cosine * cosine);
    const double ratio = p->radius / radius;
    const double rolled = ratio * (1.0 - p->slip);
    const double entry = atan2(b->sine * cosine, b->cosine);
    const hil_disc disc = hil_disc_of(p, radius, entry, ratio * b->sine * cosine, ratio * b->cosine, rolled);
    const double weight = 2.0 * p->radius * b->sine * cosine * du; /* both halves of the sphere */
    const double shrinks = -p->radius * ratio * b->sine * b->cosine * sine * sine;
    const hil_disc_change by[3] = {
        {shrinks, cosine * ratio * ratio, -rolled * shrinks / radius, b->cosine / b->sine},
        {0.0, 0.0, -ratio, 0.0},
        {1.0 / ratio, 0.0, 0.0, 1.0 / p->radius},
    };
    hil_disc_forces forces;
    (stress == HIL_LINEAR ? hil_disc_linear : hil_disc_full)(&disc, soil, derivatives, &forces);
    hil_disc_add(p, &disc, &forces, weight, by, derivatives, sum);
}

void hil_stack_evaluate(int stress, const hil_contact_point *point, double entry, int derivatives,
                        hil_contact_forces *forces) {
    const ball b = {point, entry, sin(entry), cos(entry)};
    const hil_disc_soil soil = hil_disc_soil_of(point);
    double breaks[BREAKS];
    const int count = find_breaks(&b, stress, breaks);
    memset(forces, 0, derivatives ? sizeof *forces : sizeof forces->value);
    const int few = count > 0 && stress == HIL_FULL && 1.0 - point->slip > b.cosine; /* kinks, costly discs */
    const int nodes = few ? PART : WHOLE;
    const double *share = few ? part_share : whole_share;
    const double *weight = few ? part_weight : whole_weight;
    double start = 0.0;
    for (int part = 0; part <= count; part++) {
        const double length = (part < count ? breaks[part] : QUARTER) - start;
        for (int i = 0; i < nodes; i++) {
            add_disc(&b, stress, &soil, start + length * share[i], length * weight[i], derivatives, forces);
        }
        start += length;
    }
}
