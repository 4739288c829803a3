#define _GNU_SOURCE

#include "controller.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <time.h>
#include <unistd.h>

#include "link_key_file.h"
#include "process.h"
#include "systemd.h"
#include "terrapin_interface.h"

#define TICK_NS  1000000U
#define CHORE_MS 100U /* LED, watchdog, opening a lost bus again; the clock's period in test mode */

/* ---- outputs */

static bool drive(controller *c, bool on) {
    bool good = true;
    const int16_t duty = on ? c->outputs.duty_q15 : 0;
    const bool backward = duty < 0;
    if (!on && (c->enable != NULL)) { /* off: first the line that matters */
        good = gpio_set(c->enable, false);
    }
    if (!on || (backward != c->backward)) { /* no duty of the one direction in the other */
        good = pwm_set(&c->pwm, 0) && good;
    }
    if (c->direction != NULL) {
        good = gpio_set(c->direction, backward) && good;
    }
    c->backward = backward;
    good = pwm_set(&c->pwm, duty) && good;
    if (on && (c->enable != NULL)) {
        good = good && gpio_set(c->enable, true);
    }
    c->driving = on;
    return good;
}

/* The bridge follows the last step, unless test mode or the e-stop holds it off. */
static void apply(controller *c) {
    const bool on = c->outputs.enable && terrapin_link_bridge_allowed(&c->link) && !c->stopped && !c->broken;
    if ((on || c->driving) && !drive(c, on)) {
        (void)fprintf(stderr, "terrapin-controller: cannot set an output: %s\n", strerror(errno));
        c->broken = true;
        (void)drive(c, false);
    }
}

void controller_emergency(const controller *c) {
    if (c->enable != NULL) {
        (void)gpio_set(c->enable, false);
    }
    if (c->pwm.descriptor >= 0) {
        (void)!pwrite(c->pwm.descriptor, "0\n", 2, 0);
    }
}

/* ---- inputs */

static void stop(controller *c) {
    c->healthy_ms = 0;
    if (!c->stopped) {
        c->stopped = true;
        c->presses++;
        apply(c);
    }
}

/* An edge acts at once, before the next step and whatever the line does then. A line that is gone (its chip was
 * unplugged) stays pressed until a new start, and is polled no more: its descriptor would always be ready. */
static void take_estop_edges(controller *c, short events) {
    gpio_edge edges[BUS_AT_ONCE];
    const int count = gpio_edges(c->estop, edges, BUS_AT_ONCE);
    if ((count < 0) || ((count == 0) && ((events & (POLLERR | POLLHUP | POLLNVAL)) != 0))) {
        c->estop_gone = true;
        stop(c);
        (void)fprintf(stderr, "terrapin-controller: the e-stop's line is gone: stopped until a new start\n");
    }
    for (int i = 0; i < count; i++) {
        if (!edges[i].active) {
            const bool was_driving = c->driving;
            struct timespec now;
            stop(c);
            (void)clock_gettime(CLOCK_MONOTONIC, &now);
            const uint64_t now_ns = ((uint64_t)now.tv_sec * 1000000000U) + (uint64_t)now.tv_nsec;
            if (was_driving && (now_ns >= edges[i].time_ns)) {
                c->timed++;
                c->slowest_off_ns =
                    ((now_ns - edges[i].time_ns) > c->slowest_off_ns) ? (now_ns - edges[i].time_ns) : c->slowest_off_ns;
            }
        }
    }
}

/* The level counts as well: an edge may be lost, and a line that cannot be read is a broken wire. */
static void watch_estop(controller *c) {
    if (c->estop == NULL) {
        c->stopped = false; /* then there is no bridge either (options.c) */
    } else if (c->estop_gone || (gpio_get(c->estop) != 1)) {
        stop(c);
    } else {
        /* By the looks before this one: a step follows each press, however short it was and however long the ticks.
         * A look stands for one period: nobody looked in those that were missed, and the press may lie in them. */
        c->stopped = c->stopped && (c->healthy_ms < c->options->debounce_ms);
        c->healthy_ms += (c->healthy_ms < 1000000U) ? (uint32_t)(c->clock.period_ns / TICK_NS) : 0U;
    }
}

