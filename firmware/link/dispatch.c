#include "dispatch.h"

#include "command.h"
#include "genuine.h"
#include "parameters.h"
#include "terrapin_interface.h"
#include "terrapin_pack.h"
#include "terrapin_assert.h"

#ifdef TERRAPIN_PRODUCTION
#define KIND ((uint32_t)TERRAPIN_IMAGE_KIND_PRODUCTION)
#else
#define KIND ((uint32_t)TERRAPIN_IMAGE_KIND_DESK)
#endif
const terrapin_image_mark terrapin_link_mark = {{0x72726574U, 0x6E697061U, 0x6E696B2DU, 0x00000064U}, KIND};

/* values: all parameters, or NULL for the defaults of the interface. */
static void reset_controller(terrapin_state *state, terrapin_inputs *inputs, const int32_t *values) {
    static const terrapin_inputs nothing = {0};
    *inputs = nothing;
    (void)terrapin_init_with(state, values); /* stored ones are in range, and those of a port are tested */
}

/* The parameters that stand after a reset: a stored set is whole. */
static const int32_t *start_values(const terrapin_link *link) {
    const terrapin_store *store = link->store;
    const bool stored = (store != NULL) && (store->origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED) && !store->foreign;
    return stored ? store->value : link->defaults;
}

#ifndef TERRAPIN_PRODUCTION
static void accept_test_mode(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                             terrapin_inputs *inputs) {
    terrapin_test_mode_t message;
    if (!link_genuine(link, frame, TERRAPIN_LENGTH_TEST_MODE, &link->test_counter) ||
        !terrapin_decode_test_mode(frame, &message)) {
        return;
    }
    const bool arm = message.key == (uint32_t)TERRAPIN_TEST_MODE_KEY;
    /* A controller without a clock of its own has no tick for a clear but those of test mode. */
    const bool clears = inputs->command_fresh && (inputs->command.request == (uint8_t)TERRAPIN_REQUEST_CLEAR);
    const uint32_t stopped = clears ? 0U : (terrapin_latched(state) & TERRAPIN_LINK_STOPPED);
    if (arm && (terrapin_bridge_on(state) || (stopped != 0U))) {
        link->out_of_place++;
        return;
    }
    if (!arm && !link->test_mode) { /* a wrong key, or (0) left already: nothing changes, no counter either */
        link->out_of_place += (message.key != 0U) ? 1U : 0U;
        return;
    }
    if (!link->test_mode) {
        link->latched = terrapin_latched(state);
    }
    reset_controller(state, inputs, arm ? NULL : start_values(link));
    if (!arm) {
        terrapin_latch(state, link->latched | stopped);
    }
    link->test_mode = arm;
    link->stepped = false;
    link->reply_counter = 0U;
    link->command_counter = TERRAPIN_E2E_NO_COUNTER; /* an earlier run leaves nothing behind */
    link->dropped_counter = TERRAPIN_E2E_NO_COUNTER;
    link->write_counter = TERRAPIN_E2E_NO_COUNTER;
    link->store_counter = TERRAPIN_E2E_NO_COUNTER;
}
#endif

static void protect_reply(terrapin_link *link, terrapin_frame *reply) {
    TERRAPIN_ASSERT(link->reply_counter <= TERRAPIN_E2E_COUNTER_MAX);
    terrapin_e2e_protect(reply, link->reply_counter);
    link->reply_counter = (link->reply_counter < TERRAPIN_E2E_COUNTER_MAX) ? (uint8_t)(link->reply_counter + 1U) : 0U;
}

/* Answer with the value that stands now and the result of the access. */
static void parameter_value(terrapin_link *link, const terrapin_state *state, uint16_t index,
                            terrapin_parameter_result result, terrapin_frame *reply) {
    int32_t value = 0;
    const terrapin_parameter_result read = terrapin_parameter_get(state, index, &value);
    const terrapin_parameter_value_t answer = {
        .index = index,
        .value = (read == TERRAPIN_PARAMETER_OK) ? value : 0,
        .status = (result == TERRAPIN_PARAMETER_OK) ? (int32_t)read : (int32_t)result,
    };
    (void)terrapin_encode_parameter_value(&answer, reply); /* cannot saturate: the fields have the signals' widths */
    protect_reply(link, reply);
}

