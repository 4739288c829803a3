/* Effects that a scenario adds to the plant: their formulas (terrapin_hil/physics/effects) as instructions of
 * program.h.
 *
 * A term is evaluated once a step over the state as roles. A passive one is the level of a friction: it is evaluated at
 * the magnitude of the rates, and never at 0, where sign(0) = 0 would lose the stiction. An active one is a torque that
 * resists when positive. Drag is the level of a friction on the axle, of motion seen as forwards: slip is positive
 * where it drives. The others are relative: the parameter is multiplied by 1 + term.
 */
#ifndef HIL_EFFECTS_H
#define HIL_EFFECTS_H

#include "program.h"

enum hil_effect_target {
    HIL_EFFECT_PASSIVE, /* [N m] */
    HIL_EFFECT_ACTIVE,  /* [N m] */
    HIL_EFFECT_TORQUE_CONSTANT,
    HIL_EFFECT_ARMATURE_RESISTANCE,
    HIL_EFFECT_COULOMB,
    HIL_EFFECT_VISCOUS,
    HIL_EFFECT_F_O,
    HIL_EFFECT_DRAG, /* [N], on the axle */
    HIL_EFFECT_GEAR_EFFICIENCY,
    HIL_EFFECT_TARGETS
};

typedef struct {
    int ground; /* 1: acts on the shell, whose rate and angle it sees; 0: inside the robot */
    int target; /* enum hil_effect_target */
    int begin;  /* of its instructions */
    int count;
} hil_effect;

typedef struct {
    int count;
    const hil_effect *effect;
    const hil_instruction *code;
} hil_effects;

/* Sums of the effects' terms inside the robot (ground = 0) or on the ground (1). `values` holds the roles in their
 * slots (HIL_ROLE_*). */
void hil_effects_sum(const hil_effects *effects, int ground, double *values, double sum[HIL_EFFECT_TARGETS]);

#endif
