#include "core.h"

_Static_assert((TERRAPIN_FAULT_CURRENT_SENSOR == (TERRAPIN_FAULT_OVER_CURRENT + 1)) &&
                   (TERRAPIN_FAULT_OVER_TEMPERATURE == (TERRAPIN_FAULT_OVER_CURRENT + 6)),
               "the faults that watch() sees follow on each other");

enum {
    CODE_LOW = 2, /* codes at or beyond these are the ends of a 12-bit converter */
    CODE_HIGH = 4093,
    FAST_FAULT_TICKS = 3,
    SLOW_FAULT_TICKS = 20,
    ENCODER_FAULT_TICKS = 200,
    SETTLE_TICKS = 20, /* after the bridge went off, until the current's zero is looked at */
    OFF_TICKS_MAX = 1000,
    TRIM_LIMIT_CODES = 16,                             /* a zero farther away than this is no offset but a defect */
    FILTER_SAMPLES = 16,                               /* time constant of supply and temperature, */
    FILTER_BITS = 4,                                   /* as a power of two */
    HELD_MC = 4194303,                                 /* below 2^22, so that 1/256 of it are below 2^30 */
    ASSUMED_MC = TERRAPIN_REFERENCE_TEMPERATURE * 1000 /* until the first sample */
};

static uint32_t fault_bit(uint32_t number) {
    TERRAPIN_ASSERT(number < 32U);
    return (uint32_t)1U << number;
}

int32_t sense_supply_mv(const terrapin_state *state) {
    TERRAPIN_ASSERT(state->sense.supply_q8_mv >= 0);
    return integer_right(state->sense.supply_q8_mv, 8U);
}

int32_t sense_temperature_mc(const terrapin_state *state) {
    TERRAPIN_ASSERT(integer_abs(state->sense.temperature_q8_mc) <= INTEGER_MOST);
    return state->sense.temperature_known ? integer_right(state->sense.temperature_q8_mc, 8U) : ASSUMED_MC;
}

/* One step of a first-order low-pass towards a sample that is `off` away; eight bits below the unit keep the rest. */
static int32_t low_pass(int32_t off) {
    const int32_t half = (FILTER_SAMPLES / 2) - ((off < 0) ? 1 : 0); /* halves away from zero */
    return integer_right(off + half, FILTER_BITS);
}

static void read_slow(terrapin_state *state, const terrapin_inputs *inputs) {
    const int32_t *p = state->parameter;
    terrapin_sense *sense = &state->sense;
    /* at most 65535 * 20000 uV, below 2^31; in 1/8 mV, then in 1/256 mV below 2^29 */
    const int32_t supply_q8 = (((int32_t)inputs->supply_code * p[TERRAPIN_PARAMETER_SUPPLY_SCALE]) / 125) * 32;
    const int32_t mc = ((int32_t)inputs->temperature_code * p[TERRAPIN_PARAMETER_TEMPERATURE_SCALE]) +
                       p[TERRAPIN_PARAMETER_TEMPERATURE_ZERO];
    const int32_t temperature_q8 = integer_clamp(mc, -HELD_MC, HELD_MC) * 256;
    const bool first = !sense->temperature_known;
    sense->supply_q8_mv += (sense->supply_q8_mv == 0) ? supply_q8 : low_pass(supply_q8 - sense->supply_q8_mv);
    sense->temperature_q8_mc += first ? temperature_q8 : low_pass(temperature_q8 - sense->temperature_q8_mc);
    sense->temperature_known = inputs->temperature_code != 0U;
    if (!sense->temperature_known) { /* not sampled yet, or broken, which is a fault of its own */
        sense->temperature_q8_mc = 0;
    }
    TERRAPIN_ASSERT((sense->supply_q8_mv >= 0) && (sense->supply_q8_mv < 0x20000000));
}