static terrapin_accept_result accept_parameter_write(terrapin_link *link, terrapin_state *state,
                                                     const terrapin_frame *frame, terrapin_frame *reply) {
    terrapin_parameter_write_t message;
    if (!link_genuine(link, frame, TERRAPIN_LENGTH_PARAMETER_WRITE, &link->write_counter) ||
        !terrapin_decode_parameter_write(frame, &message)) {
        return TERRAPIN_ACCEPT_NOTHING;
    }
    const uint16_t index = (uint16_t)message.index;
    parameter_value(link, state, index, terrapin_parameter_set(state, index, message.value), reply);
    return TERRAPIN_ACCEPT_REPLY;
}

static terrapin_accept_result accept_parameter_read(terrapin_link *link, const terrapin_state *state,
                                                    const terrapin_frame *frame, terrapin_frame *reply) {
    terrapin_parameter_read_t message;
    if (!terrapin_decode_parameter_read(frame, &message)) {
        link->malformed++;
        return TERRAPIN_ACCEPT_NOTHING;
    }
    parameter_value(link, state, (uint16_t)message.index, TERRAPIN_PARAMETER_OK, reply);
    return TERRAPIN_ACCEPT_REPLY;
}

static void store_status(terrapin_link *link, const terrapin_state *state, int32_t result, terrapin_frame *reply) {
    const terrapin_store *store = link->store;
    terrapin_store_status_t answer = {.result = result};
    if (store != NULL) {
        answer.sequence = store->sequence;
        answer.origin = store->foreign ? TERRAPIN_STORE_ORIGIN_FOREIGN : (int32_t)store->origin;
        answer.changed = terrapin_store_differs(store, state) ? 1 : 0;
        answer.remains = store->remains ? 1 : 0;
    }
    (void)terrapin_encode_store_status(&answer, reply); /* cannot saturate: the fields have the signals' widths */
    protect_reply(link, reply);
}

static terrapin_accept_result accept_store_command(terrapin_link *link, terrapin_state *state,
                                                   const terrapin_frame *frame, terrapin_frame *reply) {
    terrapin_store_command_t message;
    if (!link_genuine(link, frame, TERRAPIN_LENGTH_STORE_COMMAND, &link->store_counter) ||
        !terrapin_decode_store_command(frame, &message)) {
        return TERRAPIN_ACCEPT_NOTHING;
    }
    int32_t result = TERRAPIN_STORE_RESULT_OK;
    if ((message.action != TERRAPIN_STORE_ACTION_SAVE) && (message.action != TERRAPIN_STORE_ACTION_DEFAULTS)) {
        result = TERRAPIN_STORE_RESULT_UNKNOWN;
    } else if (terrapin_bridge_on(state)) {
        result = TERRAPIN_STORE_RESULT_LOCKED;
    } else if (message.action == TERRAPIN_STORE_ACTION_DEFAULTS) {
        /* The bridge is off. A test run depends on its frames alone. */
        (void)terrapin_parameter_set_all(state, link->test_mode ? NULL : link->defaults);
    } else if (link->store == NULL) {
        result = TERRAPIN_STORE_RESULT_NO_STORE;
    } else {
        (void)terrapin_store_save(link->store, state); /* refused while one is under way, which is busy as well */
        if (link->store->phase == TERRAPIN_STORE_IDLE) {
            result = TERRAPIN_STORE_RESULT_FAILED;
        } else {
            result = TERRAPIN_STORE_RESULT_BUSY;
        }
    }
    store_status(link, state, result, reply);
    return TERRAPIN_ACCEPT_REPLY;
}

static terrapin_accept_result accept_store_read(terrapin_link *link, const terrapin_state *state,
                                                const terrapin_frame *frame, terrapin_frame *reply) {
    terrapin_store_read_t message;
    const terrapin_store *store = link->store;
    if (!terrapin_decode_store_read(frame, &message) || (message.part > 1)) {
        link->malformed++;
        return TERRAPIN_ACCEPT_NOTHING;
    }
    if (message.part == 1) {
        terrapin_store_found_t found = {0};
        if (store != NULL) {
            found.dropped = store->dropped;
            found.replaced = store->replaced;
            found.missing = store->missing;
        }
        (void)terrapin_encode_store_found(&found, reply); /* cannot saturate: 16 bits each */
    } else {
        int32_t result = TERRAPIN_STORE_RESULT_NO_STORE;
        if (store != NULL) {
            const int32_t last = store->failed ? TERRAPIN_STORE_RESULT_FAILED : TERRAPIN_STORE_RESULT_OK;
            result = (store->phase != TERRAPIN_STORE_IDLE) ? TERRAPIN_STORE_RESULT_BUSY : last;
        }
        store_status(link, state, result, reply);
    }
    return TERRAPIN_ACCEPT_REPLY;
}

