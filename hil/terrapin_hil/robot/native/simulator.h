/* The simulated robot in lockstep with a controller: plant, sensors, faults and operator, one tick of 1 ms at a time.
 *
 *     hil_start(sim);
 *     for each tick:  hil_sense(sim, record);      fills the inputs and the truth
 *                     controller steps (over a wire: hil_frames(record, 1) first), its frames go into record->answer
 *                     hil_act(sim, duty, enable);  moves the plant by 1 ms
 *
 * hil_run does this with a controller in the same process; hil_answer takes the duty from the frames of one over a
 * wire. Both see the same sampled numbers: per tick SENSORS_SLOW (or COMMAND at every 50th), from a
 * robot that is steered also SENSORS_HEADING, then SENSORS_FAST.
 */
#ifndef HIL_SIMULATOR_H
#define HIL_SIMULATOR_H

#include "body.h"
#include "faults.h"
#include "sensors.h"
#include "terrapin.h"

enum { HIL_MAX_ORDERS = 64, HIL_MAX_POINTS = 64, HIL_COMMAND_TICKS = 50, HIL_HOST_FRAMES = 3 };

/* From `time` on the operator asks for this. */
typedef struct {
    double time;
    uint8_t request;
    uint8_t control;
    bool limiter;
    int16_t setpoint;
} hil_order;

/* A function of time, linear between points. */
typedef struct {
    int count;
    double time[HIL_MAX_POINTS];
    double value[HIL_MAX_POINTS];
} hil_profile;

/* Winding: follows `profile` when that has points, else heats by the current's loss and cools towards ambient. */
typedef struct {
    double start;         /* [degC] */
    double ambient;       /* [degC] */
    double to_ambient;    /* thermal resistance [K/W] */
    double heat_capacity; /* [J/K] */
    hil_profile profile;
} hil_winding;

typedef struct {
    hil_robot robot;
    hil_path path;
    hil_effects effects;
    hil_winding winding;
    hil_sensors sensors;
    hil_faults faults;
    hil_profile steering; /* heading [rad] that the inner device is steered to */
    hil_profile tow;      /* load that the axle tows [N] */
    hil_profile carriage; /* axle speed [m/s]; the axle is free before the first and after the last point */
    double wheel_radius;  /* trailing wheel [m] */
    double supply;        /* open-circuit voltage [V] */
    double supply_resistance;
    double start_position; /* [m] */
    double pass;
    double moisture;
    int order_count;
    hil_order order[HIL_MAX_ORDERS];
    int substeps;      /* of a tick */
    int fine_substeps; /* while axle and rim are slower than fine_below */
    double fine_below; /* [m/s] */
    uint64_t seed;
} hil_config;

/* Columns of the truth. Torques in N m, the rest SI; temperatures in degC. */
enum hil_truth {
    HIL_TRUTH_TIME,
    HIL_TRUTH_POSITION,
    HIL_TRUTH_SPEED,
    HIL_TRUTH_OMEGA, /* of the shell */
    HIL_TRUTH_ALPHA_RATE,
    HIL_TRUTH_SWING_ANGLE,
    HIL_TRUTH_SWING_RATE,
    HIL_TRUTH_SLIP,              /* (R omega - v) / max(|R omega|, |v|), positive when driving; 0 below 0.01 m/s */
    HIL_TRUTH_CONTACT_TORQUE,    /* C_t: torque on the shell at the contact, mean over the last tick */
    HIL_TRUTH_RESISTANCE,        /* C_r */
    HIL_TRUTH_TRACTION,          /* H [N] */
    HIL_TRUTH_MOTOR_TORQUE,      /* C_m at the drive wheel */
    HIL_TRUTH_INTERNAL_FRICTION, /* C_o */
    HIL_TRUTH_CURRENT,
    HIL_TRUTH_VOLTAGE, /* at the motor */
    HIL_TRUTH_SUPPLY,  /* at the bridge */
    HIL_TRUTH_WINDING_TEMPERATURE,
    HIL_TRUTH_SLOPE,
    HIL_TRUTH_LOAD,
    HIL_TRUTH_RUT,
    HIL_TRUTH_CARRIAGE_FORCE,
    HIL_TRUTH_SEGMENT, /* number of the path's segment, from 0 */
    HIL_TRUTH_SINKAGE, /* on a contact model's ground [m], else 0 */
    HIL_TRUTH_DUG,     /* by slipping, beyond the sinkage [m]; else 0 */
    HIL_TRUTH_HEADING, /* of the motion on the plane [rad] */
    HIL_TRUTH_PATH_X,  /* on the plane, from the start; position is along the path */
    HIL_TRUTH_PATH_Y,
    HIL_TRUTH_COUNT
};

/* One tick of the log. The host's frames are made by hil_frames when somebody wants to see or send them. */
typedef struct {
    double truth[HIL_TRUTH_COUNT];
    terrapin_inputs inputs;
    uint32_t commands; /* COMMAND frames before this tick */
    bool silent;       /* no exchange at this tick */
    uint8_t host_count;
    uint8_t answer_count;
    terrapin_frame host[HIL_HOST_FRAMES];
    terrapin_frame answer[TERRAPIN_MAX_FRAMES];
} hil_record;

/* Moves the body by one tick in the place of hil_body_step; `voltage` is the bridge's mean one [V]. */
typedef void (*hil_plant)(void *context, double voltage, bool enabled, hil_body *body);

typedef struct {
    hil_config config;
    hil_robot_derived derived;
    hil_body body;
    hil_sensor_state sensors;
    hil_fault_memory failing;
    terrapin_inputs inputs;
    hil_surroundings around;
    double heading;
    double path[2];
    double contact_torque;
    double temperature;
    double supply; /* at the bridge [V] */
    int16_t duty;
    bool enabled;
    bool silent; /* no exchange in this tick */
    uint32_t tick;
    uint32_t commands;
    hil_plant plant; /* of the caller's own, or NULL; it says motion, current and the contact torque, which stands in
                      * friction[HIL_BETA]. Sensors, faults, operator and winding are ours as ever. */
    void *context;
} hil_simulator;

typedef void (*hil_step)(void *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);

/* Sizes of hil_simulator and hil_record as compiled, for callers that read this header on their own. */
uint64_t hil_layout(void);

/* Sets the state to the start of the run that `simulator->config` describes. */
void hil_start(hil_simulator *simulator);

/* Samples the robot: inputs and truth of this tick. */
void hil_sense(hil_simulator *simulator, hil_record *record);

/* Writes the host's frames of `count` records, as their inputs say. */
void hil_frames(hil_record *records, uint32_t count);

/* Moves the plant by one tick under `duty` (Q15) and `enabled`. */
void hil_act(hil_simulator *simulator, int16_t duty, bool enabled);

/* `ticks` ticks of the robot alone under one duty; fills records[0..ticks). */
void hil_move(hil_simulator *simulator, int16_t duty, bool enabled, uint32_t ticks, hil_record *records);

/* Results of hil_answer. */
enum { HIL_ANSWERED = 0, HIL_NO_ACTUATE = 1, HIL_WRONG_TICK = 2, HIL_BAD_CRC = 3 };

/* Takes duty and enable from the ACTUATE frame in record->answer and moves the plant. Nothing moves unless
 * HIL_ANSWERED. */
int hil_answer(hil_simulator *simulator, const hil_record *record);

/* `ticks` ticks with a controller in this process; fills records[0..ticks). */
void hil_run(hil_simulator *simulator, hil_step step, void *state, uint32_t ticks, hil_record *records);

#endif
