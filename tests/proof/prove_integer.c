/* The arithmetic without products and quotients: the clamp of the exact value, and no overflow. What has products is
 * proved as integers by arithmetic.py. */
#include "proof.h"

#include "integer.c"

int main(void) {
    const int32_t a = nondet_int();
    const int32_t low = nondet_int();
    const int32_t high = nondet_int();
    const int64_t wide = (int64_t)(((uint64_t)nondet_word() << 32U) | nondet_word());
    ASSUME(low <= high);
    const int32_t held = integer_clamp(a, low, high);
    PROVE((held >= low) && (held <= high) &&
          ((held == a) || ((a < low) && (held == low)) || ((a > high) && (held == high))));
    const int32_t narrow = integer_narrow(wide, low, high);
    PROVE((narrow >= low) && (narrow <= high));
    PROVE((narrow == wide) || ((wide < low) && (narrow == low)) || ((wide > high) && (narrow == high)));
    const int32_t saturated = integer_saturate(wide);
    PROVE((saturated >= -INTEGER_MOST) && (saturated <= INTEGER_MOST));
    const int32_t sum = integer_hold(a);
    PROVE((sum >= INTEGER_LEAST) && (sum <= INTEGER_MOST) && ((a < INTEGER_LEAST) || (a > INTEGER_MOST) || (sum == a)));
    if (a > INT32_MIN) {
        PROVE((integer_abs(a) >= 0) && ((integer_abs(a) == a) || (integer_abs(a) == -a)));
    }
    PROVE((integer_sign(a) == 0) == (a == 0));
    PROVE((integer_sign(a) >= -1) && (integer_sign(a) <= 1) && ((a <= 0) || (integer_sign(a) == 1)));
    PROVE((integer_direction(a) == 1) || ((integer_direction(a) == -1) && (a < 0)));
    const uint32_t later = nondet_word();
    const uint32_t earlier = nondet_word();
    PROVE((uint32_t)integer_difference(later, earlier) == (later - earlier));
    return 0;
}
