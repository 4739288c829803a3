/* The parts of the step, in the order of a tick. Private to the core; units as in state.h. */
#ifndef TERRAPIN_CORE_H
#define TERRAPIN_CORE_H

#include "integer.h"
#include "state.h"

/* ---- gains.c: what follows from the parameters */
void gains_prepare(terrapin_state *state);
/* What follows from comp_slope alone: all that follows from parameters that may be set while the bridge is on. */
void gains_slope(terrapin_state *state);
/* What follows from `viscous` alone, which the calibration changes. */
void gains_friction(terrapin_state *state);

/* ---- sense.c: raw codes and counts to engineering units, and the faults that they show */
/* Returns the causes of faults that stand at this tick, one bit a fault; *gap is set when ticks did not follow on. */
uint32_t sense_update(terrapin_state *state, const terrapin_inputs *inputs, bool *gap);
int32_t sense_supply_mv(const terrapin_state *state);
int32_t sense_temperature_mc(const terrapin_state *state);

/* ---- slip.c */
void slip_restart(terrapin_state *state);
void slip_update(terrapin_state *state, const terrapin_inputs *inputs);

/* ---- estimator.c */
void estimator_restart(terrapin_state *state);
/* Takes a tick's samples into the running sums. */
void estimator_tick(terrapin_state *state, const terrapin_inputs *inputs);
/* The end of a slot, and of a window. */
void estimator_close(terrapin_state *state);
/* This window and its C_t, in the parts that schedule.c deals out. All but the first do nothing unless it is open. */
void estimator_open(terrapin_state *state, const terrapin_inputs *inputs);
void estimator_means(terrapin_state *state);
void estimator_acceleration(terrapin_state *state);
void estimator_momentum(terrapin_state *state);
void estimator_friction_beyond(terrapin_state *state);
void estimator_torque(terrapin_state *state);
void estimator_gate(terrapin_state *state);
void estimator_deviation(terrapin_state *state);
/* (R/r) K_t I [uN m] of a window: sum of its current codes, zero taken off, in 1/256 code (within 2^30).
 * heat_q20 is K_t over K_t at the reference temperature. */
int32_t estimator_motor_torque(const terrapin_gains *gains, int32_t current_q8, int32_t heat_q20);
/* What gear and belt pass on of that torque, in a window with `counts` motor counts. */
int32_t estimator_geared(const terrapin_gains *gains, int32_t torque_unm, int32_t counts);
/* A sgn(w) + B w [uN m] of a window with `counts` motor counts. coulomb_unm within 2^29. */
int32_t estimator_friction(const terrapin_gains *gains, int32_t coulomb_unm, int32_t counts);
/* C_t of a window, held within the full scale; *saturated says when it was. */
int32_t estimator_contact_torque(int32_t torque_unm, bool *saturated);
/* A record `slots` back from the newest: below HISTORY_SLOTS, and at most estimator.slots, which is the one that the
 * history began behind. */
static inline const terrapin_slot_record *estimator_record(const terrapin_state *state, uint32_t slots) {
    TERRAPIN_ASSERT((slots <= state->estimator.slots) && (slots < (uint32_t)HISTORY_SLOTS));
    const uint32_t newest = state->estimator.newest;
    TERRAPIN_ASSERT(newest < (uint32_t)HISTORY_SLOTS);
    const uint32_t wrap = (newest >= slots) ? 0U : (uint32_t)HISTORY_SLOTS;
    return &state->history[(newest + wrap) - slots];
}

/* ---- compensation.c: what the robot's model lacks, all zero by default */
/* K_t(T)/K_t(TERRAPIN_REFERENCE_TEMPERATURE) in Q20, within 1/4 to 2. */
int32_t compensation_heat_q20(const terrapin_state *state);
/* Torque inside the robot beyond A sgn + B w in a window with `counts` motor counts, in two parts [uN m]. */
int32_t compensation_friction(const terrapin_state *state, int32_t counts);
int32_t compensation_imbalance(const terrapin_state *state, int32_t counts);

/* ---- uncertainty.c */
/* Standard deviation of C_t [uN m] from the sensors' budget (uncertainty.c); reads the estimator's results. */
int32_t uncertainty_unm(const terrapin_state *state);
/* The part of it that follows from the parameters; the gains of C_t are there already. */
void uncertainty_prepare(terrapin_state *state);

/* ---- ground.c: f_r, the nearest terrain, the quadratic fit */
/* As the estimator's parts: the window's speed squared, f_r, and the nearest terrain, which ends the window's work. */
void ground_speed(terrapin_state *state);
void ground_resistance(terrapin_state *state);
void ground_nearest(terrapin_state *state);
/* A step of taking a fresh window into the fit, where there is one to do. */
void ground_fit_work(terrapin_state *state);
/* Torque of the hard floor at a speed, along the motion [uN m]. */
int32_t ground_floor_unm(const terrapin_state *state, int32_t omega_urad_s);

/* ---- calibration.c */
typedef enum { CALIBRATION_BUSY = 0, CALIBRATION_DONE = 1, CALIBRATION_FAILED = 2 } calibration_result;
void calibration_start(terrapin_state *state);
/* A step of the fit behind the last speed, where there is one to do. */
void calibration_work(terrapin_state *state);
/* One tick at the speed that *voltage_mv makes. DONE: A and B are fitted and taken over. FAILED: nothing changed. */
calibration_result calibration_update(terrapin_state *state, int32_t *voltage_mv);

/* ---- episode.c: what supervisor.c and extrication.c move from state to state with */
/* Enters a state and phase, timer at zero. */
void episode_enter(terrapin_state *state, int32_t next, terrapin_phase phase);
/* What came of a request, for the operator. */
void episode_report(terrapin_state *state, int32_t report, int32_t distance_mm);

/* ---- supervisor.c: states, faults, what the drive shall do */
void supervisor_update(terrapin_state *state, const terrapin_inputs *inputs, uint32_t causes, bool gap,
                       terrapin_demand *demand);
/* Idle without a latched fault: a new request is taken. */
bool supervisor_ready(const terrapin_state *state);

/* ---- extrication.c: stuck, and the way back */
/* Watches a drive in direction -1 or 1 for digging in without progress; true when stuck. */
bool extrication_watch(terrapin_state *state, int32_t direction);
/* Stuck: reports it and stops. */
void extrication_start(terrapin_state *state, const terrapin_inputs *inputs, int32_t direction);
/* One tick of stuck or extricate; true when it is over and reported. */
bool extrication_update(terrapin_state *state, const terrapin_inputs *inputs, terrapin_demand *demand);

/* ---- drive.c: speed loop, slip limiter, current limit, supply compensation */
void drive_update(terrapin_state *state, const terrapin_demand *demand);

/* ---- heading.c: heading and path on the plane, once a slot, six ticks before HEADING is sent */
void heading_slot(terrapin_state *state, const terrapin_inputs *inputs);

/* ---- schedule.c: which tick does what of estimator, ground and heading */
/* Of the first half of a tick: its samples, and a window that ends with it. */
void schedule_sense(terrapin_state *state, const terrapin_inputs *inputs);
/* Of the second half: the share of the window's work. */
void schedule_work(terrapin_state *state, const terrapin_inputs *inputs);

/* ---- telemetry.c */
void telemetry_emit(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);

#endif
