/* The dispatcher of a production image: TEST_MODE and SENSORS_* change nothing, and are counted. */
#include <string.h>

#include "unity.h"

#define TERRAPIN_PRODUCTION
#include "chaskey.c"
#include "command.c"
#include "dispatch.c"
#include "genuine.c"
#include "node.c"
#include "seal.c"
#include "terrapin_interface.c"

struct terrapin_state {
    uint32_t calls; /* of anything that may change the controller */
};

static terrapin_state state;
static terrapin_link link;
static terrapin_inputs inputs;

terrapin_parameter_result terrapin_init_with(terrapin_state *s, const int32_t *values) {
    (void)values;
    s->calls++;
    return TERRAPIN_PARAMETER_OK;
}

void terrapin_step_drive(terrapin_state *s, const terrapin_inputs *in, terrapin_outputs *out) {
    (void)in;
    (void)out;
    s->calls++;
}

void terrapin_step_think(terrapin_state *s, const terrapin_inputs *in, terrapin_outputs *out) {
    (void)in;
    (void)out;
    s->calls++;
}

terrapin_parameter_result terrapin_parameter_set(terrapin_state *s, uint16_t index, int32_t value) {
    (void)index;
    (void)value;
    s->calls++;
    return TERRAPIN_PARAMETER_OK;
}

terrapin_parameter_result terrapin_parameter_get(const terrapin_state *s, uint16_t index, int32_t *value) {
    (void)s;
    (void)index;
    *value = 0;
    return TERRAPIN_PARAMETER_OK;
}

terrapin_parameter_result terrapin_parameter_set_all(terrapin_state *s, const int32_t *values) {
    (void)values;
    s->calls++;
    return TERRAPIN_PARAMETER_OK;
}

void terrapin_latch(terrapin_state *s, uint32_t faults) {
    (void)faults;
    s->calls++;
}

uint32_t terrapin_latched(const terrapin_state *s) {
    (void)s;
    return 0U;
}

bool terrapin_bridge_on(const terrapin_state *s) {
    (void)s;
    return false;
}

bool terrapin_store_differs(const struct terrapin_store *store, const terrapin_state *s) {
    (void)store;
    (void)s;
    return false;
}

bool terrapin_store_save(struct terrapin_store *store, const terrapin_state *s) {
    (void)store;
    (void)s;
    return false;
}

bool terrapin_store_work(struct terrapin_store *store, bool may_erase) {
    (void)store;
    (void)may_erase;
    return false;
}

void setUp(void) {
    terrapin_link_init(&link, &state, &inputs);
}

void tearDown(void) {}

static void test_test_mode_and_sensors_change_nothing_and_are_counted(void) {
    static const uint16_t ids[] = {TERRAPIN_ID_TEST_MODE, TERRAPIN_ID_SENSORS_SLOW, TERRAPIN_ID_SENSORS_HEADING,
                                   TERRAPIN_ID_SENSORS_FAST};
    const terrapin_inputs before = inputs;
    terrapin_link link_before = link;
    const uint32_t calls = state.calls;
    terrapin_frame arm = {0};
    terrapin_frame reply = {0};
    const terrapin_test_mode_t message = {.key = (uint32_t)TERRAPIN_TEST_MODE_KEY};
    TEST_ASSERT_TRUE(terrapin_encode_test_mode(&message, &arm));
    for (uint32_t i = 0; i < 1000U; i++) {
        terrapin_frame frame = {.id = ids[i % 4U], .length = 8U};
        if (frame.id == arm.id) {
            frame = arm;
            terrapin_e2e_protect(&frame, i / 4U);
        }
        TEST_ASSERT_EQUAL(TERRAPIN_ACCEPT_NOTHING, terrapin_accept(&link, &state, &frame, &inputs, &reply));
    }
    link_before.out_of_place = 1000U;
    TEST_ASSERT_EQUAL_MEMORY(&link_before, &link, sizeof link);
    TEST_ASSERT_EQUAL_MEMORY(&before, &inputs, sizeof inputs);
    TEST_ASSERT_EQUAL(calls, state.calls);
    TEST_ASSERT_TRUE(terrapin_link_bridge_allowed(&link));
}

static void test_says_of_which_kind_it_is(void) {
    TEST_ASSERT_EQUAL_MEMORY("terrapin-kind\0\0", terrapin_link_mark.name, sizeof terrapin_link_mark.name);
    TEST_ASSERT_EQUAL(TERRAPIN_IMAGE_KIND_PRODUCTION, terrapin_link_mark.kind);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_test_mode_and_sensors_change_nothing_and_are_counted);
    RUN_TEST(test_says_of_which_kind_it_is);
    return UNITY_END();
}
