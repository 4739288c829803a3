/* Terrapin controller: the whole controller is one pure step.
 *
 *     #include "terrapin.h"
 *     #include "terrapin_interface.h"
 *
 *     static uint64_t memory[TERRAPIN_STATE_BYTES / 8];
 *     static terrapin_inputs in;
 *     static terrapin_outputs out;
 *
 *     void at_the_start(void) { terrapin_init((terrapin_state *)memory); }
 *
 *     void each_millisecond(void) {
 *         in.tick++;
 *         terrapin_step_drive((terrapin_state *)memory, &in, &out);
 *         terrapin_step_think((terrapin_state *)memory, &in, &out);
 *     }
 *
 * The memory is the caller's, 8-byte aligned; its size counts the parameters, which terrapin_interface.h lists.
 * terrapin_init puts every parameter at its default, and the bridge off. Gather the inputs before the first of the two
 * calls, which says what the bridge does now: set it. The second says what the ground says, and the frames: send them.
 *
 * One step is these two calls, in this order, with the same inputs and outputs. The first takes nearly the same time in
 * every tick, so that the bridge is set at the same moment of each; the second spreads its work over ten ticks by the
 * table of schedule.c. terrapin_step makes both, for callers who set no bridge in between: the same bits.
 *
 * Promise: integers only, no heap, no recursion, no globals that change, no I/O, no clock; bounded work a call.
 * The same inputs give the same outputs, bit for bit, on every machine and at every optimisation level.
 * Ports gather inputs and deliver outputs; nothing else decides anything.
 *
 * Units stand last in names. Angles are in mrad, angular speeds in mrad/s, torques in uN m, unless the name says
 * otherwise.
 */
#ifndef TERRAPIN_H
#define TERRAPIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(TERRAPIN_SHARED) && defined(__GNUC__)
#define TERRAPIN_API __attribute__((visibility("default")))
#else
#define TERRAPIN_API
#endif

#define TERRAPIN_TICK_HZ 1000
/* Bytes that are enough for a state, a multiple of 8, on every machine; its parameters are counted in
 * terrapin_interface.h. */
#define TERRAPIN_STATE_BYTES ((5364U + (4U * (uint32_t)TERRAPIN_PARAMETER_COUNT) + 7U) & ~7U)
#define TERRAPIN_MAX_FRAMES  2 /* frames that one step may emit: ACTUATE, and at most one telemetry frame */

/* One classic CAN frame with an 11-bit identifier. length is 0 to 8. */
typedef struct {
    uint16_t id;
    uint8_t length;
    uint8_t data[8];
} terrapin_frame;

/* What the operator asks for; the latest accepted COMMAND frame. Values are those of COMMAND in controller.toml. */
typedef struct {
    uint8_t request;  /* terrapin_request: 0 idle, 1 calibrate, 2 run, 3 clear faults and reports */
    uint8_t control;  /* terrapin_control: 0 voltage (setpoint in mV), 1 shell rim speed (setpoint in mm/s) */
    bool limiter;     /* slip limiter, stuck detection and extrication enabled */
    int16_t setpoint; /* mV or mm/s, signed */
} terrapin_command;

/* Everything the controller senses at one tick. Each field has the resolution of its CAN signal, so that a run through
 * memory and one over a wire see the same numbers. Fields that are not sampled at a tick hold their last value. */
typedef struct {
    uint32_t tick;                 /* ms since reset, wraps */
    uint16_t current_code;         /* 12-bit ADC, motor current; parameter current_zero_code reads as 0 A */
    uint16_t supply_code;          /* 12-bit ADC, bridge supply */
    uint16_t temperature_code;     /* 12-bit ADC, winding temperature */
    uint16_t motor_count;          /* drive wheel, TERRAPIN_ENCODER_COUNTS a turn in the body, forward is up, wraps */
    uint16_t ground_count;         /* trailing wheel (parameter ground_wheel_radius), forward is up, wraps */
    int16_t swing_angle_mrad;      /* phi, bob forward positive */
    int16_t swing_rate_centirad_s; /* phi_dot in 0.01 rad/s */
    int16_t pitch_mrad;            /* slope of the ground, uphill positive */
    int16_t ground_speed_mm_s;     /* axle speed from outside (vision) */
    uint16_t heading_turn;         /* steering of the inner device, one turn = 65536; anticlockwise */
    bool swing_valid;              /* swing_angle_mrad and swing_rate_centirad_s are measured */
    bool pitch_valid;
    bool ground_speed_valid;
    bool heading_valid; /* the inner device is steered, and its encoder read */
    bool estop;         /* emergency stop pressed, or its wire broken */
    bool command_fresh; /* a COMMAND with a good counter and CRC arrived since the last tick */
    terrapin_command command;
} terrapin_inputs;

