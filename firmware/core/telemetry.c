/* ACTUATE every tick, and the message whose slot it is. */
#include "core.h"
#include "terrapin_pack.h"

enum { E2E_COUNTERS = 15, TICK_MASK = 0xFFFF };

/* ceiling: a value that is not known better is shown as the largest, which is no fault */
static int32_t ceiling(int32_t value, int32_t most) {
    return integer_clamp(value, -most, most);
}

static int32_t flag(bool value) {
    return value ? 1 : 0;
}

static int32_t short_tick(const terrapin_inputs *inputs) {
    const uint32_t low = inputs->tick & (uint32_t)TICK_MASK;
    return (int32_t)low;
}

static bool actuate(terrapin_state *state, const terrapin_inputs *inputs, terrapin_frame *frame) {
    const terrapin_drive *d = &state->drive;
    const terrapin_actuate_t message = {
        .duty = d->duty_q15,
        .tick = short_tick(inputs),
        .state = state->supervisor.state,
        .enable = flag(d->enable),
        .limiting = flag(d->limiting),
        .current_limiting = flag(d->current_limiting),
        .ground_valid = flag(state->estimator.valid),
    };
    const bool fits = terrapin_pack_actuate(&message, frame);
    terrapin_e2e_protect(frame, state->counter);
    state->counter = (state->counter < (E2E_COUNTERS - 1)) ? (uint8_t)(state->counter + 1U) : 0U;
    return fits;
}

static bool status(const terrapin_state *state, const terrapin_inputs *inputs, terrapin_frame *frame) {
    const terrapin_supervisor *s = &state->supervisor;
    const terrapin_status_t message = {
        .faults = s->faults,
        .state = s->state,
        .report = s->report,
        .calibrated = state->parameter[TERRAPIN_PARAMETER_CALIBRATED],
        .trimmed = flag(state->sense.trimmed),
        .limiter_slow = flag(state->slip.slow),
        .saturated = flag(state->saturated_shown),
        .ready = flag(supervisor_ready(state)),
        .tick = short_tick(inputs),
    };
    return terrapin_encode_status(&message, frame);
}

static bool ground(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_estimator *e = &state->estimator;
    const terrapin_ground_fit *g = &state->ground;
    const terrapin_ground_t message = {
        .torque = e->torque_unm,
        .torque_sd = ceiling(e->sd_unm / 5, 4095),
        .f_r = ceiling(g->f_r_ppm / 10, 65535),
        .valid = flag(e->valid),
        .saturated = flag(e->saturated),
        .terrain = e->valid ? g->terrain : TERRAPIN_TERRAIN_UNKNOWN,
        .margin = e->valid ? g->margin_q3 : 0,
        .limiting = flag(state->drive.limiting),
    };
    return terrapin_encode_ground(&message, frame);
}

static bool motion(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_slip_state *s = &state->slip;
    const int32_t wheel = integer_scale(s->wheel_urad_s, state->parameter[TERRAPIN_PARAMETER_RADIUS],
                                        state->parameter[TERRAPIN_PARAMETER_DRIVE_RADIUS]);
    const terrapin_motion_t message = {
        .slip = s->slip_e4 / 10,
        .slip_valid = flag(s->valid),
        .slow = flag(s->slow),
        .external = flag(s->external),
        .shell_speed = s->shell_urad_s / 1000,
        .motor_speed = wheel / 5000,
        .ground_speed = s->ground_um_s / 100,
    };
    return terrapin_encode_motion(&message, frame);
}

static bool electrical(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_electrical_t message = {
        .current = state->estimator.recent_ua / 100,
        .supply = sense_supply_mv(state),
        .temperature = sense_temperature_mc(state) / 20,
        .voltage = state->drive.applied_mv,
        .current_limiting = flag(state->drive.current_limiting),
        .enable = flag(state->drive.enable),
    };
    return terrapin_encode_electrical(&message, frame);
}

static bool window(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_estimator *e = &state->estimator;
    const terrapin_window_t message = {
        .current = e->current_10ua,
        .omega = e->omega_urad_s / 100,
        .voltage = e->voltage_mv,
        .valid = flag(e->valid),
        .index = e->index,
        .fresh = flag(e->fresh),
    };
    return terrapin_encode_window(&message, frame);
}

static bool fit(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_ground_fit *g = &state->ground;
    const bool known = g->windows > 0U;
    const terrapin_fit_t message = {
        .f_o = g->f_o_10ppm,
        .f_o_sd = known ? ceiling(g->f_o_sd_ppm / 20, 2047) : 2047,
        .f_s = g->f_s_e7,
        .f_s_sd = known ? ceiling(g->f_s_sd_e7, 4095) : 4095,
        .windows = g->windows,
    };
    return terrapin_encode_fit(&message, frame);
}

static bool report(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_supervisor *s = &state->supervisor;
    const terrapin_report_t message = {
        .report = s->report,
        .number = s->report_number,
        .distance = ceiling(s->report_distance_mm, INT16_MAX),
        .duration = s->report_duration_10ms,
        .slip_peak = state->slip.peak_e4 / 10,
    };
    return terrapin_encode_report(&message, frame);
}

static bool calibration(const terrapin_state *state, terrapin_frame *frame) {
    const int32_t *p = state->parameter;
    const terrapin_calibration_t message = {
        .coulomb = p[TERRAPIN_PARAMETER_COULOMB] / 2,
        .viscous = p[TERRAPIN_PARAMETER_VISCOUS] / 10,
        .residual = ceiling(state->calibration.residual_unm / 10, 2047),
        .current_zero = state->sense.trim_q8_codes,
        .step = state->calibration.step,
        .calibrated = p[TERRAPIN_PARAMETER_CALIBRATED],
    };
    return terrapin_encode_calibration(&message, frame);
}

static bool attitude(const terrapin_state *state, const terrapin_inputs *inputs, terrapin_frame *frame) {
    const uint32_t swing = inputs->swing_valid ? integer_turn(inputs->swing_angle_mrad) : 0U;
    const uint32_t whole = (state->sense.motor_position * (uint32_t)state->gains.turn_per_count) - swing;
    const uint32_t turn = whole >> 16U;
    const terrapin_attitude_t message = {
        .pitch = inputs->pitch_mrad,
        .pitch_valid = flag(inputs->pitch_valid),
        .swing_valid = flag(inputs->swing_valid),
        .swing_angle = inputs->swing_angle_mrad,
        .acceleration = ceiling(state->estimator.acceleration_urad_s2 / 1000, INT16_MAX),
        .angle = (int32_t)turn,
    };
    return terrapin_encode_attitude(&message, frame);
}

static bool heading(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_heading_t message = {
        .heading = state->heading.turn,
        .path_x = state->heading.x_um / 1000,
        .path_y = state->heading.y_um / 1000,
    };
    return terrapin_encode_heading(&message, frame);
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
