/* Which tick does what, of a robot whose window closes every third slot: with one a slot, as the robots here have it,
 * asking for it changes nothing. */
#include <stdio.h>
#include <string.h>

#include "unity.h"

#include "terrapin_interface.h"
#undef TERRAPIN_RECORD_INTERVAL
#define TERRAPIN_RECORD_INTERVAL 30

#include "schedule.c"

static terrapin_state state;
static terrapin_inputs inputs;
static char done[64];

static void note(const terrapin_state *s, const char *what) {
    TEST_ASSERT_EQUAL_PTR(&state, s);
    (void)snprintf(&done[strlen(done)], sizeof done - strlen(done), "%s ", what);
}

static void note_in(const terrapin_state *s, const terrapin_inputs *in, const char *what) {
    TEST_ASSERT_EQUAL_PTR(&inputs, in);
    note(s, what);
}

void estimator_tick(terrapin_state *s, const terrapin_inputs *in) {
    note_in(s, in, "tick");
}
void estimator_close(terrapin_state *s) {
    note(s, "close");
}
void estimator_open(terrapin_state *s, const terrapin_inputs *in) {
    note_in(s, in, "open");
}
void estimator_means(terrapin_state *s) {
    note(s, "means");
}
void estimator_acceleration(terrapin_state *s) {
    note(s, "acceleration");
}
void estimator_momentum(terrapin_state *s) {
    note(s, "momentum");
}
void estimator_friction_beyond(terrapin_state *s) {
    note(s, "friction");
}
void estimator_torque(terrapin_state *s) {
    note(s, "torque");
}
void estimator_gate(terrapin_state *s) {
    note(s, "gate");
}
void estimator_deviation(terrapin_state *s) {
    note(s, "deviation");
}
void ground_speed(terrapin_state *s) {
    note(s, "speed");
}
void ground_resistance(terrapin_state *s) {
    note(s, "resistance");
}
void ground_nearest(terrapin_state *s) {
    note(s, "nearest");
}
void ground_fit_work(terrapin_state *s) {
    note(s, "fit");
}
void calibration_work(terrapin_state *s) {
    note(s, "calibration");
}
void heading_slot(terrapin_state *s, const terrapin_inputs *in) {
    note_in(s, in, "heading");
}

void setUp(void) {}
void tearDown(void) {}

static const char *at(uint32_t tick) {
    done[0] = '\0';
    inputs.tick = tick;
    schedule_sense(&state, &inputs);
    schedule_work(&state, &inputs);
    return done;
}

static void test_each_tick_of_ten_has_its_work(void) {
    for (uint32_t slot = 0U; slot < 60U; slot += 10U) {
        const bool window = (slot % 30U) == 0U; /* the tick is 4, 34, 64: of each third slot */
        TEST_ASSERT_EQUAL_STRING("tick resistance ", at(slot));
        TEST_ASSERT_EQUAL_STRING("tick nearest ", at(slot + 1U));
        TEST_ASSERT_EQUAL_STRING("tick fit ", at(slot + 2U));
        TEST_ASSERT_EQUAL_STRING("tick fit heading ", at(slot + 3U));
        TEST_ASSERT_EQUAL_STRING(window ? "tick close fit open " : "tick fit ", at(slot + 4U));
        TEST_ASSERT_EQUAL_STRING("tick means calibration ", at(slot + 5U));
        TEST_ASSERT_EQUAL_STRING("tick acceleration speed calibration ", at(slot + 6U));
        TEST_ASSERT_EQUAL_STRING("tick momentum friction ", at(slot + 7U));
        TEST_ASSERT_EQUAL_STRING("tick torque ", at(slot + 8U));
        TEST_ASSERT_EQUAL_STRING("tick deviation gate ", at(slot + 9U));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_each_tick_of_ten_has_its_work);
    return UNITY_END();
}
