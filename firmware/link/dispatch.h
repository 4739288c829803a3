/* From frames to the step's inputs: what every port does with a received frame, whatever brought it.
 *
 * A port is an edge; all of it that differs is
 *     receive:  give each received frame to terrapin_accept
 *     TERRAPIN_ACCEPT_REPLY:  send *reply
 *     TERRAPIN_ACCEPT_STEP (test mode), or each millisecond of an own clock with own sensors in *inputs (otherwise):
 *         terrapin_link_drive,
 *         apply duty and enable to the bridge if terrapin_link_bridge_allowed, else hold the bridge off,
 *         terrapin_link_think, send its frames in order
 *     leaving, for whatever reason:  bridge off
 *
 * A port with flash keeps parameters over a reset by two calls more (flash and pages as in store/parameters.h):
 *     once, after terrapin_link_init:  terrapin_store_open(&store, &flash, pages);
 *                                      terrapin_link_use_store(&link, state, &store);
 *     each tick, after the frames:     (void)terrapin_link_store_work(&link, state);
 *
 * Frames have the identifiers of node 0 here; node.h says how a port gives them those of its own node.
 *
 * Each frame is a bounded piece of work, a write of a parameter the longest one; a port that steps when its tick comes
 * and takes frames in between, one at a time, cannot be starved by them.
 *
 * The counter of a COMMAND must be 1 to 4 steps on from the last one taken; after a wrong step the second of two frames
 * that follow each other is taken. That finds stuck gateways and second hosts, and is no protection against a replay:
 * that is the hold of an IDLE (limit stop_hold), and the IDLE is taken with any counter.
 *
 * Test mode (armed by TEST_MODE, off after reset): sensors come from SENSORS_SLOW and SENSORS_FAST, and each
 * SENSORS_FAST is one tick. It is not armed while the bridge is enabled, nor while STOP_ALL holds and no clear has
 * come. Arming resets the controller, parameters to the defaults of controller.toml, so that a run in test mode is a
 * function of its frames alone; leaving resets it again, parameters to the stored ones, or to the port's own defaults,
 * and latched faults that stood before it stand again. A production build (TERRAPIN_PRODUCTION) has no test mode:
 * TEST_MODE and SENSORS_* are counted and change nothing.
 */
#ifndef TERRAPIN_DISPATCH_H
#define TERRAPIN_DISPATCH_H

#include "node.h"
#include "seal.h"
#include "terrapin.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of which kind this build is (image_kind of controller.toml): what signs an image finds it in the code. */
typedef struct {
    uint32_t name[4]; /* "terrapin-kind" and zeros, as the bytes of little-endian words */
    uint32_t kind;
} terrapin_image_mark;
extern TERRAPIN_API const terrapin_image_mark terrapin_link_mark;

struct terrapin_store; /* store/parameters.h */

typedef struct {
    uint8_t command_counter; /* E2E counters of the last accepted frames; TERRAPIN_E2E_NO_COUNTER at first */
    uint8_t dropped_counter; /* of the COMMAND dropped last, if none was taken since */
    uint8_t write_counter;
    uint8_t test_counter;
    uint8_t store_counter;
    uint8_t board;         /* enum board of controller.toml, set by the port after terrapin_link_init */
    uint8_t reply_counter; /* of the next PARAMETER_VALUE or STORE_STATUS */
    bool test_mode;
    bool no_ground_wheel;  /* set by the port after terrapin_link_init: out of test mode there is no slip to limit */
    bool limiter_refused;  /* the last COMMAND asked for that all the same */
    bool stepped;          /* a tick was taken since test mode was armed */
    uint32_t latched;      /* faults that stood when test mode was armed: they stand again when it is left */
    uint32_t bad_crc;      /* frames dropped, by cause; these wrap */
    uint32_t repeated;     /* counter or tick of the last accepted frame */
    uint32_t malformed;    /* wrong length, or a value that controller.toml does not know */
    uint32_t out_of_step;  /* COMMANDs that do not follow: a second host, or old frames */
    uint32_t out_of_place; /* SENSORS_* outside test mode; arming it with the bridge on; a COMMAND beside an IDLE, or
                            * for a limiter without a ground wheel */
    uint32_t unsealed;     /* without a good tag, where one is needed */
    uint32_t unknown;      /* other traffic on the bus */
    struct terrapin_store *store; /* the port's; NULL: parameters last until a reset */
    const int32_t *defaults;      /* the port's, of all parameters; NULL: those of controller.toml */
    terrapin_identity *identity;  /* the port's; NULL: NODE_REQUEST is other traffic */
    terrapin_seal seal;
} terrapin_link;

