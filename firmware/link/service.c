#include "service.h"

#include "terrapin_assert.h"

#include <string.h>

void terrapin_service_init(terrapin_service *service, terrapin_state *state) {
    TERRAPIN_ASSERT((service != NULL) && (state != NULL));
    (void)memset(service, 0, sizeof *service);
    service->state = state;
    terrapin_slcan_init(&service->parser);
    terrapin_link_init(&service->link, state, &service->inputs);
    terrapin_node_init(&service->node, 0U);
}

void terrapin_service_use_store(terrapin_service *service, struct terrapin_store *store) {
    terrapin_link_use_store(&service->link, service->state, store);
}

void terrapin_service_use_identity(terrapin_service *service, terrapin_identity *identity) {
    TERRAPIN_ASSERT((service != NULL) && (identity != NULL));
    service->link.identity = identity;
    terrapin_node_init(&service->node, identity->node);
}

/* A frame of ours as text, with this node's identifier. */
static size_t encode(const terrapin_service *service, const terrapin_frame *frame, uint8_t *text) {
    terrapin_frame sent = *frame;
    terrapin_node_send(&service->node, &sent);
    return terrapin_slcan_encode(&sent, text);
}

static size_t take_frame(terrapin_service *service, terrapin_frame *frame, uint8_t *answer) {
    size_t length = 0;
    terrapin_frame reply = {0};
    if (!terrapin_node_receive(&service->node, frame)) {
        service->link.unknown++;
        return 0;
    }
    switch (terrapin_accept(&service->link, service->state, frame, &service->inputs, &reply)) {
    case TERRAPIN_ACCEPT_REPLY:
        length = encode(service, &reply, answer);
        break;
    case TERRAPIN_ACCEPT_STEP:
        terrapin_link_step(service->state, &service->inputs, &service->outputs);
        service->ticks++;
        TERRAPIN_ASSERT(service->outputs.frame_count <= (uint8_t)TERRAPIN_MAX_FRAMES);
        for (uint8_t i = 0; i < service->outputs.frame_count; i++) {
            length += encode(service, &service->outputs.frames[i], &answer[length]);
        }
        break;
    case TERRAPIN_ACCEPT_NOTHING:
    default:
        break;
    }
    (void)terrapin_link_store_work(&service->link, service->state);
    TERRAPIN_ASSERT(length <= ((size_t)TERRAPIN_MAX_FRAMES * TERRAPIN_SLCAN_TEXT_MAX));
    return length;
}

size_t terrapin_service_take(terrapin_service *service, uint8_t byte, uint8_t answer[TERRAPIN_SERVICE_ANSWER_MAX]) {
    terrapin_frame frame = {0};
    terrapin_slcan_reply reply = {0};
    size_t length = 0;
    const terrapin_slcan_event event = terrapin_slcan_feed(&service->parser, byte, &frame, &reply);
    if (event == TERRAPIN_SLCAN_FRAME) {
        length = take_frame(service, &frame, answer);
    }
    if (event != TERRAPIN_SLCAN_MORE) {
        (void)memcpy(&answer[length], reply.text, reply.length);
        length += reply.length;
    }
    TERRAPIN_ASSERT(length <= TERRAPIN_SERVICE_ANSWER_MAX);
    return length;
}
