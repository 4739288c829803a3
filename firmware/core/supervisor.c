/* States, faults, and what the drive shall do.
 *
 *     boot -> self_test -> idle -> calibrate -> idle
 *                          idle -> run <-> limiting -> stuck -> extricate -> idle
 *     any -> safe (a latched fault) -> idle (clear)
 *
 * A request is served once: after it has ended by itself, it must change before it counts again. An IDLE holds: RUN and
 * CALIBRATE are refused for stop_hold after it, so that frames of a stuck gateway or an old record lose against it. A
 * clear starts nothing: it holds until an IDLE, and that one for stop_hold, so that whoever still sends RUN meanwhile
 * starts nothing with it (ISO 13850: a reset permits a start, and is none).
 */
#include "core.h"

enum {
    BOOT_MS = 10,
    SELF_TEST_MS = 180, /* long enough for one zero of the current */
    STILL_MS = 200,     /* still for this long is at rest */
    HALT_MS = 4000,     /* braking may take this long; then the bridge goes off, moving or not */
    OVERRUN_MS = 1000,
    BLIND_MS = 20,        /* without a swing sensor for this long a guard is none */
    STILL_URAD_S = 40000, /* just above one count in SPEED_TICKS */
    STILL_UM_S = 5000
};

static uint32_t fault_bit(uint32_t number) {
    TERRAPIN_ASSERT(number < 32U);
    return (uint32_t)1U << number;
}

bool supervisor_ready(const terrapin_state *state) {
    return (state->supervisor.state == TERRAPIN_STATE_IDLE) &&
           ((state->supervisor.faults & TERRAPIN_FAULTS_LATCHED) == 0U);
}

static bool driving(int32_t state) {
    return (state >= TERRAPIN_STATE_CALIBRATE) && (state <= TERRAPIN_STATE_EXTRICATE);
}

static bool command_late(const terrapin_state *state) {
    const uint32_t age = state->sense.tick - state->supervisor.command_tick;
    return age > (uint32_t)state->parameter[TERRAPIN_PARAMETER_COMMAND_TIMEOUT];
}

/* A command that starts something while an IDLE or a clear holds is heard, but not taken. */
static void listen(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_supervisor *s = &state->supervisor;
    if ((s->hold_ms > 0U) && (s->request_taken != TERRAPIN_REQUEST_CLEAR)) {
        s->hold_ms--;
        s->refused = s->refused && (s->hold_ms > 0U);
    }
    if (inputs->command_fresh) {
        const int32_t request = inputs->command.request;
        const bool starts = (request == TERRAPIN_REQUEST_RUN) || (request == TERRAPIN_REQUEST_CALIBRATE);
        s->command_tick = inputs->tick;
        if (starts && (s->hold_ms > 0U)) {
            s->refused = true;
        } else {
            s->request = request;
            s->control = inputs->command.control;
            s->setpoint = inputs->command.setpoint;
            s->limiter = inputs->command.limiter;
        }
        if (!starts) {
            s->request_taken = request;
            s->hold_ms = (uint32_t)TERRAPIN_LIMIT_STOP_HOLD;
        }
    }
    TERRAPIN_ASSERT((s->hold_ms > 0U) || !s->refused);
    TERRAPIN_ASSERT((s->request_taken != TERRAPIN_REQUEST_CLEAR) ||
                    ((s->request == TERRAPIN_REQUEST_CLEAR) && (s->hold_ms > 0U)));
}

/* The guard of the swing: beyond its limit the inner body would go over the top; unseen it could. */
static uint32_t swing_causes(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_supervisor *s = &state->supervisor;
    const int32_t limit = state->parameter[TERRAPIN_PARAMETER_SWING_LIMIT];
    uint32_t causes = 0U;
    if ((limit == 0) || inputs->swing_valid) {
        s->blind_ms = 0U;
        if ((limit > 0) && (integer_abs(inputs->swing_angle_mrad) >= limit)) {
            causes = fault_bit(TERRAPIN_FAULT_SWING);
        }
    } else if ((s->blind_ms < (uint8_t)BLIND_MS) && (s->state > TERRAPIN_STATE_SELF_TEST)) {
        s->blind_ms++;
    } else {
        /* blind for long enough, or the sensor still starts */
    }
    if (s->blind_ms >= (uint8_t)BLIND_MS) {
        causes |= fault_bit(TERRAPIN_FAULT_SWING_SENSOR);
    }
    return causes;
}