/* Of terrapin_latched: STOP_ALL holds. A port keeps it over a reset, from the tick after it came on, and latches it
 * again (terrapin_latch) after terrapin_link_init. */
#define TERRAPIN_LINK_STOPPED ((uint32_t)1U << (uint32_t)TERRAPIN_FAULT_STOP_ALL)

typedef enum {
    TERRAPIN_ACCEPT_NOTHING = 0,
    TERRAPIN_ACCEPT_REPLY = 1,  /* *reply was written: send it */
    TERRAPIN_ACCEPT_UPDATE = 3, /* the SEAL of an UPDATE_* has come: take link->seal.held now */
    TERRAPIN_ACCEPT_STEP = 2    /* the inputs of a tick are complete: step now */
} terrapin_accept_result;

/* Reset of the link (without a store), the inputs (all zero, nothing valid) and the controller. */
TERRAPIN_API void terrapin_link_init(terrapin_link *link, terrapin_state *state, terrapin_inputs *inputs);

/* After terrapin_link_init, once: a link key of four words, which must stay where it is, its generation, and the number
 * of this start, which must never come twice under one key (link/seal.h). NULL, with generation 0: anybody's frames are
 * taken. With a key the port calls terrapin_seal_at before it gives a frame. */
TERRAPIN_API void terrapin_link_seal(terrapin_link *link, const uint32_t *key, uint32_t generation, uint32_t start);

/* True when a frame waits for its SEAL now: for a port that serves UPDATE_* beside terrapin_accept. */
TERRAPIN_API bool terrapin_link_holds(terrapin_link *link, const terrapin_frame *frame);

/* Take one frame. A frame that is dropped changes nothing but its counter in *link. */
TERRAPIN_API terrapin_accept_result terrapin_accept(terrapin_link *link, terrapin_state *state,
                                                    const terrapin_frame *frame, terrapin_inputs *inputs,
                                                    terrapin_frame *reply);

/* The halves of one tick: terrapin_step_drive; then terrapin_step_think, after which the command is no longer fresh. */
TERRAPIN_API void terrapin_link_drive(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs);
TERRAPIN_API void terrapin_link_think(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs);

/* Both, for a port without a bridge. */
TERRAPIN_API void terrapin_link_step(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs);

/* Keep parameters in an open store. The state is given those that it holds, or the defaults, while its bridge is off.
 */
TERRAPIN_API void terrapin_link_use_store(terrapin_link *link, terrapin_state *state, struct terrapin_store *store);

/* Defaults of a machine that knows more of itself than controller.toml does: all TERRAPIN_PARAMETER_COUNT, in range,
 * the caller's memory. They stand after a reset while nothing is stored, and where a host asks for the defaults; not in
 * test mode. The state is given them, as by terrapin_link_use_store. */
TERRAPIN_API void terrapin_link_use_defaults(terrapin_link *link, terrapin_state *state, const int32_t *values);

/* A bounded piece of the save under way, if there is one: at most one erase, and that with the bridge off. True while
 * more is to be done. */
TERRAPIN_API bool terrapin_link_store_work(terrapin_link *link, const terrapin_state *state);

/* The physical bridge may follow the outputs: false while test mode lasts. */
TERRAPIN_API bool terrapin_link_bridge_allowed(const terrapin_link *link);

#ifdef __cplusplus
}
#endif
#endif
