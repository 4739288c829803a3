/* Who may speak to a controller that has a link key: sessions, and tags on what moves the robot or changes it.
 *
 * After AUTOSAR SecOC: the tag is over the identifier, the whole counter (32 bits) and the payload, which is exactly
 * one block of Chaskey-12; the low bits of the counter and 32 bits of the tag travel. For SEAL identifier and payload
 * are those of the frame that it seals; for COMMAND_SEALED the payload is its first three bytes and zeros.
 *
 *     SESSION_OPEN     the host's number, generation of the key      answered by SESSION, the controller's number
 *     COMMAND_SEALED   a COMMAND, counter (8 bits), tag
 *     SEAL             after a PARAMETER_WRITE, STORE_COMMAND, TEST_MODE or UPDATE_*: counter (16 bits), tag. Such a
 *                      frame is held until its SEAL comes, one frame for 50 ms
 *
 * The session's key is the tag of both numbers and the generation under the link key, which seals no frame itself. A
 * new session waits beside the running one until its first good tag, so that a stranger who asks for one ends none; it
 * is not replaced for 200 ms. The two differ in the low bit of the controller's number, their place, which travels in
 * every sealed frame: so one tag is made for a frame, and not two. A counter must be above the last one taken, by at
 * most 256 (65,536 for SEAL), so that frames may be lost; when it has come to its end the session has. At most
 * SEAL_CHECKS tags are checked in 10 ms: guessing one of 2^32 then takes 124 days for an even chance. Time is the
 * port's, not the tick: in test mode a tick is one of the host's frames, and stands still between runs. A clock that
 * jumps costs the frame that is held, no more.
 *
 * Without a key nothing is sealed, and frames are taken as they come. No message takes a key away.
 */
#ifndef TERRAPIN_SEAL_H
#define TERRAPIN_SEAL_H

#include "chaskey.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_SEAL_CHECKS 2U

typedef struct {
    uint32_t session[2][TERRAPIN_CHASKEY_WORDS]; /* two keys, by the sessions' places */
    uint32_t next[2];    /* the least counter that is taken there: 1 while the session waits, 0 when there is none */
    const uint32_t *key; /* the link key, TERRAPIN_CHASKEY_WORDS; NULL: nothing is sealed */
    uint32_t generation; /* of the key */
    uint32_t start;      /* the controller's number: never twice under one key */
    uint32_t opened;     /* sessions since the start; the number of one is twice this, and its place */
    uint32_t now_ms;     /* the port's own clock, which it sets before each frame; wraps */
    uint32_t waiting_ms; /* since when the session waits that is not the running one */
    terrapin_frame held; /* waits for its SEAL */
    uint32_t held_ms;
    uint32_t checks_ms;
    uint16_t checks;     /* tags that were checked in this hundredth of a second, */
    uint16_t checks_max; /* and may be */
    uint8_t waiting;     /* place of the session that waits, or will */
    bool holding;
} terrapin_seal;

/* A key, its generation (0: no session is opened) and the number of this start, which must not come twice; NULL: none.
 */
TERRAPIN_API void terrapin_seal_init(terrapin_seal *seal, const uint32_t *key, uint32_t generation, uint32_t start);

/* SESSION_OPEN: true when a session waits for its first good tag now, and its number is in the reply. */
TERRAPIN_API bool terrapin_seal_open(terrapin_seal *seal, const terrapin_frame *frame, terrapin_frame *reply);

/* Of a COMMAND_SEALED itself, of a SEAL the frame that was held: it may be taken now. NULL when there is none, its
 * tag is wrong or its counter old. */
TERRAPIN_API const terrapin_frame *terrapin_seal_taken(terrapin_seal *seal, const terrapin_frame *frame);

#ifdef __cplusplus
}
#endif
#endif
