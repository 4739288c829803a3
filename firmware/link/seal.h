/* Who may speak to a controller that has a link key: sessions, and tags on what moves the robot or changes it.
 *
 * After AUTOSAR SecOC, with the time as its freshness value: the tag is over the identifier, the time (32 bits) and the
 * payload, which is exactly one block of Chaskey-12; the low 8 bits of the time and 32 bits of the tag travel. For SEAL
 * identifier and payload are those of the frame that it seals; for COMMAND_SEALED the payload is its first three bytes
 * and zeros.
 *
 *     SESSION_OPEN     the host's number, generation of the key      answered by SESSION, the controller's number
 *     COMMAND_SEALED   a COMMAND, time, tag
 *     SEAL             after a PARAMETER_WRITE, STORE_COMMAND, TEST_MODE or UPDATE_*: time, tag. One such
 *                      frame is held until its SEAL comes, or another one
 *
 * The controller's number is a challenge: nobody without the link key can tell the next one, so nothing is sealed for a
 * session before it is opened. The session's key is the tag of both numbers and the generation under the link key,
 * which seals no frame itself. A new session waits beside the running one until its first good tag, so that a stranger
 * who asks for one ends none; it is not replaced for 200 ms. The two differ in the low bit of the controller's number,
 * their place, which travels in every sealed frame: so one tag is made for a frame, and not two.
 *
 * A frame's time is what the host has counted since it had SESSION, in units of 8 ms from 1 on. It must be above that
 * of the last frame taken, at most 0.96 s behind what the controller has counted since it sent SESSION, and at most 32
 * ms before it, for clocks that differ: so what somebody withholds is taken for 1 s at most, however long the order of
 * the frames is kept. A session ends 1 to 2 s after its last good tag (1.96 s after that one's time) and at 16.4 s:
 * then the host asks for another one, before that it may. At most SEAL_CHECKS tags are checked in 0.1 s: guessing one
 * of 2^32 then takes 124 days for an even chance. Time is the port's, not the tick: in test mode a tick is one of the
 * host's frames, and stands still between runs. A clock that jumps costs the sessions and the frame that is held, no
 * more.
 *
 * Without a key nothing is sealed, and frames are taken as they come. No message takes a key away.
 */
#ifndef TERRAPIN_SEAL_H
#define TERRAPIN_SEAL_H

#include "chaskey.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_SEAL_CHECKS 20U

typedef struct {
    uint32_t key[TERRAPIN_CHASKEY_WORDS];
    uint32_t begun_ms; /* when SESSION was sent */
    uint32_t next;     /* the least time that is taken: 1 while the session waits, 0 when there is none */
} terrapin_sealed_session;

typedef struct {
    uint8_t waiting; /* place of the session that waits, or will */
    bool holding;
    uint16_t checks;                    /* tags that were checked in this tenth of a second */
    uint32_t checks_ms;                 /* when it began */
    uint32_t now_ms;                    /* terrapin_seal_at */
    terrapin_frame held;                /* waits for its SEAL */
    const uint32_t *key;                /* the link key, TERRAPIN_CHASKEY_WORDS; NULL: nothing is sealed */
    uint32_t generation;                /* of the key */
    uint32_t start;                     /* the number of this start: never twice under one key */
    uint32_t opened;                    /* sessions since the start; the number of one is twice this, and its place */
    terrapin_sealed_session session[2]; /* by their places */
} terrapin_seal;

/* Of a seal that is zero everywhere: its key, the key's generation (0: no session is opened) and the number of this
 * start, which must not come twice. NULL and generation 0: no key. */
TERRAPIN_API void terrapin_seal_init(terrapin_seal *seal, const uint32_t *key, uint32_t generation, uint32_t start);

/* The port's own clock, which wraps: told before each frame, and at least once in 49 days, so that a session that has
 * ended does not come again when the clock does. */
TERRAPIN_API void terrapin_seal_at(terrapin_seal *seal, uint32_t now_ms);

/* SESSION_OPEN: true when a session waits for its first good tag now, and its number is in the reply. */
TERRAPIN_API bool terrapin_seal_open(terrapin_seal *seal, const terrapin_frame *frame, terrapin_frame *reply);

/* Of a COMMAND_SEALED itself, of a SEAL the frame that was held: it may be taken now. NULL when there is none, its
 * tag is wrong, its time is not now, or its session has ended. */
TERRAPIN_API const terrapin_frame *terrapin_seal_taken(terrapin_seal *seal, const terrapin_frame *frame);

#ifdef __cplusplus
}
#endif
#endif
