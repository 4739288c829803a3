/* The controller behind a serial line: bytes in, bytes out. What the ports that speak SLCAN are made of.
 *
 *     terrapin_service_init(&service, state);
 *     terrapin_service_use_identity(&service, &identity);       where it may be another node than 0
 *     for each received byte:
 *         send the terrapin_service_take(&service, byte, answer) bytes of answer
 *
 * It steps in test mode only, once a SENSORS_FAST (see dispatch.h); `outputs` are those of the last step.
 */
#ifndef TERRAPIN_SERVICE_H
#define TERRAPIN_SERVICE_H

#include "dispatch.h"
#include "node.h"
#include "slcan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Longest answer to one byte: the frames of a tick and the end of the line. */
#define TERRAPIN_SERVICE_ANSWER_MAX                                                                                    \
    (((uint32_t)TERRAPIN_MAX_FRAMES * TERRAPIN_SLCAN_TEXT_MAX) + TERRAPIN_SLCAN_REPLY_MAX)

typedef struct {
    terrapin_slcan parser;
    terrapin_link link;
    terrapin_node node;
    terrapin_inputs inputs;
    terrapin_outputs outputs; /* with the identifiers of node 0 */
    terrapin_state *state;    /* the caller's memory */
    uint32_t ticks;           /* steps taken; wraps */
} terrapin_service;

/* Reset of everything: line closed, outputs off, controller as after terrapin_init, node 0. */
TERRAPIN_API void terrapin_service_init(terrapin_service *service, terrapin_state *state);

/* Keep parameters in an open store (store/parameters.h), and take over those that it holds. Each frame taken, a tick or
 * not, then does a bounded piece of a save under way. */
TERRAPIN_API void terrapin_service_use_store(terrapin_service *service, struct terrapin_store *store);

/* Have the node number of an identity from now on, and answer NODE_REQUEST from it. */
TERRAPIN_API void terrapin_service_use_identity(terrapin_service *service, terrapin_identity *identity);

/* Take one byte and write what answers it; the number of bytes, at most TERRAPIN_SERVICE_ANSWER_MAX. */
TERRAPIN_API size_t terrapin_service_take(terrapin_service *service, uint8_t byte,
                                          uint8_t answer[TERRAPIN_SERVICE_ANSWER_MAX]);

#ifdef __cplusplus
}
#endif
#endif
