/* Counts the instructions of steps and of frames taken in, on an emulated Cortex-M4: inputs from a file, counts and
 * outputs to another. Everything little-endian; each record begins with a word that says its kind:
 *
 *     1, all parameters (one word each)   reset, and these values           answer: the result of setting them (word)
 *     2, terrapin_inputs                  one tick                          answer: four counts and the mode (words),
 *                                                                                   terrapin_outputs
 *     3, terrapin_frame                   one frame comes (intake.h)        answer: count (word)
 *     4, a word                           the node number from here on, 0 before      answer: none
 *     5, a link key (four words), its generation, the start's number   sealed from here on, open for generation 0
 *                                                                     answer: size of terrapin_seal (word)
 *
 * Frames that came are taken before the next tick, as a port does, until the tick's budget is spent; a COMMAND that was
 * taken stands for that of the tick. Counts are of SysTick, under `-icount shift=7`: exact, the same in every run, high
 * by the few instructions of the two readings. They are of terrapin_step_drive, of terrapin_step_think, of all frames
 * that were taken before the tick (with the empty look behind the last one, and the identifiers of the replies), and
 * how many these were; of a frame that comes, of terrapin_node_receive and terrapin_intake_put. There is a store that
 * holds these parameters. tests/target/replay.py writes and reads the files.
 */
#include <string.h>

#include "dispatch.h"
#include "intake.h"
#include "node.h"
#include "parameters.h"
#include "semihosting.h"
#include "state.h"

#define SYSTICK_CONTROL    (*(volatile uint32_t *)0xE000E010U)
#define SYSTICK_RELOAD     (*(volatile uint32_t *)0xE000E014U)
#define SYSTICK_VALUE      (*(volatile uint32_t *)0xE000E018U)
#define SYSTICK_TOP        0x00FFFFFFU
#define SYSTICK_ON         0x5U  /* counting, on the processor's clock, no interrupt */
#define CLOCK_MHZ          168U  /* of the emulated processor */
#define NS_PER_INSTRUCTION 128U  /* of -icount shift=7 */
#define BUFFER             8192U /* bytes of a transfer */

enum { RESET = 1, TICK = 2, FRAME = 3, NODE = 4, KEY = 5 };

static terrapin_state state;
static terrapin_link link;
static terrapin_intake intake;
static terrapin_node node; /* number 0 */
static terrapin_store store;
static terrapin_inputs inputs;
static terrapin_inputs from_frames;
static terrapin_outputs outputs;
static int32_t values[TERRAPIN_PARAMETER_COUNT];

static int32_t source;
static int32_t sink;
static uint8_t in[BUFFER];
static uint8_t out[BUFFER];
static size_t in_at;
static size_t in_end;
static size_t out_length;
static bool failed;

static void flush(void) {
    failed = failed || ((out_length > 0U) && (semihosting_write(sink, out, out_length) != 0));
    out_length = 0U;
}

static void put(const void *bytes, size_t length) {
    if ((out_length + length) > BUFFER) {
        flush();
    }
    memcpy(&out[out_length], bytes, length);
    out_length += length;
}

/* False at the end of the file. */
static bool take(void *to, size_t length) {
    uint8_t *bytes = to;
    for (size_t i = 0; i < length; i++) {
        if (in_at == in_end) {
            in_end = semihosting_read(source, in, BUFFER);
            in_at = 0U;
            if (in_end == 0U) {
                return false;
            }
        }
        bytes[i] = in[in_at];
        in_at++;
    }
    return true;
}

/* SysTick counts down; 168 counts a microsecond, 0.128 us an instruction. */
static uint32_t between(uint32_t before, uint32_t after) {
    const uint32_t counts = (before - after) & SYSTICK_TOP;
    const uint32_t per_thousand = CLOCK_MHZ * NS_PER_INSTRUCTION;
    return ((counts * 1000U) + (per_thousand / 2U)) / per_thousand;
}

static bool reset_with_parameters(void) {
    if (!take(values, sizeof values)) {
        return false;
    }
    terrapin_link_init(&link, &state, &from_frames);
    memcpy(store.value, values, sizeof values); /* equal: what compares them has to look at all */
    store.page[0].size = BUFFER;                /* a save is begun, and its work is never done */
    store.phase = TERRAPIN_STORE_IDLE;
    link.store = &store;
    link.defaults = values; /* dearer than those of the interface, which need no look at their ranges */
    terrapin_intake_init(&intake);
    const uint32_t result = (uint32_t)terrapin_parameter_set_all(&state, values);
    put(&result, sizeof result);
    return true;
}

/* What the controller is doing: state, phase and step of a calibration, control, limiter, what limits, and whether slip
 * has a history to be worked out from. */
