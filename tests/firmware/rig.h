/* A rig for the core's tests: the step, and around it a robot of a few lines that rolls or slips.
 *
 * The plant is deliberately coarse (no swing unless a test says so): bounds that need the real plant are held by the
 * scenarios of hil. Every test begins with rig_start().
 */
#ifndef RIG_H
#define RIG_H

#include <math.h>
#include <string.h>

#include "unity.h"

#include "core.h"

#define RADIUS       0.080
#define GEAR         (0.080 / 0.018)
#define TORQUE_CONST 0.10
#define OHMS         5.0
#define WEIGHT       18.639
#define INERTIA      0.017636
#define SHELL        0.0088
#define GRAVITY      9.81
#define SUPPLY       12.0
#define WHEEL_TURN   (2.0 * 3.14159265358979323846)

/* The controller under test and the world that it feels. Functions that a file does not use cost nothing. */
static struct {
    terrapin_state state;
    terrapin_inputs in;
    terrapin_outputs out;
    double alpha, ground;              /* angle of the drive arm [rad], way of the axle [m] */
    double omega, speed;               /* [rad/s], [m/s] */
    double current;                    /* [A] */
    double coulomb, viscous, f_o, f_s; /* of the true robot and ground */
    double slope;                      /* [rad] */
    double slope_from;                 /* [m] */
    double traction, slip_constant;    /* mu, s_k; mu = 0: pure rolling */
    double noise_codes;                /* half width of an even noise on the current */
    double offset_codes;
    double carriage; /* imposed axle speed; NAN: free */
    bool command;    /* the operator sends COMMAND every 50 ticks */
    bool blind;      /* the ground wheel does not turn */
    bool stuck;      /* it keeps its count */
    double scale;    /* that it counts of its way; */
    double runaway;  /* and what it counts of itself [m/s] */
    double counted;  /* [m] */
    uint32_t seed;
    terrapin_frame last[10]; /* the last telemetry frame of each slot */
} rig;

static inline double rig_random(void) { /* -1..1 */
    rig.seed = rig.seed * 1664525U + 1013904223U;
    return (double)(int32_t)rig.seed / 2147483648.0;
}

static inline void rig_start(void) {
    memset(&rig, 0, sizeof rig);
    terrapin_init(&rig.state);
    rig.coulomb = 0.012;
    rig.viscous = 1e-3;
    rig.f_o = 0.010;
    rig.carriage = NAN;
    rig.scale = 1.0;
    rig.slope_from = INFINITY;
    rig.seed = 1U;
    rig.noise_codes = 1.0;
    rig.in.tick = UINT32_MAX;
    rig.in.supply_code = (uint16_t)(SUPPLY / 0.004);
    rig.in.temperature_code = 1500U;
    rig.in.swing_valid = true;
    rig.command = true;
    rig.in.command.limiter = true;
}

static inline double rig_friction(double drive, double rate, double level) {
    return fabs(rate) > 1e-3 ? copysign(level, rate) : fmax(-level, fmin(level, drive));
}

static inline void rig_plant(void) {
    const int steps = rig.traction > 0.0 ? 20 : 1;
    for (int i = 0; i < steps; i++) {
        const double dt = 1e-3 / steps;
        const double volt = rig.out.duty_q15 / 32768.0 * SUPPLY;
        rig.current = rig.out.enable ? (volt - TORQUE_CONST * GEAR * rig.omega) / OHMS : 0.0;
        const double motor = GEAR * TORQUE_CONST * rig.current - rig.viscous * rig.omega;
        const double level = rig.coulomb + (rig.f_o + rig.f_s * rig.omega * rig.omega) * RADIUS * WEIGHT;
        if (rig.traction > 0.0) {
            const double climb = rig.ground > rig.slope_from ? WEIGHT * sin(rig.slope) : 0.0;
            const double fastest = fmax(fmax(fabs(RADIUS * rig.omega), fabs(rig.speed)), 0.01);
            const double slip = (RADIUS * rig.omega - rig.speed) / fastest;
            const double pull = copysign(rig.traction * WEIGHT * (1.0 - exp(-fabs(slip) / rig.slip_constant)), slip);
            const double drive = motor - RADIUS * pull;
            rig.omega += dt * (drive - rig_friction(drive, rig.omega, level)) / SHELL;
            rig.speed = isnan(rig.carriage) ? rig.speed + dt * (pull - climb) * GRAVITY / WEIGHT : rig.carriage;
        } else {
            rig.omega += dt * (motor - rig_friction(motor, rig.omega, level)) / INERTIA;
            rig.speed = RADIUS * rig.omega;
        }
        rig.alpha += dt * rig.omega;
        rig.ground += dt * rig.speed;
        rig.counted += dt * (rig.scale * rig.speed + rig.runaway);
    }
}

