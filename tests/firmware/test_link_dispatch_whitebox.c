/* The dispatcher against a controller that only notes what is done to it. */
#include <string.h>

#include "unity.h"

#include "crc32.c"
#include "chaskey.c"
#include "command.c"
#include "dispatch.c"
#include "genuine.c"
#include "node.c"
#include "seal.c"
#include "../../firmware/store/parameters.c" /* not the core's, which has the same name */
#include "terrapin_interface.c"

struct terrapin_state {
    int resets;
    int steps;
    int thoughts;
    bool fresh_at_step;
    bool locked; /* the bridge is on */
    uint32_t latched;
    int32_t value; /* of parameter 0, the only one; 0 to 10 */
};

static terrapin_state state;
static terrapin_link link;
static terrapin_inputs inputs;
static terrapin_frame reply;

terrapin_parameter_result terrapin_init_with(terrapin_state *s, const int32_t *values) {
    s->resets++;
    s->value = (values == NULL) ? 5 : values[0];
    s->latched = 0U;
    return TERRAPIN_PARAMETER_OK;
}

void terrapin_step_drive(terrapin_state *s, const terrapin_inputs *in, terrapin_outputs *out) {
    s->steps++;
    s->fresh_at_step = in->command_fresh;
    memset(out, 0, sizeof *out);
}

void terrapin_step_think(terrapin_state *s, const terrapin_inputs *in, terrapin_outputs *out) {
    s->thoughts++;
    TEST_ASSERT_EQUAL_MESSAGE(s->steps, s->thoughts, "behind the drive, once each");
    TEST_ASSERT_EQUAL(s->fresh_at_step, in->command_fresh);
    out->frame_count = 1U;
}

terrapin_parameter_result terrapin_parameter_set(terrapin_state *s, uint16_t index, int32_t value) {
    if (index != 0U) {
        return TERRAPIN_PARAMETER_UNKNOWN;
    }
    if ((value < 0) || (value > 10)) {
        return TERRAPIN_PARAMETER_RANGE;
    }
    if (s->locked) {
        return TERRAPIN_PARAMETER_LOCKED;
    }
    s->value = value;
    return TERRAPIN_PARAMETER_OK;
}

terrapin_parameter_result terrapin_parameter_get(const terrapin_state *s, uint16_t index, int32_t *value) {
    if (index != 0U) {
        return TERRAPIN_PARAMETER_UNKNOWN;
    }
    *value = s->value;
    return TERRAPIN_PARAMETER_OK;
}

const int32_t *terrapin_parameter_values(const terrapin_state *s) {
    static int32_t values[TERRAPIN_PARAMETER_COUNT]; /* a store compares all of them */
    values[0] = s->value;
    return values;
}

terrapin_parameter_result terrapin_parameter_set_all(terrapin_state *s, const int32_t *values) {
    s->value = (values == NULL) ? 5 : values[0];
    return TERRAPIN_PARAMETER_OK;
}

uint32_t terrapin_latched(const terrapin_state *s) {
    return s->latched;
}

void terrapin_latch(terrapin_state *s, uint32_t faults) {
    s->latched |= faults;
}

bool terrapin_bridge_on(const terrapin_state *s) {
    return s->locked;
}

void setUp(void) {
    memset(&state, 0, sizeof state);
    memset(&inputs, 0xA5, sizeof inputs);
    terrapin_link_init(&link, &state, &inputs);
}

void tearDown(void) {}

static terrapin_accept_result accept(const terrapin_frame *frame) {
    return terrapin_accept(&link, &state, frame, &inputs, &reply);
}

