#include "command.h"

#include "genuine.h"
#include "terrapin_assert.h"
#include "terrapin_interface.h"
#include "terrapin_pack.h"

#define COUNTER_WINDOW 4U /* steps of a COMMAND's counter: as many cycles as the longest command_timeout has */

/* Of all requests the one that is never wrong: whoever sent it, and whatever came before. */
void command_stop_all(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                      terrapin_inputs *inputs) {
    terrapin_stop_all_t message;
    if (!terrapin_decode_stop_all(frame, &message) || (message.request != TERRAPIN_REQUEST_IDLE)) {
        link->malformed++;
        return;
    }
    static const terrapin_command idle = {.request = TERRAPIN_REQUEST_IDLE};
    inputs->command = idle;
    inputs->command_fresh = true;
    terrapin_latch(state, TERRAPIN_LINK_STOPPED);
}

/* How far a counter is behind another, round the circle. */
static uint8_t steps(uint8_t from, uint8_t counter) {
    return (uint8_t)(((uint32_t)counter + TERRAPIN_E2E_COUNTER_MAX + 1U - from) % (TERRAPIN_E2E_COUNTER_MAX + 1U));
}

/* True when the counter of a COMMAND follows the last one taken, or that of the frame dropped before it, so that a new
 * host is taken with its second frame. Counts what does not. */
static bool follows(terrapin_link *link, uint8_t counter) {
    TERRAPIN_ASSERT(counter <= TERRAPIN_E2E_COUNTER_MAX);
    const bool first = link->command_counter == TERRAPIN_E2E_NO_COUNTER;
    const uint8_t step = first ? 1U : steps(link->command_counter, counter);
    const bool second =
        (link->dropped_counter != TERRAPIN_E2E_NO_COUNTER) && (steps(link->dropped_counter, counter) == 1U);
    const bool good = ((step >= 1U) && (step <= COUNTER_WINDOW)) || second;
    if (good) {
        link->command_counter = counter;
        link->dropped_counter = TERRAPIN_E2E_NO_COUNTER;
    } else {
        link->dropped_counter = counter;
        link->repeated += (step == 0U) ? 1U : 0U;
        link->out_of_step += (step == 0U) ? 0U : 1U;
    }
    return good;
}

/* An IDLE came in this tick. */
static bool idle_stands(const terrapin_inputs *inputs) {
    return inputs->command_fresh && (inputs->command.request == (uint8_t)TERRAPIN_REQUEST_IDLE);
}

/* Without a wheel on the ground no slip is known: who counts on the limiter must not drive without one. */
static bool counts_on_nothing(const terrapin_link *link, const terrapin_command_t *message) {
    return link->no_ground_wheel && !link->test_mode && (message->request == TERRAPIN_REQUEST_RUN) &&
           (message->limiter != 0);
}

/* An IDLE is taken with any counter, and no other COMMAND of its tick takes its place. */
void command_accept(terrapin_link *link, const terrapin_frame *frame, terrapin_inputs *inputs) {
    TERRAPIN_ASSERT((frame->id == TERRAPIN_ID_COMMAND) || (frame->id == TERRAPIN_ID_COMMAND_SEALED));
    terrapin_command_t message;
    uint8_t counter = TERRAPIN_E2E_NO_COUNTER;
    const bool sealed = frame->id == (uint16_t)TERRAPIN_ID_COMMAND_SEALED;
    if (!sealed && !link_genuine(link, frame, TERRAPIN_LENGTH_COMMAND, &counter)) {
        return;
    }
    if (sealed) {
        terrapin_command_sealed_t of_it; /* the same at the same places: the compiler makes one of both */
        terrapin_read_command_sealed(frame, &of_it);
        message.request = of_it.request;
        message.control = of_it.control;
        message.limiter = of_it.limiter;
        message.setpoint = of_it.setpoint;
    } else {
        terrapin_read_command(frame, &message);
    }
    const bool idle = message.request == TERRAPIN_REQUEST_IDLE;
    if ((message.request > TERRAPIN_REQUEST_CLEAR) || (message.control > TERRAPIN_CONTROL_SPEED)) {
        link->malformed++;
        return;
    }
    if (idle) {
        link->command_counter = counter;
        link->dropped_counter = TERRAPIN_E2E_NO_COUNTER;
    } else if (!sealed && (link->seal.key != NULL)) {
        link->unsealed++;
        return;
    } else if (!sealed && !follows(link, counter)) {
        return;
    } else if (idle_stands(inputs)) {
        link->out_of_place++;
        return;
    } else {
        /* taken */
    }
    link->limiter_refused = counts_on_nothing(link, &message);
    if (link->limiter_refused) {
        link->out_of_place++;
        return;
    }
    inputs->command.request = (uint8_t)message.request;
    inputs->command.control = (uint8_t)message.control;
    inputs->command.limiter = message.limiter != 0;
    inputs->command.setpoint = (int16_t)message.setpoint;
    inputs->command_fresh = true;
}
