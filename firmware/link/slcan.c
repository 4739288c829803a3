#include "slcan.h"

#include "terrapin_assert.h"

#define CR  0x0DU
#define LF  0x0AU
#define BEL 0x07U

#define STANDARD_ID_MAX 0x7FFU
#define EXTENDED_ID_MAX 0x1FFFFFFFU
#define NOT_HEX         0xFFU

typedef enum { VERDICT_DONE, VERDICT_FRAME, VERDICT_MALFORMED, VERDICT_REFUSED, VERDICT_FOREIGN } verdict;

/* Value of a hexadecimal digit, NOT_HEX when it is none. */
static uint8_t digit(uint8_t c) {
    uint8_t value = NOT_HEX;
    if ((c >= (uint8_t)'0') && (c <= (uint8_t)'9')) {
        value = (uint8_t)(c - (uint8_t)'0');
    } else if ((c >= (uint8_t)'A') && (c <= (uint8_t)'F')) {
        value = (uint8_t)(c - (uint8_t)'A' + 10U);
    } else if ((c >= (uint8_t)'a') && (c <= (uint8_t)'f')) {
        value = (uint8_t)(c - (uint8_t)'a' + 10U);
    } else {
        /* not a digit */
    }
    return value;
}

/* Read count digits (at most 8); false when one of them is none. */
static bool number(const uint8_t *text, size_t count, uint32_t *value) {
    TERRAPIN_ASSERT((count >= 1U) && (count <= 8U));
    uint32_t sum = 0U;
    bool good = true;
    for (size_t i = 0U; i < count; i++) {
        const uint8_t d = digit(text[i]);
        good = good && (d != NOT_HEX);
        sum = (sum << 4U) | (d & 0x0FU);
    }
    *value = sum;
    return good;
}

/* A line that starts with t, T, r or R. frame is written for t alone, and only when all of the line is good. */
static verdict parse_frame(const terrapin_slcan *parser, terrapin_frame *frame) {
    TERRAPIN_ASSERT((parser->length >= 1U) && (parser->length <= TERRAPIN_SLCAN_LINE_MAX));
    const uint8_t kind = parser->line[0];
    const bool extended = (kind == (uint8_t)'T') || (kind == (uint8_t)'R');
    const bool remote = (kind == (uint8_t)'r') || (kind == (uint8_t)'R');
    const uint8_t id_digits = extended ? 8U : 3U;
    const uint32_t start = 2U + (uint32_t)id_digits; /* of the data */
    uint32_t id = 0U;
    uint32_t length = 0U;
    uint8_t data[8] = {0};

    if ((parser->length < start) || !number(&parser->line[1], id_digits, &id) ||
        !number(&parser->line[1U + id_digits], 1U, &length)) {
        return VERDICT_MALFORMED;
    }
    if ((id > (extended ? EXTENDED_ID_MAX : STANDARD_ID_MAX)) || (length > 8U) ||
        (parser->length != (start + (remote ? 0U : (2U * length))))) {
        return VERDICT_MALFORMED;
    }
    for (size_t i = 0U; !remote && (i < length); i++) {
        uint32_t byte = 0U;
        if (!number(&parser->line[start + (2U * i)], 2U, &byte)) {
            return VERDICT_MALFORMED;
        }
        data[i] = (uint8_t)byte;
    }
    if (remote || !parser->open) {
        return VERDICT_REFUSED;
    }
    if (extended) {
        return VERDICT_FOREIGN;
    }
    frame->id = (uint16_t)id;
    frame->length = (uint8_t)length;
    for (size_t i = 0U; i < 8U; i++) {
        frame->data[i] = data[i];
    }
    return VERDICT_FRAME;
}

/* text has at most TERRAPIN_SLCAN_REPLY_MAX - 1 characters: the end of the line follows. */
static void answer(terrapin_slcan_reply *reply, const char *text) {
    uint8_t n = 0U;
    while (text[n] != '\0') {
        TERRAPIN_ASSERT(n < (TERRAPIN_SLCAN_REPLY_MAX - 1U));
        reply->text[n] = (uint8_t)text[n];
        n++;
    }
    reply->length = n;
}

static verdict set_open(terrapin_slcan *parser, bool open) {
    /* Closing twice is allowed: hosts close first, to begin from a known state. */
    const bool refused = open && parser->open;
    parser->open = open;
    return refused ? VERDICT_REFUSED : VERDICT_DONE;
}

