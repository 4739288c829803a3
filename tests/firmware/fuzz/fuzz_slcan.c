/* Fuzz target: any bytes through the SLCAN parser, any frame that comes out through the dispatcher, the step and the
 * SLCAN encoder. Checked beyond the sanitizers: frames are well-formed, replies end in CR or BEL, and what the encoder
 * writes the parser reads back. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "dispatch.h"
#include "slcan.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void check_round_trip(const terrapin_frame *frame) {
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX];
    terrapin_slcan parser;
    terrapin_slcan_reply reply;
    terrapin_frame again = {0};
    terrapin_slcan_event event = TERRAPIN_SLCAN_MORE;
    const size_t length = terrapin_slcan_encode(frame, text);
    CHECK((length == (6U + (2U * (size_t)frame->length))) && (length <= TERRAPIN_SLCAN_TEXT_MAX));
    terrapin_slcan_init(&parser);
    parser.open = true;
    for (size_t i = 0; i < length; i++) {
        CHECK(event == TERRAPIN_SLCAN_MORE);
        event = terrapin_slcan_feed(&parser, text[i], &again, &reply);
    }
    CHECK((event == TERRAPIN_SLCAN_FRAME) && (again.id == frame->id) && (again.length == frame->length) &&
          (memcmp(again.data, frame->data, frame->length) == 0));
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static terrapin_state *state;
    terrapin_slcan parser;
    terrapin_link link;
    terrapin_inputs inputs;
    terrapin_outputs outputs;
    if (state == NULL) {
        state = malloc(terrapin_state_size());
        CHECK(state != NULL);
    }
    terrapin_slcan_init(&parser);
    terrapin_link_init(&link, state, &inputs);
    for (size_t i = 0; i < size; i++) {
        terrapin_frame frame;
        terrapin_frame answer;
        terrapin_slcan_reply reply;
        const terrapin_slcan_event event = terrapin_slcan_feed(&parser, bytes[i], &frame, &reply);
        CHECK(parser.length <= TERRAPIN_SLCAN_LINE_MAX);
        if (event == TERRAPIN_SLCAN_MORE) {
            continue;
        }
        CHECK((reply.length >= 1U) && (reply.length <= TERRAPIN_SLCAN_REPLY_MAX));
        const uint8_t end = reply.text[reply.length - 1U];
        CHECK((end == (uint8_t)'\r') || (end == (uint8_t)'\a'));
        if (event == TERRAPIN_SLCAN_FRAME) {
            CHECK(parser.open && (frame.id <= 0x7FFU) && (frame.length <= 8U));
            check_round_trip(&frame);
            const terrapin_accept_result result = terrapin_accept(&link, state, &frame, &inputs, &answer);
            if (result == TERRAPIN_ACCEPT_REPLY) {
                check_round_trip(&answer);
            } else if (result == TERRAPIN_ACCEPT_STEP) {
                CHECK(link.test_mode && !terrapin_link_bridge_allowed(&link));
                terrapin_link_step(state, &inputs, &outputs);
                CHECK((outputs.frame_count >= 1U) && (outputs.frame_count <= TERRAPIN_MAX_FRAMES));
                check_round_trip(&outputs.frames[0]);
            } else {
                /* dropped, or taken without an answer */
            }
        }
    }
    return 0;
}
