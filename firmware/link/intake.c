#include "intake.h"

#include "terrapin_assert.h"
#include "terrapin_interface.h"
#include "terrapin_pack.h"

#define BUDGET_ON  1100U /* with the longest step, 8 frames that come and AHEAD_MAX: below 4,000 instructions */
#define BUDGET_OFF 7300U /* below 10,000 */
#define AHEAD_MAX  2U    /* tries to take a COMMAND out of turn, in a tick */
#define AHEAD_COST 200U  /* of one, beyond that of a frame that comes */

enum { STOP_ALL, COMMAND, WRITE, READ, TEST_MODE, STORE_COMMAND, STORE_READ, NODE, SENSORS, UPDATE, SEALED, FOREIGN };

static uint8_t kind_of(uint16_t id) {
    uint8_t kind = (uint8_t)FOREIGN;
    switch (id) {
    case TERRAPIN_ID_COMMAND:
        kind = (uint8_t)COMMAND;
        break;
    case TERRAPIN_ID_PARAMETER_WRITE:
        kind = (uint8_t)WRITE;
        break;
    case TERRAPIN_ID_PARAMETER_READ:
    case TERRAPIN_ID_IDENTITY_READ:
        kind = (uint8_t)READ;
        break;
    case TERRAPIN_ID_TEST_MODE:
        kind = (uint8_t)TEST_MODE;
        break;
    case TERRAPIN_ID_STORE_COMMAND:
        kind = (uint8_t)STORE_COMMAND;
        break;
    case TERRAPIN_ID_STORE_READ:
        kind = (uint8_t)STORE_READ;
        break;
    case TERRAPIN_ID_SENSORS_SLOW:
    case TERRAPIN_ID_SENSORS_FAST:
    case TERRAPIN_ID_SENSORS_HEADING:
        kind = (uint8_t)SENSORS;
        break;
    case TERRAPIN_ID_COMMAND_SEALED:
    case TERRAPIN_ID_SEAL:
    case TERRAPIN_ID_SESSION_OPEN:
        kind = (uint8_t)SEALED;
        break;
    case TERRAPIN_ID_UPDATE_BEGIN:
    case TERRAPIN_ID_UPDATE_DATA:
    case TERRAPIN_ID_UPDATE_BLOCK:
    case TERRAPIN_ID_UPDATE_END:
    case TERRAPIN_ID_UPDATE_QUERY:
    case TERRAPIN_ID_UPDATE_RESET:
        kind = (uint8_t)UPDATE;
        break;
    default:
        if (id == TERRAPIN_ID_STOP_ALL) {
            kind = (uint8_t)STOP_ALL;
        } else if (id == TERRAPIN_ID_NODE_REQUEST) {
            kind = (uint8_t)NODE;
        } else {
            /* other traffic on the bus */
        }
        break;
    }
    return kind;
}

void terrapin_intake_init(terrapin_intake *intake) {
    static const terrapin_intake empty = {0};
    TERRAPIN_ASSERT(intake != NULL);
    *intake = empty;
}

void terrapin_intake_begin_tick(terrapin_intake *intake) {
    TERRAPIN_ASSERT(intake->count <= TERRAPIN_INTAKE_SIZE);
    intake->spent = intake->ahead * AHEAD_COST;
    intake->ahead = 0U;
    intake->taken = false;
    intake->stopped = false;
}

/* The oldest one leaves. */
static void drop_first(terrapin_intake *intake) {
    TERRAPIN_ASSERT(intake->count > 0U);
    intake->first = (intake->first + 1U) % TERRAPIN_INTAKE_SIZE;
    intake->count--;
    intake->superseded -= (intake->superseded > 0U) ? 1U : 0U;
}

static inline bool is_idle(const terrapin_frame *frame) {
    terrapin_command_t message; /* unpacked here, where all but the request is left out */
    return terrapin_unpack_command(frame, &message) && (message.request == TERRAPIN_REQUEST_IDLE);
}

/* An IDLE, before those that wait. */
static void take_idle(terrapin_intake *intake, terrapin_link *link, terrapin_state *state, terrapin_inputs *inputs,
                      const terrapin_frame *frame) {
    intake->ahead++;
    /* Commands that wait have counters of their own, so that of the last accepted one may have come round again. */
    const uint8_t counter = link->command_counter;
    link->command_counter = TERRAPIN_E2E_NO_COUNTER;
    terrapin_frame no_reply = {0};
    (void)terrapin_accept(link, state, frame, inputs, &no_reply); /* a COMMAND has none */
    const bool taken = link->command_counter != TERRAPIN_E2E_NO_COUNTER;
    if (taken) {
        intake->superseded = intake->count;
    } else {
        link->command_counter = counter; /* damaged, and counted */
    }
}

