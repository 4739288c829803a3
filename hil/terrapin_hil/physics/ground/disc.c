#include "disc.h"

#include "sixteen.h"

#include <math.h>
#include <string.h>

enum { NODES = HIL_SIXTEEN, PANELS = 5, OUTPUTS = 3 };

/* Gauss-Legendre on [0, 1], n = 16 (Abramowitz & Stegun, table 25.4). */
static const double share[NODES] = {
    0.005299532504175034, 0.027712488463383712, 0.067184398806084128, 0.122297795822498483,
    0.191061877798678126, 0.270991611171386307, 0.359198224610370543, 0.452493745081181280,
    0.547506254918818720, 0.640801775389629457, 0.729008388828613693, 0.808938122201321874,
    0.877702204177501517, 0.932815601193915872, 0.972287511536616288, 0.994700467495824966};
static const double weight[NODES] = {
    0.0135762297058770475, 0.0311267619693239465, 0.0475792558412463925, 0.0623144856277669360,
    0.0747979944082883660, 0.0845782596975012690, 0.0913017075224617945, 0.0947253052275342480,
    0.0947253052275342480, 0.0913017075224617945, 0.0845782596975012690, 0.0747979944082883660,
    0.0623144856277669360, 0.0475792558412463925, 0.0311267619693239465, 0.0135762297058770475};

/* Columns that are summed over the nodes; radius and stiffness follow from them. */
enum { ENTRY, PEAK, EXIT, ROLLED, EXPONENT, COHESION, TANGENT, MODULUS, SUMMED };
static const int column[SUMMED] = {HIL_DISC_BY_ENTRY,   HIL_DISC_BY_PEAK,     HIL_DISC_BY_EXIT,
                                   HIL_DISC_BY_ROLLED,  HIL_DISC_BY_EXPONENT, HIL_DISC_BY_COHESION,
                                   HIL_DISC_BY_TANGENT, HIL_DISC_BY_MODULUS};

/* What every panel of a disc adds to, node by node. */
typedef struct {
    double value[OUTPUTS][NODES];
    double by[SUMMED][OUTPUTS][NODES];
} sums;

/* Normal stress at the nodes q of a panel, the same for both zones. */
typedef struct {
    double step[NODES];   /* q^2 */
    double weight[NODES]; /* 2 q dq */
    double sigma[NODES];
    double logarithm[NODES];                /* ln(r (cos th - cos th_1)) */
    double by_entry[NODES], by_peak[NODES]; /* d sigma */
} press;

/* Angles at the nodes of a zone. */
typedef struct {
    double turn[NODES]; /* theta_1 - theta */
    double sine[NODES], cosine[NODES];
    double lag[NODES];  /* sin theta_1 - sin theta */
    double drop[NODES]; /* cos theta - cos theta_1 */
} zone;

/* Sines and cosines of the nodes from those of half the turn: differences keep their digits at small angles. */
HIL_WIDE static void place(double sine_1, double cosine_1, zone *restrict z) {
    double half[NODES], s[NODES], c[NODES];
    for (int k = 0; k < NODES; k++) {
        half[k] = 0.5 * z->turn[k];
    }
    hil_sincos8(half, s, c);
    hil_sincos8(half + NODES / 2, s + NODES / 2, c + NODES / 2);
    for (int k = 0; k < NODES; k++) {
        const double sine = 2.0 * s[k] * c[k];
        const double cosine = 1.0 - 2.0 * s[k] * s[k];
        z->sine[k] = sine_1 * cosine - cosine_1 * sine;
        z->cosine[k] = cosine_1 * cosine + sine_1 * sine;
        z->lag[k] = 2.0 * s[k] * (cosine_1 * c[k] + sine_1 * s[k]);
        z->drop[k] = 2.0 * s[k] * (sine_1 * c[k] - cosine_1 * s[k]);
    }
}

HIL_WIDE static void load(const hil_disc *d, const hil_disc_soil *soil, double sine_1, const zone *restrict front,
                          int derivatives, press *restrict p) {
    double power[NODES];
    for (int k = 0; k < NODES; k++) {
        const double depth = d->radius * front->drop[k];
        power[k] = depth > 1e-300 ? depth : 1e-300;
    }
    hil_log16(power, p->logarithm);
    for (int k = 0; k < NODES; k++) {
        power[k] = soil->exponent * p->logarithm[k];
        power[k] = power[k] < -700.0 ? -700.0 : power[k];
    }
    hil_exp16(power, p->sigma);
    for (int k = 0; k < NODES; k++) {
        p->sigma[k] *= soil->stiffness;
    }
    if (derivatives) {
        for (int k = 0; k < NODES; k++) {
            const double rate = p->sigma[k] * soil->exponent / front->drop[k];
            p->by_entry[k] = rate * (sine_1 - front->sine[k] * (1.0 - p->step[k]));
            p->by_peak[k] = -rate * front->sine[k] * p->step[k];
        }
    }
}

