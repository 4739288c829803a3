/* Fuzz target: the step itself, with the state carried on from tick to tick. 20 bytes a record: the first two say what
 * it is and how many ticks it holds; the rest are inputs of each field's whole range, a command, a parameter's value,
 * or a reset with any value of a parameter and with faults that stood before. The last two are the speeds of the
 * encoders in eighths of a count; or the motor turns as the bridge drives it, so that the search gets past the watch on
 * the encoder, and the last is the ground's share of that. Checked beyond sanitizers and assertions: outputs within
 * their bounds, parameters within their ranges, bridge and duty agree, an emergency stop is off in its tick. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "terrapin_interface.h"

#define RECORD     20U
#define MOST_TICKS 16384U /* of one input */
#define REPEATED   0x40U  /* the command, by an operator, in every tick */
#define FOLLOWS    0x20U  /* the motor follows the bridge */
#define RESET      0x10U  /* no parameter's value, but a reset */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static uint16_t word(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | ((uint32_t)bytes[1] << 8U));
}

/* A signed value of `bits` bits. */
static int16_t value(const uint8_t *bytes, uint32_t bits) {
    const int32_t half = (int32_t)1 << (bits - 1U);
    return (int16_t)((int32_t)(word(bytes) & (((uint32_t)1U << bits) - 1U)) - half);
}

/* A byte as a signed number, modulo 2^32. */
static uint32_t eighths(uint8_t byte) {
    return (byte < 128U) ? byte : ((uint32_t)byte - 256U);
}

static void take_inputs(terrapin_inputs *in, const uint8_t *bytes) {
    in->current_code = word(bytes) & 0xFFFU;
    in->supply_code = word(&bytes[2]) & 0xFFFU;
    in->temperature_code = word(&bytes[4]) & 0xFFFU;
    in->swing_angle_mrad = value(&bytes[6], 13U);
    in->swing_rate_centirad_s = value(&bytes[8], 13U);
    in->pitch_mrad = value(&bytes[10], 12U);
    in->ground_speed_mm_s = value(&bytes[12], 13U);
    in->heading_turn = word(&bytes[14]);
    in->swing_valid = (bytes[16] & 1U) != 0U;
    in->pitch_valid = (bytes[16] & 2U) != 0U;
    in->ground_speed_valid = (bytes[16] & 4U) != 0U;
    in->heading_valid = (bytes[16] & 8U) != 0U;
    in->estop = (bytes[16] & 0xF0U) == 0xF0U;
}

static void take_command(terrapin_inputs *in, const uint8_t *bytes) {
    in->command_fresh = true;
    in->command.request = bytes[0] % (TERRAPIN_REQUEST_CLEAR + 1U);
    in->command.control = bytes[1] % (TERRAPIN_CONTROL_SPEED + 1U);
    in->command.limiter = (bytes[2] & 1U) != 0U;
    in->command.setpoint = (int16_t)word(&bytes[3]);
}

/* A value within the range of its parameter, or any value of any number. */
static void take_parameter(terrapin_state *state, const uint8_t *bytes) {
    uint16_t index = word(bytes);
    const uint32_t drawn = ((uint32_t)word(&bytes[4]) << 16U) | word(&bytes[2]);
    int32_t value = (int32_t)drawn;
    bool good = false;
    if ((bytes[6] & 1U) == 0U) {
        index %= TERRAPIN_PARAMETER_COUNT;
        const terrapin_parameter_entry entry = terrapin_parameter(index);
        const uint32_t range = (uint32_t)entry.maximum - (uint32_t)entry.minimum;
        value = (int32_t)((uint32_t)entry.minimum + ((range == UINT32_MAX) ? drawn : (drawn % (range + 1U))));
        good = true;
    } else if (index < TERRAPIN_PARAMETER_COUNT) {
        const terrapin_parameter_entry entry = terrapin_parameter(index);
        good = (value >= entry.minimum) && (value <= entry.maximum);
    } else {
        /* there is none of this number */
    }
    const bool on = terrapin_bridge_on(state);
    const terrapin_parameter_result result = terrapin_parameter_set(state, index, value);
    CHECK((result != TERRAPIN_PARAMETER_OK) || good);
    CHECK((result == TERRAPIN_PARAMETER_OK) || !good || (on && (result == TERRAPIN_PARAMETER_LOCKED)));
}

static void check_parameters(const terrapin_state *state) {
    const int32_t *values = terrapin_parameter_values(state);
    for (uint16_t i = 0; i < TERRAPIN_PARAMETER_COUNT; i++) {
        const terrapin_parameter_entry entry = terrapin_parameter(i);
        CHECK((values[i] >= entry.minimum) && (values[i] <= entry.maximum));
    }
}