typedef struct {
    int16_t duty_q15;    /* bridge duty, -32767 to 32767: applied voltage = duty / 32768 * supply */
    bool enable;         /* bridge enabled; when false duty_q15 is 0 */
    uint32_t faults;     /* one bit a fault, numbers of controller.toml */
    uint8_t frame_count; /* 0 to TERRAPIN_MAX_FRAMES; 0 between the two calls */
    terrapin_frame frames[TERRAPIN_MAX_FRAMES];
} terrapin_outputs;

typedef struct terrapin_state terrapin_state;

/* Result of a parameter access. */
typedef enum {
    TERRAPIN_PARAMETER_OK = 0,
    TERRAPIN_PARAMETER_UNKNOWN = 1, /* no such index */
    TERRAPIN_PARAMETER_RANGE = 2,   /* value outside the range of controller.toml; nothing written */
    TERRAPIN_PARAMETER_LOCKED = 3   /* bridge on; nothing written */
} terrapin_parameter_result;

/* Bytes that a state takes in this build: at most TERRAPIN_STATE_BYTES. */
TERRAPIN_API size_t terrapin_state_size(void);

/* Reset: parameters to their defaults, supervisor to boot, bridge off. */
TERRAPIN_API void terrapin_init(terrapin_state *state);

/* The same with these parameters, all of them in file order, for the work of one reset. When one is out of its range
 * the result is TERRAPIN_PARAMETER_RANGE, and all are at their defaults. */
TERRAPIN_API terrapin_parameter_result terrapin_init_with(terrapin_state *state, const int32_t *values);

/* The first half of a tick of 1 ms: sensors, slip, states, drive. Writes duty_q15, enable and faults, and frame_count =
 * 0. Bounded work. state, inputs and outputs must not overlap and must not be NULL, here and in the next two. */
TERRAPIN_API void terrapin_step_drive(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);

/* The second half: the estimator's share of the tick, telemetry. inputs are those of the first half; reads outputs and
 * writes the frames. Bounded work. */
TERRAPIN_API void terrapin_step_think(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);

/* One tick of 1 ms: both halves. */
TERRAPIN_API void terrapin_step(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);

/* Raw integer value of a parameter, in the unit and scale of controller.toml. index counts from 0 in file order. */
TERRAPIN_API terrapin_parameter_result terrapin_parameter_set(terrapin_state *state, uint16_t index, int32_t value);
TERRAPIN_API terrapin_parameter_result terrapin_parameter_get(const terrapin_state *state, uint16_t index,
                                                              int32_t *value);

/* All TERRAPIN_PARAMETER_COUNT values as they stand, in file order; they belong to the state. */
TERRAPIN_API const int32_t *terrapin_parameter_values(const terrapin_state *state);

/* All parameters, in file order (NULL: the defaults); nothing is written unless all are in range and the bridge is off.
 * About the work of one terrapin_parameter_set. */
TERRAPIN_API terrapin_parameter_result terrapin_parameter_set_all(terrapin_state *state, const int32_t *values);

/* The latched faults that stand, one bit each. */
TERRAPIN_API uint32_t terrapin_latched(const terrapin_state *state);

/* The self test is over, and no latched fault stands. */
TERRAPIN_API bool terrapin_at_work(const terrapin_state *state);

/* Latch faults that stood before a reset of the state: the bridge stays off until `clear`. Bits that are no latched
 * faults are left out. */
TERRAPIN_API void terrapin_latch(terrapin_state *state, uint32_t faults);

/* True while the bridge is enabled: what would endanger something is refused then. */
TERRAPIN_API bool terrapin_bridge_on(const terrapin_state *state);

#ifdef __cplusplus
}
#endif
#endif
