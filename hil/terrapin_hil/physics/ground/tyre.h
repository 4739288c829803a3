/* A flexible tyre on soft soil (Vella et al. 2024, section 2): stresses over the substitution circle, their integrals.
 *
 *     d = F_z / k_z,  R* = R_t (1 + d/z),  R_e = R_t - d/3,  th_f = acos(1 - z/R*),  th_r = -asin(min(0.9, sqrt(2 R_t
 * d)/R*)) th_m = min(0.95, c0 + c1 |i|) th_f,  sigma = k_s [R* (cos th - cos th_f)]^n ahead of th_m, mirrored onto
 * [th_r, th_m] j = R* [(th_f - th) - (1 - i)(sin th_f - sin th)],  tau = sgn(j) (c + sigma tan phi)(1 - exp(-|j|/K))
 *     F_x = b R* int(tau cos - sigma sin),  F_z = b R* int(sigma cos + tau sin),  M_y = b R* R_e int tau
 * The paper names these parts and prints none of their formulas: the formulas and the tyre's data are our assumption.
 * Gauss-Legendre, 16 nodes on each side of th_m: relative error of F_z about 8e-6, at most 1.1e-5 (the stress has a
 * root at both ends, which the rule does not follow; it is kept because published runs were made with it). Derivatives
 * are exact for that sum. SI units, angles in rad. No allocation, no global state.
 */
#ifndef HIL_TYRE_H
#define HIL_TYRE_H

typedef struct {
    double radius;      /* R_t, undeformed [m] */
    double width;       /* b [m] */
    double stiffness;   /* k_z [N/m] */
    double angle_share; /* c0: th_m / th_f without slip */
    double angle_slip;  /* c1: its rise with |slip| */
} hil_tyre;

/* In the order of the columns of every derivative. */
typedef struct {
    double stiffness;      /* k_s [Pa/m^n] */
    double exponent;       /* n */
    double cohesion;       /* [Pa] */
    double friction_angle; /* [rad] */
    double shear_modulus;  /* K [m] */
} hil_tyre_soil;

enum { HIL_TYRE_FORCE = 0, HIL_TYRE_LOAD = 1, HIL_TYRE_TORQUE = 2 }; /* rows: F_x, F_z, M_y */
enum { HIL_TYRE_BY_Z = 0, HIL_TYRE_BY_DEFLECTION = 1, HIL_TYRE_BY_SLIP = 2, HIL_TYRE_BY_SOIL = 3 };
enum { HIL_TYRE_ALL_SOIL = 31 };
#define HIL_TYRE_COLUMNS 8 /* sinkage, deflection, slip, then the five of the soil */

typedef struct {
    double value[3];         /* F_x [N], F_z [N], M_y [N m] */
    double derivative[3][8]; /* by column; with `columns` = 1 only the first is set */
    double effective_radius; /* R_e [m] */
    double circle_radius;    /* R* [m] */
    double entry_angle;      /* th_f [rad] */
} hil_tyre_contact;

enum {
    HIL_TYRE_OK = 0,
    HIL_TYRE_TOO_HEAVY = 1,     /* flattened to the axle, or not carried even at th_f = 90 degrees */
    HIL_TYRE_NOT_CONVERGED = 2, /* no sinkage within 1e-9 of the load in 60 steps */
    HIL_TYRE_BAD_INPUT = 3,     /* a value that is not finite or not positive */
    HIL_TYRE_STEP_TOO_LONG = 4  /* the time step does not resolve the contact (vehicle.h) */
};

/* Slip i, 1 - i = V / (R_e omega), from the axle's speed V and the rim's u = R_e omega [m/s], the larger one held above
 * `floor`: driving i = (u - V)/max(u, floor); braking 1 - i = min(1/(1 + i_b + 1e-9), 3), i_b = (u - V)/max(V, floor).
 * The limit also holds where the rim stands or turns back. Sets *by_axle and *by_rim, its derivatives. */
double hil_tyre_slip(double axle, double rim, double floor, double *by_axle, double *by_rim);

/* Integrals at given sinkage [m] and vertical deflection d [m]; `columns` 1 or 8 derivatives. Sinkage and deflection >
 * 0. */
void hil_tyre_evaluate(const hil_tyre *tyre, const hil_tyre_soil *soil, double sinkage, double deflection, double slip,
                       int columns, hil_tyre_contact *contact);

/* The same; of the soil's derivatives only those whose bit is set (1 << 0 for its first number), 0 elsewhere. */
void hil_tyre_evaluate_by(const hil_tyre *tyre, const hil_tyre_soil *soil, double sinkage, double deflection,
                          double slip, int columns, unsigned soil_wanted, hil_tyre_contact *contact);

/* Sinkage that carries `load` [N] within 1e-9, by Newton's method in a bracket from the guess *sinkage, which it
 * replaces. Derivatives are at fixed sinkage and deflection. At most 60 evaluations; HIL_TYRE_... */
int hil_tyre_equilibrium(const hil_tyre *tyre, const hil_tyre_soil *soil, double load, double slip, int columns,
                         double *sinkage, hil_tyre_contact *contact);

/* Deepest sinkage of the model, where th_f = 90 degrees [m]. */
double hil_tyre_deepest(const hil_tyre *tyre, double deflection);

/* `count` points at once, slip within [-1, 1]. sinkage holds guesses and becomes the result where `solve`, else is
 * taken as given. value: count x 3, geometry: count x 3 (R*, th_f, R_e), derivative: count x 3 x 8 or NULL. Returns the
 * index of the first point that failed with its code in *status, or count. */
int hil_tyre_points(const hil_tyre *tyre, const hil_tyre_soil *soils, int soil_stride, int count, int solve,
                    const double *load, const double *slip, double *sinkage, double *value, double *geometry,
                    double *derivative, int *status);

#endif