/* The mean of TRIM_TICKS codes with the bridge off is the zero of the current. Returns false when it cannot be. */
static bool trim(terrapin_state *state) {
    terrapin_sense *sense = &state->sense;
    TERRAPIN_ASSERT(sense->trim_count < (uint16_t)TRIM_TICKS);
    bool plausible = true;
    if (state->drive.enable) {
        sense->off_ticks = 0U;
    } else if (sense->off_ticks < OFF_TICKS_MAX) {
        sense->off_ticks++;
    } else {
        /* long enough */
    }
    if (sense->off_ticks <= SETTLE_TICKS) {
        sense->trim_sum_codes = 0U;
        sense->trim_count = 0U;
    } else {
        sense->trim_sum_codes += (uint32_t)sense->current_code;
        sense->trim_count++;
    }
    if (sense->trim_count == TRIM_TICKS) {
        const int32_t zero_q8 = state->parameter[TERRAPIN_PARAMETER_CURRENT_ZERO_CODE];
        const uint32_t mean_q8 = (sense->trim_sum_codes * 256U) / (uint32_t)TRIM_TICKS;
        const int32_t off_q8 = (int32_t)mean_q8 - zero_q8;
        plausible = integer_abs(off_q8) <= (TRIM_LIMIT_CODES * 256);
        sense->trimmed = plausible && (state->parameter[TERRAPIN_PARAMETER_TRIM_CURRENT] != 0);
        sense->trim_q8_codes = sense->trimmed ? off_q8 : 0;
        sense->trim_sum_codes = 0U;
        sense->trim_count = 0U;
    }
    TERRAPIN_ASSERT(integer_abs(sense->trim_q8_codes) <= (TRIM_LIMIT_CODES * 256));
    return plausible;
}

/* Counts how long a cause has lasted; true from `ticks` on. */
static bool lasting(uint16_t *counter, bool cause, int32_t ticks) {
    TERRAPIN_ASSERT((ticks > 0) && (*counter <= (uint16_t)ticks));
    if (!cause) {
        *counter = 0U;
    } else if (*counter < (uint16_t)ticks) {
        (*counter)++;
    } else {
        /* stays */
    }
    return *counter >= (uint16_t)ticks;
}

static bool at_rail(uint16_t code) {
    return (code <= CODE_LOW) || (code >= CODE_HIGH);
}

static uint32_t watch(terrapin_state *state, const terrapin_inputs *inputs) {
    const int32_t *p = state->parameter;
    terrapin_sense *sense = &state->sense;
    const int32_t supply = sense_supply_mv(state);
    uint32_t causes = 0U; /* bit 0: TERRAPIN_FAULT_OVER_CURRENT, and so on */
    if (integer_abs(sense->current_ua) >= (p[TERRAPIN_PARAMETER_OVER_CURRENT] * 1000)) {
        causes |= 1U;
    }
    if (at_rail(inputs->current_code)) {
        causes |= 2U;
    }
    if (at_rail(inputs->supply_code)) {
        causes |= 4U;
    }
    if (at_rail(inputs->temperature_code)) {
        causes |= 8U;
    }
    if (supply < p[TERRAPIN_PARAMETER_SUPPLY_LOW]) {
        causes |= 16U;
    }
    if (supply > p[TERRAPIN_PARAMETER_SUPPLY_HIGH]) {
        causes |= 32U;
    }
    if (sense_temperature_mc(state) > p[TERRAPIN_PARAMETER_TEMPERATURE_HIGH]) {
        causes |= 64U;
    }
    uint32_t standing = 0U;
    uint32_t changing = causes | sense->causes; /* the counters of all others are 0 and stay so */
    while (changing != 0U) {
        const uint32_t i = (uint32_t)__builtin_ctz(changing);
        TERRAPIN_ASSERT(i < (uint32_t)SENSED_FAULTS);
        const int32_t ticks = (i <= 1U) ? FAST_FAULT_TICKS : SLOW_FAULT_TICKS;
        if (lasting(&sense->fault_ticks[i], ((causes >> i) & 1U) != 0U, ticks)) {
            standing |= fault_bit((uint32_t)TERRAPIN_FAULT_OVER_CURRENT + i);
        }
        changing &= changing - 1U;
    }
    sense->causes = causes;
    return standing;
}

