#include "core.h"

enum { SLIP_MAX_E4 = 40000, DISAGREE_TICKS = 500 };

void slip_restart(terrapin_state *state) {
    state->slip.ticks = 0U;
    state->slip.disagree_ticks = 0U;
}

/* counts of the last `ticks` ticks as a signed number; |result| < 32768 */
static int32_t counted(const uint16_t *counts, uint8_t newest, uint32_t ticks) {
    TERRAPIN_ASSERT((newest < (uint8_t)FAST_TICKS) && (ticks < (uint32_t)FAST_TICKS));
    const uint32_t then = ((uint32_t)newest - ticks) & (FAST_TICKS - 1U);
    const uint32_t forward = ((uint32_t)counts[newest] - counts[then]) & 0xFFFFU;
    return (int32_t)forward - ((forward >= 0x8000U) ? 0x10000 : 0);
}

/* slip_e4 where the ground passes under the rim at `ground`, both of any unit, rim not 0 [1e-4]. Three steps of long
 * division, whose products fit as long as the rim is slower than 42 m/s. */
static int32_t slip_of(int32_t ground_um_s, int32_t rim_um_s) {
    TERRAPIN_ASSERT(rim_um_s != 0);
    const int32_t along = (rim_um_s < 0) ? -ground_um_s : ground_um_s;
    const uint32_t rim = (uint32_t)integer_abs(rim_um_s);
    const uint32_t way = (uint32_t)integer_abs(along);
    int32_t gone;
    if (rim < 42000000U) {
        const uint32_t ones = way / rim;
        const uint32_t rest = (way - (ones * rim)) * 100U;
        const uint32_t hundredths = rest / rim;
        const uint32_t last = (((rest - (hundredths * rim)) * 100U) + (rim / 2U)) / rim;
        const uint32_t size = (((ones < 6U) ? ones : 6U) * 10000U) + (hundredths * 100U) + last; /* from 5 on held */
        gone = (int32_t)size;
        gone = (along < 0) ? -gone : gone;
    } else {
        gone = integer_scale(along, 10000, (int32_t)rim);
    }
    return integer_clamp(10000 - gone, -SLIP_MAX_E4, SLIP_MAX_E4);
}

static void record(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_slip_state *slip = &state->slip;
    const int32_t swing_rate = inputs->swing_rate_centirad_s;
    slip->newest = (uint8_t)((slip->newest + 1U) & (FAST_TICKS - 1U));
    TERRAPIN_ASSERT(slip->newest < (uint8_t)FAST_TICKS);
    slip->swing_sum_centirad_s += (uint32_t)swing_rate;
    state->fast.motor_counts[slip->newest] = state->sense.motor_count;
    state->fast.ground_counts[slip->newest] = state->sense.ground_count;
    state->fast.swing_sum_centirad_s[slip->newest] = slip->swing_sum_centirad_s;
    if (slip->ticks < FAST_TICKS) {
        slip->ticks++;
    }
}

/* The two speeds over slip_window with a swing sensor, else over the estimator's window, a whole swing period. */
static bool speeds(terrapin_state *state) {
    terrapin_slip_state *slip = &state->slip;
    const terrapin_rates *r = &state->rates;
    const uint32_t slots = state->gains.window_slots;
    const uint32_t fast = (uint32_t)state->parameter[TERRAPIN_PARAMETER_SLIP_WINDOW]; /* 10..120 < FAST_TICKS */
    TERRAPIN_ASSERT((fast > 0U) && (fast < (uint32_t)FAST_TICKS));
    bool known = true;
    slip->slow = state->estimator.swing_ticks < fast;
    if (!slip->slow && (slip->ticks > fast)) {
        const uint32_t then = ((uint32_t)slip->newest - fast) & (FAST_TICKS - 1U);
        const int32_t swung = integer_difference(slip->swing_sum_centirad_s, state->fast.swing_sum_centirad_s[then]);
        const int32_t alpha = integer_gained(&r->motor_fast, counted(state->fast.motor_counts, slip->newest, fast));
        slip->shell_urad_s = integer_hold(alpha - integer_gained(&r->swing_fast, swung));
        slip->ground_um_s = integer_gained(&r->ground_fast, counted(state->fast.ground_counts, slip->newest, fast));
    } else if (slip->slow && (state->estimator.slots > slots)) {
        const terrapin_slot_record *now = estimator_record(state, 0U);
        const terrapin_slot_record *then = estimator_record(state, slots);
        slip->shell_urad_s =
            integer_gained(&r->motor_window, integer_difference(now->position_counts, then->position_counts));
        slip->ground_um_s =
            integer_gained(&r->ground_window, integer_difference(now->ground_counts, then->ground_counts));
    } else {
        known = false;
    }
    return known;
}

