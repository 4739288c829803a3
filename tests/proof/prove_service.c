/* The serial lines of controller and boot loader: any byte. What is answered fits in the answer. Of the parser and the
 * encoder is taken what the proof `slcan` shows, of the others what their headers say. */
#include "proof.h"

#include "serial.c"
#include "service.c"

static terrapin_service service;
static terrapin_boot_serial serial;

terrapin_slcan_event terrapin_slcan_feed(terrapin_slcan *parser, uint8_t byte, terrapin_frame *frame,
                                         terrapin_slcan_reply *reply) {
    (void)parser;
    (void)byte;
    ANYTHING(*frame);
    ANYTHING(*reply);
    ASSUME((frame->id <= 0x7FFU) && (frame->length <= 8U));
    ASSUME((reply->length >= 1U) && (reply->length <= TERRAPIN_SLCAN_REPLY_MAX));
    return (terrapin_slcan_event)(nondet_byte() % 3U);
}

size_t terrapin_slcan_encode(const terrapin_frame *frame, uint8_t text[TERRAPIN_SLCAN_TEXT_MAX]) {
    PROVE(__CPROVER_r_ok(frame, sizeof *frame) && __CPROVER_w_ok(text, TERRAPIN_SLCAN_TEXT_MAX));
    const uint8_t length = nondet_byte();
    ASSUME(length <= TERRAPIN_SLCAN_TEXT_MAX);
    return length;
}

terrapin_accept_result terrapin_accept(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                       terrapin_inputs *inputs, terrapin_frame *reply) {
    (void)link;
    (void)state;
    (void)frame;
    (void)inputs;
    ANYTHING(*reply);
    return (terrapin_accept_result)(nondet_byte() % 4U);
}

void terrapin_link_step(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs) {
    (void)state;
    (void)inputs;
    ANYTHING(*outputs);
    ASSUME(outputs->frame_count <= TERRAPIN_MAX_FRAMES); /* asserted in service.c */
}

bool terrapin_link_store_work(terrapin_link *link, const terrapin_state *state) {
    (void)link;
    (void)state;
    return nondet_bool();
}

bool terrapin_node_receive(const terrapin_node *node, terrapin_frame *frame) {
    PROVE(__CPROVER_r_ok(node, sizeof *node) && __CPROVER_w_ok(frame, sizeof *frame));
    return nondet_bool();
}

void terrapin_node_send(const terrapin_node *node, terrapin_frame *frame) {
    PROVE(__CPROVER_r_ok(node, sizeof *node) && __CPROVER_w_ok(frame, sizeof *frame));
}

uint32_t terrapin_update_accept(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                                terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]) {
    (void)update;
    (void)frame;
    (void)motor_on;
    PROVE(__CPROVER_w_ok(replies, TERRAPIN_UPDATE_REPLIES * sizeof *replies));
    return nondet_byte() % (TERRAPIN_UPDATE_REPLIES + 1U); /* proof `update` */
}

int main(void) {
    if (nondet_bool()) {
        uint8_t answer[TERRAPIN_SERVICE_ANSWER_MAX];
        ANYTHING(service);
        PROVE(terrapin_service_take(&service, nondet_byte(), answer) <= sizeof answer);
    } else {
        uint8_t answer[TERRAPIN_BOOT_SERIAL_ANSWER_MAX];
        ANYTHING(serial);
        PROVE(terrapin_boot_serial_take(&serial, nondet_byte(), nondet_bool(), answer) <= sizeof answer);
    }
    return 0;
}