static terrapin_frame command(int32_t request, int32_t control, int32_t setpoint, uint32_t counter) {
    terrapin_frame frame;
    const terrapin_command_t message = {.request = request, .control = control, .limiter = 1, .setpoint = setpoint};
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static terrapin_frame test_mode(uint32_t key, uint32_t counter) {
    terrapin_frame frame;
    const terrapin_test_mode_t message = {.key = key};
    TEST_ASSERT_TRUE(terrapin_encode_test_mode(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static void arm(uint32_t counter) {
    const terrapin_frame frame = test_mode(TERRAPIN_TEST_MODE_KEY, counter);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    TEST_ASSERT_TRUE(link.test_mode);
}

static terrapin_frame fast(uint32_t tick) {
    terrapin_frame frame;
    const terrapin_sensors_fast_t message = {.current_code = 4095,
                                             .estop = 1,
                                             .swing_valid = 1,
                                             .ground_speed_valid = 1,
                                             .motor_count = 65535,
                                             .ground_count = 1234,
                                             .tick = (int32_t)(tick & 0xFFFFU)};
    TEST_ASSERT_TRUE(terrapin_encode_sensors_fast(&message, &frame));
    return frame;
}

static void test_reset_clears_everything(void) {
    static const terrapin_inputs nothing = {0};
    TEST_ASSERT_EQUAL(1, state.resets);
    TEST_ASSERT_EQUAL(nothing.tick, inputs.tick);
    TEST_ASSERT_EQUAL(0, inputs.command.request);
    TEST_ASSERT_FALSE(inputs.command_fresh);
    TEST_ASSERT_FALSE(link.test_mode);
    TEST_ASSERT_TRUE(terrapin_link_bridge_allowed(&link));
}

static void test_command_arrives_and_is_fresh_for_one_step(void) {
    terrapin_outputs outputs;
    const terrapin_frame frame = command(TERRAPIN_REQUEST_RUN, TERRAPIN_CONTROL_SPEED, -300, 0);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_RUN, inputs.command.request);
    TEST_ASSERT_EQUAL(TERRAPIN_CONTROL_SPEED, inputs.command.control);
    TEST_ASSERT_TRUE(inputs.command.limiter);
    TEST_ASSERT_EQUAL(-300, inputs.command.setpoint);
    terrapin_link_step(&state, &inputs, &outputs);
    TEST_ASSERT_TRUE(state.fresh_at_step);
    terrapin_link_step(&state, &inputs, &outputs);
    TEST_ASSERT_FALSE(state.fresh_at_step);
    TEST_ASSERT_EQUAL_MESSAGE(-300, inputs.command.setpoint, "the command itself stays");
}

static void test_mode_frame(uint32_t key, uint32_t counter) {
    terrapin_frame frame;
    const terrapin_test_mode_t message = {.key = key};
    TEST_ASSERT_TRUE(terrapin_encode_test_mode(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    (void)accept(&frame);
}

/* It is a latched fault, which the core takes away with a clear alone; nothing that comes here does. */
static void test_stop_all_latches_and_no_frame_takes_it_away(void) {
    const terrapin_stop_all_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame stop;
    terrapin_link_init(&link, &state, &inputs);
    TEST_ASSERT_TRUE(terrapin_encode_stop_all(&message, &stop));
    const terrapin_frame clear = command(TERRAPIN_REQUEST_CLEAR, 0, 0, 1U);
    (void)accept(&clear);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&stop));
    TEST_ASSERT_EQUAL_HEX32(1UL << TERRAPIN_FAULT_STOP_ALL, state.latched);
    TEST_ASSERT_TRUE(inputs.command_fresh);
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_REQUEST_IDLE, inputs.command.request, "instead of the clear before it");
    for (int32_t request = TERRAPIN_REQUEST_IDLE; request <= TERRAPIN_REQUEST_CLEAR; request++) {
        const terrapin_frame later = command(request, 0, 100, (uint32_t)(2 + request));
        (void)accept(&later);
        TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_REQUEST_IDLE, inputs.command.request, "in the same tick");
    }
    inputs.command_fresh = false; /* a tick */
    const int resets = state.resets;
    const uint32_t out_of_place = link.out_of_place;
    test_mode_frame(TERRAPIN_TEST_MODE_KEY, 1U);
    TEST_ASSERT_FALSE_MESSAGE(link.test_mode, "not armed while it holds");
    TEST_ASSERT_EQUAL(resets, state.resets);
    TEST_ASSERT_EQUAL(out_of_place + 1U, link.out_of_place);
    TEST_ASSERT_EQUAL_HEX32(1UL << TERRAPIN_FAULT_STOP_ALL, state.latched);
    const terrapin_frame then = command(TERRAPIN_REQUEST_CLEAR, 0, 0, 9U);
    (void)accept(&then);
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_CLEAR, inputs.command.request);
    test_mode_frame(TERRAPIN_TEST_MODE_KEY, 2U);
    TEST_ASSERT_TRUE_MESSAGE(link.test_mode, "armed instead of the tick that would have taken the clear");
    TEST_ASSERT_EQUAL_HEX32(0U, state.latched);
}

/* In test mode it stops the simulated robot, and the real one when that is left; arming anew does not undo it. */
static void test_stop_all_in_test_mode_outlives_it(void) {
    const terrapin_stop_all_t message = {.request = TERRAPIN_REQUEST_IDLE};
    terrapin_frame stop;
    terrapin_link_init(&link, &state, &inputs);
    TEST_ASSERT_TRUE(terrapin_encode_stop_all(&message, &stop));
    state.latched = 5U;
    test_mode_frame(TERRAPIN_TEST_MODE_KEY, 1U);
    TEST_ASSERT_TRUE(link.test_mode);
    (void)accept(&stop);
    test_mode_frame(TERRAPIN_TEST_MODE_KEY, 2U);
    TEST_ASSERT_EQUAL_HEX32(1UL << TERRAPIN_FAULT_STOP_ALL, state.latched);
    test_mode_frame(0U, 3U);
    TEST_ASSERT_FALSE(link.test_mode);
    TEST_ASSERT_EQUAL_HEX32(5U | (1UL << TERRAPIN_FAULT_STOP_ALL), state.latched);
}

static void test_a_stop_all_that_is_none(void) {
    const terrapin_stop_all_t message = {.request = TERRAPIN_REQUEST_RUN}; /* nobody starts all robots at once */
    terrapin_frame stop;
    terrapin_link_init(&link, &state, &inputs);
    TEST_ASSERT_TRUE(terrapin_encode_stop_all(&message, &stop));
    const uint32_t malformed = link.malformed;
    (void)accept(&stop);
    stop.data[0] = 0U;
    stop.length = 0U;
    (void)accept(&stop);
    TEST_ASSERT_EQUAL(malformed + 2U, link.malformed);
    TEST_ASSERT_EQUAL_HEX32(0U, state.latched);
    TEST_ASSERT_FALSE(inputs.command_fresh);
}

