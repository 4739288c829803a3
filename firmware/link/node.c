#include "node.h"

#include "terrapin_assert.h"

/* A row of [identifiers] of controller.toml. */
typedef struct {
    uint16_t first; /* of node 0 */
    uint16_t node_1;
    uint16_t step;
    uint8_t size;          /* at most 64 */
    uint32_t protected[2]; /* a bit for each identifier: its message has a CRC */
} terrapin_block;

static const terrapin_block blocks[TERRAPIN_BLOCK_COUNT] = TERRAPIN_BLOCKS;

static uint8_t crc_of(uint16_t id) {
    terrapin_frame frame = {.id = id, .length = 8U};
    terrapin_e2e_protect(&frame, 0U);
    return frame.data[7];
}

void terrapin_node_init(terrapin_node *node, uint8_t number) {
    TERRAPIN_ASSERT(node != NULL);
    node->number = (number < (uint8_t)TERRAPIN_NODES) ? number : 0U;
    for (uint32_t i = 0U; i < TERRAPIN_BLOCK_COUNT; i++) {
        const terrapin_block *block = &blocks[i];
        uint32_t first = block->first;
        if (node->number > 0U) {
            first = (uint32_t)block->node_1 + (((uint32_t)node->number - 1U) * block->step);
        }
        node->first[i] = (uint16_t)first;
        /* A CRC is linear: other bits of the identifier change it by the same, whatever the data. */
        const uint32_t shift = (uint32_t)crc_of(block->first) ^ crc_of(node->first[i]);
        node->shift[i] = (uint8_t)shift;
    }
}

/* The low bit of `protected` says whether the frame has a CRC, which changes by `shift`. */
static inline void move(terrapin_frame *frame, uint32_t id, uint32_t protected, uint32_t shift) {
    if ((protected & 1U) != 0U) {
        const uint32_t crc = (uint32_t)frame->data[7] ^ shift;
        frame->data[7] = (uint8_t)crc;
    }
    frame->id = (uint16_t)id;
}

/* At another node than 0. Identifiers of a block differ in the same bits from node to node, since it begins at
 * multiples of its size. */
static bool received(const terrapin_node *node, terrapin_frame *frame) {
    const uint32_t id = frame->id;
    uint32_t i = 0U;
    while ((i < TERRAPIN_BLOCK_RECEIVED) && ((id ^ node->first[i]) >= blocks[i].size)) {
        i++;
    }
    if (i < TERRAPIN_BLOCK_RECEIVED) {
        TERRAPIN_ASSERT(blocks[i].size <= 32U);
        const uint32_t offset = id ^ node->first[i];
        move(frame, blocks[i].first ^ offset, blocks[i].protected[0] >> offset, node->shift[i]);
    }
    return i < TERRAPIN_BLOCK_RECEIVED;
}

bool terrapin_node_receive(const terrapin_node *node, terrapin_frame *frame) {
    TERRAPIN_ASSERT((node != NULL) && (frame != NULL) && (node->number < TERRAPIN_NODES));
    return (node->number == 0U) || received(node, frame);
}

void terrapin_node_send(const terrapin_node *node, terrapin_frame *frame) {
    TERRAPIN_ASSERT((node != NULL) && (frame != NULL) && (node->number < TERRAPIN_NODES));
    if (node->number > 0U) {
        const terrapin_block *block = &blocks[TERRAPIN_BLOCK_ANSWERS];
        const uint32_t offset = (uint32_t)frame->id ^ block->first;
        TERRAPIN_ASSERT(offset < block->size);
        move(frame, node->first[TERRAPIN_BLOCK_ANSWERS] ^ offset, block->protected[offset / 32U] >> (offset % 32U),
             node->shift[TERRAPIN_BLOCK_ANSWERS]);
    }
}

void terrapin_node_filters(const terrapin_node *node, terrapin_filter filters[TERRAPIN_BLOCK_RECEIVED]) {
    for (uint32_t i = 0U; i < TERRAPIN_BLOCK_RECEIVED; i++) {
        const uint32_t mask = 0x7FFU & ~((uint32_t)blocks[i].size - 1U);
        filters[i].id = node->first[i];
        filters[i].mask = (uint16_t)mask;
    }
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
