/* Fuzz target: any sequence of CAN frames through the dispatcher and the step. 11 bytes a frame: id (low byte first;
 * bit 15 asks for a repaired counter and CRC, so that the search gets past the protection), length, 8 data bytes. Test
 * mode is armed first. A store on emulated flash is attached. What is left behind the last whole frame says what else:
 * 1 byte, a link key, and what is repaired is sealed by a host that has it; 2, no store, and defaults of the port's
 * own. Checked beyond the sanitizers: the inputs stay within their signals, outputs within their bounds, bridge and
 * duty agree, no call to the flash is refused, and none erases with the bridge on. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "dispatch.h"
#include "flash_emulated.c"
#include "parameters.h"
#include "../sealed_host.h"
#include "terrapin_interface.h"

#define RECORD 11U
#define PAGE   1024U /* one set */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void check_inputs(const terrapin_inputs *in) {
    CHECK((in->current_code <= 4095U) && (in->supply_code <= 4095U) && (in->temperature_code <= 4095U));
    CHECK((in->swing_angle_mrad >= -4096) && (in->swing_angle_mrad <= 4095));
    CHECK((in->swing_rate_centirad_s >= -4096) && (in->swing_rate_centirad_s <= 4095));
    CHECK((in->pitch_mrad >= -2048) && (in->pitch_mrad <= 2047));
    CHECK((in->ground_speed_mm_s >= -4096) && (in->ground_speed_mm_s <= 4095));
    CHECK((in->command.request <= TERRAPIN_REQUEST_CLEAR) && (in->command.control <= TERRAPIN_CONTROL_SPEED));
}

static void check_outputs(const terrapin_outputs *out) {
    CHECK((out->frame_count >= 1U) && (out->frame_count <= TERRAPIN_MAX_FRAMES));
    CHECK(out->duty_q15 >= -32767);
    CHECK(out->enable || (out->duty_q15 == 0));
    CHECK((out->faults & ~TERRAPIN_FAULTS_KNOWN) == 0U);
    for (uint8_t i = 0; i < out->frame_count; i++) {
        CHECK((out->frames[i].id <= 0x7FFU) && (out->frames[i].length <= 8U));
    }
}

static terrapin_flash_emulated memory;
static const uint32_t link_key[4] = {1U, 2U, 3U, 4U};

#define GENERATION 3U

static sealed_host host; /* in the session that it opened last */
static uint32_t number;

static void send(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame, terrapin_inputs *inputs) {
    terrapin_frame reply;
    terrapin_outputs outputs;
    const terrapin_accept_result result = terrapin_accept(link, state, frame, inputs, &reply);
    check_inputs(inputs);
    if (result == TERRAPIN_ACCEPT_STEP) {
        CHECK(link->test_mode);
        terrapin_link_step(state, inputs, &outputs);
        check_outputs(&outputs);
    } else if (result == TERRAPIN_ACCEPT_REPLY) {
        terrapin_parameter_value_t value;
        terrapin_store_status_t status;
        terrapin_store_found_t found;
        terrapin_identity_t identity;
        terrapin_node_status_t node;
        terrapin_session_t session;
        if (terrapin_decode_session(&reply, &session)) {
            sealed_host_opens(&host, link_key, number, GENERATION, &session, link->seal.now_ms);
            return;
        }
        CHECK(terrapin_decode_node_status(&reply, &node) || terrapin_decode_parameter_value(&reply, &value) ||
              terrapin_decode_store_status(&reply, &status) || terrapin_decode_store_found(&reply, &found) ||
              terrapin_decode_identity(&reply, &identity));
    } else if (result == TERRAPIN_ACCEPT_UPDATE) {
        CHECK((link->seal.key != NULL) && (link->seal.held.id >= TERRAPIN_ID_UPDATE_BEGIN));
    } else {
        /* dropped, or taken without an answer */
    }
    CHECK(terrapin_link_bridge_allowed(link) != link->test_mode);
    if (link->store == NULL) {
        return;
    }
    const bool erasing = link->store->phase == TERRAPIN_STORE_ERASE;
    const uint32_t before = memory.operations;
    (void)terrapin_link_store_work(link, state);
    CHECK(!erasing || !terrapin_bridge_on(state) || (memory.operations == before));
    CHECK((memory.misuse == 0U) && !link->store->failed);
}