static void test_node_requests_reach_the_identity(void) {
    terrapin_identity identity;
    const terrapin_node_request_t message = {0};
    terrapin_frame frame;
    terrapin_link_init(&link, &state, &inputs);
    (void)terrapin_encode_node_request(&message, &frame);
    terrapin_e2e_protect(&frame, 0U);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, terrapin_accept(&link, &state, &frame, &inputs, &reply));
    TEST_ASSERT_EQUAL(1, link.unknown);
    terrapin_identity_init(&identity, 9U, 3U);
    link.identity = &identity;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, terrapin_accept(&link, &state, &frame, &inputs, &reply));
    TEST_ASSERT_EQUAL_HEX16(TERRAPIN_ID_NODE_STATUS, reply.id);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, terrapin_accept(&link, &state, &frame, &inputs, &reply));
    TEST_ASSERT_EQUAL(1, link.malformed);
}

/* Whatever else is on the bus is none of the identity's business. */
static void test_a_controller_with_an_identity_counts_other_traffic(void) {
    terrapin_identity identity;
    terrapin_identity_init(&identity, 0x1234U, 0U);
    link.identity = &identity;
    const terrapin_frame other = {.id = 0x7F0U, .length = 8U};
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, terrapin_accept(&link, &state, &other, &inputs, &reply));
    TEST_ASSERT_EQUAL_UINT32(1U, link.unknown);
    TEST_ASSERT_EQUAL_UINT32(0U, link.bad_crc + link.malformed + link.repeated);
}

/* On a controller with a key these wait for their seal, and none of all other identifiers does. */
static void test_what_needs_a_seal(void) {
    static const uint16_t sealed[] = {TERRAPIN_ID_PARAMETER_WRITE, TERRAPIN_ID_TEST_MODE,    TERRAPIN_ID_STORE_COMMAND,
                                      TERRAPIN_ID_NODE_REQUEST,    TERRAPIN_ID_UPDATE_BEGIN, TERRAPIN_ID_UPDATE_END,
                                      TERRAPIN_ID_UPDATE_RESET};
    uint32_t found = 0U;
    for (uint16_t id = 0U; id < 0x800U; id++) {
        terrapin_frame frame = {.id = id, .length = 8U};
        const terrapin_node_request_t write = {.action = TERRAPIN_NODE_ACTION_WRITE};
        if (id == TERRAPIN_ID_NODE_REQUEST) {
            TEST_ASSERT_TRUE(terrapin_encode_node_request(&write, &frame));
        }
        bool expected = false;
        for (size_t i = 0U; i < (sizeof sealed / sizeof sealed[0]); i++) {
            expected = expected || (sealed[i] == id);
        }
        TEST_ASSERT_EQUAL(expected, needs_seal(&frame));
        found += expected ? 1U : 0U;
    }
    TEST_ASSERT_EQUAL_UINT32(7U, found);
    const terrapin_node_request_t read = {.action = TERRAPIN_NODE_ACTION_READ};
    terrapin_frame asks = {0};
    TEST_ASSERT_TRUE(terrapin_encode_node_request(&read, &asks));
    TEST_ASSERT_FALSE_MESSAGE(needs_seal(&asks), "who is there may be asked by anybody");
}

static void test_protected_frames_are_checked(void) {
    const terrapin_frame good = command(TERRAPIN_REQUEST_RUN, 0, 1000, 3);
    for (size_t bit = 0; bit < 64U; bit++) {
        terrapin_frame bad = good;
        bad.data[bit / 8U] ^= (uint8_t)(1U << (bit % 8U));
        (void)accept(&bad);
        TEST_ASSERT_FALSE(inputs.command_fresh);
    }
    TEST_ASSERT_EQUAL(64, link.bad_crc);
    (void)accept(&good);
    TEST_ASSERT_TRUE(inputs.command_fresh);
    inputs.command_fresh = false;
    (void)accept(&good);
    TEST_ASSERT_FALSE(inputs.command_fresh);
    TEST_ASSERT_EQUAL(1, link.repeated);
    const terrapin_frame later = command(TERRAPIN_REQUEST_RUN, 0, 1000, 7); /* three frames lost: tolerated */
    (void)accept(&later);
    TEST_ASSERT_TRUE(inputs.command_fresh);
}

static bool taken(int32_t request, uint32_t counter) {
    const terrapin_frame frame = command(request, 0, 1000, counter);
    inputs.command_fresh = false;
    (void)accept(&frame);
    return inputs.command_fresh;
}

