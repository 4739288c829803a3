/* ground.c from any state: f_r, the nearest terrain and the fit. The fit's sums stay bounded, and nothing divides by 0.
 */
#define TO_THE_UNIT
#include "invariant.h"

/* The ends of two products, which CBMC does not find, follow from those of their factors, which are shown here. */
static int32_t squared_q20(int32_t value, int32_t factor, uint32_t bits) {
    PROVE((value >= 0) && (value <= 4000000) && (factor == 1374390) && (bits == 17U));
    const int32_t result = contract_q(value, factor, bits);
    ASSUME((result >= 0) && (result <= 41943055));
    return result;
}

static int32_t curve_sum(int32_t summand, int32_t value, int32_t factor) {
    PROVE(within(value, 1280000000) && (factor >= 0) && (factor <= 1342177760));
    PROVE(within(summand, 1000000));
    const int32_t part = nondet_int();
    ASSUME(within(part, 400000144));
    return summand + part;
}

#undef integer_q
#define integer_q        squared_q20
#define integer_q32_plus curve_sum
#include "ground.c"

static terrapin_state state;

static bool fit_holds(const terrapin_state *s) {
    const terrapin_ground_fit *g = &s->ground;
    const int64_t most = (int64_t)65 << 30U; /* 64 (2^30 + 64): what a moment comes to that loses a 64th a window */
    return (g->weight_q8 >= 0) && (g->weight_q8 <= ((FIT_WINDOWS * 256) + FIT_WINDOWS)) && (g->x_q8 >= 0) &&
           (g->x_q8 <= (X_MAX * 256)) && within(g->y_q8, Y_MAX * 256) && (g->xx >= 0) && (g->xx <= most) &&
           (g->xy >= -most) && (g->xy <= most) && (g->windows <= (uint8_t)WINDOWS_MAX) &&
           (g->todo <= (uint8_t)FIT_STEPS) &&
           ((g->todo == 0U) || (g->todo == (uint8_t)FIT_STEPS) || (g->weight_q8 >= 256)) && within(g->f_r_ppm, Y_MAX) &&
           (g->f_r_sd_ppm >= 0) && (g->f_r_sd_ppm <= Y_MAX) && (g->square_q25 >= 0) &&
           (g->square_q25 <= 1342177728); /* 40 and 1.4e-5 of 2^25, by 1374390 / 2^17 */
}

int main(void) {
    ANYTHING(state);
    PARAMETERS_HOLD(state);
    ASSUME(state_holds(&state) && fit_holds(&state));
    const int32_t omega = nondet_int();

    switch (nondet_byte()) {
    case 0U:
        ASSUME(omega > INT32_MIN);
        PROVE(within(ground_floor_unm(&state, omega), HELD_OR_LEAST));
        break;
    case 3U:
        ground_speed(&state);
        break;
    case 1U:
        ground_resistance(&state);
        PROVE(!state.estimator.open || (state.ground.f_r_sd_ppm > 0));
        break;
    case 2U:
        ASSUME(state.ground.f_r_sd_ppm > 0); /* ground_resistance, a tick before */
        ground_nearest(&state);
        break;
    case 3U:
        ground_speed(&state);
        break;
    default:
        ground_fit_work(&state);
        break;
    }

    PROVE(fit_holds(&state));
    return 0;
}