static void sense(controller *c) {
    quadrature_update(&c->motor);
    quadrature_update(&c->ground);
    c->inputs.motor_count = encoder_divided(&c->motor_encoder, c->motor.count, TERRAPIN_ENCODER_DIVIDER);
    c->inputs.ground_count = c->ground.count;
    c->inputs.current_code = analog_read(&c->current);
    if ((c->inputs.tick & 1U) == 0U) {
        c->inputs.supply_code = analog_read(&c->supply);
    } else {
        c->inputs.temperature_code = analog_read(&c->temperature);
    }
    c->inputs.estop = c->stopped;
}

/* ---- the step */

static void step(controller *c) {
    terrapin_link_drive(c->state, &c->inputs, &c->outputs);
    apply(c); /* first the bridge, then the ground and the words about both */
    terrapin_link_think(c->state, &c->inputs, &c->outputs);
    if (c->flash_open) {
        terrapin_process_keep_stop(&c->flash, c->state, &c->stop_kept);
    }
    c->steps++;
    bus_send(&c->bus, c->outputs.frames, c->outputs.frame_count);
}

static void chores(controller *c) {
    const uint32_t phase = (c->uptime_ms / CHORE_MS) % 10U;
    bool lit = phase < 5U;
    if (c->driving) {
        lit = true;
    } else if (c->link.test_mode) {
        lit = phase == 0U;
    } else if ((c->outputs.faults & TERRAPIN_FAULTS_LATCHED) != 0U) {
        lit = (phase & 1U) == 0U;
    } else {
        /* idle */
    }
    if (c->led != NULL) {
        (void)gpio_set(c->led, lit);
    }
    (void)bus_reopen(&c->bus);
    terrapin_seal_at(&c->link.seal, terrapin_process_ms());
    systemd_tell("WATCHDOG=1");
}

static void tick(controller *c) {
    const bool own = !c->link.test_mode;
    const uint32_t periods = tick_clock_take(&c->clock, own);
    const uint32_t elapsed_ms = periods * (uint32_t)(c->clock.period_ns / TICK_NS);
    if (periods == 0U) {
        return;
    }
    terrapin_intake_begin_tick(&c->intake);
    watch_estop(c);
    if (c->link.store != NULL) {
        (void)terrapin_link_store_work(&c->link, c->state);
    }
    if (own) {
        c->inputs.tick += periods;
        sense(c);
        step(c);
    }
    const uint32_t before = c->uptime_ms / CHORE_MS;
    c->uptime_ms += elapsed_ms;
    if ((c->uptime_ms / CHORE_MS) != before) {
        chores(c);
    }
}

/* Test mode came or went: the controller was reset, so the last outputs hold no more; the clock steps only outside. */
static bool change_mode(controller *c) {
    (void)memset(&c->outputs, 0, sizeof c->outputs);
    apply(c);
    return tick_clock_start(&c->clock, c->link.test_mode ? (uint64_t)CHORE_MS * TICK_NS : TICK_NS);
}

static bool take_frame(controller *c, const terrapin_frame *frame) {
    const bool test_mode = c->link.test_mode;
    terrapin_frame reply = {0};
    terrapin_seal_at(&c->link.seal, terrapin_process_ms());
    switch (terrapin_accept(&c->link, c->state, frame, &c->inputs, &reply)) {
    case TERRAPIN_ACCEPT_REPLY:
        bus_send(&c->bus, &reply, 1);
        break;
    case TERRAPIN_ACCEPT_STEP:
        step(c);
        break;
    case TERRAPIN_ACCEPT_NOTHING:
    default:
        break;
    }
    return (c->link.test_mode == test_mode) || change_mode(c);
}

/* Those whose turn it is in this tick. */
static bool take_waiting(controller *c) {
    terrapin_frame frame;
    uint8_t source = 0;
    bool good = true;
    while (good && terrapin_intake_next(&c->intake, &c->link, c->state, &frame, &source)) {
        good = take_frame(c, &frame);
    }
    return good;
}

static void receive(controller *c) {
    terrapin_frame frames[BUS_AT_ONCE];
    const int count = bus_receive(&c->bus, frames);
    for (int i = 0; i < count; i++) {
        terrapin_intake_put(&c->intake, &c->link, c->state, &c->inputs, &frames[i], 0U);
    }
}

