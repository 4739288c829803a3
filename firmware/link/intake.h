/* Frames that wait for their turn: how much of them is taken in a tick is bounded, whatever a bus brings.
 *
 *     each received frame:   terrapin_intake_put(&intake, &link, state, &inputs, &frame, source);
 *     then, and after a tick:
 *         while (terrapin_intake_next(&intake, &link, state, &frame, &source)) give it to terrapin_accept
 *     before each own tick:  terrapin_intake_begin_tick(&intake);
 *
 * Frames are taken in the order in which they came, until the tick's budget is spent: that of instructions on a
 * Cortex-M4, a small one while the bridge is on. The rest waits for the next tick. A frame that costs more than a
 * budget is taken as the first of a tick.
 *
 * While the bridge is on, a COMMAND with request IDLE does not wait: when others wait before it, it is taken as it
 * comes, and COMMANDs that wait before it are older than it and are passed over. A third one in a tick waits in order.
 *
 * STOP_ALL never waits, bridge on or off: it is taken as it comes, and COMMANDs that wait are passed over.
 *
 * There is room for TERRAPIN_INTAKE_SIZE frames; when it is full the oldest one gives way and is counted in `lost`.
 * In test mode nothing is held back but TEST_MODE itself: there a tick is one of the frames. Foreign traffic never
 * waits.
 */
#ifndef TERRAPIN_INTAKE_H
#define TERRAPIN_INTAKE_H

#include "dispatch.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_INTAKE_SIZE 32U /* a power of two */

typedef struct {
    struct {
        terrapin_frame frame;
        uint8_t kind;   /* row of the table of costs */
        uint8_t source; /* the port's own: where the answer goes */
    } waiting[TERRAPIN_INTAKE_SIZE];
    uint32_t first;      /* place of the oldest one */
    uint32_t count;      /* that wait */
    uint32_t superseded; /* of the oldest ones: their COMMANDs are older than an IDLE that was taken */
    uint32_t spent;      /* of this tick's budget [instructions] */
    uint32_t ahead;      /* COMMANDs that were tried out of turn in this tick */
    bool taken;          /* a frame that waited was taken in this tick */
    bool stopped;        /* STOP_ALL was taken in this tick: one is enough */
    uint32_t lost;       /* frames that gave way to newer ones; wraps */
} terrapin_intake;

/* Nothing waits. */
TERRAPIN_API void terrapin_intake_init(terrapin_intake *intake);

/* A tick begins: its budget is whole again. */
TERRAPIN_API void terrapin_intake_begin_tick(terrapin_intake *intake);

/* A frame has come, from a source that the port numbers. */
TERRAPIN_API void terrapin_intake_put(terrapin_intake *intake, terrapin_link *link, terrapin_state *state,
                                      terrapin_inputs *inputs, const terrapin_frame *frame, uint8_t source);

/* The next frame to be taken; false when none waits or the tick's budget is spent. */
TERRAPIN_API bool terrapin_intake_next(terrapin_intake *intake, const terrapin_link *link, const terrapin_state *state,
                                       terrapin_frame *frame, uint8_t *source);

#ifdef __cplusplus
}
#endif
#endif