/* As the host that has the key sends it: a COMMAND_SEALED with its tag, all else with a SEAL behind it. */
static void send_sealed(terrapin_link *link, terrapin_state *state, terrapin_frame *frame, terrapin_inputs *inputs) {
    sealed_host_at(&host, link->seal.now_ms);
    if (frame->id == TERRAPIN_ID_SESSION_OPEN) {
        number = terrapin_get_word(frame->data);
        terrapin_put_word(&frame->data[4], GENERATION);
        send(link, state, frame, inputs);
    } else if (frame->id == TERRAPIN_ID_COMMAND_SEALED) {
        sealed_host_commands(&host, frame);
        send(link, state, frame, inputs);
    } else {
        const terrapin_frame seal = sealed_host_seals(&host, frame);
        send(link, state, frame, inputs);
        send(link, state, &seal, inputs);
    }
}

static bool keep_node(void *context, uint8_t node) {
    (void)context;
    CHECK(node < TERRAPIN_NODES);
    return (node % 2U) == 0U;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static terrapin_state *state;
    terrapin_link link;
    terrapin_inputs inputs;
    terrapin_frame frame;
    const terrapin_test_mode_t arm = {.key = TERRAPIN_TEST_MODE_KEY};
    uint32_t counter = 0;
    if (state == NULL) {
        state = malloc(terrapin_state_size());
        CHECK(state != NULL);
    }
    static const uint32_t sectors[2] = {PAGE, PAGE};
    static const terrapin_flash_area pages[2] = {{0U, PAGE}, {PAGE, PAGE}};
    static uint8_t cells[2U * PAGE];
    terrapin_store store;
    (void)memset(cells, 0xFF, sizeof cells);
    terrapin_flash_emulated_init(&memory, cells, sectors, 2U, 4U);
    const terrapin_flash flash = terrapin_flash_emulated_driver(&memory);
    CHECK(terrapin_store_open(&store, &flash, pages));
    terrapin_link_init(&link, state, &inputs);
    terrapin_link_use_store(&link, state, &store);
    CHECK(terrapin_encode_test_mode(&arm, &frame));
    terrapin_e2e_protect(&frame, counter);
    send(&link, state, &frame, &inputs);
    CHECK(link.test_mode);
    terrapin_identity identity;
    terrapin_identity_init(&identity, 0x01020304U, 0U);
    identity.store = keep_node;
    link.identity = &identity;
    const bool keyed = (size % RECORD) == 1U;
    if (keyed) {
        (void)memset(&host, 0, sizeof host);
        terrapin_link_seal(&link, link_key, GENERATION, 1U);
    }
    if ((size % RECORD) == 2U) {
        static int32_t values[TERRAPIN_PARAMETER_COUNT];
        terrapin_parameter_defaults(values);
        link.store = NULL;
        terrapin_link_use_defaults(&link, state, values);
    }
    for (size_t at = 0; (at + RECORD) <= size; at += RECORD) {
        terrapin_seal_at(&link.seal, link.seal.now_ms + 10U); /* as fast as tags are looked at */
        const uint8_t *record = &bytes[at];
        frame.id = (uint16_t)(record[0] | ((record[1] & 0x07U) << 8U));
        frame.length = record[2] % 9U;
        for (size_t i = 0; i < 8U; i++) {
            frame.data[i] = record[3U + i];
        }
        if ((record[1] & 0x80U) != 0U) {
            counter++;
            frame.length = 8U;
            terrapin_e2e_protect(&frame, counter);
        }
        if (keyed && ((record[1] & 0x80U) != 0U)) {
            send_sealed(&link, state, &frame, &inputs);
        } else {
            send(&link, state, &frame, &inputs);
        }
    }
    return 0;
}