/* How far theta (a share of the node's motion) and the zone's length follow the three angles. */
typedef struct {
    double angle_constant, angle_step; /* d theta = constant + step q^2 */
    double length;
} motion;

static const motion still = {0.0, 0.0, 0.0};
static const motion front_motion[3] = {{1.0, -1.0, 1.0}, {0.0, 1.0, -1.0}, {0.0, 0.0, 0.0}};
static const motion rear_motion[3] = {{0.0, 0.0, 0.0}, {0.0, 1.0, 1.0}, {1.0, -1.0, -1.0}};

/* Adds the derivatives of a zone's sums: `sigma_by` and `tau_by` at the nodes, and what the motion of the nodes adds.
 */
HIL_WIDE static void add(const zone *restrict z, const press *restrict p, double length, const double *restrict tau,
                         const double *restrict sigma_by, const double *restrict tau_by, motion m,
                         double (*restrict sum)[NODES]) {
    double across[NODES], along[NODES], angle[NODES];
    for (int k = 0; k < NODES; k++) {
        angle[k] = length * (m.angle_constant + m.angle_step * p->step[k]);
        across[k] = p->sigma[k] * z->cosine[k] + tau[k] * z->sine[k];
        along[k] = tau[k] * z->cosine[k] - p->sigma[k] * z->sine[k];
    }
    for (int k = 0; k < NODES; k++) {
        const double turned = length * (sigma_by[k] * z->cosine[k] + tau_by[k] * z->sine[k]) + along[k] * angle[k];
        sum[HIL_VERTICAL][k] += p->weight[k] * (turned + m.length * across[k]);
    }
    for (int k = 0; k < NODES; k++) {
        const double turned = length * (tau_by[k] * z->cosine[k] - sigma_by[k] * z->sine[k]) - across[k] * angle[k];
        sum[HIL_TRACTION][k] += p->weight[k] * (turned + m.length * along[k]);
    }
    for (int k = 0; k < NODES; k++) {
        sum[HIL_TORQUE][k] += p->weight[k] * (length * tau_by[k] + m.length * tau[k]);
    }
}

HIL_WIDE static void add_derivatives(const hil_disc *d, const hil_disc_soil *soil, const zone *restrict z,
                                     const press *restrict p, double length, double cosine_1, const motion *moves,
                                     const double *travel, const double *left, const double *mobilised,
                                     const double *tau, sums *total) {
    static const double zero[NODES] = {0.0};
    double rate[NODES], sigma_by[NODES], tau_by[NODES]; /* rate: d tau / d j */
    const double inverse = 1.0 / soil->modulus;
    for (int k = 0; k < NODES; k++) {
        rate[k] = (soil->cohesion + p->sigma[k] * soil->tangent) * left[k] * inverse;
    }
    for (int a = 0; a < 3; a++) {
        const motion *m = &moves[a];
        const double edge = a == ENTRY ? 1.0 - d->rolled * cosine_1 : 0.0;
        for (int k = 0; k < NODES; k++) {
            const double angle = m->angle_constant + m->angle_step * p->step[k];
            const double travel_by = d->radius * (edge - (1.0 - d->rolled * z->cosine[k]) * angle);
            sigma_by[k] = a == ENTRY ? p->by_entry[k] : a == PEAK ? p->by_peak[k] : 0.0;
            tau_by[k] = mobilised[k] * soil->tangent * sigma_by[k] + rate[k] * travel_by;
        }
        add(z, p, length, tau, sigma_by, tau_by, *m, total->by[a]);
    }
    for (int k = 0; k < NODES; k++) {
        tau_by[k] = -rate[k] * d->radius * z->lag[k];
    }
    add(z, p, length, tau, zero, tau_by, still, total->by[ROLLED]);
    for (int k = 0; k < NODES; k++) {
        sigma_by[k] = p->sigma[k] * p->logarithm[k];
        tau_by[k] = mobilised[k] * soil->tangent * sigma_by[k];
    }
    add(z, p, length, tau, sigma_by, tau_by, still, total->by[EXPONENT]);
    add(z, p, length, tau, zero, mobilised, still, total->by[COHESION]);
    for (int k = 0; k < NODES; k++) {
        tau_by[k] = mobilised[k] * p->sigma[k];
    }
    add(z, p, length, tau, zero, tau_by, still, total->by[TANGENT]);
    for (int k = 0; k < NODES; k++) {
        tau_by[k] = -rate[k] * travel[k] * inverse;
    }
    add(z, p, length, tau, zero, tau_by, still, total->by[MODULUS]);
}