static void judge(terrapin_state *state, const terrapin_inputs *inputs, uint32_t sensed, bool gap) {
    terrapin_supervisor *s = &state->supervisor;
    uint32_t causes = sensed | swing_causes(state, inputs);
    if (inputs->estop) {
        causes |= fault_bit(TERRAPIN_FAULT_ESTOP);
    }
    if (driving(s->state) && command_late(state)) {
        causes |= fault_bit(TERRAPIN_FAULT_COMMAND_TIMEOUT);
    }
    if (!state->gains.consistent) {
        causes |= fault_bit(TERRAPIN_FAULT_PARAMETER);
    }
    if (state->slip.implausible) {
        causes |= fault_bit(TERRAPIN_FAULT_GROUND_SPEED);
    } else if (state->slip.doubt_ticks > 0U) {
        causes |= fault_bit(TERRAPIN_FAULT_GROUND_WHEEL);
    } else {
        /* wheel and ground bear each other out */
    }
    if (state->saturated_shown || state->estimator.saturated) {
        causes |= fault_bit(TERRAPIN_FAULT_SATURATED);
    }
    if (gap) {
        s->overrun_ms = OVERRUN_MS;
    }
    if (s->overrun_ms > 0U) {
        s->overrun_ms--;
        causes |= fault_bit(TERRAPIN_FAULT_OVERRUN);
    }
    /* What came now: s->request may be an older clear, when an IDLE holds and a RUN was refused. */
    const bool clear = inputs->command_fresh && (inputs->command.request == (uint8_t)TERRAPIN_REQUEST_CLEAR);
    if (clear) {
        s->report = TERRAPIN_REPORT_NONE;
    }
    const uint32_t kept = clear ? 0U : (s->faults & TERRAPIN_FAULTS_LATCHED);
    s->faults = kept | causes;
    const bool latched = (s->faults & TERRAPIN_FAULTS_LATCHED) != 0U;
    if (latched) {
        episode_enter(state, TERRAPIN_STATE_SAFE, PHASE_FIRST);
    } else if (s->state == TERRAPIN_STATE_SAFE) {
        episode_enter(state, TERRAPIN_STATE_IDLE, PHASE_FIRST);
    } else {
        /* goes on */
    }
}

static void watch_motion(terrapin_state *state) {
    const bool still = (integer_abs(state->slip.wheel_urad_s) < STILL_URAD_S) &&
                       ((state->slip.doubt_ticks > 0U) || (integer_abs(state->slip.ground_um_s) < STILL_UM_S));
    state->supervisor.still_ms = still ? (state->supervisor.still_ms + 1U) : 0U;
}

static void idle(terrapin_state *state) {
    terrapin_supervisor *s = &state->supervisor;
    TERRAPIN_ASSERT(s->state == TERRAPIN_STATE_IDLE);
    const bool asked = !command_late(state) && (s->request != s->request_taken);
    const bool at_rest = s->still_ms >= STILL_MS;
    const bool zeroed = state->sense.trimmed || (state->parameter[TERRAPIN_PARAMETER_TRIM_CURRENT] == 0);
    if (asked && (s->request == TERRAPIN_REQUEST_RUN)) {
        s->request_taken = s->request;
        s->episode_ms = 0U;
        s->digging = false;
        s->moved = false;
        s->rolling_ua = 0;
        s->no_progress_ms = 0U;
        state->slip.peak_e4 = 0;
        episode_enter(state, TERRAPIN_STATE_RUN, PHASE_FIRST);
    } else if (asked && at_rest && zeroed) {
        s->request_taken = s->request; /* calibrate: the other two are always taken */
        s->episode_ms = 0U;
        calibration_start(state);
        episode_enter(state, TERRAPIN_STATE_CALIBRATE, PHASE_FIRST);
    } else {
        /* waits */
    }
}

/* The shorted motor brakes, into idle at rest or when it has taken too long. */
static void halt(terrapin_state *state, terrapin_demand *demand) {
    if ((state->supervisor.still_ms >= STILL_MS) || (state->supervisor.timer_ms >= HALT_MS)) {
        episode_enter(state, TERRAPIN_STATE_IDLE, PHASE_FIRST);
    } else {
        demand->mode = DEMAND_VOLTAGE;
    }
}

static void calibrate(terrapin_state *state, terrapin_demand *demand) {
    terrapin_supervisor *s = &state->supervisor;
    TERRAPIN_ASSERT(s->phase <= PHASE_HALT);
    if (s->phase == PHASE_HALT) {
        halt(state, demand);
    } else {
        calibration_result result = CALIBRATION_FAILED;
        demand->mode = DEMAND_VOLTAGE;
        if (s->request == TERRAPIN_REQUEST_CALIBRATE) {
            result = calibration_update(state, &demand->voltage_mv);
        }
        if (result != CALIBRATION_BUSY) {
            const bool done = result == CALIBRATION_DONE;
            episode_report(state, done ? TERRAPIN_REPORT_CALIBRATED : TERRAPIN_REPORT_CALIBRATION_FAILED, 0);
            episode_enter(state, TERRAPIN_STATE_CALIBRATE, PHASE_HALT);
            demand->voltage_mv = 0;
        }
    }
}

