#include "seal.h"

#include "terrapin_assert.h"
#include "terrapin_interface.h"
#include "terrapin_pack.h"

#define HELD_MS    50U
#define WAITING_MS 200U
#define CHECKS_MS  10U
#define OPENED_MAX (UINT32_MAX / 2U) /* or a number came twice */

void terrapin_seal_init(terrapin_seal *seal, const uint32_t *key, uint32_t generation, uint32_t start) {
    TERRAPIN_ASSERT(seal != NULL);
    seal->key = key;
    seal->generation = generation;
    seal->start = start;
    seal->opened = 0U;
    seal->next[0] = 0U;
    seal->next[1] = 0U;
    seal->waiting = 0U;
    seal->holding = false;
    seal->checks = 0U;
    seal->checks_max = TERRAPIN_SEAL_CHECKS;
    seal->checks_ms = 0U;
    seal->now_ms = 0U;
}

bool terrapin_seal_open(terrapin_seal *seal, const terrapin_frame *frame, terrapin_frame *reply) {
    TERRAPIN_ASSERT((frame->id == TERRAPIN_ID_SESSION_OPEN) && (frame->length == TERRAPIN_LENGTH_SESSION_OPEN));
    const uint32_t place = seal->waiting;
    TERRAPIN_ASSERT(place < 2U);
    terrapin_session_open_t message;
    terrapin_read_session_open(frame, &message);
    if (((seal->next[place] == 1U) && ((seal->now_ms - seal->waiting_ms) < WAITING_MS)) || (seal->key == NULL) ||
        (message.generation == 0U) || (message.generation != seal->generation) || (seal->opened >= OPENED_MAX)) {
        return false;
    }
    seal->opened++;
    seal->waiting_ms = seal->now_ms;
    seal->next[place] = 1U;
    const terrapin_session_t answer = {.start = seal->start, .count = (2U * seal->opened) + place};
    const uint32_t numbers[TERRAPIN_CHASKEY_WORDS] = {message.host, answer.start, answer.count, message.generation};
    terrapin_chaskey(seal->key, numbers, seal->session[place]);
    (void)terrapin_pack_session(&answer, reply); /* the fields have the signals' widths */
    return true;
}

/* True when `tag` is that of the block in the session at this place, and its counter, of which the bits in `mask` came,
 * is new; it is then taken. */
static bool genuine(terrapin_seal *seal, uint32_t place, uint32_t block[TERRAPIN_CHASKEY_WORDS], uint32_t mask,
                    uint32_t tag) {
    TERRAPIN_ASSERT(place < 2U);
    const uint32_t next = seal->next[place];
    const uint32_t counter = next + ((block[1] - next) & mask);
    if ((seal->now_ms - seal->checks_ms) >= CHECKS_MS) {
        seal->checks_ms = seal->now_ms;
        seal->checks = 0U;
    }
    if ((next == 0U) || (counter < next) || (seal->checks >= seal->checks_max)) {
        return false;
    }
    seal->checks++;
    block[1] = counter;
    terrapin_chaskey(seal->session[place], block, block);
    if (block[0] != tag) {
        return false;
    }
    seal->next[place] = counter + 1U;
    if (next == 1U) { /* it waited: the other one has ended */
        seal->waiting = (uint8_t)(1U - place);
        seal->next[seal->waiting] = 0U;
    }
    return true;
}

const terrapin_frame *terrapin_seal_taken(terrapin_seal *seal, const terrapin_frame *frame) {
    TERRAPIN_ASSERT((frame->id == TERRAPIN_ID_SEAL) || (frame->id == TERRAPIN_ID_COMMAND_SEALED));
    TERRAPIN_ASSERT((TERRAPIN_LENGTH_SEAL == 8U) && (frame->length == TERRAPIN_LENGTH_COMMAND_SEALED));
    const terrapin_frame *taken = frame;
    uint32_t block[TERRAPIN_CHASKEY_WORDS];
    uint32_t mask = 0xFFU;
    uint32_t place;
    uint32_t tag;
    if (frame->id == (uint16_t)TERRAPIN_ID_SEAL) {
        terrapin_seal_t message;
        terrapin_read_seal(frame, &message);
        taken = &seal->held;
        if (!seal->holding || ((seal->now_ms - seal->held_ms) > HELD_MS)) {
            return NULL;
        }
        block[1] = (uint32_t)message.counter;
        block[2] = terrapin_get_word(taken->data);
        block[3] = terrapin_get_word(&taken->data[4]);
        mask = 0xFFFFU;
        place = (uint32_t)message.session;
        tag = message.tag;
    } else {
        terrapin_command_sealed_t command;
        terrapin_read_command_sealed(frame, &command);
        block[1] = (uint32_t)command.counter;
        block[2] = terrapin_get_word(frame->data) & 0x00FFFFFFU; /* but the counter */
        block[3] = 0U;
        place = (uint32_t)command.session;
        tag = command.tag;
    }
    block[0] = taken->id;
    if (!genuine(seal, place, block, mask, tag)) {
        return NULL;
    }
    if (taken != frame) {
        seal->holding = false;
    }
    return taken;
}
