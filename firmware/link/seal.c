#include "seal.h"

#include "terrapin_assert.h"
#include "terrapin_interface.h"
#include "terrapin_pack.h"

#define WAITING_MS 200U
#define CHECKS_MS  100U
#define OPENED_MAX 0x80000000U /* or a number came twice */
#define UNIT_MS    8U          /* of a frame's time */
#define LATE       120U        /* units that a frame may be behind this clock: 0.96 s */
#define EARLY      4U          /* and before it, so that with the one under way nothing older than 1 s is taken */
#define SILENT     244U        /* units above the least time until a session ends: 1.96 s after its last good tag's */
#define LASTING    2048U       /* units of a session: 16.4 s */

void terrapin_seal_init(terrapin_seal *seal, const uint32_t *key, uint32_t generation, uint32_t start) {
    TERRAPIN_ASSERT((seal != NULL) && ((key != NULL) || (generation == 0U)));
    seal->key = key;
    seal->generation = generation;
    seal->start = start;
}

/* How long ago it was opened, as its host counts. */
static uint32_t units(const terrapin_seal *seal, const terrapin_sealed_session *session) {
    return (seal->now_ms - session->begun_ms) / UNIT_MS;
}

void terrapin_seal_at(terrapin_seal *seal, uint32_t now_ms) {
    seal->now_ms = now_ms;
    for (uint32_t place = 0; place < 2U; place++) {
        terrapin_sealed_session *const session = &seal->session[place];
        if (units(seal, session) >= (session->next + SILENT)) {
            session->next = 0U;
        }
    }
}

bool terrapin_seal_open(terrapin_seal *seal, const terrapin_frame *frame, terrapin_frame *reply) {
    TERRAPIN_ASSERT((frame->id == TERRAPIN_ID_SESSION_OPEN) && (frame->length == TERRAPIN_LENGTH_SESSION_OPEN));
    const uint32_t place = seal->waiting;
    TERRAPIN_ASSERT(place < 2U);
    terrapin_sealed_session *const session = &seal->session[place];
    terrapin_session_open_t message;
    terrapin_read_session_open(frame, &message);
    if (((session->next == 1U) && ((seal->now_ms - session->begun_ms) < WAITING_MS)) || (message.generation == 0U) ||
        (message.generation != seal->generation) || (seal->opened >= OPENED_MAX)) {
        return false;
    }
    seal->opened++;
    session->begun_ms = seal->now_ms;
    session->next = 1U;
    uint32_t *const key = session->key;
    key[0] = seal->start;
    key[1] = seal->opened;
    key[2] = 0U;
    key[3] = 0U; /* a generation that no session has */
    terrapin_chaskey(seal->key, key, key);
    key[1] = key[0];
    key[2] = (2U * seal->opened) + place;
    const terrapin_session_t answer = {.start = key[1], .count = key[2]};
    (void)terrapin_pack_session(&answer, reply); /* the fields have the signals' widths */
    key[0] = message.host;
    key[3] = message.generation;
    terrapin_chaskey(seal->key, key, key);
    return true;
}

/* True when `tag` is that of the block in the session at this place, and its time, of which the low 8 bits came, is now
 * and after the last one taken; it is then taken. */
static bool genuine(terrapin_seal *seal, uint32_t place, uint32_t block[TERRAPIN_CHASKEY_WORDS], uint32_t tag) {
    TERRAPIN_ASSERT(place < 2U);
    terrapin_sealed_session *const session = &seal->session[place];
    const uint32_t next = session->next;
    const uint32_t latest = units(seal, session) + EARLY;
    const uint32_t age = (latest - block[1]) & 0xFFU;
    const uint32_t sent = latest - age;
    if ((seal->now_ms - seal->checks_ms) >= CHECKS_MS) {
        seal->checks_ms = seal->now_ms;
        seal->checks = 0U;
    }
    if ((next == 0U) || (age > (LATE + EARLY)) || (sent < next) || (sent >= LASTING) ||
        (seal->checks >= TERRAPIN_SEAL_CHECKS)) {
        return false;
    }
    seal->checks++;
    block[1] = sent;
    terrapin_chaskey(session->key, block, block);
    if (block[0] != tag) {
        return false;
    }
    session->next = sent + 1U;
    if (next == 1U) { /* it waited: the other one has ended */
        seal->waiting = (uint8_t)(1U - place);
        seal->session[seal->waiting].next = 0U;
    }
    return true;
}

const terrapin_frame *terrapin_seal_taken(terrapin_seal *seal, const terrapin_frame *frame) {
    TERRAPIN_ASSERT((frame->id == TERRAPIN_ID_SEAL) || (frame->id == TERRAPIN_ID_COMMAND_SEALED));
    TERRAPIN_ASSERT((TERRAPIN_LENGTH_SEAL == 8U) && (frame->length == TERRAPIN_LENGTH_COMMAND_SEALED));
    const terrapin_frame *taken = frame;
    uint32_t block[TERRAPIN_CHASKEY_WORDS];
    uint32_t place;
    uint32_t tag;
    if (frame->id == (uint16_t)TERRAPIN_ID_SEAL) {
        terrapin_seal_t message;
        terrapin_read_seal(frame, &message);
        taken = &seal->held;
        if (!seal->holding) {
            return NULL;
        }
        block[1] = (uint32_t)message.time;
        block[2] = terrapin_get_word(taken->data);
        block[3] = terrapin_get_word(&taken->data[4]);
        place = (uint32_t)message.session;
        tag = message.tag;
    } else {
        terrapin_command_sealed_t command;
        terrapin_read_command_sealed(frame, &command);
        block[1] = (uint32_t)command.time;
        block[2] = terrapin_get_word(frame->data) & 0x00FFFFFFU; /* but the time */
        block[3] = 0U;
        place = (uint32_t)command.session;
        tag = command.tag;
    }
    block[0] = taken->id;
    if (!genuine(seal, place, block, tag)) {
        return NULL;
    }
    if (taken != frame) {
        seal->holding = false;
    }
    return taken;
}
