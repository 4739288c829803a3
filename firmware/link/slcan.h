/* SLCAN (the ASCII protocol of Lawicel's adapters): CAN frames as text over a serial line.
 *
 *     for each received byte:
 *         switch (terrapin_slcan_feed(&parser, byte, &frame, &reply)) ...
 *
 * The parser keeps one line of bounded length and no more; bytes may come in any portions. It answers every line: "\r"
 * for done, "\a" for refused. Frames are classic CAN with 11-bit identifiers; extended frames are well-formed traffic
 * that is not for this controller (acknowledged, counted, dropped), remote frames are refused.
 */
#ifndef TERRAPIN_SLCAN_H
#define TERRAPIN_SLCAN_H

#include "terrapin.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_SLCAN_LINE_MAX  32U /* longest line kept, terminator not counted; a longer one is refused */
#define TERRAPIN_SLCAN_REPLY_MAX 6U  /* longest answer to a line */
#define TERRAPIN_SLCAN_TEXT_MAX  22U /* longest frame as text: t, 3 digits, length, 16 digits, \r */

typedef struct {
    uint8_t line[TERRAPIN_SLCAN_LINE_MAX];
    uint8_t length;
    bool overlong;      /* the line did not fit; it is refused at its end */
    bool open;          /* O was received; frames are taken only then */
    uint32_t malformed; /* lines that are no SLCAN; wraps, like the others */
    uint32_t refused;   /* good SLCAN that this controller does not do: remote frames, frames while closed, ... */
    uint32_t foreign;   /* extended frames */
} terrapin_slcan;

typedef struct {
    uint8_t length;
    uint8_t text[TERRAPIN_SLCAN_REPLY_MAX];
} terrapin_slcan_reply;

typedef enum {
    TERRAPIN_SLCAN_MORE = 0, /* line not complete; neither frame nor reply was written */
    TERRAPIN_SLCAN_DONE = 1, /* a line was handled: send reply */
    TERRAPIN_SLCAN_FRAME = 2 /* a frame arrived: handle it, then send reply (so the reply closes the answers to it) */
} terrapin_slcan_event;

/* Reset: closed, line empty, counters 0. */
TERRAPIN_API void terrapin_slcan_init(terrapin_slcan *parser);

/* Take one byte. */
TERRAPIN_API terrapin_slcan_event terrapin_slcan_feed(terrapin_slcan *parser, uint8_t byte, terrapin_frame *frame,
                                                      terrapin_slcan_reply *reply);

/* Write a frame as text with its "\r" (no terminating zero); the number of bytes, at most TERRAPIN_SLCAN_TEXT_MAX.
 * frame->id must be below 0x800 and frame->length at most 8; 0 and nothing written otherwise. */
TERRAPIN_API size_t terrapin_slcan_encode(const terrapin_frame *frame, uint8_t text[TERRAPIN_SLCAN_TEXT_MAX]);

#ifdef __cplusplus
}
#endif
#endif