HIL_WIDE static void add_zone(const hil_disc *d, const hil_disc_soil *soil, const zone *restrict z,
                              const press *restrict p, double length, double cosine_1, const motion *moves,
                              int derivatives, sums *restrict total) {
    const double radius = d->radius, rolled = d->rolled, cohesion = soil->cohesion, tangent = soil->tangent;
    const double inverse = 1.0 / soil->modulus;
    double travel[NODES], decay[NODES], left[NODES], mobilised[NODES], tau[NODES];
    for (int k = 0; k < NODES; k++) {
        travel[k] = radius * (z->turn[k] - rolled * z->lag[k]);
        const double exponent = -fabs(travel[k]) * inverse;
        decay[k] = exponent < -700.0 ? -700.0 : exponent;
    }
    hil_exp16(decay, left);
    for (int k = 0; k < NODES; k++) {
        mobilised[k] = copysign(1.0 - left[k], travel[k]);
        tau[k] = mobilised[k] * (cohesion + p->sigma[k] * tangent);
    }
    for (int k = 0; k < NODES; k++) {
        const double w = length * p->weight[k];
        total->value[HIL_VERTICAL][k] += w * (p->sigma[k] * z->cosine[k] + tau[k] * z->sine[k]);
    }
    for (int k = 0; k < NODES; k++) {
        const double w = length * p->weight[k];
        total->value[HIL_TRACTION][k] += w * (tau[k] * z->cosine[k] - p->sigma[k] * z->sine[k]);
    }
    for (int k = 0; k < NODES; k++) {
        total->value[HIL_TORQUE][k] += length * p->weight[k] * tau[k];
    }
    if (derivatives) {
        add_derivatives(d, soil, z, p, length, cosine_1, moves, travel, left, mobilised, tau, total);
    }
}

/* Both zones for q in [start, end]. */
HIL_WIDE static void add_panel(const hil_disc *d, const hil_disc_soil *soil, double start, double end, int derivatives,
                               sums *total) {
    const double sine_1 = d->sine, cosine_1 = d->cosine;
    const double ahead = d->entry - d->peak, behind = d->peak - d->exit, whole = d->entry - d->exit;
    press p;
    zone front, rear;
    for (int k = 0; k < NODES; k++) {
        const double q = start + (end - start) * share[k];
        p.step[k] = q * q;
        p.weight[k] = 2.0 * q * (end - start) * weight[k];
        front.turn[k] = ahead * p.step[k];
        rear.turn[k] = whole - behind * p.step[k];
    }
    place(sine_1, cosine_1, &front);
    place(sine_1, cosine_1, &rear);
    load(d, soil, sine_1, &front, derivatives, &p);
    add_zone(d, soil, &front, &p, ahead, cosine_1, front_motion, derivatives, total);
    add_zone(d, soil, &rear, &p, behind, cosine_1, rear_motion, derivatives, total);
}

static double travel_at(const hil_disc *d, double theta) {
    return (d->entry - theta) - d->rolled * 2.0 * cos(0.5 * (d->entry + theta)) * sin(0.5 * (d->entry - theta));
}

/* q of the angle `theta`, in whichever zone it lies. */
static double q_of(const hil_disc *d, double theta) {
    return theta > d->peak ? sqrt((d->entry - theta) / (d->entry - d->peak))
                           : sqrt((theta - d->exit) / (d->peak - d->exit));
}

/* Where j changes sign below theta_1: none, one or (with theta_2 < 0) two angles. Started from the solution for small
 * angles; a root that is missed or coarse costs accuracy in proportion, never correctness. */
