/* The controller between its clock, a CAN bus and a serial line: what is done when, and what is told about it. No
 * register is touched here: that is done by hardware.h, or by a test's stand-in for it.
 *
 *     port_open(&p, ...);
 *     for ever:
 *         if (!port_pass(&p, ticks so far)) sleep until an interrupt
 *
 * A pass does one bounded thing: the tick, when one has come, or else at most PORT_FRAMES_A_PASS frames and
 * PORT_BYTES_A_PASS bytes. So whatever floods the bus or the line, a tick waits for one pass at most, and all frames
 * between two ticks together take no more than what link/intake.h says; the others wait in order.
 */
#ifndef TERRAPIN_PORT_H
#define TERRAPIN_PORT_H

#include "can.h"
#include "dispatch.h"
#include "hardware.h"
#include "health.h"
#include "intake.h"
#include "phases.h"
#include "slcan.h"
#include "terrapin_interface.h"
#include "update.h"
#include "usart.h"

#define PORT_FRAMES_A_PASS 4U
#define PORT_BYTES_A_PASS  32U

typedef struct {
    terrapin_state *state;
    struct terrapin_store *store; /* NULL: no parameters are kept */
    terrapin_update *update;      /* NULL: no boot loader that would serve one */
    can *bus;
    usart *line;
    terrapin_slcan parser;
    terrapin_link link;
    terrapin_node node;
    terrapin_identity identity;
    terrapin_intake intake; /* from bus and line to terrapin_accept, by source */
    terrapin_inputs inputs;
    terrapin_outputs outputs;                   /* of the last step */
    int32_t defaults[TERRAPIN_PARAMETER_COUNT]; /* those of controller.toml, with the board's own */
    hardware_facts hardware;
    phases times;
    uint32_t tick;
    uint32_t overruns;  /* ticks missed; wraps, like the others */
    uint32_t send_lost; /* own frames and answers that the line had no room for */
    bool flash_work;    /* a save is under way, with the bridge off: the watchdog has time */
    bool trial;         /* the image runs on trial */
    health health;
    struct {
        uint32_t overruns, lost, send_lost;
    } told; /* by the last PORT_STATUS */
} port;

/* Reset of everything. What is pointed to stays the caller's; store and update may be NULL, and are open otherwise. */
void port_open(port *p, terrapin_state *state, can *bus, usart *line, struct terrapin_store *store,
               terrapin_update *update, const hardware_facts *hardware);

/* One pass; `now` counts the ticks since reset. False when there was nothing to do. */
bool port_pass(port *p, uint32_t now);

#endif
