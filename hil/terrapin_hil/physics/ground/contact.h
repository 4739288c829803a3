/* A sphere or a wheel on soft soil: forces at a given entry angle, and the entry angle that carries a load.
 *
 * Wheel (Reina et al. 2006, Eqs. 9 to 15): one disc, theta_m = (peak_share + peak_slip s) theta_1.
 * Sphere (Li et al. 2024, Eqs. 1 to 6): a stack of discs r_x = sqrt(R^2 - x^2) with one forward speed, so that
 *     1 - s_x = R (1 - s) / r_x,  theta_x1 = atan(tan(theta_1) cos u),  x = R sin(theta_1) sin u,  u in [0, pi/2]
 * with theta_m = (peak_share + peak_slip s_x) theta_x1, the factor held within [0, 1], and theta_2 = -recovery theta_1.
 * Gauss-Legendre over u: 12 nodes, or (full stresses) 8 in each part where s < z/R, when the rim's discs skid while the
 * middle slips and kinks lie inside. Relative error of the forces: 1e-8 for usual soils, 1e-7 where the rim skids,
 * 5e-6 for n from 0.4 to 1.8 with k down to 1 mm (tests/python/test_contact.py). Derivatives are exact for the
 * integral, not for the sum: equal up to the same error. SI units. No allocation.
 */
#ifndef HIL_CONTACT_H
#define HIL_CONTACT_H

enum { HIL_SPHERE = 0, HIL_WHEEL = 1 };
enum { HIL_FULL = 0, HIL_LINEAR = 1 };

/* In the order of the derivatives' columns, after the entry angle. */
typedef struct {
    double slip;           /* -1 to 1 */
    double radius;         /* [m] */
    double width;          /* [m]; not read for a sphere */
    double stiffness;      /* [Pa/m^n] */
    double exponent;       /* n */
    double cohesion;       /* [Pa] */
    double friction_angle; /* [rad] */
    double shear_modulus;  /* [m] */
    double peak_share;     /* c1 */
    double peak_slip;      /* c2 */
    double recovery;
} hil_contact_point;

#define HIL_CONTACT_COLUMNS  12
#define HIL_CONTACT_STEEPEST 1.55 /* greatest entry angle [rad] */

typedef struct {
    double value[3]; /* vertical force [N], traction [N], torque [N m] */
    double derivative[3][HIL_CONTACT_COLUMNS];
} hil_contact_forces;

enum { HIL_CONTACT_OK = 0, HIL_CONTACT_TOO_HEAVY = 1, HIL_CONTACT_NOT_CONVERGED = 2, HIL_CONTACT_BAD_INPUT = 3 };

/* Forces at the entry angle [rad] in (0, 1.55]. */
void hil_contact_evaluate(int shape, int stress, const hil_contact_point *point, double entry, int derivatives,
                          hil_contact_forces *forces);

/* Entry angle at which the soil carries `load` [N] within 1e-12 of it (1e-9 where rounding allows no more): a secant in
 * the logarithms inside a bracket, from the guess *entry (not positive: from the law for small loads). Fills `forces`
 * without derivatives. HIL_CONTACT_TOO_HEAVY leaves the greatest angle; other failures a NaN. Bounded work. */
int hil_contact_solve(int shape, int stress, const hil_contact_point *point, double load, double *entry,
                      hil_contact_forces *forces);

/* `count` points. With `load` NULL `entry` is given; else it holds guesses and becomes the result, and status[i] says
 * how that went (the forces are those at the angle that it left). value: count x 3; derivative: count x 3 x 12 or NULL.
 * Returns the number of points that are not HIL_CONTACT_OK. */
int hil_contact_points(int shape, int stress, int count, const hil_contact_point *points, const double *load,
                       double *entry, double *value, double *derivative, int *status);

#endif