static int reversals(const hil_disc *d, double *q) {
    if (d->rolled <= 1.0 || d->rolled * d->cosine >= 1.0) {
        return 0; /* j > 0 or j < 0 all along */
    }
    const double square = 6.0 * (1.0 - 1.0 / d->rolled) - 0.75 * d->entry * d->entry;
    const double root = sqrt(square > 0.0 ? square : 0.0);
    int count = 0;
    for (int side = 1; side >= -1; side -= 2) {
        double theta = -0.5 * d->entry + side * root;
        for (int i = 0; i < 4; i++) {
            const double slope = d->rolled * cos(theta) - 1.0;
            theta -= slope != 0.0 ? travel_at(d, theta) / slope : 0.0;
        }
        if (theta > d->exit && theta < d->entry) { /* false for NaN */
            q[count++] = q_of(d, theta);
        }
    }
    return count;
}

static int insert(double *edges, int count, double q) {
    int at = count;
    if (!(q > 1e-6 && q < 1.0 - 1e-6)) {
        return count;
    }
    while (at > 0 && edges[at - 1] > q) {
        edges[at] = edges[at - 1];
        at--;
    }
    edges[at] = q;
    return count + 1;
}

void hil_disc_full(const hil_disc *disc, const hil_disc_soil *soil, int derivatives, hil_disc_forces *forces) {
    sums total;
    double edges[PANELS], turned[2];
    int count = 0;
    memset(&total, 0, derivatives ? sizeof total : sizeof total.value);
    const int turns = reversals(disc, turned);
    for (int i = 0; i < turns; i++) {
        count = insert(edges, count, turned[i]);
    }
    double start = 0.0;
    for (int i = 0; i < count; i++) {
        add_panel(disc, soil, start, edges[i], derivatives, &total);
        start = edges[i];
    }
    add_panel(disc, soil, start, 1.0, derivatives, &total);
    for (int o = 0; o < OUTPUTS; o++) {
        const double arm = o == HIL_TORQUE ? disc->radius * disc->radius : disc->radius;
        forces->value[o] = arm * hil_sum16(total.value[o]);
        if (!derivatives) {
            continue;
        }
        double *by = forces->derivative[o];
        for (int p = 0; p < SUMMED; p++) {
            by[column[p]] = arm * hil_sum16(total.by[p][o]);
        }
        /* Forces are linear in K and c; r enters sigma like K^(1/n) and j like 1/k. */
        by[HIL_DISC_BY_STIFFNESS] = (forces->value[o] - soil->cohesion * by[HIL_DISC_BY_COHESION]) / soil->stiffness;
        by[HIL_DISC_BY_RADIUS] =
            ((o == HIL_TORQUE ? 2.0 : 1.0) * forces->value[o] +
             soil->exponent * soil->stiffness * by[HIL_DISC_BY_STIFFNESS] - soil->modulus * by[HIL_DISC_BY_MODULUS]) /
            disc->radius;
    }
}

/* sin(x)/x and its derivative. */
static double cardinal(double x, double *slope) {
    const double g = x * x;
    if (g < 0.01) {
        *slope = -x / 3.0 * (1.0 - g / 10.0 * (1.0 - g / 28.0 * (1.0 - g / 54.0 * (1.0 - g / 88.0))));
        return 1.0 - g / 6.0 * (1.0 - g / 20.0 * (1.0 - g / 42.0 * (1.0 - g / 72.0 * (1.0 - g / 110.0))));
    }
    const double value = sin(x) / x;
    *slope = (cos(x) - value) / x;
    return value;
}

/* Integrals of f, f cos, f sin, with f = 1 at theta_m, 0 at both ends; `by` the derivatives by the three angles. */
static void triangle(const hil_disc *d, double *area, double *cosines, double *sines, double by[3][3]) {
    const double front = 0.5 * (d->entry - d->peak), rear = 0.5 * (d->peak - d->exit);
    const double a = 0.5 * (d->entry + d->peak), b = 0.5 * (d->peak + d->exit);
    double front_slope, rear_slope;
    const double ahead = cardinal(front, &front_slope), behind = cardinal(rear, &rear_slope);
    const double sa = sin(a), ca = cos(a), sb = sin(b), cb = cos(b);
    *area = front + rear;
    *cosines = sa * ahead - sb * behind;
    *sines = cb * behind - ca * ahead;
    by[ENTRY][0] = 0.5;
    by[PEAK][0] = 0.0;
    by[EXIT][0] = -0.5;
    by[ENTRY][1] = 0.5 * (ca * ahead + sa * front_slope);
    by[PEAK][1] = 0.5 * (ca * ahead - sa * front_slope - cb * behind - sb * rear_slope);
    by[EXIT][1] = 0.5 * (sb * rear_slope - cb * behind);
    by[ENTRY][2] = 0.5 * (sa * ahead - ca * front_slope);
    by[PEAK][2] = 0.5 * (cb * rear_slope - sb * behind + sa * ahead + ca * front_slope);
    by[EXIT][2] = -0.5 * (sb * behind + cb * rear_slope);
}

