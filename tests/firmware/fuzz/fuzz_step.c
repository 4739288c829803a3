/* Fuzz target: the step itself, with the state carried on from tick to tick. 20 bytes a record: the first two say what
 * it is and how many ticks it holds, the last two the speeds of the encoders in eighths of a count; the rest are inputs
 * of each field's whole range, a command, or a parameter's value within its range. Checked beyond sanitizers and
 * assertions: outputs within their bounds, bridge and duty agree, an emergency stop is off in its tick. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "terrapin_interface.h"

#define RECORD     20U
#define MOST_TICKS 16384U /* of one input */

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

static void take_parameter(terrapin_state *state, const uint8_t *bytes) {
    const uint16_t index = word(bytes) % TERRAPIN_PARAMETER_COUNT;
    const terrapin_parameter_entry entry = terrapin_parameter(index);
    const uint32_t range = (uint32_t)entry.maximum - (uint32_t)entry.minimum;
    const uint32_t drawn = ((uint32_t)word(&bytes[4]) << 16U) | word(&bytes[2]);
    const uint32_t offset = (range == UINT32_MAX) ? drawn : (drawn % (range + 1U));
    const bool on = terrapin_bridge_on(state);
    const terrapin_parameter_result result =
        terrapin_parameter_set(state, index, (int32_t)((uint32_t)entry.minimum + offset));
    CHECK((result == TERRAPIN_PARAMETER_OK) || (on && (result == TERRAPIN_PARAMETER_LOCKED)));
}

static void step(terrapin_state *state, terrapin_inputs *in) {
    terrapin_outputs out;
    terrapin_step(state, in, &out);
    CHECK((out.frame_count >= 1U) && (out.frame_count <= TERRAPIN_MAX_FRAMES));
    CHECK((out.duty_q15 >= -32767) && (out.enable || (out.duty_q15 == 0)));
    CHECK((out.faults & ~TERRAPIN_FAULTS_KNOWN) == 0U);
    CHECK(!in->estop || !out.enable);
    CHECK(((out.faults & TERRAPIN_FAULTS_LATCHED) == 0U) || !out.enable);
    CHECK(out.enable == terrapin_bridge_on(state));
    for (uint8_t i = 0; i < out.frame_count; i++) {
        CHECK((out.frames[i].id <= 0x7FFU) && (out.frames[i].length <= 8U));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static terrapin_state *state;
    terrapin_inputs in;
    uint32_t room = MOST_TICKS;
    uint32_t motor_eighths = 0; /* of a count */
    uint32_t ground_eighths = 0;
    if (state == NULL) {
        state = malloc(terrapin_state_size());
        CHECK(state != NULL);
    }
    terrapin_init(state);
    (void)memset(&in, 0, sizeof in);
    in.tick = UINT32_MAX - 300U; /* wraps soon */
    for (size_t at = 0; (at + RECORD) <= size; at += RECORD) {
        const uint8_t *record = &bytes[at];
        const uint32_t ticks = 1U + (uint32_t)record[1];
        switch (record[0] & 3U) {
        case 0:
            take_command(&in, &record[2]);
            break;
        case 1:
            take_parameter(state, &record[2]);
            break;
        default:
            take_inputs(&in, &record[2]);
            break;
        }
        for (uint32_t i = 0; (i < ticks) && (room > 0U); i++) {
            in.tick += ((record[0] & 0xFCU) == 0xFCU) ? 2U : 1U; /* one that was missed */
            motor_eighths += eighths(record[18]);
            ground_eighths += eighths(record[19]);
            in.motor_count = (uint16_t)(motor_eighths / 8U);
            in.ground_count = (uint16_t)(ground_eighths / 8U);
            step(state, &in);
            in.command_fresh = (record[0] & 0x40U) != 0U; /* an operator who repeats it */
            room--;
        }
    }
    return 0;
}
