/* terrapin_accept: any frame, from any state of the link that it can have; with the seal, the node's number and the
 * generated decoders. The controller's and the store's functions answer anything within what their headers say. */
#include "proof.h"

#include "command.c"
#include "dispatch.c"
#include "genuine.c"
#include "node.c"
#include "seal.c"
#include "terrapin_interface.c"

static terrapin_link link;
static terrapin_store store;
static terrapin_identity identity;
static int32_t values[TERRAPIN_PARAMETER_COUNT];
static const uint32_t key[4] = {1U, 2U, 3U, 4U};
static bool bridge_on;
static bool stopped; /* STOP_ALL is among the latched faults, of which the core takes it with a clear alone */

bool terrapin_bridge_on(const terrapin_state *s) {
    (void)s;
    return bridge_on;
}

uint32_t terrapin_latched(const terrapin_state *s) {
    (void)s;
    return (nondet_word() & ~TERRAPIN_LINK_STOPPED) | (stopped ? TERRAPIN_LINK_STOPPED : 0U);
}

void terrapin_latch(terrapin_state *s, uint32_t faults) {
    (void)s;
    PROVE(((faults & ~TERRAPIN_LINK_STOPPED) == 0U) || !bridge_on || link.test_mode);
    stopped = stopped || ((faults & TERRAPIN_LINK_STOPPED) != 0U);
}

terrapin_parameter_result terrapin_init_with(terrapin_state *s, const int32_t *given) {
    (void)s;
    PROVE((given == NULL) || __CPROVER_r_ok(given, sizeof values));
    stopped = false; /* with all of the controller */
    return TERRAPIN_PARAMETER_OK;
}

terrapin_parameter_result terrapin_parameter_set_all(terrapin_state *s, const int32_t *given) {
    (void)s;
    PROVE((given == NULL) || __CPROVER_r_ok(given, sizeof values));
    return TERRAPIN_PARAMETER_OK;
}

terrapin_parameter_result terrapin_parameter_set(terrapin_state *s, uint16_t index, int32_t value) {
    (void)s;
    (void)value;
    return (index < TERRAPIN_PARAMETER_COUNT) ? (terrapin_parameter_result)(nondet_byte() % 4U)
                                              : TERRAPIN_PARAMETER_UNKNOWN;
}

terrapin_parameter_result terrapin_parameter_get(const terrapin_state *s, uint16_t index, int32_t *value) {
    (void)s;
    *value = nondet_int();
    return (index < TERRAPIN_PARAMETER_COUNT) ? TERRAPIN_PARAMETER_OK : TERRAPIN_PARAMETER_UNKNOWN;
}

bool terrapin_store_differs(const terrapin_store *s, const terrapin_state *now) {
    (void)now;
    PROVE(s == &store);
    return nondet_bool();
}

bool terrapin_store_save(terrapin_store *s, const terrapin_state *now) {
    (void)now;
    PROVE((s == &store) && !bridge_on);
    s->phase = (terrapin_store_phase)(nondet_byte() % 4U);
    return nondet_bool();
}

void terrapin_chaskey(const uint32_t k[4], const uint32_t block[4], uint32_t tag[4]) {
    PROVE(__CPROVER_r_ok(k, 16U) && __CPROVER_r_ok(block, 16U) && __CPROVER_w_ok(tag, 16U));
    __CPROVER_havoc_slice(tag, 16U);
}

static bool store_node(void *context, uint8_t node) {
    (void)context;
    PROVE((node < TERRAPIN_NODES) && !bridge_on);
    return nondet_bool();
}

static bool counter(uint8_t value) {
    return (value <= TERRAPIN_E2E_COUNTER_MAX) || (value == TERRAPIN_E2E_NO_COUNTER);
}

