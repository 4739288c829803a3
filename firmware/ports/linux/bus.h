/* The CAN bus of the Linux controller: a SocketCAN interface (bus_socketcan.c), or an SLCAN adapter on a serial port
 * (bus_adapter.c). A bus that goes away is opened again as soon as it can be; until then nothing comes and nothing
 * goes.
 */
#ifndef TERRAPIN_LINUX_BUS_H
#define TERRAPIN_LINUX_BUS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "node.h"
#include "slcan.h"
#include "terrapin.h"

#define BUS_TEXT_MAX (TERRAPIN_MAX_FRAMES * TERRAPIN_SLCAN_TEXT_MAX) /* of the frames of a tick */
#define BUS_AT_ONCE  16 /* frames taken from the bus at a time, so that no flood of them delays the step */

typedef enum { BUS_ACTIVE, BUS_WARNING, BUS_PASSIVE, BUS_OFF, BUS_DOWN } bus_state;

/* All of them wrap. */
typedef struct {
    uint32_t received;   /* frames for this controller */
    uint32_t overflowed; /* frames that the receive queue, or once each time the interface's, had no place for */
    uint32_t sent;
    uint32_t unsent; /* frames that the send queue had no place for, or the interface was down */
    uint32_t error_warning, error_passive, bus_off, restarted, no_acknowledge, other_error; /* error frames */
    uint32_t went_down; /* cable, interface or adapter gone */
    uint32_t refused;   /* lines that an SLCAN adapter did not take */
} bus_counts;

typedef struct bus bus;

/* What a kind of bus does in its own way. bus.c calls it with a bus that is there, but for `open`. */
typedef struct {
    bool (*open)(bus *b); /* false, and errno, when it cannot be opened */
    int (*receive)(bus *b, terrapin_frame frames[BUS_AT_ONCE]);
    void (*send)(bus *b, const terrapin_frame *frames, uint8_t count);
    const char *last_words; /* written to it before it is closed; NULL: none */
    bool lines;             /* it is an adapter, whose lines are counted too */
} bus_kind;

extern const bus_kind bus_socketcan;
extern const bus_kind bus_adapter;

struct bus {
    const bus_kind *kind;
    const char *name;     /* interface or device */
    terrapin_node node;   /* whose frames are taken, and whose identifiers what is sent gets */
    unsigned int bitrate; /* bit/s, of an adapter; a SocketCAN interface has its own */
    int descriptor;       /* to poll for input; -1 while the bus is gone */
    bus_state state;
    bus_counts counts;
    uint32_t queue_lost;        /* as the kernel last counted them for this socket */
    terrapin_slcan parser;      /* of an adapter's lines */
    uint8_t rest[BUS_TEXT_MAX]; /* of a line that the port took only in part */
    uint8_t rest_length;
};

/* False, and the reason on stderr, when it cannot be opened. */
bool bus_open(bus *b);

/* Try to open a bus that went away. True when it is there. */
bool bus_reopen(bus *b);

/* Frames for this node that wait, without waiting for any: their number, at most BUS_AT_ONCE. */
int bus_receive(bus *b, terrapin_frame frames[BUS_AT_ONCE]);

/* Send frames in order, without waiting. What cannot be sent now is dropped and counted. */
void bus_send(bus *b, const terrapin_frame *frames, uint8_t count);

/* The word for a state. */
const char *bus_state_name(bus_state state);

/* One line of counts. */
void bus_report(const bus *b, FILE *to);

void bus_close(bus *b);

/* ---- for the kinds */

/* The bus is gone: close it and say so. */
void bus_lost(bus *b, int reason);

/* The bus is in another state: say so. */
void bus_enter(bus *b, bus_state state);

#endif
