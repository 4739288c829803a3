/* Stuck, and the way back: stop, roll back over the way since slip passed its limit, come to rest, report.
 *
 * The rut just made is the one ground that is known to carry the robot. On a slope that is too steep it slides down by
 * itself, faster than asked: the rim then turns at (1 - slip_limit) of the ground speed, which brakes as hard as the
 * ground allows without digging.
 *
 * One sensor alone never makes it: the motor's current must have risen as slip passed its limit. Otherwise the robot
 * stops, and the ground wheel is doubted. The shell turns back once at most, and not against an operator who wants
 * another direction by now.
 */
#include "core.h"

enum {
    SMALL_SLIP_E4 = 2000,
    ROLLING_BITS = 6,  /* the current of rolling is a mean of some 2^6 ticks */
    TURN_43MRAD = 146, /* of the shell, in 2^32 times 1e-5 urad */
    RISE = 8,          /* slip that is real takes this part more of it at least */
    MOVED_TIMES = 4,   /* faster than this many times stuck_speed is progress */
    SLOWED_MS = 10,
    STOP_MS = 200, /* stop before backing out */
    REST_MS = 300  /* at rest for this long is the end */
};

static int32_t ground_way_mm(const terrapin_state *state) {
    const int32_t counts = integer_difference(state->sense.ground_position, state->supervisor.dig_ground_counts);
    return integer_scale(counts, state->gains.ground_e5_um, 100000000);
}

bool extrication_watch(terrapin_state *state, int32_t direction) {
    TERRAPIN_ASSERT((direction == 1) || (direction == -1));
    terrapin_supervisor *s = &state->supervisor;
    const bool limiting = state->drive.limiting;
    const int32_t drawn_ua = direction * state->estimator.recent_ua;
    const int32_t forward_um_s = direction * state->slip.ground_um_s;
    const int32_t slowest_um_s = state->parameter[TERRAPIN_PARAMETER_STUCK_SPEED] * 1000;
    if (forward_um_s > (MOVED_TIMES * slowest_um_s)) {
        s->moved = true;
    }
    if (state->slip.valid && (integer_abs(state->slip.slip_e4) < SMALL_SLIP_E4)) {
        s->rolling_ua += integer_right(drawn_ua, ROLLING_BITS) - integer_right(s->rolling_ua, ROLLING_BITS);
        s->borne_out = false;
    }
    if (!limiting) {
        s->digging = false;
        s->no_progress_ms = 0U;
    } else if (!s->digging) {
        s->digging = true;
        s->dig_ground_counts = state->sense.ground_position;
        s->borne_out = (s->rolling_ua > 0) && (s->borne_out || ((drawn_ua - s->rolling_ua) > (s->rolling_ua / RISE)));
    } else {
        s->no_progress_ms = (forward_um_s < slowest_um_s) ? (s->no_progress_ms + 1U) : 0U;
    }
    /* A robot that slowed down to this will not move again; one that has not moved yet may still be starting. */
    const uint32_t patience =
        s->moved ? (uint32_t)SLOWED_MS : (uint32_t)state->parameter[TERRAPIN_PARAMETER_STUCK_TIME];
    return s->no_progress_ms >= patience;
}

void extrication_start(terrapin_state *state, const terrapin_inputs *inputs, int32_t direction) {
    TERRAPIN_ASSERT((direction == 1) || (direction == -1));
    TERRAPIN_ASSERT((state->supervisor.state == TERRAPIN_STATE_RUN) ||
                    (state->supervisor.state == TERRAPIN_STATE_LIMITING));
    terrapin_supervisor *s = &state->supervisor;
    s->direction = direction;
    s->stuck_pitch_mrad = inputs->pitch_valid ? inputs->pitch_mrad : 0;
    episode_report(state, TERRAPIN_REPORT_STOPPED, ground_way_mm(state));
    s->episode_ms = 0U;
    s->back_motor_counts = state->sense.motor_position;
    if (!s->borne_out) {
        state->slip.doubt_ticks = (uint16_t)DOUBT_TICKS;
    }
    episode_enter(state, TERRAPIN_STATE_STUCK, PHASE_FIRST);
}