/* What terrapin_link_init makes so, and every frame leaves so. */
static bool sound(void) {
    return counter(link.command_counter) && counter(link.dropped_counter) && counter(link.write_counter) &&
           counter(link.test_counter) && counter(link.store_counter) &&
           (link.reply_counter <= TERRAPIN_E2E_COUNTER_MAX) && counter(identity.request_counter) &&
           (identity.reply_counter <= TERRAPIN_E2E_COUNTER_MAX) && (identity.node < TERRAPIN_NODES) &&
           (identity.stored < TERRAPIN_NODES) && (link.seal.waiting < 2U) &&
           (!link.seal.holding || needs_seal(&link.seal.held)) &&
           ((link.seal.key != NULL) || (link.seal.generation == 0U)) && (link.seal.session[0].next <= LASTING) &&
           (link.seal.session[1].next <= LASTING);
}

/* What a session takes is of now and behind all that it took; one that has ended takes nothing. */
static void prove_time(const terrapin_sealed_session *before, const terrapin_sealed_session *session) {
    if ((session->next != before->next) && (session->next > 1U)) {
        const uint32_t now = (link.seal.now_ms - session->begun_ms) / UNIT_MS;
        const uint32_t sent = session->next - 1U;
        PROVE((before->next != 0U) && (sent >= before->next) && (sent < LASTING));
        PROVE((sent <= (now + EARLY)) && ((sent + LATE) >= now));
    }
}

int main(void) {
    terrapin_state *const state = (terrapin_state *)values; /* never looked into here */
    terrapin_inputs inputs;
    terrapin_frame frame;
    terrapin_frame reply;
    ANYTHING(link);
    ANYTHING(store);
    ANYTHING(identity);
    ANYTHING(inputs);
    ANYTHING(frame);
    bridge_on = nondet_bool();
    link.store = nondet_bool() ? &store : NULL;
    link.defaults = nondet_bool() ? values : NULL;
    link.identity = nondet_bool() ? &identity : NULL;
    link.seal.key = nondet_bool() ? key : NULL;
    identity.store = nondet_bool() ? store_node : NULL;
    ASSUME(sound());
    const bool test_mode = link.test_mode;
    stopped = nondet_bool();
    const bool held = stopped;
    terrapin_stop_all_t stop;
    const bool stops = terrapin_decode_stop_all(&frame, &stop) && (stop.request == TERRAPIN_REQUEST_IDLE);
    const bool fresh = inputs.command_fresh;
    const terrapin_command before = inputs.command;
    const terrapin_sealed_session first = link.seal.session[0];
    const terrapin_sealed_session second = link.seal.session[1];

    const terrapin_accept_result result = terrapin_accept(&link, state, &frame, &inputs, &reply);

    PROVE(sound());
    prove_time(&first, &link.seal.session[0]);
    prove_time(&second, &link.seal.session[1]);
    PROVE((result != TERRAPIN_ACCEPT_STEP) || link.test_mode);
    PROVE(test_mode || !link.test_mode || !bridge_on); /* armed with the bridge off alone */
    if ((result == TERRAPIN_ACCEPT_REPLY) || (result == TERRAPIN_ACCEPT_UPDATE)) {
        PROVE((reply.id <= 0x7FFU) || (result == TERRAPIN_ACCEPT_UPDATE));
    }
    if (inputs.command_fresh) {
        PROVE(fresh || (inputs.command.request <= TERRAPIN_REQUEST_CLEAR));
        PROVE(fresh || (inputs.command.control <= TERRAPIN_CONTROL_SPEED));
    }
    const bool idle = inputs.command_fresh && (inputs.command.request == TERRAPIN_REQUEST_IDLE);
    if (fresh && (before.request == TERRAPIN_REQUEST_IDLE) && inputs.command_fresh) {
        PROVE(idle); /* nothing takes the place of an IDLE of this tick */
    }
    const bool clears = fresh && (before.request == TERRAPIN_REQUEST_CLEAR);
    PROVE(stopped || !held || clears);                      /* no frame takes it away, */
    PROVE(test_mode || !link.test_mode || !held || clears); /* test mode is no way round it, */
    PROVE(!stops || (stopped && idle));                     /* and it takes the place of a clear of its tick */
    PROVE((link.seal.key == NULL) || (frame.id != TERRAPIN_ID_COMMAND) || fresh || !inputs.command_fresh || idle);
    return 0;
}
