/* A host that has the link key: its session, and what it seals. */
#ifndef SEALED_HOST_H
#define SEALED_HOST_H

#include "seal.h"
#include "terrapin_interface.h"
#include "terrapin_pack.h"

typedef struct {
    uint32_t key[TERRAPIN_CHASKEY_WORDS];
    uint32_t place;    /* low bit of the session's number */
    uint32_t begun_ms; /* when it had SESSION */
    uint32_t time;     /* of the frame that it sealed last, in units of 8 ms */
} sealed_host;

/* After the answer to its SESSION_OPEN, which came at `now_ms` of its clock. */
static inline void sealed_host_opens(sealed_host *host, const uint32_t link_key[4], uint32_t number,
                                     uint32_t generation, const terrapin_session_t *answer, uint32_t now_ms) {
    const uint32_t numbers[TERRAPIN_CHASKEY_WORDS] = {number, answer->start, answer->count, generation};
    terrapin_chaskey(link_key, numbers, host->key);
    host->place = answer->count & 1U;
    host->begun_ms = now_ms;
    host->time = 0U;
}

/* The next frame is sealed now. */
static inline void sealed_host_at(sealed_host *host, uint32_t now_ms) {
    const uint32_t now = (now_ms - host->begun_ms) / 8U;
    host->time = (now > host->time) ? now : (host->time + 1U);
}

/* It wants another session: it said nothing for 0.9 s, or this one is half over. */
static inline bool sealed_host_ends(const sealed_host *host, uint32_t now_ms) {
    const uint32_t now = (now_ms - host->begun_ms) / 8U;
    return (now >= (host->time + 113U)) || (now >= 1024U);
}

static inline uint32_t sealed_host_tag(const sealed_host *host, uint32_t id, uint32_t low, uint32_t high) {
    uint32_t block[TERRAPIN_CHASKEY_WORDS] = {id, host->time, low, high};
    terrapin_chaskey(host->key, block, block);
    return block[0];
}

/* A COMMAND_SEALED with the host's time: session, time and tag are written into it. */
static inline void sealed_host_commands(const sealed_host *host, terrapin_frame *frame) {
    const uint32_t head = (uint32_t)frame->data[0] & 0x7FU;
    frame->data[0] = (uint8_t)(head | (host->place << 7U));
    const uint32_t low = terrapin_get_word(frame->data) & 0x00FFFFFFU;
    terrapin_put_word(frame->data, low | (host->time << 24U));
    terrapin_put_word(&frame->data[4], sealed_host_tag(host, frame->id, low, 0U));
}

/* The SEAL of a frame, with the host's time. */
static inline terrapin_frame sealed_host_seals(const sealed_host *host, const terrapin_frame *frame) {
    terrapin_frame seal = {.id = TERRAPIN_ID_SEAL, .length = TERRAPIN_LENGTH_SEAL};
    const uint32_t tag =
        sealed_host_tag(host, frame->id, terrapin_get_word(frame->data), terrapin_get_word(&frame->data[4]));
    terrapin_put_word(seal.data, (host->place << 7U) | ((host->time & 0xFFU) << 16U));
    terrapin_put_word(&seal.data[4], tag);
    return seal;
}

#endif
