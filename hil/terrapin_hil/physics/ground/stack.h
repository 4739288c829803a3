/* The sphere as a stack of discs (contact.h). */
#ifndef HIL_STACK_H
#define HIL_STACK_H

#include "contact.h"
#include "disc.h"

/* Columns of the derivatives: 0 the entry angle, then the fields of hil_contact_point. */
enum {
    HIL_BY_ENTRY,
    HIL_BY_SLIP,
    HIL_BY_RADIUS,
    HIL_BY_WIDTH,
    HIL_BY_STIFFNESS,
    HIL_BY_EXPONENT,
    HIL_BY_COHESION,
    HIL_BY_FRICTION_ANGLE,
    HIL_BY_SHEAR_MODULUS,
    HIL_BY_PEAK_SHARE,
    HIL_BY_PEAK_SLIP,
    HIL_BY_RECOVERY
};

typedef void (*hil_disc_function)(const hil_disc *disc, const hil_disc_soil *soil, int derivatives,
                                  hil_disc_forces *forces);

/* A disc of radius r with entry angle theta_1 (sine and cosine as well) and rolled = 1 - slip. */
hil_disc hil_disc_of(const hil_contact_point *point, double radius, double entry, double sine, double cosine,
                     double rolled);

hil_disc_soil hil_disc_soil_of(const hil_contact_point *point);

/* Adds `weight` times the forces of a disc; with derivatives also those by soil and angles, for which `by` gives the
 * change of radius, entry angle, rolled and of ln(weight) by the columns entry, slip and radius of the point. */
typedef struct {
    double radius, entry, rolled, weight;
} hil_disc_change;

void hil_disc_add(const hil_contact_point *point, const hil_disc *disc, const hil_disc_forces *forces, double weight,
                  const hil_disc_change by[3], int derivatives, hil_contact_forces *sum);

/* The sphere's forces. */
void hil_stack_evaluate(int stress, const hil_contact_point *point, double entry, int derivatives,
                        hil_contact_forces *forces);

#endif