static void test_the_counter_of_a_command_follows_in_a_window_of_four(void) {
    for (uint32_t last = 0; last < 15U; last++) {
        for (uint32_t step = 0; step < 15U; step++) {
            link.command_counter = (uint8_t)last;
            link.dropped_counter = TERRAPIN_E2E_NO_COUNTER;
            TEST_ASSERT_EQUAL((step >= 1U) && (step <= 4U), taken(TERRAPIN_REQUEST_RUN, (last + step) % 15U));
            TEST_ASSERT_TRUE_MESSAGE(taken(TERRAPIN_REQUEST_RUN, (last + step + 1U) % 15U), "the second of two");
            link.command_counter = (uint8_t)last;
            TEST_ASSERT_TRUE_MESSAGE(taken(TERRAPIN_REQUEST_IDLE, (last + step) % 15U), "an IDLE with any");
            TEST_ASSERT_EQUAL_MESSAGE((last + step) % 15U, link.command_counter, "from there on");
        }
    }
    TEST_ASSERT_EQUAL(15U, link.repeated);
    TEST_ASSERT_EQUAL(15U * 10U, link.out_of_step);
}

static void test_two_hosts_that_jump_are_never_taken(void) {
    TEST_ASSERT_TRUE(taken(TERRAPIN_REQUEST_RUN, 14U));
    for (uint32_t i = 0; i < 100U; i++) {
        TEST_ASSERT_FALSE(taken(TERRAPIN_REQUEST_RUN, ((i % 2U) != 0U) ? 12U : 7U));
    }
    TEST_ASSERT_EQUAL(100U, link.out_of_step);
}

/* A dropped frame counts as the first of two only until the next one that is taken, an IDLE too. */
static void test_an_old_dropped_frame_has_no_second(void) {
    for (uint32_t idle = 0; idle < 2U; idle++) {
        link.command_counter = 1U;
        TEST_ASSERT_FALSE(taken(TERRAPIN_REQUEST_RUN, 9U));
        TEST_ASSERT_TRUE(taken((idle != 0U) ? TERRAPIN_REQUEST_IDLE : TERRAPIN_REQUEST_RUN, 2U));
        TEST_ASSERT_FALSE(taken(TERRAPIN_REQUEST_RUN, 10U));
        TEST_ASSERT_TRUE(taken(TERRAPIN_REQUEST_RUN, 11U));
    }
}

static void test_no_command_takes_the_place_of_an_idle_in_its_tick(void) {
    terrapin_outputs outputs;
    for (int32_t request = TERRAPIN_REQUEST_CALIBRATE; request <= TERRAPIN_REQUEST_CLEAR; request++) {
        const terrapin_frame idle = command(TERRAPIN_REQUEST_IDLE, 0, 0, 0);
        const terrapin_frame other = command(request, 0, 1000, 1);
        (void)accept(&idle);
        (void)accept(&other);
        TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_IDLE, inputs.command.request);
        TEST_ASSERT_EQUAL(request, link.out_of_place);
        terrapin_link_step(&state, &inputs, &outputs);
    }
    TEST_ASSERT_TRUE(taken(TERRAPIN_REQUEST_RUN, 2U));
    TEST_ASSERT_EQUAL(TERRAPIN_REQUEST_RUN, inputs.command.request);
}

static void test_wrong_lengths_and_values(void) {
    static const uint16_t ids[] = {TERRAPIN_ID_COMMAND,        TERRAPIN_ID_PARAMETER_WRITE, TERRAPIN_ID_PARAMETER_READ,
                                   TERRAPIN_ID_TEST_MODE,      TERRAPIN_ID_SENSORS_SLOW,    TERRAPIN_ID_SENSORS_FAST,
                                   TERRAPIN_ID_SENSORS_HEADING};
    arm(0);
    for (uint32_t i = 0; i < 7U; i++) {
        const terrapin_frame frame = {.id = ids[i], .length = 1};
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
        TEST_ASSERT_EQUAL(i + 1U, link.malformed);
    }
    const terrapin_frame request = command(TERRAPIN_REQUEST_CLEAR + 1, 0, 0, 0);
    const terrapin_frame control = command(TERRAPIN_REQUEST_RUN, TERRAPIN_CONTROL_SPEED + 1, 0, 1);
    (void)accept(&request);
    (void)accept(&control);
    TEST_ASSERT_EQUAL(9, link.malformed);
    TEST_ASSERT_FALSE(inputs.command_fresh);
}

static void test_other_traffic_is_counted(void) {
    const terrapin_frame frame = {.id = 0x7FF, .length = 8};
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    TEST_ASSERT_EQUAL(1, link.unknown);
}

/* A RUN that counts on the limiter is not taken where no wheel sees the ground; all else is, and in test mode the host
 * is the wheel. */
