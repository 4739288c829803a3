/* Which of several controllers on one bus this is: its identifiers, and how it gets another number.
 *
 * All of the firmware speaks the identifiers of node 0, those of controller.toml. A port changes them at its edge:
 *
 *     terrapin_node_init(&node, number);
 *     each received frame:   if (terrapin_node_receive(&node, &frame)) it is for this controller
 *     each frame to send:    terrapin_node_send(&node, &frame)
 *
 * The CRC of a protected message is over the identifier on the bus, so that no frame passes for another node's, and is
 * changed with it: what was damaged stays so. At node 0 nothing changes.
 *
 * The number is a port's own (the F405's stands in the boot loader's records, a process's beside its parameters), and
 * is read once, at the start. NODE_REQUEST of controller.toml asks for it and stores another.
 */
#ifndef TERRAPIN_NODE_H
#define TERRAPIN_NODE_H

#include "terrapin_interface.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint8_t number;                       /* below TERRAPIN_NODES */
    uint8_t shift[TERRAPIN_BLOCK_COUNT];  /* what the CRC of a message of the block changes by */
    uint16_t first[TERRAPIN_BLOCK_COUNT]; /* identifier of the block on the bus */
} terrapin_node;

/* What a receiver lets through: identifiers for which (received ^ id) & mask is 0. */
typedef struct {
    uint16_t id;
    uint16_t mask;
} terrapin_filter;

/* Who a controller says that it is, and where it keeps its number. */
typedef struct {
    uint32_t unique;                            /* tells it from all others; 0: it cannot be told */
    uint8_t node;                               /* in use */
    uint8_t stored;                             /* from the next start on */
    bool (*store)(void *context, uint8_t node); /* false: it failed; NULL: there is no place for it */
    void *context;
    uint8_t request_counter; /* E2E counter of the last NODE_REQUEST */
    uint8_t reply_counter;   /* of the next NODE_STATUS */
} terrapin_identity;

/* A number that no node has is taken for 0. */
TERRAPIN_API void terrapin_node_init(terrapin_node *node, uint8_t number);

/* False when the frame is none for this node, and it is as it was. Otherwise it has the identifier of node 0. */
TERRAPIN_API bool terrapin_node_receive(const terrapin_node *node, terrapin_frame *frame);

/* Give a frame with an identifier of node 0 this node's. */
TERRAPIN_API void terrapin_node_send(const terrapin_node *node, terrapin_frame *frame);

/* The filters for everything that a controller receives, and nothing else. */
TERRAPIN_API void terrapin_node_filters(const terrapin_node *node, terrapin_filter filters[TERRAPIN_BLOCK_RECEIVED]);

/* At the start. */
TERRAPIN_API void terrapin_identity_init(terrapin_identity *identity, uint32_t unique, uint8_t node);

/* A NODE_REQUEST: true when *reply is to be sent. A damaged or repeated one has no answer. */
TERRAPIN_API bool terrapin_identity_accept(terrapin_identity *identity, const terrapin_frame *frame, bool bridge_on,
                                           terrapin_frame *reply);

#ifdef __cplusplus
}
#endif
#endif