static void take_stop_all(terrapin_intake *intake, terrapin_link *link, terrapin_state *state, terrapin_inputs *inputs,
                          const terrapin_frame *frame) {
    if (!intake->stopped) {
        terrapin_frame no_reply = {0};
        const uint32_t malformed = link->malformed;
        (void)terrapin_accept(link, state, frame, inputs, &no_reply);
        intake->stopped = link->malformed == malformed;
    }
    if (intake->stopped) {
        intake->superseded = intake->count;
    }
}

void terrapin_intake_put(terrapin_intake *intake, terrapin_link *link, terrapin_state *state, terrapin_inputs *inputs,
                         const terrapin_frame *frame, uint8_t source) {
    TERRAPIN_ASSERT((intake != NULL) && (link != NULL) && (frame != NULL));
    const uint8_t kind = kind_of(frame->id);
    if (kind == (uint8_t)FOREIGN) {
        link->unknown++;
        return;
    }
    if ((kind == (uint8_t)STOP_ALL) && !link->test_mode) {
        take_stop_all(intake, link, state, inputs, frame);
        return;
    }
    if ((kind == (uint8_t)COMMAND) && (intake->count > 0U) && (intake->ahead < AHEAD_MAX) && !link->test_mode &&
        is_idle(frame) && terrapin_bridge_on(state)) {
        take_idle(intake, link, state, inputs, frame);
        return;
    }
    if (intake->count == TERRAPIN_INTAKE_SIZE) {
        drop_first(intake);
        intake->lost++;
    }
    const uint32_t place = (intake->first + intake->count) % TERRAPIN_INTAKE_SIZE;
    intake->waiting[place].frame = *frame;
    intake->waiting[place].kind = kind;
    intake->waiting[place].source = source;
    intake->count++;
}

/* True when a frame of this kind is still to be taken in this tick. */
static bool affordable(terrapin_intake *intake, uint8_t kind, bool on) {
    /* What a frame costs at most [instructions on a Cortex-M4], the queue's own work with it; tests/target/test_step.py
     * measures. UPDATE_* are the port's, and announced when they verify. With the bridge off TEST_MODE resets the
     * controller, which a host can ask for as often as it likes. */
    static const struct {
        uint16_t on;  /* with the bridge on */
        uint16_t off; /* above the budget: a tick for itself */
    } cost[FOREIGN] = {
        [STOP_ALL] = {80U, 80U},          [NODE] = {430U, 8000U},        [COMMAND] = {275U, 275U},
        [WRITE] = {430U, 4200U},          [READ] = {260U, 260U},         [TEST_MODE] = {230U, 8000U},
        [STORE_COMMAND] = {1000U, 8000U}, [STORE_READ] = {1000U, 1000U}, [SENSORS] = {110U, 110U},
        [UPDATE] = {430U, 200U},          [SEALED] = {1000U, 7000U}, /* a SEAL with the frame that it seals */
    };
    TERRAPIN_ASSERT(kind < (uint8_t)FOREIGN);
    uint32_t budget = BUDGET_OFF;
    uint32_t price = cost[kind].off;
    if (on) {
        budget = BUDGET_ON;
        price = cost[kind].on;
    }
    const bool yes =
        !intake->taken || ((intake->spent + price) <= budget); /* one frame always: nothing waits forever */
    intake->spent += yes ? price : 0U;
    intake->taken = intake->taken || yes;
    return yes;
}

bool terrapin_intake_next(terrapin_intake *intake, const terrapin_link *link, const terrapin_state *state,
                          terrapin_frame *frame, uint8_t *source) {
    TERRAPIN_ASSERT((intake != NULL) && (link != NULL) && (frame != NULL) && (source != NULL));
    while ((intake->superseded > 0U) && (intake->waiting[intake->first].kind == (uint8_t)COMMAND)) {
        drop_first(intake);
    }
    if (intake->count == 0U) {
        return false;
    }
    const uint8_t kind = intake->waiting[intake->first].kind;
    const bool unpriced = link->test_mode && (kind != (uint8_t)TEST_MODE);
    if (!unpriced && !affordable(intake, kind, terrapin_bridge_on(state))) {
        return false;
    }
    *frame = intake->waiting[intake->first].frame;
    *source = intake->waiting[intake->first].source;
    drop_first(intake);
    return true;
}