static void test_no_limiter_without_a_ground_wheel(void) {
    link.no_ground_wheel = true;
    terrapin_frame frame = command(TERRAPIN_REQUEST_RUN, 0, 5000, 1);
    inputs.command_fresh = false;
    (void)accept(&frame);
    TEST_ASSERT_FALSE(inputs.command_fresh);
    TEST_ASSERT_TRUE(link.limiter_refused);
    TEST_ASSERT_EQUAL(1, link.out_of_place);
    for (int32_t request = TERRAPIN_REQUEST_IDLE; request <= TERRAPIN_REQUEST_CLEAR; request++) {
        if (request != TERRAPIN_REQUEST_RUN) {
            frame = command(request, 0, 0, 2U + (uint32_t)request);
            inputs.command_fresh = false;
            (void)accept(&frame);
            TEST_ASSERT_EQUAL(request, inputs.command.request);
            TEST_ASSERT_TRUE(inputs.command_fresh);
            TEST_ASSERT_FALSE_MESSAGE(link.limiter_refused, "that of the last one alone");
            inputs.command_fresh = false;
        }
    }
    const terrapin_command_t without = {.request = TERRAPIN_REQUEST_RUN, .limiter = 0, .setpoint = 5000};
    TEST_ASSERT_TRUE(terrapin_encode_command(&without, &frame));
    terrapin_e2e_protect(&frame, 6);
    (void)accept(&frame);
    TEST_ASSERT_TRUE(inputs.command_fresh);
    TEST_ASSERT_FALSE(inputs.command.limiter);
    TEST_ASSERT_EQUAL(1, link.out_of_place);

    arm(0);
    link.no_ground_wheel = true;
    inputs.command_fresh = false;
    frame = command(TERRAPIN_REQUEST_RUN, 0, 5000, 1);
    (void)accept(&frame);
    TEST_ASSERT_TRUE(inputs.command_fresh && inputs.command.limiter);
    TEST_ASSERT_FALSE(link.limiter_refused);
}

static void test_sensors_only_in_test_mode(void) {
    const terrapin_frame step = fast(0);
    const terrapin_frame slow = {.id = TERRAPIN_ID_SENSORS_SLOW, .length = 8, .data = {0xFF, 0xFF}};
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&step));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&slow));
    const terrapin_frame steered = {.id = TERRAPIN_ID_SENSORS_HEADING, .length = 8, .data = {0xFF, 0xFF, 1}};
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&steered));
    TEST_ASSERT_EQUAL(3, link.out_of_place);
    TEST_ASSERT_FALSE(inputs.heading_valid);
    TEST_ASSERT_EQUAL(0, inputs.current_code);
    TEST_ASSERT_EQUAL(0, inputs.temperature_code);
    arm(0);
    TEST_ASSERT_FALSE(terrapin_link_bridge_allowed(&link));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_STEP, accept(&step));
    const terrapin_frame leave = test_mode(0, 1);
    (void)accept(&leave);
    TEST_ASSERT_FALSE(link.test_mode);
    TEST_ASSERT_TRUE(terrapin_link_bridge_allowed(&link));
    TEST_ASSERT_EQUAL_MESSAGE(3, state.resets, "arming and leaving reset the controller");
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&step));
    TEST_ASSERT_EQUAL_MESSAGE(0, inputs.current_code, "injected sensors are forgotten");
}

static void test_wrong_key_does_not_reset_a_controller_at_work(void) {
    const terrapin_frame frame = test_mode(TERRAPIN_TEST_MODE_KEY ^ 1U, 0);
    (void)accept(&frame);
    TEST_ASSERT_FALSE(link.test_mode);
    TEST_ASSERT_EQUAL(1, state.resets);
}

static void test_wrong_key_leaves_the_counters(void) {
    terrapin_frame command = {0};
    const terrapin_command_t message = {.request = TERRAPIN_REQUEST_RUN};
    const terrapin_frame wrong = test_mode(TERRAPIN_TEST_MODE_KEY ^ 1U, 0);
    const terrapin_frame left = test_mode(0, 1);
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &command));
    terrapin_e2e_protect(&command, 7);
    (void)accept(&command);
    TEST_ASSERT_TRUE(inputs.command_fresh);
    inputs.command_fresh = false;
    link.reply_counter = 5U;
    (void)accept(&wrong);
    (void)accept(&left);
    (void)accept(&command);
    TEST_ASSERT_FALSE_MESSAGE(inputs.command_fresh, "a command that was replayed counts as new");
    TEST_ASSERT_EQUAL(1, link.repeated);
    TEST_ASSERT_EQUAL(5, link.reply_counter);
    TEST_ASSERT_EQUAL_MESSAGE(1, link.out_of_place, "the wrong key; to leave what was left already is no error");
}

static void test_test_mode_is_not_armed_while_the_bridge_is_on(void) {
    const terrapin_frame arming = test_mode(TERRAPIN_TEST_MODE_KEY, 0);
    const terrapin_frame sensors = fast(1);
    state.locked = true;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&arming));
    TEST_ASSERT_FALSE(link.test_mode);
    TEST_ASSERT_TRUE(terrapin_link_bridge_allowed(&link));
    TEST_ASSERT_EQUAL_MESSAGE(1, state.resets, "the drive goes on");
    TEST_ASSERT_EQUAL(1, link.out_of_place);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&sensors));
    TEST_ASSERT_EQUAL(0, inputs.current_code);
    state.locked = false;
    const terrapin_frame again = test_mode(TERRAPIN_TEST_MODE_KEY, 1);
    (void)accept(&again);
    TEST_ASSERT_TRUE(link.test_mode);
    state.locked = true; /* the bridge of the run in test mode: it is left, not armed anew */
    const terrapin_frame rearm = test_mode(TERRAPIN_TEST_MODE_KEY, 2);
    (void)accept(&rearm);
    TEST_ASSERT_EQUAL(2, state.resets);
    const terrapin_frame leave = test_mode(0, 3);
    (void)accept(&leave);
    TEST_ASSERT_FALSE(link.test_mode);
    TEST_ASSERT_EQUAL(3, state.resets);
}