/* The shell speed of a rim speed in mm/s; R is at least 1e4 um. */
static int32_t shell_speed(const terrapin_state *state, int32_t rim_mm_s) {
    return integer_gained(&state->rates.shell_per_rim, rim_mm_s);
}

static void run(terrapin_state *state, const terrapin_inputs *inputs, terrapin_demand *demand) {
    terrapin_supervisor *s = &state->supervisor;
    TERRAPIN_ASSERT(s->phase <= PHASE_HALT);
    if ((s->phase != PHASE_HALT) && (s->request != TERRAPIN_REQUEST_RUN)) {
        episode_enter(state, TERRAPIN_STATE_RUN, PHASE_HALT);
    }
    if (s->phase == PHASE_HALT) {
        halt(state, demand);
    } else {
        const int32_t direction = integer_direction(s->setpoint);
        const bool speed = s->control == TERRAPIN_CONTROL_SPEED;
        demand->mode = speed ? DEMAND_SPEED : DEMAND_VOLTAGE;
        demand->voltage_mv = s->setpoint;
        demand->speed_urad_s = speed ? shell_speed(state, s->setpoint) : 0;
        demand->limiter = s->limiter && (state->slip.doubt_ticks == 0U);
        s->state = state->drive.limiting ? TERRAPIN_STATE_LIMITING : TERRAPIN_STATE_RUN;
        if (extrication_watch(state, direction)) {
            extrication_start(state, inputs, direction);
            demand->mode = DEMAND_VOLTAGE;
            demand->voltage_mv = 0;
        }
    }
}

static void wait(terrapin_state *state, uint32_t ms, int32_t next) {
    if (state->supervisor.timer_ms >= ms) {
        episode_enter(state, next, PHASE_FIRST);
    }
}

void supervisor_update(terrapin_state *state, const terrapin_inputs *inputs, uint32_t causes, bool gap,
                       terrapin_demand *demand) {
    terrapin_supervisor *s = &state->supervisor;
    demand->mode = DEMAND_OFF;
    demand->voltage_mv = 0;
    demand->speed_urad_s = 0;
    demand->limiter = false;
    listen(state, inputs);
    watch_motion(state);
    s->timer_ms++;
    s->episode_ms++;
    judge(state, inputs, causes, gap);
    switch (s->state) {
    case TERRAPIN_STATE_BOOT:
        wait(state, BOOT_MS, TERRAPIN_STATE_SELF_TEST);
        break;
    case TERRAPIN_STATE_SELF_TEST:
        wait(state, SELF_TEST_MS, TERRAPIN_STATE_IDLE);
        break;
    case TERRAPIN_STATE_IDLE:
        idle(state);
        break;
    case TERRAPIN_STATE_CALIBRATE:
        calibrate(state, demand);
        break;
    case TERRAPIN_STATE_RUN:
    case TERRAPIN_STATE_LIMITING:
        run(state, inputs, demand);
        break;
    case TERRAPIN_STATE_STUCK:
    case TERRAPIN_STATE_EXTRICATE:
        if (extrication_update(state, inputs, demand)) {
            episode_enter(state, TERRAPIN_STATE_IDLE, PHASE_FIRST);
            demand->mode = DEMAND_OFF;
        }
        break;
    case TERRAPIN_STATE_SAFE:
    default: /* a state that does not exist would be a defect of memory: off as well */
        break;
    }
    TERRAPIN_ASSERT((s->state != TERRAPIN_STATE_SAFE) || (demand->mode == DEMAND_OFF));
    TERRAPIN_ASSERT(((s->faults & TERRAPIN_FAULTS_LATCHED) == 0U) || (s->state == TERRAPIN_STATE_SAFE));
}

uint32_t terrapin_latched(const terrapin_state *state) {
    TERRAPIN_ASSERT(state != NULL);
    return state->supervisor.faults & TERRAPIN_FAULTS_LATCHED;
}

bool terrapin_at_work(const terrapin_state *state) {
    TERRAPIN_ASSERT(state != NULL);
    return (state->supervisor.state > TERRAPIN_STATE_SELF_TEST) && (terrapin_latched(state) == 0U);
}

void terrapin_latch(terrapin_state *state, uint32_t faults) {
    TERRAPIN_ASSERT(state != NULL);
    state->supervisor.faults |= faults & TERRAPIN_FAULTS_LATCHED;
}