static terrapin_accept_result accept_identity_read(terrapin_link *link, const terrapin_frame *frame,
                                                   terrapin_frame *reply) {
    terrapin_identity_read_t message;
    if (!terrapin_decode_identity_read(frame, &message) || (message.part != 0)) {
        link->malformed++;
        return TERRAPIN_ACCEPT_NOTHING;
    }
    const terrapin_identity_t answer = {
        .robot = TERRAPIN_ROBOT_IDENTITY,
        .interface = TERRAPIN_INTERFACE_IDENTITY,
        .board = (int32_t)link->board,
        .version = TERRAPIN_INTERFACE_VERSION,
    };
    (void)terrapin_encode_identity(&answer, reply); /* cannot saturate: the fields have the signals' widths */
    return TERRAPIN_ACCEPT_REPLY;
}

static terrapin_accept_result accept_node_request(terrapin_link *link, const terrapin_state *state,
                                                  const terrapin_frame *frame, terrapin_frame *reply) {
    terrapin_accept_result result = TERRAPIN_ACCEPT_NOTHING;
    if (terrapin_identity_accept(link->identity, frame, terrapin_bridge_on(state), reply)) {
        result = TERRAPIN_ACCEPT_REPLY;
    } else {
        link->malformed++; /* or meant for another controller with this node number */
    }
    return result;
}

#ifndef TERRAPIN_PRODUCTION
static void accept_sensors_slow(terrapin_link *link, const terrapin_frame *frame, terrapin_inputs *inputs) {
    TERRAPIN_ASSERT(link->test_mode);
    terrapin_sensors_slow_t message;
    if (!terrapin_decode_sensors_slow(frame, &message)) {
        link->malformed++;
        return;
    }
    if (message.slow_channel == 0) {
        inputs->supply_code = (uint16_t)message.slow_code;
    } else {
        inputs->temperature_code = (uint16_t)message.slow_code;
    }
    inputs->swing_angle_mrad = (int16_t)message.swing_angle;
    inputs->swing_rate_centirad_s = (int16_t)message.swing_rate;
    inputs->pitch_mrad = (int16_t)message.pitch;
    inputs->ground_speed_mm_s = (int16_t)message.ground_speed;
}

static void accept_sensors_heading(terrapin_link *link, const terrapin_frame *frame, terrapin_inputs *inputs) {
    terrapin_sensors_heading_t message;
    if (!terrapin_decode_sensors_heading(frame, &message)) {
        link->malformed++;
        return;
    }
    inputs->heading_turn = (uint16_t)message.heading;
    inputs->heading_valid = message.heading_valid != 0;
}

static terrapin_accept_result accept_sensors_fast(terrapin_link *link, const terrapin_frame *frame,
                                                  terrapin_inputs *inputs) {
    TERRAPIN_ASSERT(link->test_mode);
    terrapin_sensors_fast_t message;
    if (!terrapin_decode_sensors_fast(frame, &message)) {
        link->malformed++;
        return TERRAPIN_ACCEPT_NOTHING;
    }
    /* The full tick follows from its low half: ticks only go forward, by less than 65536. */
    const uint32_t advance = ((uint32_t)message.tick - inputs->tick) & 0xFFFFU;
    if (link->stepped && (advance == 0U)) {
        link->repeated++;
        return TERRAPIN_ACCEPT_NOTHING;
    }
    inputs->tick += advance;
    inputs->current_code = (uint16_t)message.current_code;
    inputs->motor_count = (uint16_t)message.motor_count;
    inputs->ground_count = (uint16_t)message.ground_count;
    inputs->estop = message.estop != 0;
    inputs->swing_valid = message.swing_valid != 0;
    inputs->pitch_valid = message.pitch_valid != 0;
    inputs->ground_speed_valid = message.ground_speed_valid != 0;
    link->stepped = true;
    return TERRAPIN_ACCEPT_STEP;
}
#endif