/* What changes the robot's speed is the ground, which takes time. A wheel that stops, turns round or jumps within
 * JUMP_TICKS is a sensor's defect: real slip comes with the shell's speed or with torque, and the robot's speed
 * follows. Once doubted, a wheel must agree with the shell for DOUBT_TICKS before it is believed again. */
static void doubt(terrapin_state *state) {
    terrapin_slip_state *slip = &state->slip;
    const uint16_t *counts = state->fast.ground_counts;
    TERRAPIN_ASSERT(slip->doubt_ticks <= (uint16_t)DOUBT_TICKS);
    const uint32_t middle = ((uint32_t)slip->newest - (uint32_t)JUMP_TICKS) & (FAST_TICKS - 1U);
    const uint32_t then = ((uint32_t)slip->newest - (2U * (uint32_t)JUMP_TICKS)) & (FAST_TICKS - 1U);
    const uint32_t change = ((uint32_t)counts[slip->newest] - (2U * counts[middle]) + counts[then]) & 0xFFFFU;
    const uint32_t size = (change < 0x8000U) ? change : (0x10000U - change);
    const bool jumped = (slip->ticks > (2U * (uint32_t)JUMP_TICKS)) && (size > state->rates.jump_counts);
    const bool agrees =
        slip->moving && ((2 * integer_abs(slip->slip_e4)) < state->parameter[TERRAPIN_PARAMETER_SLIP_LIMIT]);
    if (jumped || slip->implausible || ((slip->doubt_ticks > 0U) && !agrees)) {
        slip->doubt_ticks = (uint16_t)DOUBT_TICKS;
    } else if (slip->doubt_ticks > 0U) {
        slip->doubt_ticks--;
    } else {
        /* believed */
    }
}

/* Two ways to know the ground's speed: they must agree, and when they do not the lower one makes the larger slip. */
static void compare_grounds(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_slip_state *slip = &state->slip;
    slip->implausible = false;
    slip->external = false;
    if (!inputs->ground_speed_valid) {
        slip->disagree_ticks = 0U;
        return;
    }
    const int32_t outside = (int32_t)inputs->ground_speed_mm_s * 1000;
    const int32_t outer = integer_abs(outside);
    const int32_t other = integer_abs(slip->ground_um_s);
    const int32_t larger = (outer > other) ? outer : other;
    const int32_t tolerance = (state->parameter[TERRAPIN_PARAMETER_GROUND_TOLERANCE] * 1000) + (larger / 10);
    const bool disagree = integer_abs(outside - slip->ground_um_s) > tolerance;
    if (!disagree) {
        slip->disagree_ticks = 0U;
    } else if (slip->disagree_ticks < DISAGREE_TICKS) {
        slip->disagree_ticks++;
    } else {
        /* a fault by now */
    }
    slip->implausible = slip->disagree_ticks >= DISAGREE_TICKS;
    TERRAPIN_ASSERT(slip->disagree_ticks <= (uint16_t)DISAGREE_TICKS);
    slip->external = slip->implausible && (outer < other);
    if (slip->external) {
        slip->ground_um_s = outside;
    }
}

void slip_update(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_slip_state *slip = &state->slip;
    record(state, inputs);
    const int32_t wheel_urad_s = integer_gained(&state->rates.motor_speed,
                                                counted(state->fast.motor_counts, slip->newest, (uint32_t)SPEED_TICKS));
    const int32_t emf_uv = integer_widened(&state->rates.emf, wheel_urad_s);
    if (slip->ticks > SPEED_TICKS) {
        slip->wheel_urad_s = wheel_urad_s;
        slip->emf_uv = emf_uv;
    }
    doubt(state);
    const bool known = speeds(state);
    if (known) {
        compare_grounds(state, inputs);
    }
    /* At least 50 mrad/s, and R 1e4 um: the rim's speed is at least 500 um/s, and nothing is divided by zero. */
    slip->moving = known && (integer_abs(slip->shell_urad_s) >= state->rates.dead_urad_s);
    const int32_t rim_um_s = slip->moving ? integer_q32(slip->shell_urad_s, state->rates.rim_q32) : 1;
    slip->slip_e4 = slip_of(slip->moving ? slip->ground_um_s : 1, rim_um_s); /* 0 of equal speeds */
    slip->valid = slip->moving && !slip->implausible && (slip->doubt_ticks == 0U);
    if ((slip->slip_e4 > slip->peak_e4) && (slip->slip_e4 <= 10000)) { /* above 1 it rolls back */
        slip->peak_e4 = slip->slip_e4;
    }
    TERRAPIN_ASSERT(integer_abs(slip->slip_e4) <= SLIP_MAX_E4);
    TERRAPIN_ASSERT((slip->slip_e4 == 0) || known);
}
