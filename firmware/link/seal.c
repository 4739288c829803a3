#include "seal.h"

#include "terrapin_assert.h"
#include "terrapin_interface.h"

#define HELD_MS    50U
#define WAITING_MS 200U
#define CHECKS_MS  10U

void terrapin_seal_init(terrapin_seal *seal, const uint32_t *key, uint32_t generation, uint32_t start) {
    TERRAPIN_ASSERT(seal != NULL);
    seal->key = key;
    seal->generation = generation;
    seal->start = start;
    seal->opened = 0U;
    seal->running.open = false;
    seal->waiting.open = false;
    seal->holding = false;
    seal->checks = 0U;
    seal->checks_max = TERRAPIN_SEAL_CHECKS;
    seal->checks_ms = 0U;
    seal->now_ms = 0U;
}

bool terrapin_seal_open(terrapin_seal *seal, uint32_t host, uint32_t generation) {
    const bool kept = seal->waiting.open && ((seal->now_ms - seal->waiting_ms) < WAITING_MS);
    const bool good = (seal->key != NULL) && (generation != 0U) && (generation == seal->generation) && !kept &&
                      (seal->opened < UINT32_MAX);
    if (good) {
        seal->opened++;
        const uint32_t numbers[TERRAPIN_CHASKEY_WORDS] = {host, seal->start, seal->opened, generation};
        terrapin_chaskey(seal->key, numbers, seal->waiting.key);
        seal->waiting.counter = 0U;
        seal->waiting.open = true;
        seal->waiting_ms = seal->now_ms;
    }
    return good;
}

uint32_t terrapin_seal_tag(const uint32_t key[4], uint32_t id, uint32_t counter, uint32_t low, uint32_t high) {
    uint32_t block[TERRAPIN_CHASKEY_WORDS] = {id, counter, low, high};
    terrapin_chaskey(key, block, block);
    return block[0];
}

/* The whole counter above the last one whose low bits are these; not above it when there is none. */
static uint32_t whole_counter(uint32_t last, uint32_t low, uint32_t bits) {
    TERRAPIN_ASSERT((bits > 0U) && (bits < 32U));
    const uint32_t mask = ((uint32_t)1U << bits) - 1U;
    return last + ((low - last) & mask);
}

static bool fits(terrapin_seal *seal, terrapin_session *session, uint32_t counter, const uint32_t message[3],
                 uint32_t tag) {
    if (!session->open || (counter <= session->counter) || (seal->checks >= seal->checks_max)) {
        return false;
    }
    seal->checks++;
    const bool good = terrapin_seal_tag(session->key, message[0], counter, message[1], message[2]) == tag;
    if (good) {
        session->counter = counter;
    }
    return good;
}

bool terrapin_seal_check(terrapin_seal *seal, uint32_t id, uint32_t counter, uint32_t bits, uint32_t low, uint32_t high,
                         uint32_t tag) {
    const uint32_t message[3] = {id, low, high};
    if ((seal->now_ms - seal->checks_ms) >= CHECKS_MS) {
        seal->checks_ms = seal->now_ms;
        seal->checks = 0U;
    }
    bool good = fits(seal, &seal->running, whole_counter(seal->running.counter, counter, bits), message, tag);
    if (!good) {
        good = fits(seal, &seal->waiting, whole_counter(seal->waiting.counter, counter, bits), message, tag);
        if (good) {
            seal->running = seal->waiting;
            seal->waiting.open = false;
        }
    }
    return good;
}

void terrapin_seal_hold(terrapin_seal *seal, const terrapin_frame *frame) {
    seal->held = *frame;
    seal->held_ms = seal->now_ms;
    seal->holding = true;
}

static uint32_t word(const uint8_t *bytes) {
    return ((uint32_t)bytes[3] << 24U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[1] << 8U) | bytes[0];
}

bool terrapin_seal_release(terrapin_seal *seal, uint32_t id_low, uint32_t counter, uint32_t tag,
                           terrapin_frame *frame) {
    const uint32_t id = seal->held.id;
    bool good = seal->holding && ((id & 0xFFU) == id_low) && ((seal->now_ms - seal->held_ms) <= HELD_MS);
    if (good) {
        good = terrapin_seal_check(seal, id, counter, 16U, word(seal->held.data), word(&seal->held.data[4]), tag);
    }
    if (good) {
        *frame = seal->held;
        seal->holding = false;
    }
    return good;
}