/* Back over the whole way, and off the slope that stopped the robot if its pitch is known. */
static bool backed_out(const terrapin_state *state, const terrapin_inputs *inputs) {
    const terrapin_supervisor *s = &state->supervisor;
    const int32_t counts = integer_hold(integer_difference(state->sense.ground_position, s->dig_ground_counts));
    const bool far = (s->direction * counts) <= -state->rates.margin_counts; /* negative: behind where it began */
    const bool flat =
        !inputs->pitch_valid || ((2 * integer_abs(inputs->pitch_mrad)) <= integer_abs(s->stuck_pitch_mrad));
    return far && flat;
}

/* As far as it may go, whatever the ground wheel says; or that is not believed. */
static bool far_enough(const terrapin_state *state) {
    const terrapin_supervisor *s = &state->supervisor;
    const int32_t counts = integer_difference(state->sense.motor_position, s->back_motor_counts);
    const int32_t turned = s->direction * integer_q32(counts, state->gains.count_e5_urad); /* below 2^28 */
    return (state->slip.doubt_ticks > 0U) || (turned < -TURN_43MRAD);
}

/* Rim speed of backing out, as a shell speed. */
static int32_t back_speed(const terrapin_state *state) {
    const int32_t *p = state->parameter;
    TERRAPIN_ASSERT((state->supervisor.direction == 1) || (state->supervisor.direction == -1));
    const int32_t back = -state->supervisor.direction;
    const int32_t sliding_um_s = back * state->slip.ground_um_s; /* positive: backwards */
    const int32_t braked_um_s = integer_q(sliding_um_s, state->rates.keep_q30, 30U);
    const int32_t asked_um_s = p[TERRAPIN_PARAMETER_EXTRICATE_SPEED] * 1000;
    const int32_t rim_um_s = (braked_um_s > asked_um_s) ? braked_um_s : asked_um_s;
    return back * integer_q_held(rim_um_s, state->rates.shell_q24, 24U);
}

bool extrication_update(terrapin_state *state, const terrapin_inputs *inputs, terrapin_demand *demand) {
    terrapin_supervisor *s = &state->supervisor;
    TERRAPIN_ASSERT((s->state == TERRAPIN_STATE_STUCK) || (s->state == TERRAPIN_STATE_EXTRICATE));
    TERRAPIN_ASSERT(demand->mode == DEMAND_OFF);
    TERRAPIN_ASSERT((s->direction == 1) || (s->direction == -1));
    const bool late = s->episode_ms > (uint32_t)state->parameter[TERRAPIN_PARAMETER_EXTRICATE_TIMEOUT];
    bool over = false;
    demand->mode = DEMAND_VOLTAGE; /* 0 V unless said otherwise: the shorted motor brakes */
    const bool wanted = (s->request == TERRAPIN_REQUEST_RUN) && (integer_sign(s->setpoint) == s->direction);
    if (late || !wanted) {
        episode_report(state, TERRAPIN_REPORT_EXTRICATION_FAILED, ground_way_mm(state));
        over = true;
    } else if (s->state == TERRAPIN_STATE_STUCK) {
        if (s->timer_ms >= STOP_MS) {
            episode_enter(state, TERRAPIN_STATE_EXTRICATE, s->borne_out ? PHASE_FIRST : PHASE_HALT);
        }
    } else if (s->phase == PHASE_FIRST) {
        demand->mode = DEMAND_SPEED;
        demand->speed_urad_s = back_speed(state);
        s->borne_out = !far_enough(state);
        if (!s->borne_out || backed_out(state, inputs)) {
            episode_enter(state, TERRAPIN_STATE_EXTRICATE, PHASE_HALT);
        }
    } else if (s->still_ms >= REST_MS) {
        episode_report(state, s->borne_out ? TERRAPIN_REPORT_EXTRICATED : TERRAPIN_REPORT_EXTRICATION_FAILED,
                       ground_way_mm(state));
        over = true;
    } else {
        /* coming to rest */
    }
    return over;
}
