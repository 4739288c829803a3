/* Identifiers of several controllers on one bus, and how one gets another number. */
#include <string.h>

#include "unity.h"

#include "node.h"

#define IDENTIFIERS 0x800U

static terrapin_node nodes[TERRAPIN_NODES];
static uint32_t seed;

void setUp(void) {
    seed = 1U;
    for (uint8_t i = 0; i < TERRAPIN_NODES; i++) {
        terrapin_node_init(&nodes[i], i);
        TEST_ASSERT_EQUAL(i, nodes[i].number);
    }
}

void tearDown(void) {}

static terrapin_frame noise(uint16_t id) {
    terrapin_frame frame = {.id = id, .length = 8U};
    for (size_t i = 0; i < 8U; i++) {
        seed = (seed * 1664525U) + 1013904223U;
        frame.data[i] = (uint8_t)(seed >> 24U);
    }
    return frame;
}

static void test_node_0_is_what_stood_before(void) {
    for (uint16_t id = 0; id < IDENTIFIERS; id++) {
        const terrapin_frame before = noise(id);
        terrapin_frame frame = before;
        TEST_ASSERT_TRUE(terrapin_node_receive(&nodes[0], &frame));
        TEST_ASSERT_EQUAL_MEMORY(&before, &frame, sizeof frame);
        terrapin_node_send(&nodes[0], &frame);
        TEST_ASSERT_EQUAL_MEMORY(&before, &frame, sizeof frame);
    }
    terrapin_node none;
    terrapin_node_init(&none, TERRAPIN_NODES);
    TEST_ASSERT_EQUAL_MEMORY(&nodes[0], &none, sizeof none);
}

/* Where a frame of node n stands on the bus, by the text of the plan and not by its table. */
static uint32_t planned(uint32_t node, uint32_t id) {
    uint32_t own = id;
    if ((id >= 0x080U) && (id < 0x090U) && (node > 0U)) {
        own = (0x010U * node) + (id & 0xFU);
    } else if ((id >= 0x0A0U) && (id < 0x0A8U) && (node > 0U)) {
        own = 0x140U + (8U * (node - 1U)) + (id & 7U);
    } else if ((id >= 0x100U) && (id < 0x108U)) {
        own = id + (8U * node);
    } else if ((id >= 0x180U) && (id < 0x1B0U)) {
        own = id + (0x40U * node);
    } else {
        /* broadcast */
    }
    return own;
}

static const uint16_t to_controller[] = {
    TERRAPIN_ID_STOP_ALL,     TERRAPIN_ID_COMMAND,       TERRAPIN_ID_PARAMETER_WRITE, TERRAPIN_ID_PARAMETER_READ,
    TERRAPIN_ID_TEST_MODE,    TERRAPIN_ID_STORE_COMMAND, TERRAPIN_ID_STORE_READ,      TERRAPIN_ID_NODE_REQUEST,
    TERRAPIN_ID_SENSORS_FAST, TERRAPIN_ID_SENSORS_SLOW,  TERRAPIN_ID_SENSORS_HEADING, TERRAPIN_ID_UPDATE_BEGIN,
    TERRAPIN_ID_UPDATE_DATA,  TERRAPIN_ID_UPDATE_BLOCK,  TERRAPIN_ID_UPDATE_END,      TERRAPIN_ID_UPDATE_QUERY,
    TERRAPIN_ID_UPDATE_RESET,
};
#define TO_CONTROLLER (sizeof to_controller / sizeof to_controller[0])

/* Of each identifier of the bus: the node takes it exactly when the plan says so, and as the message that it is. */
static void test_each_takes_its_own_and_no_other(void) {
    for (uint32_t n = 1; n < TERRAPIN_NODES; n++) {
        uint16_t own[IDENTIFIERS] = {0};
        bool known[IDENTIFIERS] = {false};
        for (uint16_t id = 0; id < 0x180U; id++) { /* its answers are no frames for it */
            const bool block = (id < 0x010U) || ((id >= 0x080U) && (id < 0x090U)) ||
                               ((id >= 0x0A0U) && (id < 0x0A8U)) || ((id >= 0x100U) && (id < 0x108U));
            if (block) {
                known[planned(n, id)] = true;
                own[planned(n, id)] = id;
            }
        }
        for (uint16_t id = 0; id < IDENTIFIERS; id++) {
            terrapin_frame frame = noise(id);
            const bool taken = terrapin_node_receive(&nodes[n], &frame);
            TEST_ASSERT_EQUAL_HEX16_MESSAGE(known[id], taken, "taken");
            TEST_ASSERT_EQUAL_HEX16(taken ? own[id] : id, frame.id);
        }
    }
}

