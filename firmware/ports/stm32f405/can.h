/* bxCAN: receives what the filters let through into a bounded queue, sends by priority, says how the bus is.
 *
 * Sending: a queue in the order of the identifiers, at most one frame of an identifier in the mailboxes (two of one
 * would leave in the order of the mailboxes). When a frame comes that is before all those in three full mailboxes, the
 * last of these is taken back, so that a busy bus never holds up the first behind the last.
 */
#ifndef TERRAPIN_CAN_H
#define TERRAPIN_CAN_H

#include "node.h"
#include "registers.h"

#define CAN_IN_SIZE    32U /* a power of two */
#define CAN_OUT_SIZE   32U
#define CAN_FILTER_MAX 14U

typedef enum {
    CAN_KEEP = 0,   /* each frame counts: answers */
    CAN_REPLACE = 1 /* a newer one takes the place of one of the same identifier that still waits: telemetry */
} can_policy;

typedef enum { CAN_CLOSED = 0, CAN_STARTING = 1, CAN_RUNNING = 2, CAN_ABSENT = 3 } can_phase;

typedef struct {
    bool bus_off;
    bool passive;
    bool no_acknowledge;     /* frames go out and nobody takes them: alone on the bus, or the bit rate is another one */
    uint8_t transmit_errors; /* the chip's counters */
    uint8_t receive_errors;
    uint32_t bus_off_count; /* times the bus was lost; it comes back by itself */
} can_state;

typedef struct {
    can_registers *registers;
    can_phase phase;
    uint32_t starting; /* polls since the start was asked for */
    can_state state;
    terrapin_frame in[CAN_IN_SIZE]; /* from the interrupt to can_take */
    volatile uint32_t in_head, in_tail;
    volatile uint32_t in_lost;        /* frames that found no room, here or in the chip; wraps */
    terrapin_frame out[CAN_OUT_SIZE]; /* by identifier, then by age */
    uint8_t out_count;
    uint32_t out_lost; /* frames that had to give way; wraps */
    struct {
        terrapin_frame frame;
        bool used;
        bool aborting;
    } box[3];
} can;

/* Bit timing register for a bit rate: at 16 MHz and above 500 kbit/s and 1 Mbit/s are exact, sampled at 80 to 89 %.
 * 0 when no whole division gives it. */
uint32_t can_timing(uint32_t apb_hz, uint32_t bit_rate);

/* Ask for the bus. False when there is no such chip: what follows does nothing then, and the phase is CAN_ABSENT.
 * The bus is joined (phase CAN_RUNNING) once it was quiet for 11 bits, which can_poll watches. */
bool can_open(can *c, can_registers *registers, uint32_t timing, const terrapin_filter *filters, uint32_t filter_count);

/* To be called from the receive interrupt: takes one frame. */
void can_receive_interrupt(can *c);

/* The next received frame; false when there is none. */
bool can_take(can *c, terrapin_frame *frame);

/* Queue a frame. False when it, or one of lower priority that gave way to it, is lost; both are counted. */
bool can_send(can *c, const terrapin_frame *frame, can_policy policy);

/* True when no frame waits to leave, or none can: the bus was not joined. */
bool can_idle(const can *c);

/* Once a tick, and after can_send: moves frames to the mailboxes and brings `state` up to date. */
void can_poll(can *c);

#endif
