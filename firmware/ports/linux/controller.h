/* The controller on Linux: bus, clock, lines and the step between them.
 *
 *     if (controller_open(&c, &options)) { status = controller_run(&c); }
 *     controller_close(&c);
 *
 * Out of test mode a timer makes it step each millisecond, with sensors of its own. In test mode each SENSORS_FAST is
 * one tick, and the bridge stays off. The bridge is off before the first step and after the last one.
 */
#ifndef TERRAPIN_LINUX_CONTROLLER_H
#define TERRAPIN_LINUX_CONTROLLER_H

#include "../encoder_count.h"
#include "bus.h"
#include "clock.h"
#include "dispatch.h"
#include "edges.h"
#include "flash_file.h"
#include "intake.h"
#include "options.h"
#include "parameters.h"

typedef struct {
    const controller_options *options;
    bus bus;
    tick_clock clock;
    gpio_line *estop, *enable, *led, *direction; /* NULL: not named */
    quadrature motor, ground;
    encoder_count motor_encoder;
    analog_input current, supply, temperature;
    pwm_output pwm;
    terrapin_state *state;
    terrapin_link link;
    terrapin_identity identity;
    terrapin_intake intake; /* from the bus to terrapin_accept */
    terrapin_inputs inputs;
    terrapin_outputs outputs;
    terrapin_flash_file flash; /* of --flash */
    terrapin_store store;
    bool flash_open;
    bool stop_kept;      /* STOP_ALL, as it stands in there */
    int signals;         /* descriptor */
    bool driving;        /* the bridge is enabled */
    bool backward;       /* what the direction line says */
    bool stopped;        /* the e-stop, debounced; true until the line was seen healthy */
    bool estop_gone;     /* its line cannot be read any more, for good */
    bool broken;         /* an output cannot be set: leave */
    uint32_t healthy_ms; /* for so long has the e-stop's line been active */
    uint32_t uptime_ms;
    uint32_t steps;          /* wraps, like all counts here */
    uint32_t presses;        /* of the e-stop */
    uint32_t timed;          /* presses whose edge came before the level was seen: those are timed */
    uint64_t slowest_off_ns; /* from such an edge to the enable line off */
} controller;

/* False, and one line on stderr, when something that was asked for cannot be had. */
bool controller_open(controller *c, const controller_options *options);

/* Until a signal ends it: the exit status. */
int controller_run(controller *c);

/* Everything off and given back. */
void controller_close(controller *c);

/* For handlers of fatal signals: the bridge off, with nothing but system calls. */
void controller_emergency(const controller *c);

#endif
