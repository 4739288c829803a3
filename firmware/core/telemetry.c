/* ACTUATE every tick, and the message whose slot it is. What is filled in here is in the units of state.h:
 * terrapin_scaling.h knows how it goes out. */
#include "core.h"
#include "terrapin_pack.h"
#include "terrapin_scaling.h"

static bool actuate(terrapin_state *state, const terrapin_inputs *inputs, terrapin_frame *frame) {
    const terrapin_drive *d = &state->drive;
    const terrapin_actuate_source source = {
        .duty_q15 = d->duty_q15,
        .tick = (uint16_t)inputs->tick,
        .state = state->supervisor.state,
        .enable = d->enable,
        .limiting = d->limiting,
        .current_limiting = d->current_limiting,
        .ground_valid = state->estimator.valid,
    };
    const terrapin_actuate_t message = terrapin_scale_actuate(&source);
    const bool fits = terrapin_pack_actuate(&message, frame);
    terrapin_e2e_protect(frame, state->counter);
    state->counter = (state->counter < TERRAPIN_E2E_COUNTER_MAX) ? (uint8_t)(state->counter + 1U) : 0U;
    return fits;
}

static bool status(const terrapin_state *state, const terrapin_inputs *inputs, terrapin_frame *frame) {
    const terrapin_supervisor *s = &state->supervisor;
    const uint32_t hold = s->refused ? ((s->hold_ms + 99U) / 100U) : 0U; /* upwards: 0 says that none was refused */
    const terrapin_status_source source = {
        .faults = s->faults,
        .state = s->state,
        .report = s->report,
        .calibrated = state->parameter[TERRAPIN_PARAMETER_CALIBRATED] != 0,
        .trimmed = state->sense.trimmed,
        .limiter_slow = state->slip.slow,
        .saturated = state->saturated_shown,
        .ready = supervisor_ready(state),
        .hold_100ms = (int32_t)hold,
        .tick = (uint16_t)inputs->tick,
    };
    const terrapin_status_t message = terrapin_scale_status(&source);
    return terrapin_pack_status(&message, frame);
}

static bool ground(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_estimator *e = &state->estimator;
    const terrapin_ground_fit *g = &state->ground;
    const terrapin_ground_source source = {
        .torque_unm = e->torque_unm,
        .sd_unm = e->sd_unm,
        .f_r_ppm = g->f_r_ppm,
        .valid = e->valid,
        .saturated = e->saturated,
        .terrain = e->valid ? g->terrain : TERRAPIN_TERRAIN_UNKNOWN,
        .margin_q3 = e->valid ? g->margin_q3 : 0,
        .limiting = state->drive.limiting,
    };
    const terrapin_ground_t message = terrapin_scale_ground(&source);
    return terrapin_pack_ground(&message, frame);
}

static bool motion(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_slip_state *s = &state->slip;
    const terrapin_motion_source source = {
        .slip_e4 = s->slip_e4,
        .slip_valid = s->valid,
        .slow = s->slow,
        .external = s->external,
        .shell_urad_s = s->shell_urad_s,
        .wheel_urad_s = integer_q_held(s->wheel_urad_s, state->gains.wheel_q22, 22U),
        .ground_um_s = s->ground_um_s,
    };
    const terrapin_motion_t message = terrapin_scale_motion(&source);
    return terrapin_pack_motion(&message, frame);
}

static bool electrical(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_electrical_source source = {
        .recent_ua = state->estimator.recent_ua,
        .supply_mv = sense_supply_mv(state),
        .temperature_mc = sense_temperature_mc(state),
        .applied_mv = state->drive.applied_mv,
        .current_limiting = state->drive.current_limiting,
        .enable = state->drive.enable,
    };
    const terrapin_electrical_t message = terrapin_scale_electrical(&source);
    return terrapin_pack_electrical(&message, frame);
}

static bool window(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_estimator *e = &state->estimator;
    const terrapin_window_source source = {
        .current_10ua = e->current_10ua,
        .omega_urad_s = e->omega_urad_s,
        .voltage_mv = e->voltage_mv,
        .valid = e->valid,
        .index = e->index,
        .fresh = e->fresh,
    };
    const terrapin_window_t message = terrapin_scale_window(&source);
    return terrapin_pack_window(&message, frame);
}

