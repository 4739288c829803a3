/* The frames that wait: any frame put into any queue, and the next one taken. The queue stays one, nothing is written
 * outside of it, and an IDLE that does not wait goes through terrapin_accept. */
#include "proof.h"

#include "intake.c"

#define DEAREST 8000U /* what a frame costs at most: one is taken always, and no dearer one beside another */

static uint32_t accepted;

terrapin_accept_result terrapin_accept(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                       terrapin_inputs *inputs, terrapin_frame *reply) {
    (void)state;
    (void)frame;
    (void)inputs;
    (void)reply;
    accepted++;
    link->command_counter = nondet_byte();
    return TERRAPIN_ACCEPT_NOTHING;
}

bool terrapin_bridge_on(const terrapin_state *state) {
    (void)state;
    return nondet_bool();
}

bool terrapin_decode_command(const terrapin_frame *frame, terrapin_command_t *message) {
    (void)frame;
    ANYTHING(*message);
    return nondet_bool();
}

static bool whole(const terrapin_intake *intake) {
    bool good = (intake->first < TERRAPIN_INTAKE_SIZE) && (intake->count <= TERRAPIN_INTAKE_SIZE) &&
                (intake->superseded <= intake->count) && (intake->ahead <= AHEAD_MAX) &&
                (intake->spent <= (AHEAD_MAX * AHEAD_COST) + (intake->taken ? DEAREST : 0U));
    for (uint32_t i = 0U; i < TERRAPIN_INTAKE_SIZE; i++) {
        good = good && (intake->waiting[i].kind < (uint8_t)FOREIGN);
    }
    return good;
}

int main(void) {
    terrapin_intake intake;
    terrapin_link link;
    terrapin_inputs inputs;
    terrapin_frame frame;
    uint8_t source = 0U;
    terrapin_intake_init(&intake);
    PROVE(whole(&intake));
    ANYTHING(intake);
    ANYTHING(link);
    ANYTHING(inputs);
    ANYTHING(frame);
    ASSUME(whole(&intake)); /* of an empty one it is proved above, of every later one below */
    const uint32_t before = intake.count;
    if (nondet_bool()) {
        terrapin_intake_begin_tick(&intake);
    } else if (nondet_bool()) {
        terrapin_intake_put(&intake, &link, NULL, &inputs, &frame, nondet_byte());
        PROVE((intake.count == before) || (intake.count == (before + 1U)));
    } else if (terrapin_intake_next(&intake, &link, NULL, &frame, &source)) {
        PROVE(intake.count < before);
    } else {
        PROVE((intake.count == 0U) || !link.test_mode || (intake.waiting[intake.first].kind == (uint8_t)TEST_MODE));
    }
    PROVE(whole(&intake) && (accepted <= 1U));
    return 0;
}