void terrapin_link_init(terrapin_link *link, terrapin_state *state, terrapin_inputs *inputs) {
    TERRAPIN_ASSERT((link != NULL) && (state != NULL) && (inputs != NULL));
    *link = (terrapin_link){
        .command_counter = TERRAPIN_E2E_NO_COUNTER,
        .dropped_counter = TERRAPIN_E2E_NO_COUNTER,
        .write_counter = TERRAPIN_E2E_NO_COUNTER,
        .test_counter = TERRAPIN_E2E_NO_COUNTER,
        .store_counter = TERRAPIN_E2E_NO_COUNTER,
    };
    reset_controller(state, inputs, NULL);
}

/* What concerns the bus, and other traffic on it. */
static terrapin_accept_result accept_of_the_bus(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                                terrapin_inputs *inputs, terrapin_frame *reply) {
    terrapin_accept_result result = TERRAPIN_ACCEPT_NOTHING;
    if (frame->id == TERRAPIN_ID_STOP_ALL) {
        command_stop_all(link, state, frame, inputs);
    } else if ((frame->id == TERRAPIN_ID_NODE_REQUEST) && (link->identity != NULL)) {
        result = accept_node_request(link, state, frame, reply);
    } else {
        link->unknown++;
    }
    return result;
}

/* A frame that may be taken. */
static terrapin_accept_result take_frame(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                         terrapin_inputs *inputs, terrapin_frame *reply) {
    terrapin_accept_result result = TERRAPIN_ACCEPT_NOTHING;
    switch (frame->id) {
    case TERRAPIN_ID_COMMAND:
    case TERRAPIN_ID_COMMAND_SEALED:
        command_accept(link, frame, inputs);
        break;
    case TERRAPIN_ID_SESSION_OPEN:
        if (terrapin_seal_open(&link->seal, frame, reply)) {
            result = TERRAPIN_ACCEPT_REPLY;
        } else {
            link->out_of_place++;
        }
        break;
    case TERRAPIN_ID_PARAMETER_WRITE:
        result = accept_parameter_write(link, state, frame, reply);
        break;
    case TERRAPIN_ID_PARAMETER_READ:
        result = accept_parameter_read(link, state, frame, reply);
        break;
    case TERRAPIN_ID_STORE_COMMAND:
        result = accept_store_command(link, state, frame, reply);
        break;
    case TERRAPIN_ID_STORE_READ:
        result = accept_store_read(link, state, frame, reply);
        break;
    case TERRAPIN_ID_IDENTITY_READ:
        result = accept_identity_read(link, frame, reply);
        break;
#ifdef TERRAPIN_PRODUCTION
    case TERRAPIN_ID_TEST_MODE:
    case TERRAPIN_ID_SENSORS_SLOW:
    case TERRAPIN_ID_SENSORS_HEADING:
    case TERRAPIN_ID_SENSORS_FAST:
        link->out_of_place++;
        break;
#else
    case TERRAPIN_ID_TEST_MODE:
        accept_test_mode(link, state, frame, inputs);
        break;
    case TERRAPIN_ID_SENSORS_SLOW:
        if (link->test_mode) {
            accept_sensors_slow(link, frame, inputs);
        } else {
            link->out_of_place++;
        }
        break;
    case TERRAPIN_ID_SENSORS_HEADING:
        if (link->test_mode) {
            accept_sensors_heading(link, frame, inputs);
        } else {
            link->out_of_place++;
        }
        break;
    case TERRAPIN_ID_SENSORS_FAST:
        if (link->test_mode) {
            result = accept_sensors_fast(link, frame, inputs);
        } else {
            link->out_of_place++;
        }
        break;
#endif
    default:
        result = accept_of_the_bus(link, state, frame, inputs, reply);
        break;
    }
    TERRAPIN_ASSERT((result != TERRAPIN_ACCEPT_STEP) || link->test_mode);
    return result;
}

/* A bit for an identifier among 32. */
#define BIT(id) ((uint32_t)1U << ((uint32_t)(id) % 32U))