static inline uint16_t rig_count(double turns) {
    return (uint16_t)((int64_t)floor(turns * 2048.0) & 0xFFFF);
}

/* The step alone, with the inputs as they are; keeps the telemetry. */
static inline void rig_step(void) {
    terrapin_step(&rig.state, &rig.in, &rig.out);
    TEST_ASSERT_EQUAL_HEX16(TERRAPIN_ID_ACTUATE, rig.out.frames[0].id);
    TEST_ASSERT_TRUE(rig.out.enable || rig.out.duty_q15 == 0);
    if (rig.out.frame_count == 2U) {
        rig.last[rig.in.tick % 10U] = rig.out.frames[1];
    }
}

/* One millisecond of robot and controller. */
static inline void rig_tick(void) {
    rig.in.tick++;
    const double code = 2048.0 + rig.offset_codes + rig.current * 1000.0 + rig.noise_codes * rig_random();
    rig.in.current_code = (uint16_t)fmax(0.0, fmin(4095.0, rint(code)));
    rig.in.motor_count = rig_count(rig.alpha * GEAR / WHEEL_TURN);
    if (!rig.stuck) {
        rig.in.ground_count = rig.blind ? 0U : rig_count(rig.counted / 0.030 / WHEEL_TURN);
    }
    rig.in.command_fresh = rig.command && rig.in.tick % 50U == 0U;
    rig_step();
    rig_plant();
}

static inline void rig_run(uint32_t ms) {
    for (uint32_t i = 0; i < ms; i++) {
        rig_tick();
    }
}

static inline int32_t rig_state(void) {
    return rig.state.supervisor.state;
}

/* Runs until the state is reached; fails when it is not within ms. */
static inline void rig_until(int32_t state, uint32_t ms) {
    for (uint32_t i = 0; i < ms && rig_state() != state; i++) {
        rig_tick();
    }
    TEST_ASSERT_EQUAL_INT32(state, rig_state());
}

static inline void rig_request(uint8_t request, int16_t setpoint) {
    rig.in.command.request = request;
    rig.in.command.setpoint = setpoint;
}

/* Boots into idle and drives, once the hold of an IDLE before is over. */
static inline void rig_drive(int16_t setpoint, uint8_t control) {
    rig.in.command.control = control;
    rig_request(TERRAPIN_REQUEST_RUN, setpoint);
    rig_until(TERRAPIN_STATE_RUN, 300U + TERRAPIN_LIMIT_STOP_HOLD);
}

static inline void rig_set(uint16_t index, int32_t value) {
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set(&rig.state, index, value));
}

static inline int32_t rig_get(uint16_t index) {
    int32_t value = 0;
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_get(&rig.state, index, &value));
    return value;
}

static inline bool rig_fault(uint32_t number) {
    return (rig.out.faults & (1U << number)) != 0U;
}

/* The true torque on the shell of a rolling rig [uN m]. */
static inline double rig_contact_unm(void) {
    return 1e6 * (rig.f_o + rig.f_s * rig.omega * rig.omega) * RADIUS * WEIGHT * (rig.omega < 0.0 ? -1.0 : 1.0);
}

#endif
