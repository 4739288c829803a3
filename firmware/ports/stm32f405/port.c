#include "port.h"

#include "parameters.h"
#include "terrapin_scaling.h"

#define STATUS_TICKS   100U
#define IDENTITY_TICKS 1000U
#define IDENTITY_AT    502U
#define LINK_AT        702U
#define STARTING_TICKS 1000U /* a bus that is not quiet for 11 bits in this time is taken for absent */
#define ANSWER_MAX     ((2U * TERRAPIN_SLCAN_TEXT_MAX) + TERRAPIN_SLCAN_REPLY_MAX) /* to one byte of the line */
_Static_assert(TERRAPIN_MAX_FRAMES == 2, "ANSWER_MAX");

typedef enum { FROM_BUS, FROM_LINE } source;

static uint8_t capped(uint32_t value) {
    return (uint8_t)((value > 255U) ? 255U : value);
}

/* Below here frames have the identifiers of the bus, above those of node 0. */
static void send_line(port *p, const terrapin_frame *frame) {
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX];
    const size_t length = terrapin_slcan_encode(frame, text);
    if (!usart_send(p->line, text, (uint32_t)length)) {
        p->send_lost++;
    }
}

/* Where everybody may hear it. */
static void publish(port *p, const terrapin_frame *frame) {
    terrapin_frame sent = *frame;
    terrapin_node_send(&p->node, &sent);
    (void)can_send(p->bus, &sent, CAN_REPLACE); /* counted by the driver */
    if (p->parser.open) {
        send_line(p, &sent);
    }
}

static void answer(port *p, source from, const terrapin_frame *frame) {
    terrapin_frame sent = *frame;
    terrapin_node_send(&p->node, &sent);
    if (from == FROM_LINE) {
        send_line(p, &sent);
    } else {
        (void)can_send(p->bus, &sent, CAN_KEEP);
    }
}

/* The bridge is set as soon as the drive is done: at the same moment of every tick. */
static void step(port *p) {
    const uint32_t start = hardware_cycles();
    terrapin_link_drive(p->state, &p->inputs, &p->outputs);
    const bool on = p->outputs.enable && terrapin_link_bridge_allowed(&p->link);
    hardware_drive(&p->hardware, p->outputs.duty_q15, on); /* off in test mode */
    terrapin_link_think(p->state, &p->inputs, &p->outputs);
    phases_note(&p->times, PHASE_STEP, hardware_cycles() - start);
}

/* What the boot loader's protocol leaves to an application: to say what runs, and to reset. */
static void take_update(port *p, source from, const terrapin_frame *frame) {
    terrapin_frame replies[TERRAPIN_UPDATE_REPLIES];
    p->health.heard = true;
    const bool motor_on = terrapin_bridge_on(p->state);
    const bool query = frame->id == TERRAPIN_ID_UPDATE_QUERY;
    if (motor_on && query) {
        p->link.out_of_place++; /* it reads the whole log of the boot loader: up to 15 ms at 168 MHz */
        return;
    }
    if (query) {
        hardware_flash_work(true);
    }
    const uint32_t count = terrapin_update_application(p->update, frame, motor_on, replies);
    if (query) {
        hardware_flash_work(p->flash_work);
    }
    for (uint32_t i = 0; i < count; i++) {
        answer(p, from, &replies[i]);
    }
    if (p->update->reset) {
        hardware_drive(&p->hardware, 0, false);
        can_poll(p->bus);
        hardware_reset(p->bus, p->line, p->update->stay);
    }
}

static uint32_t dropped_frames(const terrapin_link *link) {
    return link->bad_crc + link->repeated + link->out_of_step + link->malformed + link->out_of_place + link->unsealed +
           link->unknown;
}

static void take_frame(port *p, source from, const terrapin_frame *frame) {
    if ((p->update != NULL) && (frame->id >= TERRAPIN_UPDATE_ID_FIRST) && (frame->id <= TERRAPIN_UPDATE_ID_LAST)) {
        if (!terrapin_link_holds(&p->link, frame)) {
            take_update(p, from, frame);
        }
        return;
    }
    const bool test_mode = p->link.test_mode;
    const uint32_t dropped = dropped_frames(&p->link);
    terrapin_frame reply = {0};
    switch (terrapin_accept(&p->link, p->state, frame, &p->inputs, &reply)) {
    case TERRAPIN_ACCEPT_REPLY:
        answer(p, from, &reply);
        break;
    case TERRAPIN_ACCEPT_UPDATE:
        if (p->update != NULL) {
            take_update(p, from, &p->link.seal.held);
        }
        break;
    case TERRAPIN_ACCEPT_STEP:
        step(p);
        for (uint8_t i = 0; i < p->outputs.frame_count; i++) {
            answer(p, from, &p->outputs.frames[i]);
        }
        break;
    case TERRAPIN_ACCEPT_NOTHING:
    default:
        break;
    }
    p->health.heard = p->health.heard || (dropped_frames(&p->link) == dropped);
    if (p->link.test_mode != test_mode) {
        hardware_drive(&p->hardware, 0, false);
    }
}