static void test_test_mode_is_off_after_a_reset(void) {
    arm(0);
    TEST_ASSERT_TRUE(link.test_mode);
    terrapin_link_init(&link, &state, &inputs);
    TEST_ASSERT_FALSE(link.test_mode);
    const terrapin_frame sensors = fast(1);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&sensors));
    TEST_ASSERT_EQUAL(1, link.out_of_place);
}

static void test_leaving_test_mode_keeps_latched_faults(void) {
    const terrapin_frame leave = test_mode(0, 2);
    state.latched = 5U;
    arm(0);
    TEST_ASSERT_EQUAL_MESSAGE(0U, state.latched, "a run in test mode is a function of its frames");
    state.latched = 2U; /* of the simulated robot */
    arm(1);
    (void)accept(&leave);
    TEST_ASSERT_FALSE(link.test_mode);
    TEST_ASSERT_EQUAL(5U, state.latched);
}

/* What stands in flash of another robot is told as that, and is not what holds after a reset. */
static void test_a_store_of_another_robot_is_told_as_foreign(void) {
    static const terrapin_frame read = {.id = TERRAPIN_ID_STORE_READ, .length = 1, .data = {0}};
    static const int32_t defaults[TERRAPIN_PARAMETER_COUNT] = {7};
    terrapin_store_status_t status;
    static terrapin_store stored = {.origin = TERRAPIN_STORE_ORIGIN_STORED, .sequence = 5U};
    link.defaults = defaults;
    for (int i = 0; i < 2; i++) {
        stored.foreign = i == 1;
        link.store = &stored;
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&read));
        TEST_ASSERT_TRUE(terrapin_decode_store_status(&reply, &status));
        TEST_ASSERT_EQUAL((i == 1) ? TERRAPIN_STORE_ORIGIN_FOREIGN : TERRAPIN_STORE_ORIGIN_STORED, status.origin);
        TEST_ASSERT_EQUAL(5, status.sequence);
        TEST_ASSERT_EQUAL_PTR((i == 1) ? defaults : stored.value, start_values(&link));
    }
    link.store = NULL;
}

static void test_store_commands_without_a_store(void) {
    terrapin_frame frame;
    terrapin_store_status_t status;
    terrapin_store_command_t message = {.action = TERRAPIN_STORE_ACTION_SAVE};
    static const int32_t results[] = {TERRAPIN_STORE_RESULT_NO_STORE, TERRAPIN_STORE_RESULT_OK,
                                      TERRAPIN_STORE_RESULT_UNKNOWN, TERRAPIN_STORE_RESULT_UNKNOWN};
    static const int32_t actions[] = {TERRAPIN_STORE_ACTION_SAVE, TERRAPIN_STORE_ACTION_DEFAULTS, 0, 255};
    for (uint32_t i = 0; i < 4U; i++) {
        message.action = actions[i];
        TEST_ASSERT_TRUE(terrapin_encode_store_command(&message, &frame));
        terrapin_e2e_protect(&frame, i);
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&frame));
        TEST_ASSERT_TRUE(terrapin_decode_store_status(&reply, &status));
        TEST_ASSERT_EQUAL(results[i], status.result);
        TEST_ASSERT_EQUAL(i, status.counter);
    }
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame)); /* repeated */
    TEST_ASSERT_EQUAL(1, link.repeated);
    frame.data[0] ^= 1U;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    TEST_ASSERT_EQUAL(1, link.bad_crc);
    const terrapin_frame part = {.id = TERRAPIN_ID_STORE_READ, .length = 1, .data = {2}};
    const terrapin_frame longer = {.id = TERRAPIN_ID_STORE_READ, .length = 2};
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&part));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&longer));
    TEST_ASSERT_EQUAL(2, link.malformed);
    const terrapin_frame found = {.id = TERRAPIN_ID_STORE_READ, .length = 1, .data = {1}};
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&found));
    TEST_ASSERT_EQUAL(TERRAPIN_ID_STORE_FOUND, reply.id);
    TEST_ASSERT_FALSE(terrapin_link_store_work(&link, &state));
    state.locked = true;
    message.action = TERRAPIN_STORE_ACTION_DEFAULTS;
    TEST_ASSERT_TRUE(terrapin_encode_store_command(&message, &frame));
    terrapin_e2e_protect(&frame, 9);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&frame));
    TEST_ASSERT_TRUE(terrapin_decode_store_status(&reply, &status));
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_RESULT_LOCKED, status.result);
}

/* A machine's own defaults, for a host that asks for the defaults and where test mode is left; a stored set is whole.
 */
