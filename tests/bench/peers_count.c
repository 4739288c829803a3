/* Instructions of the codec and of integer arithmetic on an emulated Cortex-M4, beside what others have: written by
 * tests/bench/bench_arithmetic.py, which compiles it with the setting that is shipped and prints what it says.
 *
 * One line a function: name, mean and largest count over CALLS calls, without the call itself.
 */
#include <stdio.h>

#include "integer.h"
#include "peer.h"
#include "semihosting.h"
#include "terrapin_interface.h"
#ifdef WITH_PEERS
#include "dsp/fast_math_functions.h"
#include "fix16.h"
#endif

#define SYSTICK_CONTROL    (*(volatile uint32_t *)0xE000E010U)
#define SYSTICK_RELOAD     (*(volatile uint32_t *)0xE000E014U)
#define SYSTICK_VALUE      (*(volatile uint32_t *)0xE000E018U)
#define SYSTICK_TOP        0x00FFFFFFU
#define CLOCK_MHZ          168U
#define NS_PER_INSTRUCTION 128U
#define CALLS              500

static uint32_t seed = 1U;
static int32_t a, b;
static uint32_t turn, square;
static terrapin_frame frame;
static terrapin_command_t command;
static terrapin_actuate_t actuate;
static terrapin_ground_t ground;
static struct peer_command_t peer_command;
static struct peer_actuate_t peer_actuate;
static struct peer_ground_t peer_ground;
static volatile int32_t sink;
static int32_t output;

static uint32_t draw(void) {
    seed = (seed * 1664525U) + 1013904223U;
    return seed >> 1U;
}

/* What stands for a function's arguments and result: its call is taken off. */
__attribute__((noinline)) static int32_t empty(int32_t x, int32_t y) {
    __asm__ volatile("" : "+r"(x) : "r"(y));
    return x;
}
__attribute__((noinline)) static bool empty_codec(const void *from, void *to) {
    __asm__ volatile("" : : "r"(from), "r"(to) : "memory");
    return true;
}
static void nothing_codec(void) {
    (void)empty_codec(&actuate, &frame);
}
static void nothing(void) {
    output = empty(a, b);
}
static void decode_command(void) {
    (void)terrapin_decode_command(&frame, &command);
}
static void peer_unpack_command(void) {
    (void)peer_command_unpack(&peer_command, frame.data, 8U);
}
static void encode_actuate(void) {
    (void)terrapin_encode_actuate(&actuate, &frame);
}
static void peer_pack_actuate(void) {
    (void)peer_actuate_pack(frame.data, &peer_actuate, 8U);
}
static void encode_ground(void) {
    (void)terrapin_encode_ground(&ground, &frame);
}
static void peer_pack_ground(void) {
    (void)peer_ground_pack(frame.data, &peer_ground, 8U);
}
__attribute__((noinline)) static int32_t product(int32_t x, int32_t y) {
    return integer_q(x, y, 20U);
}
__attribute__((noinline)) static int32_t product_held(int32_t x, int32_t y) {
    return integer_q_held(x, y, 20U);
}
static void q_product(void) {
    output = product(a, b);
}
static void q_product_held(void) {
    output = product_held(a, b);
}
static void scale(void) {
    output = integer_scale(a, b, 1000000);
}
static void sine(void) {
    output = integer_sine(turn);
}
static void root(void) {
    output = (int32_t)integer_root(square);
}
#ifdef WITH_PEERS
static void fixmath_product(void) {
    output = fix16_mul(a, b);
}
static void fixmath_quotient(void) {
    output = fix16_div(a, b);
}
static void fixmath_sine(void) {
    output = fix16_sin((fix16_t)(turn % 411774U)); /* of a turn */
}
static void fixmath_root(void) {
    output = fix16_sqrt((fix16_t)(square >> 1U));
}
static void cmsis_sine_q31(void) {
    output = arm_sin_q31((q31_t)(turn >> 1U));
}
static void cmsis_sine_q15(void) {
    output = arm_sin_q15((q15_t)(turn >> 17U));
}
static void cmsis_root_q31(void) {
    q31_t found;
    (void)arm_sqrt_q31((q31_t)(square >> 1U), &found);
    output = found;
}
#endif