/* What waits for its SEAL on a controller that has a key. */
static bool needs_seal(const terrapin_frame *frame) {
    const uint32_t of_link = BIT(TERRAPIN_ID_PARAMETER_WRITE) | BIT(TERRAPIN_ID_TEST_MODE) |
                             BIT(TERRAPIN_ID_STORE_COMMAND) | BIT(TERRAPIN_ID_NODE_REQUEST);
    const uint32_t of_update =
        BIT(TERRAPIN_ID_UPDATE_BEGIN) | BIT(TERRAPIN_ID_UPDATE_END) | BIT(TERRAPIN_ID_UPDATE_RESET);
    const uint32_t block = (uint32_t)frame->id / 32U;
    uint32_t which = 0U;
    if (block == ((uint32_t)TERRAPIN_ID_COMMAND / 32U)) {
        which = of_link;
    } else if (block == ((uint32_t)TERRAPIN_ID_UPDATE_BEGIN / 32U)) {
        which = of_update;
    } else {
        /* everything else is as it comes */
    }
    terrapin_node_request_t request;
    terrapin_read_node_request(frame, &request);
    const bool asks = (frame->id == (uint16_t)TERRAPIN_ID_NODE_REQUEST) &&
                      (request.action == TERRAPIN_NODE_ACTION_READ); /* which is free */
    return ((which & BIT(frame->id)) != 0U) && !asks;
}

bool terrapin_link_holds(terrapin_link *link, const terrapin_frame *frame) {
    const bool held = (link->seal.key != NULL) && needs_seal(frame);
    if (held) {
        link->unsealed += link->seal.holding ? 1U : 0U; /* the one that waited never got its seal */
        link->seal.held = *frame;
        link->seal.holding = true;
    }
    return held;
}

terrapin_accept_result terrapin_accept(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                       terrapin_inputs *inputs, terrapin_frame *reply) {
    TERRAPIN_ASSERT((link != NULL) && (state != NULL) && (inputs != NULL));
    TERRAPIN_ASSERT((frame != NULL) && (reply != NULL));
    const bool of_seal = (frame->id >= (uint16_t)TERRAPIN_ID_SESSION_OPEN) &&
                         (frame->id <= (uint16_t)TERRAPIN_ID_COMMAND_SEALED); /* and SEAL between them */
    const terrapin_frame *taken = frame;
    if (of_seal && (frame->length != TERRAPIN_LENGTH_SEAL)) {
        link->malformed++;
        return TERRAPIN_ACCEPT_NOTHING;
    }
    if (of_seal && (frame->id != TERRAPIN_ID_SESSION_OPEN)) {
        taken = terrapin_seal_taken(&link->seal, frame);
        TERRAPIN_ASSERT((taken == NULL) || (taken == frame) || needs_seal(taken));
        link->unsealed += (taken == NULL) ? 1U : 0U;
    } else if (terrapin_link_holds(link, frame)) {
        taken = NULL;
    } else {
        /* as it comes */
    }
    terrapin_accept_result result = TERRAPIN_ACCEPT_NOTHING;
    if (taken == NULL) {
        /* nothing */
    } else if ((taken != frame) && (taken->id >= (uint16_t)TERRAPIN_ID_UPDATE_BEGIN)) {
        result = TERRAPIN_ACCEPT_UPDATE;
    } else {
        result = take_frame(link, state, taken, inputs, reply);
    }
    return result;
}

void terrapin_link_seal(terrapin_link *link, const uint32_t *key, uint32_t generation, uint32_t start) {
    TERRAPIN_ASSERT(link != NULL);
    terrapin_seal_init(&link->seal, key, generation, start);
}

void terrapin_link_drive(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs) {
    terrapin_step_drive(state, inputs, outputs);
}

void terrapin_link_think(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs) {
    terrapin_step_think(state, inputs, outputs);
    inputs->command_fresh = false;
}

void terrapin_link_step(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs) {
    terrapin_link_drive(state, inputs, outputs);
    terrapin_link_think(state, inputs, outputs);
}

void terrapin_link_use_store(terrapin_link *link, terrapin_state *state, struct terrapin_store *store) {
    TERRAPIN_ASSERT((link != NULL) && (store != NULL));
    link->store = store;
    (void)terrapin_parameter_set_all(state, start_values(link));
}

void terrapin_link_use_defaults(terrapin_link *link, terrapin_state *state, const int32_t *values) {
    TERRAPIN_ASSERT((link != NULL) && (values != NULL));
    link->defaults = values;
    (void)terrapin_parameter_set_all(state, start_values(link));
}

bool terrapin_link_store_work(terrapin_link *link, const terrapin_state *state) {
    return (link->store != NULL) && terrapin_store_work(link->store, !terrapin_bridge_on(state));
}

bool terrapin_link_bridge_allowed(const terrapin_link *link) {
    return !link->test_mode;
}
