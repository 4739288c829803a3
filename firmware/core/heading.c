/* Heading and path of a sphere whose inner device is steered: the ground wheel's way, laid along the mean heading of
 * each slot. A slot of 10 ms errs by at most 1 um and by the arc's sagitta: 4e-6 of the way while turning at 1 rad/s.
 */
#include "core.h"

enum { FARTHEST_UM = 520000000 };

static int32_t moved(int32_t from_um, int32_t way_um, int32_t share_q15) {
    TERRAPIN_ASSERT(integer_abs(from_um) <= FARTHEST_UM);
    TERRAPIN_ASSERT(integer_abs(share_q15) <= 32767);
    return integer_clamp(from_um + integer_of_sine(way_um, share_q15), -FARTHEST_UM, FARTHEST_UM);
}

void heading_slot(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_heading *h = &state->heading;
    const uint32_t position = state->sense.ground_position;
    const uint32_t turn = inputs->heading_turn;
    if (inputs->heading_valid && h->known) {
        const uint32_t counts = position - h->ground_position;
        const int32_t way_um = integer_gained(&state->gains.way_um, (int32_t)counts);
        /* Half of the shorter way round from the last heading: the difference in 1/2^32 turn, taken as signed. */
        const uint32_t turned = (turn - h->turn) << 16U;
        const int32_t half = (int32_t)turned / 2;
        const uint32_t middle = ((uint32_t)h->turn << 16U) + (uint32_t)half;
        h->x_um = moved(h->x_um, way_um, integer_cosine(middle));
        h->y_um = moved(h->y_um, way_um, integer_sine(middle));
    }
    h->ground_position = position;
    h->turn = (uint16_t)turn;
    h->known = inputs->heading_valid;
}