/* ---- the loop */

static void report(const controller *c) {
    char off[64] = "";
    if (c->timed > 0U) {
        (void)snprintf(off, sizeof off, ", enable off within %lu us of it",
                       (unsigned long)((c->slowest_off_ns + 999U) / 1000U));
    }
    bus_report(&c->bus, stderr);
    tick_clock_report(&c->clock, stderr);
    (void)fprintf(
        stderr,
        "terrapin-controller: %lu steps; dropped: %lu bad CRC, %lu repeated, %lu malformed, %lu out of place, "
        "%lu unknown, %lu too many to wait; e-stop %lu times, %lu timed from the edge%s; encoders skipped %lu\n",
        (unsigned long)c->steps, (unsigned long)c->link.bad_crc, (unsigned long)c->link.repeated,
        (unsigned long)c->link.malformed, (unsigned long)c->link.out_of_place, (unsigned long)c->link.unknown,
        (unsigned long)c->intake.lost, (unsigned long)c->presses, (unsigned long)c->timed, off,
        (unsigned long)c->motor.skipped + (unsigned long)c->ground.skipped);
}

/* True when it is to go on. */
static bool take_signal(const controller *c) {
    struct signalfd_siginfo info;
    if (read(c->signals, &info, sizeof info) != (ssize_t)sizeof info) {
        return true;
    }
    if (info.ssi_signo == (uint32_t)SIGUSR1) {
        report(c);
        return true;
    }
    (void)fprintf(stderr, "terrapin-controller: stopped by a signal, outputs off\n");
    return false;
}

int controller_run(controller *c) {
    bool going = true;
    bool good = tick_clock_start(&c->clock, TICK_NS);
    (void)fprintf(stderr, "terrapin-controller: ready on %s\n", c->bus.name);
    if (!c->flash_open) {
        (void)fprintf(stderr,
                      "terrapin-controller: no --flash FILE: a restart forgets a STOP_ALL, parameters, node number\n");
    }
    systemd_tell("READY=1");
    while (going && good && !c->broken) {
        struct pollfd waiting[] = {
            {.fd = c->clock.descriptor, .events = POLLIN},
            {.fd = ((c->estop != NULL) && !c->estop_gone) ? gpio_descriptor(c->estop) : -1, .events = POLLIN},
            {.fd = c->bus.descriptor, .events = POLLIN},
            {.fd = c->signals, .events = POLLIN},
        };
        if ((poll(waiting, sizeof waiting / sizeof waiting[0], -1) < 0) && (errno != EINTR)) {
            good = false;
        }
        if (waiting[1].revents != 0) {
            take_estop_edges(c, waiting[1].revents);
        }
        if (waiting[0].revents != 0) {
            tick(c);
        }
        if (waiting[2].revents != 0) {
            receive(c);
        }
        good = good && take_waiting(c);
        if (waiting[3].revents != 0) {
            going = take_signal(c);
        }
    }
    (void)drive(c, false);
    systemd_tell("STOPPING=1");
    if (!good) {
        (void)fprintf(stderr, "terrapin-controller: the system failed it: %s\n", strerror(errno));
    }
    report(c);
    return (good && !c->broken) ? 0 : 1;
}

/* ---- opening and closing */

static bool open_line(gpio_line **line, const line_option *option, gpio_direction direction) {
    char why[160];
    if (option->given) {
        *line = gpio_open(&option->name, direction, why, sizeof why);
        if (*line == NULL) {
            (void)fprintf(stderr, "terrapin-controller: line %s: %s\n", option->text, why);
        }
    }
    return !option->given || (*line != NULL);
}

static bool open_encoder(quadrature *encoder, const line_option lines[2]) {
    const gpio_name names[2] = {lines[0].name, lines[1].name};
    char why[160];
    if (lines[0].given && !quadrature_open(encoder, names, why, sizeof why)) {
        (void)fprintf(stderr, "terrapin-controller: encoder %s: %s\n", lines[0].text, why);
        return false;
    }
    return true;
}

static bool said(bool good, const char *what, const char *name) {
    if (!good) {
        (void)fprintf(stderr, "terrapin-controller: cannot open %s%s: %s\n", what, (name != NULL) ? name : "",
                      strerror(errno));
    }
    return good;
}