void hil_disc_linear(const hil_disc *disc, const hil_disc_soil *soil, int derivatives, hil_disc_forces *forces) {
    const double half = 0.5 * (disc->entry - disc->peak), middle = 0.5 * (disc->entry + disc->peak);
    const double drop = 2.0 * sin(middle) * sin(half);
    const double depth = disc->radius * (drop > 0.0 ? drop : 0.0);
    const double sigma = soil->stiffness * pow(depth, soil->exponent);
    const double travel = disc->radius * (2.0 * half - disc->rolled * 2.0 * cos(middle) * sin(half));
    const double left = exp(-fabs(travel) / soil->modulus);
    const double mobilised = copysign(-expm1(-fabs(travel) / soil->modulus), travel);
    const double strength = soil->cohesion + sigma * soil->tangent;
    const double tau = strength * mobilised;
    const double r = disc->radius;
    double area, cosines, sines, by[3][3];
    triangle(disc, &area, &cosines, &sines, by);
    forces->value[HIL_VERTICAL] = r * (sigma * cosines + tau * sines);
    forces->value[HIL_TRACTION] = r * (tau * cosines - sigma * sines);
    forces->value[HIL_TORQUE] = r * r * tau * area;
    if (!derivatives) {
        return;
    }
    const double rate = strength * left / soil->modulus; /* d tau / d j */
    double sigma_by[HIL_DISC_COLUMNS] = {0.0}, travel_by[HIL_DISC_COLUMNS] = {0.0}, tau_by[HIL_DISC_COLUMNS] = {0.0};
    const double per_drop = drop > 0.0 ? soil->exponent * sigma / drop : 0.0;
    sigma_by[HIL_DISC_BY_RADIUS] = soil->exponent * sigma / r;
    sigma_by[HIL_DISC_BY_ENTRY] = per_drop * disc->sine;
    sigma_by[HIL_DISC_BY_PEAK] = -per_drop * sin(disc->peak);
    sigma_by[HIL_DISC_BY_STIFFNESS] = sigma / soil->stiffness;
    sigma_by[HIL_DISC_BY_EXPONENT] = depth > 0.0 ? sigma * log(depth) : 0.0;
    travel_by[HIL_DISC_BY_RADIUS] = travel / r;
    travel_by[HIL_DISC_BY_ENTRY] = r * (1.0 - disc->rolled * disc->cosine);
    travel_by[HIL_DISC_BY_PEAK] = r * (disc->rolled * cos(disc->peak) - 1.0);
    travel_by[HIL_DISC_BY_ROLLED] = -r * 2.0 * cos(middle) * sin(half);
    tau_by[HIL_DISC_BY_COHESION] = mobilised;
    tau_by[HIL_DISC_BY_TANGENT] = mobilised * sigma;
    tau_by[HIL_DISC_BY_MODULUS] = -rate * travel / soil->modulus;
    for (int p = 0; p < HIL_DISC_COLUMNS; p++) {
        const int angle = p - HIL_DISC_BY_ENTRY;
        const int moves = angle >= 0 && angle < 3;
        const double area_by = moves ? by[angle][0] : 0.0;
        const double cosines_by = moves ? by[angle][1] : 0.0;
        const double sines_by = moves ? by[angle][2] : 0.0;
        const double s = sigma_by[p];
        const double t = tau_by[p] + mobilised * soil->tangent * s + rate * travel_by[p];
        forces->derivative[HIL_VERTICAL][p] = r * (s * cosines + t * sines + sigma * cosines_by + tau * sines_by);
        forces->derivative[HIL_TRACTION][p] = r * (t * cosines - s * sines + tau * cosines_by - sigma * sines_by);
        forces->derivative[HIL_TORQUE][p] = r * r * (t * area + tau * area_by);
    }
    for (int o = 0; o < OUTPUTS; o++) {
        forces->derivative[o][HIL_DISC_BY_RADIUS] += (o == HIL_TORQUE ? 2.0 : 1.0) * forces->value[o] / r;
    }
}
