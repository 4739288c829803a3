#include "node.h"

#include "terrapin_assert.h"

/* A row of [identifiers] of controller.toml. */
typedef struct {
    uint16_t first; /* of node 0 */
    uint16_t size;
    uint16_t node_1;
    uint16_t step;
    bool to_controller;
} terrapin_block;

static const terrapin_block blocks[TERRAPIN_BLOCK_COUNT] = TERRAPIN_BLOCKS;

static uint16_t first_of(const terrapin_block *block, uint8_t number) {
    uint32_t first = block->first;
    if (number > 0U) {
        first = (uint32_t)block->node_1 + (((uint32_t)number - 1U) * block->step);
    }
    return (uint16_t)first;
}

/* What stands between a block's identifiers at node 0 and at this one: the same bits for all of them, since blocks
 * begin at multiples of their size. */
static uint16_t difference(const terrapin_block *block, uint8_t number) {
    return (uint16_t)((uint32_t)block->first ^ first_of(block, number));
}

/* A CRC is linear: other bits of the identifier change it by the same, whatever the data. */
static uint8_t crc_of(uint16_t bits) {
    const uint8_t without[9] = {0};
    uint8_t with[9] = {0};
    with[0] = (uint8_t)(bits & 0xFFU);
    with[1] = (uint8_t)(bits >> 8U);
    const uint32_t shift = (uint32_t)terrapin_crc8(0U, with, sizeof with) ^ terrapin_crc8(0U, without, sizeof without);
    return (uint8_t)shift;
}

void terrapin_node_init(terrapin_node *node, uint8_t number) {
    TERRAPIN_ASSERT(node != NULL);
    node->number = (number < (uint8_t)TERRAPIN_NODES) ? number : 0U;
    for (uint32_t i = 0U; i < TERRAPIN_BLOCK_COUNT; i++) {
        node->shift[i] = crc_of(difference(&blocks[i], node->number));
    }
}

/* The block with an identifier of a node; TERRAPIN_BLOCK_COUNT when it is in none. */
static uint32_t block_with(uint8_t number, uint16_t id) {
    uint32_t found = TERRAPIN_BLOCK_COUNT;
    for (uint32_t i = 0U; i < TERRAPIN_BLOCK_COUNT; i++) {
        const uint32_t offset = (uint32_t)id ^ first_of(&blocks[i], number);
        if (offset < blocks[i].size) {
            found = i;
        }
    }
    return found;
}

/* `own` is the identifier at node 0, which says whether the message is protected. */
static void move(const terrapin_node *node, uint32_t block, uint16_t own, terrapin_frame *frame) {
    const uint32_t id = (uint32_t)frame->id ^ difference(&blocks[block], node->number);
    if (terrapin_e2e_protected(own)) {
        const uint32_t crc = (uint32_t)frame->data[7] ^ node->shift[block];
        frame->data[7] = (uint8_t)crc;
    }
    frame->id = (uint16_t)id;
}

bool terrapin_node_receive(const terrapin_node *node, terrapin_frame *frame) {
    TERRAPIN_ASSERT((node != NULL) && (frame != NULL) && (node->number < TERRAPIN_NODES));
    if (node->number == 0U) {
        return true;
    }
    const uint32_t block = block_with(node->number, frame->id);
    if (block < TERRAPIN_BLOCK_COUNT) {
        const uint32_t own = (uint32_t)frame->id ^ difference(&blocks[block], node->number);
        move(node, block, (uint16_t)own, frame);
    }
    return block < TERRAPIN_BLOCK_COUNT;
}

void terrapin_node_send(const terrapin_node *node, terrapin_frame *frame) {
    TERRAPIN_ASSERT((node != NULL) && (frame != NULL) && (node->number < TERRAPIN_NODES));
    if (node->number > 0U) {
        const uint32_t block = block_with(0U, frame->id);
        TERRAPIN_ASSERT(block == TERRAPIN_BLOCK_ANSWERS);
        move(node, block, frame->id, frame);
    }
}

terrapin_filter terrapin_node_filter(const terrapin_node *node, uint32_t block) {
    TERRAPIN_ASSERT((node != NULL) && (block < TERRAPIN_BLOCK_COUNT));
    const uint32_t mask = 0x7FFU & ~((uint32_t)blocks[block].size - 1U);
    const terrapin_filter filter = {.id = first_of(&blocks[block], node->number), .mask = (uint16_t)mask};
    return filter;
}

uint32_t terrapin_node_filters(const terrapin_node *node, terrapin_filter filters[TERRAPIN_BLOCK_COUNT]) {
    uint32_t count = 0U;
    for (uint32_t i = 0U; i < TERRAPIN_BLOCK_COUNT; i++) {
        if (blocks[i].to_controller) {
            filters[count] = terrapin_node_filter(node, i);
            count++;
        }
    }
    return count;
}

void terrapin_identity_init(terrapin_identity *identity, uint32_t unique, uint8_t node) {
    TERRAPIN_ASSERT(identity != NULL);
    const terrapin_identity fresh = {
        .unique = unique,
        .node = node,
        .stored = node,
        .request_counter = TERRAPIN_E2E_NO_COUNTER,
    };
    *identity = fresh;
}

/* Keep another number; a node_result. */
static int32_t store_number(terrapin_identity *identity, int32_t number, bool bridge_on) {
    int32_t result = TERRAPIN_NODE_RESULT_OK;
    if ((number < 0) || ((uint32_t)number >= TERRAPIN_NODES)) {
        result = TERRAPIN_NODE_RESULT_UNKNOWN;
    } else if (bridge_on) {
        result = TERRAPIN_NODE_RESULT_LOCKED;
    } else if (identity->store == NULL) {
        result = TERRAPIN_NODE_RESULT_NO_STORE;
    } else if (identity->store(identity->context, (uint8_t)number)) {
        identity->stored = (uint8_t)number;
    } else {
        result = TERRAPIN_NODE_RESULT_FAILED;
    }
    return result;
}

bool terrapin_identity_accept(terrapin_identity *identity, const terrapin_frame *frame, bool bridge_on,
                              terrapin_frame *reply) {
    TERRAPIN_ASSERT((identity != NULL) && (frame != NULL) && (reply != NULL));
    terrapin_node_request_t message;
    if ((terrapin_e2e_check(frame, &identity->request_counter) != TERRAPIN_E2E_OK) ||
        !terrapin_decode_node_request(frame, &message)) {
        return false;
    }
    int32_t result = TERRAPIN_NODE_RESULT_OK;
    if (message.action == TERRAPIN_NODE_ACTION_WRITE) {
        if (message.unique != identity->unique) {
            return false; /* another controller with this number is meant */
        }
        result = store_number(identity, message.node, bridge_on);
    } else if (message.action != TERRAPIN_NODE_ACTION_READ) {
        result = TERRAPIN_NODE_RESULT_UNKNOWN;
    } else {
        /* asked */
    }
    const terrapin_node_status_t answer = {
        .unique = identity->unique,
        .node = (int32_t)identity->node,
        .stored = (int32_t)identity->stored,
        .result = result,
    };
    (void)terrapin_encode_node_status(&answer, reply); /* cannot saturate: the fields have the signals' widths */
    TERRAPIN_ASSERT(identity->reply_counter <= TERRAPIN_E2E_COUNTER_MAX);
    terrapin_e2e_protect(reply, identity->reply_counter);
    identity->reply_counter =
        (identity->reply_counter < TERRAPIN_E2E_COUNTER_MAX) ? (uint8_t)(identity->reply_counter + 1U) : 0U;
    return true;
}