static bool fit(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_ground_fit *g = &state->ground;
    const bool known = g->windows > 0U;
    const terrapin_fit_source source = {
        .f_o_10ppm = g->f_o_10ppm,
        .f_o_sd_ppm = known ? g->f_o_sd_ppm : INT32_MAX,
        .f_s_e7 = g->f_s_e7,
        .f_s_sd_e7 = known ? g->f_s_sd_e7 : INT32_MAX,
        .windows = g->windows,
    };
    const terrapin_fit_t message = terrapin_scale_fit(&source);
    return terrapin_pack_fit(&message, frame);
}

static bool report(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_supervisor *s = &state->supervisor;
    const terrapin_report_source source = {
        .report = s->report,
        .number = s->report_number,
        .report_distance_mm = s->report_distance_mm,
        .report_duration_10ms = s->report_duration_10ms,
        .peak_e4 = state->slip.peak_e4,
    };
    const terrapin_report_t message = terrapin_scale_report(&source);
    return terrapin_pack_report(&message, frame);
}

static bool calibration(const terrapin_state *state, terrapin_frame *frame) {
    const int32_t *p = state->parameter;
    const terrapin_calibration_source source = {
        .coulomb_unm = p[TERRAPIN_PARAMETER_COULOMB],
        .viscous_e8 = p[TERRAPIN_PARAMETER_VISCOUS],
        .residual_unm = state->calibration.residual_unm,
        .trim_q8_codes = state->sense.trim_q8_codes,
        .step = state->calibration.step,
        .calibrated = p[TERRAPIN_PARAMETER_CALIBRATED] != 0,
    };
    const terrapin_calibration_t message = terrapin_scale_calibration(&source);
    return terrapin_pack_calibration(&message, frame);
}

static bool attitude(const terrapin_state *state, const terrapin_inputs *inputs, terrapin_frame *frame) {
    const uint32_t swing = inputs->swing_valid ? integer_turn(inputs->swing_angle_mrad) : 0U;
    const uint32_t whole = (state->sense.motor_position * (uint32_t)state->gains.turn_per_count) - swing;
    const uint32_t late = ((inputs->tick - (uint32_t)SLOT_MS) % (uint32_t)RECORD_MS) / (uint32_t)SLOT_MS;
    const terrapin_attitude_source source = {
        .pitch_mrad = inputs->pitch_mrad,
        .pitch_valid = inputs->pitch_valid,
        .swing_valid = inputs->swing_valid,
        .swing_angle_mrad = inputs->swing_angle_mrad,
        .acceleration_urad_s2 = state->estimator.acceleration_urad_s2,
        .angle_turn = (uint16_t)(whole >> 16U),
        .ground_late_10ms = (int32_t)late,
    };
    const terrapin_attitude_t message = terrapin_scale_attitude(&source);
    return terrapin_pack_attitude(&message, frame);
}

static bool heading(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_heading_source source = {
        .heading_turn = state->heading.turn,
        .x_um = state->heading.x_um,
        .y_um = state->heading.y_um,
    };
    const terrapin_heading_t message = terrapin_scale_heading(&source);
    return terrapin_pack_heading(&message, frame);
}

/* The message of this slot; false when the slot is empty. */
static bool slot(const terrapin_state *state, const terrapin_inputs *inputs, uint32_t number, terrapin_frame *frame,
                 bool *fits) {
    bool sent = true;
    switch (number) {
    case 0U:
        *fits = status(state, inputs, frame);
        break;
    case 1U:
        *fits = ground(state, frame);
        break;
    case 2U:
        *fits = motion(state, frame);
        break;
    case 3U:
        *fits = electrical(state, frame);
        break;
    case 4U:
        *fits = window(state, frame);
        break;
    case 5U:
        *fits = fit(state, frame);
        break;
    case 6U:
        *fits = report(state, frame);
        break;
    case 7U:
        *fits = calibration(state, frame);
        break;
    case 8U:
        *fits = attitude(state, inputs, frame);
        break;
    default:
        sent = state->heading.known;
        if (sent) {
            *fits = heading(state, frame);
        }
        break;
    }
    return sent;
}

void telemetry_emit(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs) {
    static const terrapin_frame nothing = {0};
    const bool actuate_fits = actuate(state, inputs, &outputs->frames[0]);
    const uint32_t number = inputs->tick % (uint32_t)SLOT_MS;
    bool slot_fits = true;
    outputs->frame_count = 2U;
    if (!slot(state, inputs, number, &outputs->frames[1], &slot_fits)) {
        outputs->frames[1] = nothing;
        outputs->frame_count = 1U;
    }
    if (!actuate_fits || !slot_fits) {
        state->saturated = true;
    }
    if (number == ((uint32_t)SLOT_MS - 1U)) {
        state->saturated_shown = state->saturated;
        state->saturated = false;
    }
}