/* The next frame whose turn it is in this tick; false when there is none. */
static bool take_waiting(port *p) {
    terrapin_frame frame = {0};
    uint8_t from = 0;
    const bool any = terrapin_intake_next(&p->intake, &p->link, p->state, &frame, &from);
    if (any) {
        take_frame(p, (from == (uint8_t)FROM_LINE) ? FROM_LINE : FROM_BUS, &frame);
    }
    return any;
}

static void put(port *p, source from, terrapin_frame *frame) {
    if (terrapin_node_receive(&p->node, frame)) {
        terrapin_intake_put(&p->intake, &p->link, p->state, &p->inputs, frame, (uint8_t)from);
    } else {
        p->link.unknown++;
    }
}

static void take_byte(port *p, uint8_t byte) {
    terrapin_frame frame = {0};
    terrapin_slcan_reply reply = {0};
    const terrapin_slcan_event event = terrapin_slcan_feed(&p->parser, byte, &frame, &reply);
    if (event == TERRAPIN_SLCAN_FRAME) {
        put(p, FROM_LINE, &frame);
        /* When it need not wait, its answer leaves before that of the line; so in test mode, also behind others. */
        while (take_waiting(p) && p->link.test_mode && (ring_free(&p->line->out) >= ANSWER_MAX)) {
        }
    }
    if ((event != TERRAPIN_SLCAN_MORE) && !usart_send(p->line, reply.text, reply.length)) {
        p->send_lost++;
    }
}

/* A few frames and bytes; true when there was one. */
static bool receive(port *p) {
    bool any = false;
    terrapin_frame frame = {0};
    for (uint32_t i = 0; (i < PORT_FRAMES_A_PASS) && can_take(p->bus, &frame); i++) {
        put(p, FROM_BUS, &frame);
        any = true;
    }
    for (uint32_t i = 0; (i < PORT_FRAMES_A_PASS) && take_waiting(p); i++) {
        any = true;
    }
    /* Nothing is taken whose answer has no room: a host that sends on without reading loses its own lines, not ours. */
    uint8_t byte = 0;
    for (uint32_t i = 0;
         (i < PORT_BYTES_A_PASS) && (ring_free(&p->line->out) >= ANSWER_MAX) && usart_take(p->line, &byte); i++) {
        take_byte(p, byte);
        any = true;
    }
    if (any) {
        can_poll(p->bus); /* answers leave now */
    }
    return any;
}

static uint32_t lost_frames(const port *p) {
    return p->bus->in_lost + p->line->in.lost + p->line->damaged + p->intake.lost;
}

static void tell_status(port *p) {
    const hardware_facts *hardware = &p->hardware;
    const can_state *bus = &p->bus->state;
    const bool absent =
        (p->bus->phase == CAN_ABSENT) || ((p->bus->phase == CAN_STARTING) && (p->bus->starting >= STARTING_TICKS));
    const uint32_t lost = lost_frames(p);
    const uint32_t send_lost = p->send_lost + p->bus->out_lost;
    const terrapin_port_status_t message = {
        .clock_fallback = hardware->clock_fallback ? 1 : 0,
        .adc_silent = hardware->adc_silent ? 1 : 0,
        .can_absent = absent ? 1 : 0,
        .can_bus_off = bus->bus_off ? 1 : 0,
        .can_passive = bus->passive ? 1 : 0,
        .can_no_acknowledge = bus->no_acknowledge ? 1 : 0,
        .receive_overflow = (lost != p->told.lost) ? 1 : 0,
        .send_overflow = (send_lost != p->told.send_lost) ? 1 : 0,
        .watchdog_reset = (hardware->reset_cause == TERRAPIN_RESET_CAUSE_WATCHDOG) ? 1 : 0,
        .watchdog_absent = hardware->watchdog_absent ? 1 : 0,
        .bridge_break = hardware->bridge_break ? 1 : 0,
        .brown_out = hardware->brown_out ? 1 : 0,
        .brown_out_unset = hardware->brown_out_unset ? 1 : 0,
        .overrun = (p->overruns != p->told.overruns) ? 1 : 0,
        .imu_absent = hardware->imu_absent ? 1 : 0,
        .limiter_refused = p->link.limiter_refused ? 1 : 0,
        .reset_cause = hardware->reset_cause,
        .bus_off_count = capped(bus->bus_off_count),
        .transmit_errors = bus->transmit_errors,
        .receive_errors = bus->receive_errors,
        .lost_frames = capped(lost),
        .overruns = capped(p->overruns),
    };
    p->told.overruns = p->overruns;
    p->told.lost = lost;
    p->told.send_lost = send_lost;
    terrapin_frame frame = {0};
    (void)terrapin_encode_port_status(&message, &frame); /* the fields have the signals' widths */
    publish(p, &frame);
}

