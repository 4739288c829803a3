/* The step as a whole over streams of inputs made from integers alone, so that every machine sees the same ones: no
 * input breaks a promise, and the outputs are the same bits at every optimisation level, word size and compiler. */
#include <string.h>

#include "unity.h"

#include "terrapin.h"
#include "terrapin_interface.h"

static uint64_t memory[2][4096];
static terrapin_state *const state = (terrapin_state *)memory[0];
static terrapin_inputs in;
static terrapin_outputs out;
static uint64_t generator;
static uint64_t hash;

static uint32_t draw(void) { /* xorshift64* */
    generator ^= generator >> 12U;
    generator ^= generator << 25U;
    generator ^= generator >> 27U;
    return (uint32_t)((generator * 2685821657736338717ULL) >> 32U);
}

static void absorb(const void *data, size_t length) { /* FNV-1a */
    const uint8_t *bytes = data;
    for (size_t i = 0; i < length; i++) {
        hash = (hash ^ bytes[i]) * 1099511628211ULL;
    }
}

void setUp(void) {
    TEST_ASSERT_TRUE(terrapin_state_size() <= sizeof memory[0]);
    memset(memory, 0x5A, sizeof memory);
    memset(&in, 0, sizeof in);
    generator = 88172645463325252ULL;
    hash = 14695981039346656037ULL;
    terrapin_init(state);
}

void tearDown(void) {}

static void step(void) {
    terrapin_step(state, &in, &out);
    TEST_ASSERT_TRUE(out.frame_count >= 1U && out.frame_count <= TERRAPIN_MAX_FRAMES);
    TEST_ASSERT_TRUE(out.enable || out.duty_q15 == 0);
    TEST_ASSERT_TRUE(out.duty_q15 >= -32767);
    TEST_ASSERT_FALSE_MESSAGE(in.estop && out.enable, "the bridge is off in the tick of the e-stop");
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0U, out.faults & ~TERRAPIN_FAULTS_KNOWN, "a fault without a number");
    for (uint8_t i = 0U; i < out.frame_count; i++) {
        absorb(&out.frames[i].id, sizeof out.frames[i].id);
        absorb(&out.frames[i].length, 1U);
        absorb(out.frames[i].data, out.frames[i].length);
    }
}

/* Anything that fits the types, among it what no sensor would say. */
static void noise(void) {
    in.tick += (draw() % 500U == 0U) ? draw() : 1U;
    in.current_code = (uint16_t)draw();
    in.supply_code = (uint16_t)draw();
    in.temperature_code = (uint16_t)draw();
    in.motor_count = (uint16_t)draw();
    in.ground_count = (uint16_t)draw();
    in.swing_angle_mrad = (int16_t)draw();
    in.swing_rate_centirad_s = (int16_t)draw();
    in.pitch_mrad = (int16_t)draw();
    in.ground_speed_mm_s = (int16_t)draw();
    in.swing_valid = draw() % 4U != 0U;
    in.pitch_valid = draw() % 2U != 0U;
    in.ground_speed_valid = draw() % 2U != 0U;
    in.estop = draw() % 50U == 0U;
    in.command_fresh = draw() % 20U == 0U;
    in.command.request = (uint8_t)(draw() % 256U);
    in.command.control = (uint8_t)(draw() % 256U);
    in.command.limiter = draw() % 2U != 0U;
    in.command.setpoint = (int16_t)draw();
}

/* Something like a robot: counts that follow the duty, a current, an operator; in integers. */
static void plausible(void) {
    static int32_t speed, position, way, grip;
    if (in.tick == 0U) {
        speed = position = way = 0;
        grip = 330000;
    }
    in.tick++;
    speed += (out.enable ? out.duty_q15 * 600 : 0) / 160 - speed / 288;
    position += speed / 200000;
    grip += (in.tick / 4096U) % 2U == 0U ? (grip > 330000 ? -500 : 0) : (grip < 900000 ? 500 : 0);
    way += speed / grip; /* slip comes and goes, and takes current */
    in.current_code = (uint16_t)(2048 + (out.enable ? out.duty_q15 / 40 - speed / 30000 : 0) / 4 +
                                 (out.enable ? grip / 3000 - 110 : 0) + (int32_t)(draw() % 3U));
    in.supply_code = (uint16_t)(2990U + draw() % 20U);
    in.temperature_code = (uint16_t)(1500U + (in.tick / 1024U) % 256U);
    in.motor_count = (uint16_t)position;
    in.ground_count = (uint16_t)way;
    in.swing_rate_centirad_s = (int16_t)((int32_t)(draw() % 7U) - 3);
    in.swing_angle_mrad = (int16_t)(100 + (int32_t)(draw() % 5U));
    in.swing_valid = (in.tick / 8192U) % 4U != 3U;
    in.pitch_valid = true;
    in.pitch_mrad = (int16_t)((in.tick / 64U) % 100U);
    in.command_fresh = in.tick % 50U == 0U;
    if (in.command_fresh) {
        static const uint8_t requests[16] = {2U, 2U, 0U, 3U, 2U, 1U, 1U, 3U, 2U, 2U, 3U, 3U, 1U, 1U, 2U, 3U};
        const uint32_t turn = in.tick / 8000U;
        const bool cleared = requests[(turn + 15U) % 16U] == 3U;
        in.command.request =
            (cleared && (in.tick % 8000U < 100U)) ? 0U : requests[turn % 16U]; /* an IDLE ends a clear */
        in.command.control = (uint8_t)((in.tick / 5000U) % 2U);
        in.command.setpoint = (int16_t)(2000 + (int32_t)((in.tick / 3000U) % 5U) * 1200);
        in.command.limiter = (in.tick / 16000U) % 2U == 0U;
    }
}