static uint32_t mode(void) {
    const terrapin_supervisor *s = &state.supervisor;
    const terrapin_slip_state *slip = &state.slip;
    const bool filled = slip->slow ? (state.estimator.slots > state.gains.window_slots)
                                   : (slip->ticks > state.parameter[TERRAPIN_PARAMETER_SLIP_WINDOW]);
    const uint32_t flags =
        (s->limiter ? 1U : 0U) | (state.drive.limiting ? 2U : 0U) | (slip->slow ? 4U : 0U) | (filled ? 8U : 0U);
    return (uint32_t)s->state | ((uint32_t)s->phase << 8U) | ((uint32_t)state.calibration.step << 12U) |
           ((uint32_t)s->control << 16U) | (flags << 24U);
}

/* The frames of a tick; how many. */
static uint32_t take_waiting(void) {
    terrapin_frame message;
    terrapin_frame reply;
    uint8_t from = 0U;
    uint32_t taken = 0U;
    while (terrapin_intake_next(&intake, &link, &state, &message, &from)) {
        if (terrapin_accept(&link, &state, &message, &from_frames, &reply)) {
            terrapin_node_send(&node, &reply);
        }
        taken++;
    }
    return taken;
}

static bool tick(void) {
    if (!take(&inputs, sizeof inputs)) {
        return false;
    }
    terrapin_seal_at(&link.seal, inputs.tick);
    uint32_t counts[5];
    uint32_t before = SYSTICK_VALUE;
    terrapin_intake_begin_tick(&intake);
    counts[3] = take_waiting();
    counts[2] = between(before, SYSTICK_VALUE);
    if (from_frames.command_fresh) {
        inputs.command = from_frames.command;
        inputs.command_fresh = true;
        from_frames.command_fresh = false;
    }
    before = SYSTICK_VALUE;
    terrapin_step_drive(&state, &inputs, &outputs);
    counts[0] = between(before, SYSTICK_VALUE);
    before = SYSTICK_VALUE;
    terrapin_step_think(&state, &inputs, &outputs);
    counts[1] = between(before, SYSTICK_VALUE);
    counts[4] = mode();
    put(counts, sizeof counts);
    put(&outputs, sizeof outputs);
    return true;
}

static bool frame(void) {
    terrapin_frame message;
    if (!take(&message, sizeof message)) {
        return false;
    }
    const uint32_t before = SYSTICK_VALUE;
    if (terrapin_node_receive(&node, &message)) {
        terrapin_intake_put(&intake, &link, &state, &from_frames, &message, 0U);
    }
    const uint32_t count = between(before, SYSTICK_VALUE);
    put(&count, sizeof count);
    return true;
}

static bool other_number(void) {
    uint32_t number = 0U;
    if (!take(&number, sizeof number)) {
        return false;
    }
    terrapin_node_init(&node, (uint8_t)number);
    return true;
}

static bool sealed(void) {
    static uint32_t words[6];
    const uint32_t size = sizeof(terrapin_seal);
    if (!take(words, sizeof words)) {
        return false;
    }
    terrapin_link_seal(&link, (words[4] != 0U) ? words : NULL, words[4], words[5]);
    put(&size, sizeof size);
    return true;
}

/* False when the file has ended, or says what is not known. */
static bool one_record(void) {
    uint32_t kind = 0U;
    if (!take(&kind, sizeof kind)) {
        return false;
    }
    switch (kind) {
    case RESET:
        return reset_with_parameters();
    case TICK:
        return tick();
    case FRAME:
        return frame();
    case NODE:
        return other_number();
    case KEY:
        return sealed();
    default:
        failed = true;
        return false;
    }
}

/* The words of the command line: its own name, the two files. */
int main(void) {
    static char command[512];
    const char *word[3] = {"", "", ""};
    if (semihosting_command_line(command, sizeof command) != 0) {
        return 2;
    }
    size_t words = 0U;
    for (char *at = command; (at != NULL) && (words < 3U); words++) {
        word[words] = at;
        at = strchr(at, ' ');
        if (at != NULL) {
            *at = '\0';
            at++;
        }
    }
    source = semihosting_open(word[1], 0);
    sink = semihosting_open(word[2], 1);
    if ((source < 0) || (sink < 0)) {
        return 1;
    }
    SYSTICK_RELOAD = SYSTICK_TOP;
    SYSTICK_VALUE = 0U;
    SYSTICK_CONTROL = SYSTICK_ON;
    terrapin_link_init(&link, &state, &from_frames);
    while (one_record()) {
    }
    flush();
    return failed ? 1 : 0;
}