static void tell_times(port *p) {
    terrapin_port_times_source times = {0};
    times.receive_250ns = phases_take_250ns(&p->times, PHASE_RECEIVE);
    times.sense_250ns = phases_take_250ns(&p->times, PHASE_SENSE);
    times.step_250ns = phases_take_250ns(&p->times, PHASE_STEP);
    times.send_250ns = phases_take_250ns(&p->times, PHASE_SEND);
    times.late_250ns = phases_take_250ns(&p->times, PHASE_LATE);
    const terrapin_port_times_t message = terrapin_scale_port_times(&times);
    terrapin_frame frame = {0};
    (void)terrapin_encode_port_times(&message, &frame);
    publish(p, &frame);
}

static void tell_identity(port *p) {
    terrapin_port_identity_source identity = {0};
    identity.unique = p->hardware.unique;
    identity.board = p->hardware.board;
    identity.slot = p->hardware.slot;
    identity.core_clock = (p->hardware.core_hz / 1000000U);
    identity.stack_used_words = (int32_t)(hardware_stack_used() / 4U);
    identity.kind = (int32_t)terrapin_link_mark.kind;
    identity.trust = (p->link.seal.key != NULL) ? TERRAPIN_TRUST_SEALED : TERRAPIN_TRUST_OPEN;
    const terrapin_port_identity_t message = terrapin_scale_port_identity(&identity);
    terrapin_frame frame = {0};
    (void)terrapin_encode_port_identity(&message, &frame);
    publish(p, &frame);
}

static void tell_link(port *p) {
    const terrapin_link *link = &p->link;
    const terrapin_port_link_t message = {
        .bad_crc = capped(link->bad_crc),
        .repeated = capped(link->repeated),
        .out_of_step = capped(link->out_of_step),
        .malformed = capped(link->malformed),
        .out_of_place = capped(link->out_of_place),
        .unsealed = capped(link->unsealed),
        .sessions = capped(link->seal.opened),
        .generation = capped(link->seal.generation),
    };
    terrapin_frame frame = {0};
    (void)terrapin_encode_port_link(&message, &frame);
    publish(p, &frame);
}

/* The port's own messages, one a tick at most. */
static void tell(port *p) {
    switch (p->tick % STATUS_TICKS) {
    case 0U:
        tell_status(p);
        break;
    case 1U:
        tell_times(p);
        break;
    case 2U:
        if ((p->tick % IDENTITY_TICKS) == IDENTITY_AT) {
            tell_identity(p);
        } else if ((p->tick % IDENTITY_TICKS) == LINK_AT) {
            tell_link(p);
        } else {
            /* another time */
        }
        break;
    default:
        break;
    }
}

/* A save under way, piece by piece; an erase holds the processor for longer than a tick. */
static void keep_parameters(port *p) {
    const bool saving = (p->store != NULL) && (p->store->phase != TERRAPIN_STORE_IDLE);
    const bool slow = saving && !terrapin_bridge_on(p->state); /* the erase waits for that, and so does the watchdog */
    if (slow != p->flash_work) {
        p->flash_work = slow;
        hardware_flash_work(slow);
    }
    if (saving) {
        (void)terrapin_link_store_work(&p->link, p->state);
    }
}

/* Own sensors, own clock. What endangers somebody reaches the core as an emergency stop: off, and latched. */
static void own_tick(port *p) {
    const uint32_t begin = hardware_cycles();
    hardware_sense(&p->hardware, &p->inputs);
    p->inputs.tick = p->tick;
    p->inputs.estop = p->inputs.estop || p->hardware.bridge_break || p->hardware.brown_out;
    phases_note(&p->times, PHASE_SENSE, hardware_cycles() - begin);
    step(p);
    const uint32_t stepped = hardware_cycles();
    for (uint8_t i = 0; i < p->outputs.frame_count; i++) {
        publish(p, &p->outputs.frames[i]);
    }
    tell(p);
    phases_note(&p->times, PHASE_SEND, hardware_cycles() - stepped);
}