static void test_defaults_are_the_ports_own(void) {
    static const int32_t own[TERRAPIN_PARAMETER_COUNT] = {7};
    static terrapin_store store = {.origin = TERRAPIN_STORE_ORIGIN_BLANK, .value = {3}};
    terrapin_frame frame;
    const terrapin_store_command_t message = {.action = TERRAPIN_STORE_ACTION_DEFAULTS};
    terrapin_link_use_defaults(&link, &state, own);
    TEST_ASSERT_EQUAL_INT32(7, state.value);
    state.value = 1;
    TEST_ASSERT_TRUE(terrapin_encode_store_command(&message, &frame));
    terrapin_e2e_protect(&frame, 0);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&frame));
    TEST_ASSERT_EQUAL_INT32(7, state.value);
    arm(0);
    TEST_ASSERT_EQUAL_INT32(5, state.value); /* of the interface: a test run depends on its frames alone */
    state.value = 1;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&frame));
    TEST_ASSERT_EQUAL_INT32(5, state.value);
    frame = test_mode(0, 1);
    (void)accept(&frame);
    TEST_ASSERT_EQUAL_INT32(7, state.value);
    terrapin_link_use_store(&link, &state, &store);
    TEST_ASSERT_EQUAL_INT32(7, state.value); /* nothing is stored */
    store.origin = TERRAPIN_STORE_ORIGIN_STORED;
    arm(2);
    frame = test_mode(0, 3);
    (void)accept(&frame);
    TEST_ASSERT_EQUAL_INT32(3, state.value);
    TEST_ASSERT_EQUAL(5, state.resets); /* of setUp, and by each TEST_MODE: once */
}

static void test_sensors_reach_the_inputs(void) {
    terrapin_sensors_slow_t slow = {.slow_code = 3000,
                                    .slow_channel = 0,
                                    .swing_angle = -4096,
                                    .swing_rate = 4095,
                                    .pitch = -2048,
                                    .ground_speed = -4096};
    terrapin_frame frame;
    arm(0);
    TEST_ASSERT_TRUE(terrapin_encode_sensors_slow(&slow, &frame));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    slow.slow_code = 2000;
    slow.slow_channel = 1;
    TEST_ASSERT_TRUE(terrapin_encode_sensors_slow(&slow, &frame));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    const terrapin_sensors_heading_t heading = {.heading = 65535, .heading_valid = 1};
    TEST_ASSERT_TRUE(terrapin_encode_sensors_heading(&heading, &frame));
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    frame = fast(7);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_STEP, accept(&frame));
    TEST_ASSERT_EQUAL(65535, inputs.heading_turn);
    TEST_ASSERT_TRUE(inputs.heading_valid);
    TEST_ASSERT_EQUAL(3000, inputs.supply_code);
    TEST_ASSERT_EQUAL(2000, inputs.temperature_code);
    TEST_ASSERT_EQUAL(-4096, inputs.swing_angle_mrad);
    TEST_ASSERT_EQUAL(4095, inputs.swing_rate_centirad_s);
    TEST_ASSERT_EQUAL(-2048, inputs.pitch_mrad);
    TEST_ASSERT_EQUAL(-4096, inputs.ground_speed_mm_s);
    TEST_ASSERT_EQUAL(4095, inputs.current_code);
    TEST_ASSERT_EQUAL(65535, inputs.motor_count);
    TEST_ASSERT_EQUAL(1234, inputs.ground_count);
    TEST_ASSERT_EQUAL(7, inputs.tick);
    TEST_ASSERT_TRUE(inputs.estop && inputs.swing_valid && inputs.ground_speed_valid);
    TEST_ASSERT_FALSE(inputs.pitch_valid);
}

static void test_ticks_continue_past_16_bits(void) {
    arm(0);
    for (uint32_t tick = 65000U; tick < 140000U; tick += 1000U) {
        const terrapin_frame frame = fast(tick);
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_STEP, accept(&frame));
        TEST_ASSERT_EQUAL(tick, inputs.tick);
        TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_ACCEPT_NOTHING, accept(&frame), "a tick is taken once");
    }
    TEST_ASSERT_EQUAL(75, link.repeated);
    arm(1);
    const terrapin_frame zero = fast(0);
    TEST_ASSERT_EQUAL_MESSAGE(TERRAPIN_ACCEPT_STEP, accept(&zero), "arming anew begins a new count");
    TEST_ASSERT_EQUAL(0, inputs.tick);
}

static void test_arming_forgets_the_counters_of_an_earlier_host(void) {
    const terrapin_frame frame = command(TERRAPIN_REQUEST_RUN, 0, 0, 4);
    (void)accept(&frame);
    arm(0);
    TEST_ASSERT_FALSE(inputs.command_fresh);
    (void)accept(&frame);
    TEST_ASSERT_TRUE(inputs.command_fresh);
}

static terrapin_parameter_value_t expect_value(uint32_t counter) {
    terrapin_parameter_value_t value;
    TEST_ASSERT_TRUE(terrapin_decode_parameter_value(&reply, &value));
    uint8_t last = TERRAPIN_E2E_NO_COUNTER;
    TEST_ASSERT_EQUAL(TERRAPIN_E2E_OK, terrapin_e2e_check(&reply, &last));
    TEST_ASSERT_EQUAL(counter, last);
    return value;
}

static void write_parameter(int32_t index, int32_t value, uint32_t counter) {
    terrapin_frame frame;
    const terrapin_parameter_write_t message = {.index = index, .value = value};
    TEST_ASSERT_TRUE(terrapin_encode_parameter_write(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&frame));
}

