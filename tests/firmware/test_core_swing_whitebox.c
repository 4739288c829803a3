/* What the swing and the pitch change: which inertia the swing's momentum is of, and that backing out goes on without a
 * sensor of the pitch. */
#include <string.h>

#include "unity.h"

#include "episode.c"
#include "estimator.c"
#include "extrication.c"
#include "integer.c"

static terrapin_state state;
static terrapin_inputs inputs;

int32_t compensation_friction(const terrapin_state *s, int32_t counts) {
    (void)s, (void)counts;
    return 0;
}
int32_t compensation_imbalance(const terrapin_state *s, int32_t counts) {
    (void)s, (void)counts;
    return 0;
}
int32_t compensation_heat_q20(const terrapin_state *s) {
    (void)s;
    return 0x100000;
}
int32_t uncertainty_unm(const terrapin_state *s) {
    (void)s;
    return 0;
}

void setUp(void) {
    memset(&state, 0, sizeof state);
    memset(&inputs, 0, sizeof inputs);
    state.supervisor.state = TERRAPIN_STATE_RUN;
    state.supervisor.direction = 1;
}
void tearDown(void) {}

/* Of a swing rate that grew from nothing over the window, at an angle. */
static int32_t momentum(int32_t shell, int32_t swing, int16_t angle_mrad) {
    state.gains.window_slots = 20U;
    state.gains.swing_q20 = 1 << 20;
    state.parameter[TERRAPIN_PARAMETER_INERTIA_SHELL] = shell;
    state.parameter[TERRAPIN_PARAMETER_INERTIA_SWING] = swing;
    state.estimator.newest = 100U;
    state.estimator.slots = 100U;
    state.estimator.swing_ticks = 10000U;
    state.estimator.swing_angle_mrad = angle_mrad;
    state.history[100].swing_sum_centirad_s = 4096U; /* the records before have none */
    return swing_momentum(&state);
}

/* J_s - J_w cos(angle): the body hanging below takes its own part, at a right angle none, upside down it adds. */
static void test_the_swing_s_momentum_is_of_both_inertias(void) {
    TEST_ASSERT_INT32_WITHIN(1, 3000, momentum(5000, 2000, 0));
    TEST_ASSERT_INT32_WITHIN(2, 5000, momentum(5000, 2000, 1571));
    TEST_ASSERT_INT32_WITHIN(2, 7000, momentum(5000, 2000, 3142));
    TEST_ASSERT_INT32_WITHIN(1, 5000, momentum(5000, 0, 0));
    TEST_ASSERT_INT32_WITHIN(1, 2000, momentum(0, 2000, 0));
    state.estimator.swing_ticks = ((20U + SWING_SLOTS) * RECORD_MS) - 1U; /* not seen for the whole window */
    TEST_ASSERT_EQUAL(0, swing_momentum(&state));
}

/* Far behind where it began, on the slope that stopped it. */
static void test_backing_out_ends_on_a_flatter_place_if_that_is_known(void) {
    state.supervisor.dig_ground_counts = 1000U;
    state.sense.ground_position = 900U;
    state.rates.margin_counts = 50;
    state.supervisor.stuck_pitch_mrad = 100;
    inputs.pitch_mrad = 90;
    inputs.pitch_valid = true;
    TEST_ASSERT_FALSE(backed_out(&state, &inputs));
    inputs.pitch_valid = false; /* what stands there is nothing */
    TEST_ASSERT_TRUE(backed_out(&state, &inputs));
    inputs.pitch_valid = true;
    inputs.pitch_mrad = -50;
    TEST_ASSERT_TRUE(backed_out(&state, &inputs));
    inputs.pitch_mrad = 51;
    TEST_ASSERT_FALSE(backed_out(&state, &inputs));
    inputs.pitch_valid = false;
    state.sense.ground_position = 951U;
    TEST_ASSERT_FALSE_MESSAGE(backed_out(&state, &inputs), "not far enough");
}

static void test_a_pitch_that_is_not_measured_is_not_kept(void) {
    inputs.pitch_mrad = 77;
    inputs.pitch_valid = true;
    extrication_start(&state, &inputs, 1);
    TEST_ASSERT_EQUAL_INT32(77, state.supervisor.stuck_pitch_mrad);
    setUp();
    inputs.pitch_mrad = 77;
    extrication_start(&state, &inputs, -1);
    TEST_ASSERT_EQUAL_INT32(0, state.supervisor.stuck_pitch_mrad);
    TEST_ASSERT_EQUAL_INT32(-1, state.supervisor.direction);
    TEST_ASSERT_EQUAL(TERRAPIN_STATE_STUCK, state.supervisor.state);
    TEST_ASSERT_EQUAL_MESSAGE(DOUBT_TICKS, state.slip.doubt_ticks, "the current did not bear it out");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_swing_s_momentum_is_of_both_inertias);
    RUN_TEST(test_backing_out_ends_on_a_flatter_place_if_that_is_known);
    RUN_TEST(test_a_pitch_that_is_not_measured_is_not_kept);
    return UNITY_END();
}
