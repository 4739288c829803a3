/* The controller between its clock, a CAN bus and a serial line: what is done when, and what is told about it. No
 * register is touched here; the image (main.c) or a test provides the functions at the end.
 *
 *     port_open(&p, ...);
 *     for ever:
 *         if (!port_pass(&p, ticks so far)) sleep until an interrupt
 *
 * A pass does one bounded thing: the tick, when one has come, or else at most PORT_FRAMES_A_PASS frames and
 * PORT_BYTES_A_PASS bytes. So whatever floods the bus or the line, a tick waits for one pass at most.
 */
#ifndef TERRAPIN_PORT_H
#define TERRAPIN_PORT_H

#include "can.h"
#include "dispatch.h"
#include "phases.h"
#include "slcan.h"
#include "update.h"
#include "usart.h"

#define PORT_FRAMES_A_PASS 4U
#define PORT_BYTES_A_PASS  32U
#define PORT_HEALTHY_TICKS 2000U

/* What only the hardware knows; the image fills it at the start, and each tick where it changes. */
typedef struct {
    bool clock_fallback;
    bool adc_silent;
    bool watchdog_absent;
    bool bridge_break;
    bool brown_out;
    bool brown_out_unset;
    uint8_t reset_cause;
    uint8_t board;
    uint8_t slot;
    uint32_t unique;
    uint32_t core_hz;
} port_hardware;

typedef struct {
    terrapin_state *state;
    struct terrapin_store *store; /* NULL: no parameters are kept */
    terrapin_update *update;      /* NULL: no boot loader that would serve one */
    can *bus;
    usart *line;
    terrapin_slcan parser;
    terrapin_link link;
    terrapin_inputs inputs;
    terrapin_outputs outputs; /* of the last step */
    port_hardware hardware;
    phases times;
    uint32_t tick;
    uint32_t overruns;  /* ticks missed; wraps, like the others */
    uint32_t send_lost; /* own frames and answers that the line had no room for */
    bool flash_work;    /* a save is under way, with the bridge off: the watchdog has time */
    bool judged;        /* this start was told to be healthy */
    struct {
        uint32_t overruns, lost, send_lost;
    } told; /* by the last PORT_STATUS */
} port;

/* Reset of everything. What is pointed to stays the caller's; store and update may be NULL, and are open otherwise. */
void port_open(port *p, terrapin_state *state, can *bus, usart *line, struct terrapin_store *store,
               terrapin_update *update, const port_hardware *hardware);

/* One pass; `now` counts the ticks since reset. False when there was nothing to do. */
bool port_pass(port *p, uint32_t now);

/* The parameters that stand after a reset: the stored set, or, while there is none, the defaults with the board's own.
 * Called at the start and when test mode is left. A host that asks for the defaults gets the board's own as well. */
void terrapin_port_parameters(port *p);

/* ---- provided by the image */

/* Sample: codes, counts and the emergency stop into *inputs; p->hardware as it is now. */
void port_sense(port *p, terrapin_inputs *inputs);
/* The bridge: duty when on, off otherwise. */
void port_drive(port *p, int16_t duty_q15, bool on);
/* What follows may take longer than the watchdog allows: an erase, a long read (true); or no longer. */
void port_flash_work(bool begins);
/* PORT_HEALTHY_TICKS went by, and the bridge is off: a boot loader may count this start as a good one. Called once. */
void port_healthy(port *p);
/* A host asked for it (UPDATE_RESET), and was answered: reset, and with `stay` remain in the boot loader. */
void port_reset(port *p, bool stay);
/* A tick is done: the watchdog may be fed. */
void port_alive(port *p);
/* Cycles of the core, and those at the last tick's beginning; 0 where nothing counts them. */
uint32_t port_cycles(void);
uint32_t port_tick_cycles(void);
/* Bytes of stack that were ever used. */
uint32_t port_stack_used(void);
/* The board's parameters: their number, and one of them. */
typedef struct {
    uint16_t index;
    int32_t value;
} port_parameter;
extern const port_parameter port_parameters[];
extern const uint32_t port_parameter_count;

#endif
