/* Fuzz target: the queue of frames before the dispatcher, with the real controller behind it, as a port has it. 12
 * bytes a frame: what happens after it (bit 0 the queue is emptied as far as the tick allows, bit 1 a tick ends, bit 7
 * the frame gets a counter and a right CRC), id (low byte first), length, 8 data bytes. The bridge is on when it
 * begins. Checked beyond the sanitizers: no more waits than there is room for, frames leave in the order in which they
 * came, a STOP_ALL acts at once, a COMMAND that is older than an IDLE that was taken never comes after it, and a tick
 * takes a bounded number of frames. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "intake.h"
#include "terrapin_interface.h"

#define RECORD      12U
#define MOST_A_TICK 64U /* outside test mode */
#define WARM_TICKS  2000U

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

typedef struct {
    terrapin_intake intake;
    terrapin_link link;
    terrapin_inputs inputs;
    uint32_t counter;     /* of the repaired frames */
    uint32_t put;         /* the number of the last one that waits, from 1 */
    uint32_t taken;       /* the last one that left */
    uint32_t superseded;  /* COMMANDs up to this one do not leave any more */
    uint32_t in_tick;     /* that left in this tick */
    uint32_t number[256]; /* by the low byte, which the queue keeps as the source */
} port;

static terrapin_state *state;
static terrapin_state *warm; /* driving */
static port fresh;

static void step(port *p) {
    terrapin_outputs outputs;
    p->inputs.tick++;
    terrapin_link_step(state, &p->inputs, &outputs);
    CHECK(outputs.enable == terrapin_bridge_on(state));
    terrapin_intake_begin_tick(&p->intake);
    p->in_tick = 0U;
}

static void take(port *p) {
    terrapin_frame frame;
    terrapin_frame reply;
    uint8_t source = 0;
    while (terrapin_intake_next(&p->intake, &p->link, state, &frame, &source)) {
        const uint32_t number = p->number[source];
        CHECK((number > p->taken) && (number <= p->put));
        CHECK((frame.id != TERRAPIN_ID_COMMAND) || (number > p->superseded));
        p->taken = number;
        p->in_tick++;
        CHECK(p->link.test_mode || (p->in_tick <= MOST_A_TICK));
        if (terrapin_accept(&p->link, state, &frame, &p->inputs, &reply) == TERRAPIN_ACCEPT_STEP) {
            step(p);
        }
    }
}

static void put(port *p, const terrapin_frame *frame) {
    const uint32_t before = p->intake.count;
    const uint32_t lost = p->intake.lost;
    const bool test_mode = p->link.test_mode;
    terrapin_stop_all_t stop;
    const bool stops = terrapin_decode_stop_all(frame, &stop) && (stop.request == TERRAPIN_REQUEST_IDLE);
    const uint32_t number = p->put + 1U;
    p->number[number & 0xFFU] = number;
    terrapin_intake_put(&p->intake, &p->link, state, &p->inputs, frame, (uint8_t)(number & 0xFFU));
    CHECK((p->intake.count <= TERRAPIN_INTAKE_SIZE) && (p->intake.superseded <= p->intake.count));
    CHECK((p->intake.count == before) || (p->intake.count == (before + 1U)));
    CHECK((p->intake.lost == lost) || ((before == TERRAPIN_INTAKE_SIZE) && (p->intake.count == before)));
    p->put += ((p->intake.count != before) || (p->intake.lost != lost)) ? 1U : 0U; /* it waits */
    if (stops && !test_mode) {
        CHECK(((terrapin_latched(state) & TERRAPIN_LINK_STOPPED) != 0U) && (p->intake.count == before));
    }
    if ((p->intake.count == before) && (before > 0U) && (p->intake.superseded == before)) {
        p->superseded = p->put; /* an IDLE or a STOP_ALL was taken: what waits is older */
    }
}

/* A robot that drives, once for all inputs. */
static void begin(void) {
    const terrapin_command_t run = {.request = TERRAPIN_REQUEST_RUN, .setpoint = 1000};
    terrapin_frame frame;
    terrapin_frame reply;
    state = malloc(terrapin_state_size());
    warm = malloc(terrapin_state_size());
    CHECK((state != NULL) && (warm != NULL));
    terrapin_link_init(&fresh.link, state, &fresh.inputs);
    terrapin_intake_init(&fresh.intake);
    fresh.inputs.tick = UINT32_MAX;
    fresh.inputs.current_code = 2048U;
    fresh.inputs.supply_code = 3000U;
    fresh.inputs.temperature_code = 1500U;
    fresh.inputs.swing_valid = true;
    for (uint32_t i = 0U; (i < WARM_TICKS) && !terrapin_bridge_on(state); i++) {
        if ((i % 50U) == 0U) {
            CHECK(terrapin_encode_command(&run, &frame));
            terrapin_e2e_protect(&frame, i / 50U);
            (void)terrapin_accept(&fresh.link, state, &frame, &fresh.inputs, &reply);
        }
        step(&fresh);
    }
    CHECK(terrapin_bridge_on(state));
    fresh.counter = fresh.link.command_counter;
    (void)memcpy(warm, state, terrapin_state_size());
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    if (warm == NULL) {
        begin();
    }
    static port p;
    p = fresh;
    (void)memcpy(state, warm, terrapin_state_size());
    for (size_t at = 0; (at + RECORD) <= size; at += RECORD) {
        const uint8_t *record = &bytes[at];
        terrapin_frame frame = {.id = (uint16_t)(record[1] | ((record[2] & 0x07U) << 8U)),
                                .length = (uint8_t)(record[3] % 9U)};
        (void)memcpy(frame.data, &record[4], sizeof frame.data);
        if ((record[0] & 0x80U) != 0U) {
            p.counter++;
            frame.length = 8U;
            terrapin_e2e_protect(&frame, p.counter);
        }
        put(&p, &frame);
        if ((record[0] & 1U) != 0U) {
            take(&p);
        }
        if (((record[0] & 2U) != 0U) && !p.link.test_mode) {
            step(&p);
        }
    }
    return 0;
}