/* As a controller starts: with the values of a store, and the faults that stood before. */
static void start(terrapin_state *state, const uint8_t *bytes) {
    int32_t values[TERRAPIN_PARAMETER_COUNT];
    const uint16_t index = word(bytes) % TERRAPIN_PARAMETER_COUNT;
    const terrapin_parameter_entry entry = terrapin_parameter(index);
    const uint32_t faults = ((uint32_t)word(&bytes[8]) << 16U) | word(&bytes[6]);
    terrapin_parameter_defaults(values);
    values[index] = (int32_t)(((uint32_t)word(&bytes[4]) << 16U) | word(&bytes[2]));
    const bool good = (values[index] >= entry.minimum) && (values[index] <= entry.maximum);
    CHECK(terrapin_init_with(state, values) == (good ? TERRAPIN_PARAMETER_OK : TERRAPIN_PARAMETER_RANGE));
    terrapin_latch(state, faults);
    CHECK(terrapin_latched(state) == (faults & TERRAPIN_FAULTS_LATCHED));
    CHECK(!terrapin_bridge_on(state));
}

/* Speed of a motor without a load at what the bridge gives it [1/8 count a tick]. */
static int32_t driven(const terrapin_state *state, const terrapin_inputs *in, const terrapin_outputs *out) {
    int32_t torque_unm_per_a = 0;
    int32_t code_uv = 0;
    CHECK(terrapin_parameter_get(state, TERRAPIN_PARAMETER_TORQUE_CONSTANT, &torque_unm_per_a) ==
          TERRAPIN_PARAMETER_OK);
    CHECK(terrapin_parameter_get(state, TERRAPIN_PARAMETER_SUPPLY_SCALE, &code_uv) == TERRAPIN_PARAMETER_OK);
    const int64_t applied_uv = (int64_t)out->duty_q15 * in->supply_code * code_uv / 32768;
    const int64_t speed_mrad_s = applied_uv * 1000 / torque_unm_per_a;
    return (int32_t)(speed_mrad_s * 8 * TERRAPIN_ENCODER_COUNTS / 6283185);
}

static void step(terrapin_state *state, const terrapin_inputs *in, terrapin_outputs *result) {
    terrapin_outputs out;
    terrapin_step(state, in, &out);
    *result = out;
    CHECK((out.frame_count >= 1U) && (out.frame_count <= TERRAPIN_MAX_FRAMES));
    CHECK((out.duty_q15 >= -32767) && (out.enable || (out.duty_q15 == 0)));
    CHECK((out.faults & ~TERRAPIN_FAULTS_KNOWN) == 0U);
    CHECK(!in->estop || !out.enable);
    CHECK(((out.faults & TERRAPIN_FAULTS_LATCHED) == 0U) || !out.enable);
    CHECK(out.enable == terrapin_bridge_on(state));
    CHECK((out.faults & TERRAPIN_FAULTS_LATCHED) == terrapin_latched(state));
    CHECK(terrapin_at_work(state) || !out.enable);
    for (uint8_t i = 0; i < out.frame_count; i++) {
        CHECK((out.frames[i].id <= 0x7FFU) && (out.frames[i].length <= 8U));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static terrapin_state *state;
    terrapin_inputs in;
    terrapin_outputs out;
    uint32_t room = MOST_TICKS;
    uint32_t motor_eighths = 0; /* of a count */
    uint32_t ground_eighths = 0;
    if (state == NULL) {
        state = malloc(terrapin_state_size());
        CHECK(state != NULL);
    }
    terrapin_init(state);
    (void)memset(&in, 0, sizeof in);
    (void)memset(&out, 0, sizeof out);
    in.tick = UINT32_MAX - 300U; /* wraps soon */
    for (size_t at = 0; (at + RECORD) <= size; at += RECORD) {
        const uint8_t *record = &bytes[at];
        const uint32_t ticks = 1U + (uint32_t)record[1];
        switch (record[0] & 3U) {
        case 0:
            take_command(&in, &record[2]);
            break;
        case 1:
            if ((record[0] & RESET) != 0U) {
                start(state, &record[2]);
            } else {
                take_parameter(state, &record[2]);
            }
            break;
        default:
            take_inputs(&in, &record[2]);
            break;
        }
        for (uint32_t i = 0; (i < ticks) && (room > 0U); i++) {
            in.tick += ((record[0] & 0xFCU) == 0xFCU) ? 2U : 1U; /* one that was missed */
            if ((record[0] & FOLLOWS) != 0U) {
                const uint32_t motor = (uint32_t)driven(state, &in, &out);
                motor_eighths += motor;
                ground_eighths += (uint32_t)((int32_t)(motor * eighths(record[19])) / 128);
            } else {
                motor_eighths += eighths(record[18]);
                ground_eighths += eighths(record[19]);
            }
            in.motor_count = (uint16_t)(motor_eighths / 8U);
            in.ground_count = (uint16_t)(ground_eighths / 8U);
            step(state, &in, &out);
            in.command_fresh = (record[0] & REPEATED) != 0U;
            room--;
        }
        check_parameters(state);
    }
    return 0;
}
