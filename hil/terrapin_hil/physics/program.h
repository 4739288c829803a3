/* Formulas of effects inside an integrator or the plant: a stack machine over a table of values, so that a new effect
 * needs no compiler. terrapin_hil/physics/program.py makes the instructions from an expression.
 */
#ifndef HIL_PROGRAM_H
#define HIL_PROGRAM_H

enum {
    HIL_OP_NUMBER,
    HIL_OP_VALUE, /* values[slot] */
    HIL_OP_ADD,
    HIL_OP_SUBTRACT,
    HIL_OP_MULTIPLY,
    HIL_OP_DIVIDE,
    HIL_OP_POWER,
    HIL_OP_LESS,
    HIL_OP_LESS_EQUAL,
    HIL_OP_GREATER,
    HIL_OP_GREATER_EQUAL,
    HIL_OP_EQUAL,
    HIL_OP_NOT_EQUAL,
    HIL_OP_MINIMUM,
    HIL_OP_MAXIMUM,
    HIL_OP_NEGATE, /* from here on one argument */
    HIL_OP_ABS,
    HIL_OP_SIGN, /* tanh(x / smoothing), for friction in an integrator must not jump; the very sign for smoothing 0 */
    HIL_OP_SQRT,
    HIL_OP_EXP,
    HIL_OP_LOG,
    HIL_OP_SIN,
    HIL_OP_COS,
    HIL_OP_TAN,
    HIL_OP_TANH
};

enum { HIL_PROGRAM_DEPTH = 150 }; /* of the stack: a formula's operations inside each other are no more */

typedef struct {
    int op;
    int slot;
    double number;
} hil_instruction;

/* Value of a formula of `count` instructions. The code must be sound: never deeper than HIL_PROGRAM_DEPTH. */
double hil_program_run(const hil_instruction *code, int count, double smoothing, const double *values);

enum { HIL_PROGRAM_LENGTH = 2048 }; /* instructions of a formula whose gradient is asked for */

/* The same, of at most HIL_PROGRAM_LENGTH instructions; adds its derivatives by the values to gradient[slot] (as many
 * as there are slots), by one sweep back through the formula. Where a function has a corner (abs, min) one side's
 * derivative is taken, where a root begins (sqrt(0)) none. */
double hil_program_gradient(const hil_instruction *code, int count, double smoothing, const double *values,
                            double *gradient);

/* Slots of what every model knows of its motion and surroundings; a model's parameters follow from HIL_ROLES on. */
enum {
    HIL_ROLE_TIME,
    HIL_ROLE_OMEGA, /* rate on which the term acts: of the drive, or of the shell or wheel on the ground */
    HIL_ROLE_ANGLE,
    HIL_ROLE_ACCELERATION,
    HIL_ROLE_SLIP,
    HIL_ROLE_SPEED,
    HIL_ROLE_LOAD,
    HIL_ROLE_SLOPE,
    HIL_ROLE_TEMPERATURE,
    HIL_ROLE_PASS,
    HIL_ROLE_MOISTURE,
    HIL_ROLE_VOLTAGE,
    HIL_ROLE_JOINT_RATE,
    HIL_ROLE_DRIVE_TORQUE,
    HIL_ROLE_BULLDOZING, /* resistance of the sand pushed ahead [N], in the plant */
    HIL_ROLE_DIRECTION,  /* 1 forwards, -1 backwards, in the plant */
    HIL_ROLE_SWING,      /* of what swings in the shell: drive less shell [rad] */
    HIL_ROLES = 17
};

/* What a term does. */
enum {
    HIL_TERM_ADD,      /* values[slot] += e */
    HIL_TERM_MULTIPLY, /* values[slot] *= 1 + e */
    HIL_TERM_TORQUE    /* a resisting torque e [N m] */
};

typedef struct {
    int kind;
    int ground; /* 1: acts on the shell, wheel or car at the ground, with its roles; 0: inside the drive */
    int slot;
    int begin; /* of its instructions */
    int count;
    int inertial; /* the formula uses the acceleration, linearly: that part joins the inertia */
} hil_term;

typedef struct {
    int count;
    const hil_term *term;
    const hil_instruction *code;
    double smoothing; /* of sign(), in the unit of its argument */
} hil_additions;

/* Changes parameters in `values` by the terms for the drive (ground = 0) or the ground (1). */
void hil_additions_change(const hil_additions *additions, int ground, double *values);

/* Sum of the resisting torques [N m] without acceleration; *inertia receives their sum for 1 rad/s^2 less that. */
double hil_additions_torque(const hil_additions *additions, int ground, double *values, double *inertia);

#endif