static bool has_crc(uint16_t id) {
    static const uint16_t with[] = {TERRAPIN_ID_COMMAND,       TERRAPIN_ID_PARAMETER_WRITE, TERRAPIN_ID_TEST_MODE,
                                    TERRAPIN_ID_STORE_COMMAND, TERRAPIN_ID_NODE_REQUEST,    TERRAPIN_ID_UPDATE_BEGIN,
                                    TERRAPIN_ID_UPDATE_END,    TERRAPIN_ID_UPDATE_RESET};
    bool found = false;
    for (size_t i = 0; i < (sizeof with / sizeof with[0]); i++) {
        found = found || (id == with[i]);
    }
    return found;
}

/* What a host protects for the identifier on the bus is good at that node; the same frame for another is not. */
static void test_protection_is_over_the_identifier_on_the_bus(void) {
    for (uint32_t n = 0; n < TERRAPIN_NODES; n++) {
        for (size_t i = 0; i < TO_CONTROLLER; i++) {
            if (!has_crc(to_controller[i])) {
                continue;
            }
            terrapin_frame frame = noise((uint16_t)planned(n, to_controller[i]));
            terrapin_e2e_protect(&frame, 3U);
            terrapin_frame damaged = frame;
            damaged.data[2] ^= 0x10U;
            terrapin_frame strayed = frame;
            strayed.id = (uint16_t)planned((n + 1U) % TERRAPIN_NODES, to_controller[i]);
            uint8_t last = TERRAPIN_E2E_NO_COUNTER;
            TEST_ASSERT_TRUE(terrapin_node_receive(&nodes[n], &frame));
            TEST_ASSERT_EQUAL_HEX16(to_controller[i], frame.id);
            TEST_ASSERT_EQUAL(TERRAPIN_E2E_OK, terrapin_e2e_check(&frame, &last));
            last = TERRAPIN_E2E_NO_COUNTER;
            TEST_ASSERT_TRUE(terrapin_node_receive(&nodes[n], &damaged));
            TEST_ASSERT_EQUAL(TERRAPIN_E2E_BAD_CRC, terrapin_e2e_check(&damaged, &last));
            TEST_ASSERT_TRUE(terrapin_node_receive(&nodes[(n + 1U) % TERRAPIN_NODES], &strayed));
            TEST_ASSERT_EQUAL(TERRAPIN_E2E_BAD_CRC, terrapin_e2e_check(&strayed, &last));
        }
        terrapin_frame sent = noise(TERRAPIN_ID_ACTUATE);
        uint8_t last = TERRAPIN_E2E_NO_COUNTER;
        terrapin_e2e_protect(&sent, 7U);
        terrapin_node_send(&nodes[n], &sent);
        TEST_ASSERT_EQUAL_HEX16(0x180U + (0x40U * n), sent.id);
        TEST_ASSERT_EQUAL(TERRAPIN_E2E_OK, terrapin_e2e_check(&sent, &last));
        terrapin_frame plain = noise(TERRAPIN_ID_GROUND);
        const terrapin_frame before = plain;
        terrapin_node_send(&nodes[n], &plain);
        TEST_ASSERT_EQUAL_HEX8_ARRAY(before.data, plain.data, 8U);
    }
}

static void test_every_command_comes_before_all_telemetry(void) {
    for (uint32_t n = 0; n < TERRAPIN_NODES; n++) {
        TEST_ASSERT_GREATER_THAN(TERRAPIN_ID_STOP_ALL, planned(n, TERRAPIN_ID_COMMAND));
        for (uint32_t k = 0; k < TERRAPIN_NODES; k++) {
            TEST_ASSERT_LESS_THAN(planned(k, TERRAPIN_ID_ACTUATE), planned(n, TERRAPIN_ID_COMMAND));
        }
    }
}

/* In hardware: what passes is what the node takes, but for its own answers. */
static void test_filters_are_the_blocks(void) {
    for (uint32_t n = 0; n < TERRAPIN_NODES; n++) {
        terrapin_filter filters[TERRAPIN_BLOCK_RECEIVED];
        terrapin_node_filters(&nodes[n], filters);
        bool wanted[IDENTIFIERS] = {false};
        for (uint32_t id = 0; id < 0x180U; id++) {
            const bool block = (id < 0x010U) || ((id >= 0x080U) && (id < 0x090U)) ||
                               ((id >= 0x0A0U) && (id < 0x0A8U)) || ((id >= 0x100U) && (id < 0x108U));
            if (block) {
                wanted[planned(n, id)] = true;
            }
        }
        for (uint32_t id = 0; id < IDENTIFIERS; id++) {
            bool passes = false;
            for (uint32_t i = 0; i < TERRAPIN_BLOCK_RECEIVED; i++) {
                passes = passes || (((id ^ filters[i].id) & filters[i].mask) == 0U);
            }
            TEST_ASSERT_EQUAL_MESSAGE(wanted[id], passes, "passes");
        }
        TEST_ASSERT_EQUAL_HEX16(planned(n, 0x0A0U), nodes[n].first[TERRAPIN_BLOCK_UPDATES]);
    }
}

