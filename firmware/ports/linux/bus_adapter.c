/* An SLCAN adapter on a serial port: the controller is its host. Frames go out as lines; what the adapter says is read
 * by the same parser that the ports with a serial line of their own use, its acknowledgements are skipped. */
#define _GNU_SOURCE /* cfmakeraw */

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#include "bus.h"

static const struct {
    unsigned int bitrate;
    char digit;
} speeds[] = {{10000, '0'},  {20000, '1'},  {50000, '2'},  {100000, '3'}, {125000, '4'},
              {250000, '5'}, {500000, '6'}, {800000, '7'}, {1000000, '8'}};

static char speed_digit(unsigned int bitrate) {
    for (size_t i = 0; i < (sizeof speeds / sizeof speeds[0]); i++) {
        if (speeds[i].bitrate == bitrate) {
            return speeds[i].digit;
        }
    }
    return '\0';
}

static bool adapter_open(bus *b) {
    struct termios settings;
    char hello[] = "\rC\rS6\rO\r"; /* the first ends a line that an earlier host may have left unfinished */
    const char digit = speed_digit(b->bitrate);
    if (digit == '\0') {
        errno = EINVAL;
        return false;
    }
    hello[4] = digit;
    const int fd = open(b->name, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) {
        return false;
    }
    bool good = tcgetattr(fd, &settings) == 0;
    if (good) {
        cfmakeraw(&settings);
        settings.c_cflag |= (tcflag_t)CLOCAL | (tcflag_t)CREAD;
        good = (tcsetattr(fd, TCSANOW, &settings) == 0) &&
               (write(fd, hello, sizeof hello - 1U) == (ssize_t)(sizeof hello - 1U));
    }
    if (!good) {
        const int reason = errno;
        (void)close(fd);
        errno = reason;
        return false;
    }
    terrapin_slcan_init(&b->parser);
    b->parser.open = true; /* we are the side that opens */
    b->rest_length = 0;
    b->descriptor = fd;
    return true;
}

/* True when a frame for this controller is complete in *frame. */
static bool take_byte(bus *b, uint8_t byte, terrapin_frame *frame) {
    terrapin_slcan_reply reply;
    const bool at_start = (b->parser.length == 0U) && !b->parser.overlong;
    if (byte == (uint8_t)'\a') {
        b->counts.refused++;
        return false;
    }
    if (at_start && ((byte == (uint8_t)'z') || (byte == (uint8_t)'Z') || (byte == (uint8_t)'\r'))) {
        return false; /* an acknowledgement */
    }
    const bool whole = terrapin_slcan_feed(&b->parser, byte, frame, &reply) == TERRAPIN_SLCAN_FRAME;
    b->parser.open = true; /* the adapter's words open and close nothing here */
    return whole;
}

/* Bytes are taken up to so many that no more frames than BUS_AT_ONCE can come of them. */
static int adapter_receive(bus *b, terrapin_frame frames[BUS_AT_ONCE]) {
    enum { SHORTEST = 6 /* t1230\r */ };
    uint8_t in[SHORTEST * (BUS_AT_ONCE - 1)];
    int taken = 0;
    const ssize_t n = read(b->descriptor, in, sizeof in);
    if ((n == 0) || ((n < 0) && (errno != EAGAIN) && (errno != EINTR))) {
        bus_lost(b, (n == 0) ? ENODEV : errno);
        return 0;
    }
    for (ssize_t i = 0; i < n; i++) {
        if (take_byte(b, in[i], &frames[taken])) {
            b->counts.received++;
            taken++;
        }
    }
    return taken;
}

/* Write what a line begun earlier still lacks. True when nothing of it is left. */
static bool finish_line(bus *b) {
    if (b->rest_length > 0U) {
        const ssize_t n = write(b->descriptor, b->rest, b->rest_length);
        const size_t done = (n > 0) ? (size_t)n : 0U;
        b->rest_length -= (uint8_t)done;
        (void)memmove(b->rest, &b->rest[done], b->rest_length);
    }
    return b->rest_length == 0U;
}

/* A port that takes a line only in part gets its rest before anything else. */
static void adapter_send(bus *b, const terrapin_frame *frames, uint8_t count) {
    uint8_t text[BUS_TEXT_MAX];
    size_t length = 0;
    if (!finish_line(b)) {
        b->counts.unsent += count;
        return;
    }
    for (uint8_t i = 0; i < count; i++) {
        length += terrapin_slcan_encode(&frames[i], &text[length]);
    }
    const ssize_t n = write(b->descriptor, text, length);
    if (n > 0) {
        b->rest_length = (uint8_t)(length - (size_t)n);
        (void)memcpy(b->rest, &text[n], b->rest_length);
        b->counts.sent += count;
    } else {
        b->counts.unsent += count;
        if ((n < 0) && (errno != EAGAIN) && (errno != EINTR)) {
            bus_lost(b, errno);
        }
    }
}

const bus_kind bus_adapter = {
    .open = adapter_open,
    .receive = adapter_receive,
    .send = adapter_send,
    .last_words = "C\r",
    .lines = true,
};