/* Somebody takes what we send. */
static bool listened_to(const port *p) {
    const can_state *bus = &p->bus->state;
    return p->parser.open || ((p->bus->phase == CAN_RUNNING) && !bus->bus_off && !bus->passive && !bus->no_acknowledge);
}

static void judge(port *p, uint32_t missed) {
    const bool good = terrapin_at_work(p->state) && !p->hardware.adc_silent && listened_to(p) && (missed == 0U);
    switch (health_tick(&p->health, good, terrapin_bridge_on(p->state), p->trial)) {
    case HEALTH_CONFIRM:
        hardware_flash_work(true);
        hardware_healthy();
        hardware_flash_work(p->flash_work);
        break;
    case HEALTH_FALL_BACK: /* the boot loader tries again, or starts the old image */
        hardware_drive(&p->hardware, 0, false);
        hardware_reset(p->bus, p->line, false);
        break;
    case HEALTH_OPEN:
    default:
        break;
    }
}

static void tick(port *p, uint32_t now) {
    phases_note(&p->times, PHASE_LATE, hardware_cycles() - hardware_tick_cycles());
    const uint32_t missed = now - p->tick - 1U;
    p->overruns += missed;
    p->tick = now;
    terrapin_seal_at(&p->link.seal, now);
    terrapin_intake_begin_tick(&p->intake);
    if (p->link.test_mode) {
        hardware_drive(&p->hardware, 0, false);
    } else {
        own_tick(p);
    }
    const bool stopped = (terrapin_latched(p->state) & TERRAPIN_LINK_STOPPED) != 0U;
    if (stopped != p->hardware.stopped) {
        p->hardware.stopped = stopped;
        hardware_keep_stop(stopped);
    }
    can_poll(p->bus);
    keep_parameters(p);
    if (!p->link.test_mode) {
        judge(p, missed);
    }
    hardware_alive((p->tick & (p->outputs.enable ? 0x80U : 0x200U)) != 0U); /* quick blinks: the bridge is on */
}

/* The bridge is off; a page of the records may be erased. */
static bool store_node(void *context, uint8_t node) {
    const port *p = context;
    hardware_flash_work(true);
    const bool good = hardware_store_node(node);
    hardware_flash_work(p->flash_work);
    return good;
}

void port_open(port *p, terrapin_state *state, can *bus, usart *line, struct terrapin_store *store,
               terrapin_update *update, const hardware_facts *hardware) {
    const bool trial = (update != NULL) && terrapin_boot_on_trial(update->boot, update->running);
    *p = (port){.trial = trial,
                .state = state,
                .bus = bus,
                .line = line,
                .store = store,
                .update = update,
                .hardware = *hardware};
    phases_open(&p->times, hardware->core_hz);
    terrapin_slcan_init(&p->parser);
    terrapin_intake_init(&p->intake);
    terrapin_link_init(&p->link, state, &p->inputs);
    terrapin_link_seal(&p->link, hardware->link_key, hardware->link_generation, hardware->start);
    terrapin_node_init(&p->node, hardware->node);
    terrapin_identity_init(&p->identity, hardware->unique, p->node.number);
    if (update != NULL) { /* the boot loader's records are there */
        p->identity.store = store_node;
        p->identity.context = p;
    }
    p->link.identity = &p->identity;
    p->link.board = (uint8_t)hardware->board;
    p->link.no_ground_wheel = hardware->no_ground_wheel;
    terrapin_parameter_defaults(p->defaults);
    for (uint32_t i = 0; i < hardware_parameter_count; i++) {
        p->defaults[hardware_parameters[i].index] = hardware_parameters[i].value; /* a test checks the range */
    }
    terrapin_link_use_defaults(&p->link, state, p->defaults);
    if (store != NULL) {
        terrapin_link_use_store(&p->link, state, store);
    }
    terrapin_latch(state, hardware->stopped ? TERRAPIN_LINK_STOPPED : 0U);
}

bool port_pass(port *p, uint32_t now) {
    if (now != p->tick) {
        tick(p, now);
        return true;
    }
    const uint32_t begin = hardware_cycles();
    const bool any = receive(p);
    if (any) {
        phases_note(&p->times, PHASE_RECEIVE, hardware_cycles() - begin);
    }
    return any;
}
