/* gains_prepare from any parameters within their ranges: whatever the others rest on of what follows from them. */
#include "invariant.h"

/* Five quotients whose ends CBMC does not find: each grows with value and factor and falls with the divisor, so that
 * its ends are those at the ends of its arguments. These are shown here; tests/python/test_proof.py works the ends out.
 */
static int32_t scale(int32_t value, int32_t factor, int32_t divisor);
#define integer_scale scale
#include "gains.c"
#undef integer_scale

static terrapin_state state;

static int32_t between(int32_t value, int32_t low, int32_t high) {
    ASSUME((value >= low) && (value <= high));
    return value;
}

static uint32_t calls;

static int32_t scale(int32_t value, int32_t factor, int32_t divisor) {
    int32_t result = integer_scale(value, factor, divisor);
    switch (calls++) {
    case 0U: /* count_e5_urad */
        PROVE((value == COUNT_E5_URAD) && (factor >= 2000) && (factor <= divisor) && (divisor <= 500000));
        result = between(result, 1, 0x1FFFFFFF);
        break;
    case 1U: /* ground_e5_um */
        PROVE((value == COUNT_E5_URAD) && (factor >= 5000) && (factor <= 200000) && (divisor == 1000000));
        result = between(result, 1, 0x3FFFFFF);
        break;
    case 3U: /* torque_unm_per_a */
        PROVE((value >= divisor) && (value <= 500000) && (divisor >= 2000));
        PROVE((factor >= 1000) && (factor <= 2000000));
        result = between(result, 1, 500000000);
        break;
    case 4U: /* weight_unm */
        PROVE((value >= 10000) && (value <= 500000) && (factor >= 1000) && (factor <= 500000) && (divisor == 1000));
        result = between(result, 10000, 250000000);
        break;
    case 6U: /* of zero_q8 */
        PROVE((value >= -1000000) && (value <= 1000000) && (factor == 256) && (divisor >= 100));
        result = between(result, -2560000, 2560000);
        break;
    default: /* as the contract has it */
        break;
    }
    return result;
}

void uncertainty_prepare(terrapin_state *s) { /* prove_friction.c */
    PROVE((s->gains.torque_unm_per_a > 0) && (s->gains.window_slots > 0U) && is_wide(&s->rates.emf));
    s->gains.fixed_variance = nondet_word();
    s->gains.gain_q30 = (int32_t)(nondet_word() % 0x40000001U);
    s->gains.trimmed_unm = s->gains.untrimmed_unm = s->gains.floor_unm = 0;
}

int main(void) {
    ANYTHING(state);
    PARAMETERS_HOLD(state);
    gains_prepare(&state);
    PROVE(gains_hold(&state));
    return 0;
}