/* The encoder against the motor's own equation V = R_e I + back-EMF, with the speed of the last ticks. A speed that
 * missed ticks leave unknown bears nothing out: with ticks lost again and again the drive would be blind for good. */
static bool encoder_lies(terrapin_state *state) {
    const int32_t *p = state->parameter;
    bool off = state->drive.enable;
    if (off && (state->slip.ticks > SPEED_TICKS)) {
        const int32_t drop_mv = integer_q32(state->sense.current_ua, state->rates.drop_q32);
        const int32_t seen_mv = state->drive.applied_mv - drop_mv; /* below 2^22: 100 ohm at 21 A */
        off = integer_abs(seen_mv - (state->slip.emf_uv / 1000)) > p[TERRAPIN_PARAMETER_ENCODER_TOLERANCE];
    }
    /* A tick of agreement takes back a quarter of one that disagreed: a loose contact agrees half of the time. */
    uint16_t *quarters = &state->sense.encoder_quarters;
    if (off) {
        *quarters = (uint16_t)integer_clamp((int32_t)*quarters + 4, 0, 4 * ENCODER_FAULT_TICKS);
    } else if (*quarters > 0U) {
        (*quarters)--;
    } else {
        /* they agree */
    }
    return *quarters >= (uint16_t)(4 * ENCODER_FAULT_TICKS);
}

static void read_counts(terrapin_sense *sense, const terrapin_inputs *inputs) {
    const uint32_t motor = ((uint32_t)inputs->motor_count - sense->motor_count) & 0xFFFFU;
    const uint32_t ground = ((uint32_t)inputs->ground_count - sense->ground_count) & 0xFFFFU;
    sense->motor_step = (int32_t)motor - ((motor >= 0x8000U) ? 0x10000 : 0);
    TERRAPIN_ASSERT((sense->motor_step >= INT16_MIN) && (sense->motor_step <= INT16_MAX));
    sense->motor_position += (uint32_t)sense->motor_step;
    sense->ground_position += ground - ((ground >= 0x8000U) ? 0x10000U : 0U);
    sense->motor_count = inputs->motor_count;
    sense->ground_count = inputs->ground_count;
}

uint32_t sense_update(terrapin_state *state, const terrapin_inputs *inputs, bool *gap) {
    terrapin_sense *sense = &state->sense;
    *gap = sense->started && (inputs->tick != (sense->tick + 1U));
    if (!sense->started) {
        sense->motor_count = inputs->motor_count;
        sense->ground_count = inputs->ground_count;
        sense->started = true;
    }
    sense->tick = inputs->tick;
    read_counts(sense, inputs);
    sense->current_code = inputs->current_code;
    const bool plausible_zero = trim(state);
    const int32_t zero_q8 = state->parameter[TERRAPIN_PARAMETER_CURRENT_ZERO_CODE] + sense->trim_q8_codes;
    /* a code from a broken port, below 65536, still fits */
    sense->current_ua =
        integer_q((sense->current_code * 256) - zero_q8, state->parameter[TERRAPIN_PARAMETER_CURRENT_SCALE], 8U);
    read_slow(state, inputs);

    uint32_t causes = watch(state, inputs);
    if (!plausible_zero) {
        causes |= fault_bit(TERRAPIN_FAULT_CURRENT_SENSOR);
    }
    const bool jump = integer_abs(sense->motor_step) > TERRAPIN_LIMIT_ENCODER_JUMP;
    if ((jump && !*gap) || encoder_lies(state)) {
        causes |= fault_bit(TERRAPIN_FAULT_MOTOR_ENCODER);
    }
    return causes;
}
