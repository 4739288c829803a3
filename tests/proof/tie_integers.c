/* Do the functions of integer.h keep to the contracts of integers.h? Compiled twice: with -DREAL the functions under
 * another name, without it the contracts, whose answers are then those of the functions, and a main that draws what
 * goes in. Prints how often each was asked as it may be; status 1 when an answer was not within its contract.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef REAL

#define integer_scale         real_scale
#define integer_factor        real_factor
#define integer_signed_factor real_signed_factor
#define integer_gain_of       real_gain_of
#define integer_wide_of       real_wide_of
#define integer_divide        real_divide
#define integer_root          real_root
#define integer_sine          real_sine
#define integer_cosine        real_cosine
#define integer_turn          real_turn
#define integer_exp           real_exp
#define integer_narrow        real_narrow
#define integer_saturate      real_saturate
#include "integer.c"

int32_t real_q(int32_t value, int32_t factor, uint32_t bits) {
    return integer_q(value, factor, bits);
}
int32_t real_q32(int32_t value, int32_t factor) {
    return integer_q32(value, factor);
}
int32_t real_q_held(int32_t value, int32_t factor, uint32_t bits) {
    return integer_q_held(value, factor, bits);
}
int32_t real_of_sine(int32_t value, int32_t sine) {
    return integer_of_sine(value, sine);
}
int32_t real_gained(const integer_gain *gain, int32_t count) {
    return integer_gained(gain, count);
}
int32_t real_widened(const integer_wide *wide, int32_t value) {
    return integer_widened(wide, value);
}
int32_t real_ratio(int32_t value, int32_t divisor) {
    return integer_ratio(value, divisor);
}

#else

#include <stdio.h>

#define PROOF_H
#define TO_THE_UNIT
#define PROVE(condition)  (asked_right = asked_right && (condition))
#define ASSUME(condition) (answered_right = answered_right && (condition))
#define ANYTHING(object)  ((object) = answer)

static bool asked_right, answered_right;
static int64_t answer; /* of the function */

static int32_t nondet_int(void) {
    return (int32_t)answer;
}

static uint32_t nondet_word(void) {
    return (uint32_t)answer;
}

#include "integers.h"

int32_t real_q(int32_t value, int32_t factor, uint32_t bits);
int32_t real_q32(int32_t value, int32_t factor);
int32_t real_q_held(int32_t value, int32_t factor, uint32_t bits);
int32_t real_of_sine(int32_t value, int32_t sine);
int32_t real_gained(const integer_gain *gain, int32_t count);
int32_t real_widened(const integer_wide *wide, int32_t value);
int32_t real_ratio(int32_t value, int32_t divisor);
int32_t real_scale(int32_t value, int32_t factor, int32_t divisor);
int32_t real_factor(int64_t value, uint32_t bits, int32_t divisor);
int32_t real_signed_factor(int64_t value, uint32_t bits, int32_t divisor);
integer_gain real_gain_of(int32_t value, int32_t divisor);
integer_wide real_wide_of(int32_t value, int32_t divisor);
int64_t real_divide(int64_t numerator, int64_t denominator);
uint32_t real_root(uint64_t value);
int32_t real_sine(uint32_t turn);
int32_t real_exp(int32_t x_q16);

static uint64_t state = 88172645463325252U;

static uint64_t draw64(void) { /* xorshift */
    state ^= state << 13U;
    state ^= state >> 7U;
    state ^= state << 17U;
    return state;
}

/* Of any length up to `bits`, now and then at the end of a word. */
static int64_t drawn(uint32_t bits) {
    const uint32_t length = (uint32_t)(draw64() % (bits + 1U));
    const uint64_t edge = ((uint64_t)1 << length);
    const uint64_t size = ((draw64() % 8U) == 0U) ? (edge - (draw64() % 2U)) : (draw64() % edge);
    const uint64_t most = ((uint64_t)1 << bits) - 1U;
    return (int64_t)((size < most) ? size : most);
}

static int64_t any(uint32_t bits) {
    return ((draw64() % 2U) == 0U) ? drawn(bits) : -drawn(bits);
}

static int failed;

/* Asks the contract twice: whether it may be asked so, then whether the function's answer is within it. */
#define TIED(name, contract, function)                                                                                 \
    do {                                                                                                               \
        uint32_t asked = 0U;                                                                                           \
        for (uint32_t i = 0U; i < POINTS; i++) {                                                                       \
            const int32_t value = (int32_t)any(31U), factor = (int32_t)any(31U);                                       \
            const int32_t divisor = (int32_t)drawn(31U) | 1, sine = (int32_t)any(15U);                                 \
            const uint32_t bits = (uint32_t)(draw64() % 48U);                                                          \
            const int64_t wide = any(62U), positive = drawn(61U), below = drawn(62U) | 1;                              \
            const integer_gain gain = real_gain_of((int32_t)drawn(29U), divisor | 4096);                               \
            const integer_wide product_of = real_wide_of((int32_t)drawn(30U), divisor);                                \
            (void)value, (void)factor, (void)sine, (void)bits, (void)wide, (void)positive, (void)below, (void)gain,    \
                (void)product_of;                                                                                      \
            asked_right = true;                                                                                        \
            answer = 0;                                                                                                \
            (void)(contract);                                                                                          \
            if (asked_right) {                                                                                         \
                answer = (int64_t)(function);                                                                          \
                answered_right = true;                                                                                 \
                (void)(contract);                                                                                      \
                failed += answered_right ? 0 : 1;                                                                      \
                asked++;                                                                                               \
            }                                                                                                          \
        }                                                                                                              \
        printf("%s %u %d\n", name, asked, failed);                                                                     \
    } while (0)

int main(void) {
    TIED("q", contract_q(value, factor, (bits % 31U) + 1U), real_q(value, factor, (bits % 31U) + 1U));
    TIED("q32", contract_q32(value, factor), real_q32(value, factor));
    TIED("q_held", contract_q_held(value, factor, (bits % 29U) + 2U), real_q_held(value, factor, (bits % 29U) + 2U));
    TIED("of_sine", contract_of_sine(value, sine), real_of_sine(value, sine));
    TIED("gained", contract_gained(&gain, value), real_gained(&gain, value));
    TIED("gain", contract_gained(&gain, gain.most), real_gained(&gain, gain.most));
    TIED("widened", contract_widened(&product_of, value), real_widened(&product_of, value));
    TIED("wide", contract_widened(&product_of, -product_of.most), real_widened(&product_of, -product_of.most));
    TIED("ratio", contract_ratio(value, divisor), real_ratio(value, divisor));
    TIED("scale", integer_scale(value, factor, divisor), real_scale(value, factor, divisor));
    TIED("factor", integer_factor(positive, bits, divisor), real_factor(positive, bits, divisor));
    TIED("divide", integer_divide(wide, below), real_divide(wide, below));
    TIED("root", integer_root((uint64_t)positive * 7U), real_root((uint64_t)positive * 7U));
    TIED("sine", integer_sine((uint32_t)value), real_sine((uint32_t)value));
    TIED("exp", integer_exp(value), real_exp(value));
    return (failed == 0) ? 0 : 1;
}

#endif