/* A command of one letter and at most one digit. The bit rate is taken and has no effect: a serial line has its own. */
static verdict parse_command(terrapin_slcan *parser, terrapin_slcan_reply *reply) {
    TERRAPIN_ASSERT((parser->length >= 1U) && (reply->length == 0U));
    const uint8_t argument = (parser->length == 2U) ? digit(parser->line[1]) : NOT_HEX;
    const bool bare = parser->length == 1U;
    verdict result = VERDICT_MALFORMED;
    switch (parser->line[0]) {
    case (uint8_t)'O':
        result = bare ? set_open(parser, true) : VERDICT_MALFORMED;
        break;
    case (uint8_t)'C':
        result = bare ? set_open(parser, false) : VERDICT_MALFORMED;
        break;
    case (uint8_t)'S':
        if (argument <= 8U) {
            result = parser->open ? VERDICT_REFUSED : VERDICT_DONE;
        }
        break;
    case (uint8_t)'Z': /* time stamps: off is all there is */
        if (argument <= 1U) {
            result = (argument == 1U) ? VERDICT_REFUSED : VERDICT_DONE;
        }
        break;
    case (uint8_t)'V':
        if (bare) {
            answer(reply, "V0101");
            result = VERDICT_DONE;
        }
        break;
    case (uint8_t)'N':
        if (bare) {
            answer(reply, "NTRPN");
            result = VERDICT_DONE;
        }
        break;
    case (uint8_t)'F': /* status flags: the line has no error counters */
        if (bare) {
            answer(reply, "F00");
            result = VERDICT_DONE;
        }
        break;
    case (uint8_t)'L': /* listen only: a controller that may not answer is of no use */
        result = bare ? VERDICT_REFUSED : VERDICT_MALFORMED;
        break;
    case (uint8_t)'s': /* bit timing and acceptance filters: there is no CAN chip behind this line */
    case (uint8_t)'M':
    case (uint8_t)'m':
        result = VERDICT_REFUSED;
        break;
    default:
        result = VERDICT_MALFORMED;
        break;
    }
    return result;
}

static verdict parse_line(terrapin_slcan *parser, terrapin_frame *frame, terrapin_slcan_reply *reply) {
    verdict result = VERDICT_DONE; /* an empty line: hosts send some to clear what an earlier one left behind */
    if (parser->overlong) {
        result = VERDICT_MALFORMED;
    } else if (parser->length > 0U) {
        switch (parser->line[0]) {
        case (uint8_t)'t':
        case (uint8_t)'T':
        case (uint8_t)'r':
        case (uint8_t)'R':
            result = parse_frame(parser, frame);
            break;
        default:
            result = parse_command(parser, reply);
            break;
        }
    } else {
        /* empty */
    }
    return result;
}

void terrapin_slcan_init(terrapin_slcan *parser) {
    parser->length = 0U;
    parser->overlong = false;
    parser->open = false;
    parser->malformed = 0U;
    parser->refused = 0U;
    parser->foreign = 0U;
}

terrapin_slcan_event terrapin_slcan_feed(terrapin_slcan *parser, uint8_t byte, terrapin_frame *frame,
                                         terrapin_slcan_reply *reply) {
    TERRAPIN_ASSERT(parser->length <= TERRAPIN_SLCAN_LINE_MAX);
    if (byte != CR) {
        if ((byte == LF) && (parser->length == 0U)) {
            /* some terminals send CR LF */
        } else if (parser->length < TERRAPIN_SLCAN_LINE_MAX) {
            parser->line[parser->length] = byte;
            parser->length++;
        } else {
            parser->overlong = true;
        }
        return TERRAPIN_SLCAN_MORE;
    }

    reply->length = 0U;
    const verdict result = parse_line(parser, frame, reply);
    TERRAPIN_ASSERT(reply->length < TERRAPIN_SLCAN_REPLY_MAX);
    TERRAPIN_ASSERT((result != VERDICT_FRAME) || ((frame->id <= STANDARD_ID_MAX) && (frame->length <= 8U)));
    const bool good = (result == VERDICT_DONE) || (result == VERDICT_FRAME) || (result == VERDICT_FOREIGN);
    reply->text[reply->length] = good ? CR : BEL;
    reply->length++;
    parser->malformed += (result == VERDICT_MALFORMED) ? 1U : 0U;
    parser->refused += (result == VERDICT_REFUSED) ? 1U : 0U;
    parser->foreign += (result == VERDICT_FOREIGN) ? 1U : 0U;
    parser->length = 0U;
    parser->overlong = false;
    return (result == VERDICT_FRAME) ? TERRAPIN_SLCAN_FRAME : TERRAPIN_SLCAN_DONE;
}

/* The digit of the low half of a byte. */
static uint8_t hex(uint32_t value) {
    static const char digits[] = "0123456789ABCDEF";
    return (uint8_t)digits[value & 0x0FU];
}

size_t terrapin_slcan_encode(const terrapin_frame *frame, uint8_t text[TERRAPIN_SLCAN_TEXT_MAX]) {
    size_t n = 0U;
    if ((frame->id <= STANDARD_ID_MAX) && (frame->length <= 8U)) {
        text[0] = (uint8_t)'t';
        text[1] = hex((uint32_t)frame->id >> 8U);
        text[2] = hex((uint32_t)frame->id >> 4U);
        text[3] = hex(frame->id);
        text[4] = hex(frame->length);
        n = 5U;
        for (size_t i = 0U; i < frame->length; i++) {
            text[n] = hex((uint32_t)frame->data[i] >> 4U);
            text[n + 1U] = hex(frame->data[i]);
            n += 2U;
        }
        text[n] = CR;
        n++;
    }
    TERRAPIN_ASSERT(n <= TERRAPIN_SLCAN_TEXT_MAX);
    return n;
}
