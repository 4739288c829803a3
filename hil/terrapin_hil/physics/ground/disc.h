/* Stress under one disc that rolls on soil: what the sphere (a stack of discs) and the wheel (one disc) are made of.
 *
 * A disc of radius r enters at theta_1, leaves at theta_2 <= 0 and carries its largest normal stress at theta_m. Full:
 *     sigma = K [r (cos th - cos th_1)]^n                    th_m <= th <= th_1; behind th_m the same, mapped linearly
 *     tau   = sgn(j) (c + sigma tan phi) (1 - exp(-|j|/k)),  j = r [(th_1 - th) - (1 - s)(sin th_1 - sin th)]
 * Linear: sigma and tau fall in straight lines from their values at th_m to 0 at both ends.
 *     vertical = r int(sigma cos + tau sin),  traction = r int(tau cos - sigma sin),  torque = r^2 int tau
 * Sources: Li et al. 2024, Eqs. 3 and 7; Reina et al. 2006, Eqs. 9 to 15 with j put right (printed without "(th_1 - th)
 * -", by which torque would fall with slip). Full stresses: Gauss-Legendre, 16 nodes a zone on th = end -+ length q^2,
 * split where j changes sign, a kink; contact.h states the error. SI units, angles in rad; per metre of width.
 */
#ifndef HIL_DISC_H
#define HIL_DISC_H

typedef struct {
    double radius;
    double entry;  /* theta_1, 0 to 1.55 */
    double peak;   /* theta_m */
    double exit;   /* theta_2 >= -theta_1 */
    double rolled; /* 1 - slip of this disc */
    double sine;   /* of theta_1 */
    double cosine;
} hil_disc;

typedef struct {
    double stiffness; /* K [Pa/m^n] */
    double exponent;  /* n */
    double cohesion;  /* c [Pa] */
    double tangent;   /* tan(friction angle) */
    double modulus;   /* k [m] */
} hil_disc_soil;

enum { HIL_VERTICAL = 0, HIL_TRACTION = 1, HIL_TORQUE = 2 };

/* Columns of the derivatives: the fields above in their order, without sine and cosine. */
enum {
    HIL_DISC_BY_RADIUS,
    HIL_DISC_BY_ENTRY,
    HIL_DISC_BY_PEAK,
    HIL_DISC_BY_EXIT,
    HIL_DISC_BY_ROLLED,
    HIL_DISC_BY_STIFFNESS,
    HIL_DISC_BY_EXPONENT,
    HIL_DISC_BY_COHESION,
    HIL_DISC_BY_TANGENT,
    HIL_DISC_BY_MODULUS,
    HIL_DISC_COLUMNS
};

typedef struct {
    double value[3]; /* vertical [N/m], traction [N/m], torque [N m/m] */
    double derivative[3][HIL_DISC_COLUMNS];
} hil_disc_forces;

/* Forces of one disc; derivatives, exact, only where `derivatives` is not 0. Bounded work. */
void hil_disc_full(const hil_disc *disc, const hil_disc_soil *soil, int derivatives, hil_disc_forces *forces);
void hil_disc_linear(const hil_disc *disc, const hil_disc_soil *soil, int derivatives, hil_disc_forces *forces);

#endif
