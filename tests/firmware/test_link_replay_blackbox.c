/* Recorded commands against an operator who says IDLE, with link layer and core: who wins. */
#include "unity.h"

#include "dispatch.h"
#include "state.h"

#define SECOND 1000U

static terrapin_state state;
static terrapin_link link;
static terrapin_inputs inputs;
static terrapin_outputs outputs;

void setUp(void) {
    terrapin_link_init(&link, &state, &inputs);
}

void tearDown(void) {}

static void send(int32_t request, uint32_t counter) {
    terrapin_frame frame;
    terrapin_frame reply;
    /* a voltage within encoder_tolerance: the motor of this test stands */
    const terrapin_command_t message = {.request = request, .setpoint = 1000};
    TEST_ASSERT_TRUE(terrapin_encode_command(&message, &frame));
    terrapin_e2e_protect(&frame, counter);
    (void)terrapin_accept(&link, &state, &frame, &inputs, &reply);
}

static void step(uint32_t tick) {
    inputs.tick = tick;
    inputs.current_code = 2048U;
    inputs.supply_code = 3000U;
    inputs.temperature_code = 1500U;
    terrapin_link_step(&state, &inputs, &outputs);
}

/* Ticks of a minute with the bridge on: `count` recorded frames in turn, one each `every` ticks, and an operator who
 * asks for IDLE each half second, with whatever counter, from the second `first` on. */
static uint32_t ticks_on(uint32_t count, uint32_t every, uint32_t phase, uint32_t first) {
    uint32_t on = 0;
    uint32_t sent = 0;
    setUp();
    for (uint32_t tick = 0; tick < 60U * SECOND; tick++) {
        if ((tick % 500U == phase) && (tick >= first)) {
            send(TERRAPIN_REQUEST_IDLE, tick / 500U * 7U);
        }
        if (tick % every == 0U) {
            send(TERRAPIN_REQUEST_RUN, sent % count);
            sent++;
        }
        step(tick);
        on += outputs.enable ? 1U : 0U;
    }
    return on;
}

static void test_recorded_frames_lose_against_idle(void) {
    static const uint32_t counts[] = {2U, 15U, 15U};
    static const uint32_t everies[] = {100U, 100U, 50U};
    for (size_t i = 0; i < 3U; i++) {
        for (uint32_t phase = 0; phase < 500U; phase += 7U) {
            TEST_ASSERT_LESS_THAN_UINT32(600U, ticks_on(counts[i], everies[i], phase, 0U)); /* 1 % of a minute */
        }
    }
    /* and without an operator they drive, or this test could not fail */
    TEST_ASSERT_GREATER_THAN_UINT32(50U * SECOND, ticks_on(15U, 50U, 0U, UINT32_MAX));
}

static void test_an_idle_stops_within_a_tick_whatever_its_counter(void) {
    for (uint32_t counter = 0; counter < 15U; counter++) {
        uint32_t sent = 0;
        setUp();
        for (uint32_t tick = 0; tick < SECOND; tick++) {
            if (tick % 50U == 0U) {
                send(TERRAPIN_REQUEST_RUN, sent);
                sent++;
            }
            step(tick);
        }
        TEST_ASSERT_TRUE(outputs.enable && (outputs.duty_q15 != 0));
        send(TERRAPIN_REQUEST_IDLE, counter);
        send(TERRAPIN_REQUEST_RUN, sent); /* and in the same tick the next of the others */
        step(SECOND);
        TEST_ASSERT_EQUAL(0, outputs.duty_q15);
    }
}

static void test_a_latched_fault_outlives_test_mode(void) {
    terrapin_frame frame;
    terrapin_frame reply;
    terrapin_test_mode_t message = {.key = (uint32_t)TERRAPIN_TEST_MODE_KEY};
    inputs.estop = true;
    step(0U);
    inputs.estop = false;
    for (uint32_t i = 0; i < 2U; i++) {
        TEST_ASSERT_TRUE(terrapin_encode_test_mode(&message, &frame));
        terrapin_e2e_protect(&frame, i);
        (void)terrapin_accept(&link, &state, &frame, &inputs, &reply);
        message.key = 0U;
    }
    TEST_ASSERT_FALSE(link.test_mode);
    for (uint32_t tick = 0; tick < SECOND; tick++) {
        if (tick % 50U == 0U) {
            send(TERRAPIN_REQUEST_RUN, tick / 50U);
        }
        step(tick);
        TEST_ASSERT_FALSE(outputs.enable);
    }
    TEST_ASSERT_EQUAL_HEX32(1U << TERRAPIN_FAULT_ESTOP, outputs.faults);
    send(TERRAPIN_REQUEST_CLEAR, 5U);
    send(TERRAPIN_REQUEST_CLEAR, 6U);
    step(SECOND);
    TEST_ASSERT_EQUAL_HEX32(0U, outputs.faults);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_recorded_frames_lose_against_idle);
    RUN_TEST(test_an_idle_stops_within_a_tick_whatever_its_counter);
    RUN_TEST(test_a_latched_fault_outlives_test_mode);
    return UNITY_END();
}