/* ---- NODE_REQUEST */

static uint8_t kept;
static bool refuse;

static bool keep(void *context, uint8_t node) {
    TEST_ASSERT_EQUAL_PTR(&kept, context);
    if (!refuse) {
        kept = node;
    }
    return !refuse;
}

static terrapin_frame request(uint32_t unique, int32_t node, int32_t action, uint32_t counter) {
    const terrapin_node_request_t message = {.unique = unique, .node = node, .action = action};
    terrapin_frame frame;
    (void)terrapin_encode_node_request(&message, &frame);
    terrapin_e2e_protect(&frame, counter);
    return frame;
}

static void expect(terrapin_identity *identity, const terrapin_frame *frame, bool bridge_on, int32_t stored,
                   int32_t result) {
    terrapin_frame reply = {0};
    terrapin_node_status_t answer;
    TEST_ASSERT_TRUE(terrapin_identity_accept(identity, frame, bridge_on, &reply));
    TEST_ASSERT_TRUE(terrapin_decode_node_status(&reply, &answer));
    TEST_ASSERT_EQUAL_HEX32(identity->unique, answer.unique);
    TEST_ASSERT_EQUAL(identity->node, answer.node);
    TEST_ASSERT_EQUAL(stored, answer.stored);
    TEST_ASSERT_EQUAL(result, answer.result);
}

static void test_asking_and_storing(void) {
    terrapin_identity identity;
    terrapin_frame reply;
    terrapin_identity_init(&identity, 0xCAFEF00DU, 2U);
    terrapin_frame frame = request(0U, 0, TERRAPIN_NODE_ACTION_READ, 0U);
    expect(&identity, &frame, true, 2, TERRAPIN_NODE_RESULT_OK);
    TEST_ASSERT_FALSE_MESSAGE(terrapin_identity_accept(&identity, &frame, false, &reply), "repeated");
    frame = request(0xCAFEF00DU, 5, TERRAPIN_NODE_ACTION_WRITE, 1U);
    expect(&identity, &frame, false, 2, TERRAPIN_NODE_RESULT_NO_STORE);
    identity.store = keep;
    identity.context = &kept;
    kept = 2U;
    frame = request(0xCAFEF00EU, 5, TERRAPIN_NODE_ACTION_WRITE, 2U);
    TEST_ASSERT_FALSE_MESSAGE(terrapin_identity_accept(&identity, &frame, false, &reply), "meant for another");
    frame = request(0xCAFEF00DU, 5, TERRAPIN_NODE_ACTION_WRITE, 3U);
    expect(&identity, &frame, true, 2, TERRAPIN_NODE_RESULT_LOCKED);
    frame = request(0xCAFEF00DU, (int32_t)TERRAPIN_NODES, TERRAPIN_NODE_ACTION_WRITE, 4U);
    expect(&identity, &frame, false, 2, TERRAPIN_NODE_RESULT_UNKNOWN);
    frame = request(0xCAFEF00DU, 5, 77, 5U);
    expect(&identity, &frame, false, 2, TERRAPIN_NODE_RESULT_UNKNOWN);
    refuse = true;
    frame = request(0xCAFEF00DU, 5, TERRAPIN_NODE_ACTION_WRITE, 6U);
    expect(&identity, &frame, false, 2, TERRAPIN_NODE_RESULT_FAILED);
    TEST_ASSERT_EQUAL(2, kept);
    refuse = false;
    frame = request(0xCAFEF00DU, 5, TERRAPIN_NODE_ACTION_WRITE, 7U);
    expect(&identity, &frame, false, 5, TERRAPIN_NODE_RESULT_OK);
    TEST_ASSERT_EQUAL(5, kept);
    frame = request(0xCAFEF00DU, 6, TERRAPIN_NODE_ACTION_WRITE, 8U);
    frame.data[4] ^= 1U;
    TEST_ASSERT_FALSE_MESSAGE(terrapin_identity_accept(&identity, &frame, false, &reply), "damaged");
    TEST_ASSERT_EQUAL(5, kept);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_node_0_is_what_stood_before);
    RUN_TEST(test_each_takes_its_own_and_no_other);
    RUN_TEST(test_protection_is_over_the_identifier_on_the_bus);
    RUN_TEST(test_every_command_comes_before_all_telemetry);
    RUN_TEST(test_filters_are_the_blocks);
    RUN_TEST(test_asking_and_storing);
    return UNITY_END();
}