static void test_parameters(void) {
    write_parameter(0, 7, 0);
    terrapin_parameter_value_t value = expect_value(0);
    TEST_ASSERT_EQUAL(0, value.index);
    TEST_ASSERT_EQUAL(7, value.value);
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, value.status);
    write_parameter(0, -1, 1);
    value = expect_value(1);
    TEST_ASSERT_EQUAL_MESSAGE(7, value.value, "a refused write shows the value that stands");
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_RANGE, value.status);
    state.locked = true;
    write_parameter(0, 3, 2);
    value = expect_value(2);
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_LOCKED, value.status);
    write_parameter(1, 3, 3);
    value = expect_value(3);
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_UNKNOWN, value.status);
    TEST_ASSERT_EQUAL(1, value.index);
    TEST_ASSERT_EQUAL(0, value.value);
    terrapin_frame frame;
    for (uint32_t i = 4; i < 40U; i++) { /* the reply's counter runs 0 to 14 */
        const terrapin_parameter_read_t read = {.index = 0};
        TEST_ASSERT_TRUE(terrapin_encode_parameter_read(&read, &frame));
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_REPLY, accept(&frame));
        value = expect_value(i % 15U);
        TEST_ASSERT_EQUAL(7, value.value);
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, value.status);
    }
}

/* Counters are per message: a write that carries the counter of the last command is no repetition. */
static void test_each_message_has_its_own_counter(void) {
    const terrapin_frame first = command(TERRAPIN_REQUEST_RUN, 0, 1000, 4);
    (void)accept(&first);
    write_parameter(0, 8, 4);
    TEST_ASSERT_EQUAL(8, state.value);
    write_parameter(0, 9, 5);
    const terrapin_frame second = command(TERRAPIN_REQUEST_RUN, 0, 2000, 5);
    (void)accept(&second);
    TEST_ASSERT_EQUAL(2000, inputs.command.setpoint);
    arm(5);
    TEST_ASSERT_EQUAL(0, link.repeated);
    write_parameter(0, 7, 4);
    terrapin_frame repeated;
    const terrapin_parameter_write_t message = {.index = 0, .value = 6};
    TEST_ASSERT_TRUE(terrapin_encode_parameter_write(&message, &repeated));
    terrapin_e2e_protect(&repeated, 4);
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&repeated));
    TEST_ASSERT_EQUAL(7, state.value);
    TEST_ASSERT_EQUAL(1, link.repeated);
}

static void test_damaged_write_is_not_answered(void) {
    terrapin_frame frame;
    const terrapin_parameter_write_t message = {.index = 0, .value = 9};
    TEST_ASSERT_TRUE(terrapin_encode_parameter_write(&message, &frame));
    terrapin_e2e_protect(&frame, 0);
    frame.data[2] ^= 1U;
    TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, accept(&frame));
    TEST_ASSERT_EQUAL(5, state.value);
    TEST_ASSERT_EQUAL(1, link.bad_crc);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_reset_clears_everything);
    RUN_TEST(test_command_arrives_and_is_fresh_for_one_step);
    RUN_TEST(test_stop_all_latches_and_no_frame_takes_it_away);
    RUN_TEST(test_stop_all_in_test_mode_outlives_it);
    RUN_TEST(test_a_stop_all_that_is_none);
    RUN_TEST(test_node_requests_reach_the_identity);
    RUN_TEST(test_a_controller_with_an_identity_counts_other_traffic);
    RUN_TEST(test_what_needs_a_seal);
    RUN_TEST(test_protected_frames_are_checked);
    RUN_TEST(test_the_counter_of_a_command_follows_in_a_window_of_four);
    RUN_TEST(test_two_hosts_that_jump_are_never_taken);
    RUN_TEST(test_an_old_dropped_frame_has_no_second);
    RUN_TEST(test_no_command_takes_the_place_of_an_idle_in_its_tick);
    RUN_TEST(test_wrong_lengths_and_values);
    RUN_TEST(test_other_traffic_is_counted);
    RUN_TEST(test_no_limiter_without_a_ground_wheel);
    RUN_TEST(test_sensors_only_in_test_mode);
    RUN_TEST(test_wrong_key_does_not_reset_a_controller_at_work);
    RUN_TEST(test_wrong_key_leaves_the_counters);
    RUN_TEST(test_test_mode_is_not_armed_while_the_bridge_is_on);
    RUN_TEST(test_test_mode_is_off_after_a_reset);
    RUN_TEST(test_leaving_test_mode_keeps_latched_faults);
    RUN_TEST(test_a_store_of_another_robot_is_told_as_foreign);
    RUN_TEST(test_store_commands_without_a_store);
    RUN_TEST(test_defaults_are_the_ports_own);
    RUN_TEST(test_sensors_reach_the_inputs);
    RUN_TEST(test_ticks_continue_past_16_bits);
    RUN_TEST(test_arming_forgets_the_counters_of_an_earlier_host);
    RUN_TEST(test_parameters);
    RUN_TEST(test_each_message_has_its_own_counter);
    RUN_TEST(test_damaged_write_is_not_answered);
    return UNITY_END();
}