/* Random input for all of them. */
static void prepare(void) {
    a = (int32_t)(draw() % 2000000U) - 1000000;
    b = (int32_t)(draw() % 60000000U) - 30000000;
    turn = draw() * 2U;
    square = draw() * 2U;
    actuate = (terrapin_actuate_t){.duty = (int32_t)(draw() % 70000U) - 35000, .tick = (int32_t)(draw() % 65536U)};
    actuate.state = (int32_t)(draw() % 9U);
    ground =
        (terrapin_ground_t){.torque = (int32_t)(draw() % 2200000U) - 1100000, .torque_sd = (int32_t)(draw() % 5000U)};
    ground.f_r = (int32_t)(draw() % 140000U) - 70000;
    ground.margin = (int32_t)(draw() % 300U);
    peer_actuate = (struct peer_actuate_t){.duty = (int16_t)actuate.duty, .tick = (uint16_t)actuate.tick};
    peer_ground = (struct peer_ground_t){.torque = ground.torque % 1000000, .f_r = ground.f_r % 60000};
    frame.id = TERRAPIN_ID_COMMAND;
    frame.length = TERRAPIN_LENGTH_COMMAND;
    for (uint32_t i = 0U; i < 8U; i++) {
        frame.data[i] = (uint8_t)draw();
    }
}

static uint32_t count(void (*function)(void)) {
    const uint32_t before = SYSTICK_VALUE;
    function();
    const uint32_t counts = (before - SYSTICK_VALUE) & SYSTICK_TOP;
    sink = output;
    const uint32_t per_thousand = CLOCK_MHZ * NS_PER_INSTRUCTION;
    return ((counts * 1000U) + (per_thousand / 2U)) / per_thousand;
}

static void measure(int32_t file, const char *name, void (*function)(void), void (*without)(void)) {
    uint32_t sum = 0U;
    uint32_t most = 0U;
    seed = 1U;
    for (uint32_t i = 0U; i < CALLS; i++) {
        prepare();
        const uint32_t found = count(function) - count(without);
        sum += found;
        most = (found > most) ? found : most;
    }
    char line[80];
    const int length = snprintf(line, sizeof line, "%s %lu %lu\n", name, (unsigned long)((sum + (CALLS / 2U)) / CALLS),
                                (unsigned long)most);
    (void)semihosting_write(file, (const uint8_t *)line, (size_t)length);
}

void *_sbrk(ptrdiff_t size) { /* snprintf's, which formats integers alone and asks for nothing */
    (void)size;
    return (void *)-1;
}

int main(void) {
    static char path[512];
    if (semihosting_command_line(path, sizeof path) != 0) {
        return 2;
    }
    const int32_t file = semihosting_open(path, 1);
    SYSTICK_RELOAD = SYSTICK_TOP;
    SYSTICK_VALUE = 0U;
    SYSTICK_CONTROL = 5U;
    measure(file, "decode COMMAND", decode_command, nothing_codec);
    measure(file, "cantools: unpack COMMAND", peer_unpack_command, nothing_codec);
    measure(file, "encode ACTUATE", encode_actuate, nothing_codec);
    measure(file, "cantools: pack ACTUATE", peer_pack_actuate, nothing_codec);
    measure(file, "encode GROUND", encode_ground, nothing_codec);
    measure(file, "cantools: pack GROUND", peer_pack_ground, nothing_codec);
    measure(file, "integer_q", q_product, nothing);
    measure(file, "integer_q_held", q_product_held, nothing);
    measure(file, "integer_scale", scale, nothing);
    measure(file, "integer_sine", sine, nothing);
    measure(file, "integer_root, 32 bits", root, nothing);
#ifdef WITH_PEERS
    measure(file, "libfixmath: fix16_mul", fixmath_product, nothing);
    measure(file, "libfixmath: fix16_div", fixmath_quotient, nothing);
    measure(file, "libfixmath: fix16_sin", fixmath_sine, nothing);
    measure(file, "libfixmath: fix16_sqrt", fixmath_root, nothing);
    measure(file, "CMSIS-DSP: arm_sin_q31", cmsis_sine_q31, nothing);
    measure(file, "CMSIS-DSP: arm_sin_q15", cmsis_sine_q15, nothing);
    measure(file, "CMSIS-DSP: arm_sqrt_q31", cmsis_root_q31, nothing);
#endif
    return 0;
}