static bool open_signals(controller *c) {
    sigset_t set;
    (void)sigemptyset(&set);
    (void)sigaddset(&set, SIGTERM);
    (void)sigaddset(&set, SIGINT);
    (void)sigaddset(&set, SIGHUP);
    (void)sigaddset(&set, SIGQUIT);
    (void)sigaddset(&set, SIGUSR1);
    (void)signal(SIGPIPE, SIG_IGN);
    c->signals = (sigprocmask(SIG_BLOCK, &set, NULL) == 0) ? signalfd(-1, &set, SFD_NONBLOCK | SFD_CLOEXEC) : -1;
    return said(c->signals >= 0, "signals", NULL);
}

/* The file that was named. */
static bool open_flash(controller *c) {
    if (c->options->flash != NULL) {
        c->flash_open = terrapin_process_store(&c->flash, &c->store, c->options->flash);
    }
    terrapin_process_identity(&c->identity, c->options->node, c->flash_open ? &c->flash : NULL);
    terrapin_node_init(&c->bus.node, c->identity.node);
    return c->flash_open || (c->options->flash == NULL);
}

bool controller_open(controller *c, const controller_options *options) {
    (void)memset(c, 0, sizeof *c);
    c->options = options;
    c->stopped = true;
    c->signals = -1;
    c->clock.descriptor = -1;
    c->current.descriptor = -1;
    c->supply.descriptor = -1;
    c->temperature.descriptor = -1;
    c->pwm.descriptor = -1;
    c->bus.descriptor = -1;
    const bool adapter = options->adapter != NULL;
    c->bus.kind = adapter ? &bus_adapter : &bus_socketcan;
    c->bus.name = adapter ? options->adapter : options->can;
    c->bus.bitrate = options->bitrate;
    /* first what switches the bridge off, last what lets others switch it on */
    const bool good =
        open_line(&c->enable, &options->enable, GPIO_OUTPUT) &&
        said(pwm_open(&c->pwm, options->pwm), "PWM channel ", options->pwm) &&
        open_line(&c->direction, &options->direction, GPIO_OUTPUT) &&
        open_line(&c->estop, &options->estop, GPIO_EDGES) && open_line(&c->led, &options->led, GPIO_OUTPUT) &&
        open_encoder(&c->motor, options->motor) && open_encoder(&c->ground, options->ground) &&
        said(analog_open(&c->current, options->current, options->adc_bits), "", options->current) &&
        said(analog_open(&c->supply, options->supply, options->adc_bits), "", options->supply) &&
        said(analog_open(&c->temperature, options->temperature, options->adc_bits), "", options->temperature) &&
        open_signals(c) && said(tick_clock_open(&c->clock), "a timer", NULL) && open_flash(c) && bus_open(&c->bus);
    if (!good) {
        return false;
    }
    c->state = calloc(1, terrapin_state_size());
    if (!said(c->state != NULL, "memory", NULL)) {
        return false;
    }
    terrapin_intake_init(&c->intake);
    terrapin_link_init(&c->link, c->state, &c->inputs);
    c->link.identity = &c->identity;
    if (c->flash_open) {
        terrapin_link_use_store(&c->link, c->state, &c->store);
        c->stop_kept = terrapin_process_take_stop(&c->flash, c->state);
    }
    return (options->link_key == NULL) || terrapin_process_seal(&c->link, options->link_key);
}

void controller_close(controller *c) {
    (void)drive(c, false);
    pwm_close(&c->pwm);
    gpio_close(c->enable);
    gpio_close(c->direction);
    gpio_close(c->estop);
    if (c->led != NULL) {
        (void)gpio_set(c->led, false);
    }
    gpio_close(c->led);
    quadrature_close(&c->motor);
    quadrature_close(&c->ground);
    analog_close(&c->current);
    analog_close(&c->supply);
    analog_close(&c->temperature);
    bus_close(&c->bus);
    if (c->clock.descriptor >= 0) {
        (void)close(c->clock.descriptor);
    }
    if (c->signals >= 0) {
        (void)close(c->signals);
    }
    if (c->flash_open) {
        terrapin_flash_file_close(&c->flash);
    }
    free(c->state);
}
