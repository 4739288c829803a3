/* The SLCAN parser: any byte in any state that a parser can have. Its state stays such a one, what it answers fits, and
 * a frame that comes out is well-formed; so is the encoder's text. */
#include "proof.h"

#include "slcan.c"

int main(void) {
    terrapin_slcan parser;
    terrapin_frame frame;
    terrapin_slcan_reply reply;
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX];
    ANYTHING(parser);
    ANYTHING(frame);
    ANYTHING(reply);
    ASSUME(parser.length <= TERRAPIN_SLCAN_LINE_MAX); /* 0 from terrapin_slcan_init on, and proved below */
    const terrapin_slcan_event event = terrapin_slcan_feed(&parser, nondet_byte(), &frame, &reply);
    PROVE(parser.length <= TERRAPIN_SLCAN_LINE_MAX);
    if (event != TERRAPIN_SLCAN_MORE) {
        PROVE((reply.length >= 1U) && (reply.length <= TERRAPIN_SLCAN_REPLY_MAX));
    }
    if (event == TERRAPIN_SLCAN_FRAME) {
        PROVE(parser.open && (frame.id <= 0x7FFU) && (frame.length <= 8U));
        const size_t length = terrapin_slcan_encode(&frame, text);
        PROVE((length >= 1U) && (length <= TERRAPIN_SLCAN_TEXT_MAX));
    }
    return 0;
}