static void test_noise_keeps_every_promise(void) {
    for (int i = 0; i < 200000; i++) {
        if (i % 1000 == 0) { /* parameters anywhere in their ranges */
            for (uint16_t p = 0U; p < TERRAPIN_PARAMETER_COUNT; p++) {
                const terrapin_parameter_entry entry = terrapin_parameter((uint16_t)p);
                const uint64_t span = (uint64_t)((int64_t)entry.maximum - entry.minimum) + 1U;
                const int64_t value = entry.minimum + (int64_t)(((uint64_t)draw() << 8U) % span);
                const terrapin_parameter_result result = terrapin_parameter_set(state, p, (int32_t)value);
                TEST_ASSERT_TRUE(result == TERRAPIN_PARAMETER_OK || result == TERRAPIN_PARAMETER_LOCKED);
            }
        }
        noise();
        step();
    }
}

static void test_quiet_noise_lets_it_drive(void) {
    bool driven = false;
    for (int i = 0; i < 100000; i++) {
        const uint16_t motor = in.motor_count, ground = in.ground_count;
        const uint32_t tick = in.tick;
        noise();
        in.tick = tick + 1U;
        in.current_code = (uint16_t)(2000U + in.current_code % 100U);
        in.supply_code = 3000U;
        in.temperature_code = 1500U;
        in.motor_count = (uint16_t)(motor + in.motor_count % 8U);
        in.ground_count = (uint16_t)(ground + in.ground_count % 8U);
        in.estop = false;
        in.command_fresh = true;
        static const uint8_t requests[] = {TERRAPIN_REQUEST_CLEAR, TERRAPIN_REQUEST_IDLE, TERRAPIN_REQUEST_RUN};
        in.command.request = requests[(i / 2000) % 3];
        step();
        driven = driven || out.enable;
    }
    TEST_ASSERT_TRUE(driven);
}

static void test_same_bits_on_every_machine(void) {
    uint32_t states_seen = 0U;
    for (int i = 0; i < 200000; i++) {
        plausible();
        step();
        states_seen |= 1U << (out.frames[0].data[4] & 0xFU);
    }
    for (int i = 0; i < 20000; i++) {
        noise();
        step();
    }
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(0x1FFU, states_seen | (1U << (out.frames[0].data[4] & 0xFU)),
                                    "every state was passed through");
    /* The hash of every frame. It changes with the controller's behaviour, and with nothing else. */
    TEST_ASSERT_EQUAL_HEX64(0xD3C49927B7BB4333ULL, hash);
}

static void test_two_controllers_do_not_know_each_other(void) {
    terrapin_state *const other = (terrapin_state *)memory[1];
    terrapin_outputs second;
    terrapin_init(other);
    for (int i = 0; i < 2000; i++) {
        plausible();
        terrapin_step(other, &in, &second);
        step();
        TEST_ASSERT_EQUAL_MEMORY(out.frames[0].data, second.frames[0].data, 8);
        TEST_ASSERT_EQUAL_INT16(out.duty_q15, second.duty_q15);
    }
}

/* One reset with parameters is the reset and then the parameters, byte for byte, whatever stood there before. */
static void test_a_reset_with_parameters(void) {
    terrapin_state *const other = (terrapin_state *)memory[1];
    int32_t values[TERRAPIN_PARAMETER_COUNT];
    for (uint16_t i = 0; i < TERRAPIN_PARAMETER_COUNT; i++) {
        values[i] = terrapin_parameter(i).minimum;
    }
    memset(memory, 0xA5, sizeof memory);
    terrapin_init(state);
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set_all(state, values));
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_init_with(other, values));
    TEST_ASSERT_EQUAL_MEMORY(state, other, terrapin_state_size());
    TEST_ASSERT_EQUAL_HEX64(0xA5A5A5A5A5A5A5A5ULL, memory[1][(terrapin_state_size() + 7U) / 8U]);
    values[TERRAPIN_PARAMETER_COUNT - 1]--;
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_RANGE, terrapin_init_with(other, values));
    terrapin_init(state);
    TEST_ASSERT_EQUAL_MEMORY(state, other, terrapin_state_size());
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_noise_keeps_every_promise);
    RUN_TEST(test_quiet_noise_lets_it_drive);
    RUN_TEST(test_same_bits_on_every_machine);
    RUN_TEST(test_two_controllers_do_not_know_each_other);
    RUN_TEST(test_a_reset_with_parameters);
    return UNITY_END();
}
