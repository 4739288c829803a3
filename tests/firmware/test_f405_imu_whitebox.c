/* The IMU of the STM32F405's port on a bus made of memory: a chip that is missing, another one, one that hangs or
 * forgets its settings; and the swing of a body whose axle is shaken, against the truth. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "unity.h"

static void hardware_moves(void);
static void hardware_takes(volatile uint32_t *address, uint32_t value);
#define TERRAPIN_SPIN()          hardware_moves()
#define TERRAPIN_PUT(reg, value) hardware_takes(&(reg), (value))

#include "../../firmware/core/integer.c"
#include "../../firmware/ports/stm32f405/imu.c"
#include "../../firmware/ports/stm32f405/pins.c"
#include "../../firmware/ports/stm32f405/spi.c"
#include "../../firmware/ports/stm32f405/swing.c"

/* The wires of a board that has one, whose chip is SPI1 alone; below, the chip has no wires. */
static spi_registers port;
static gpio_registers wires;
#define TERRAPIN_BOARD "terrapin_board.h"
#include "boards/selected.h"
#undef BOARD_IMU_SELECT
#undef SPI1
#undef GPIO
#define BOARD_IMU_SELECT {1U, 5U, PIN_OUTPUT, PIN_UP, 0U}
#define SPI1             (&port)
#define GPIO(letter)     ((letter) == 1U ? &wires : NULL)
#define imu_exchange     wired_exchange
bool wired_exchange(uint8_t address, uint8_t *bytes, uint32_t count);
#include "../../firmware/ports/stm32f405/imu_bus.c"
#undef imu_exchange

#define G       9.81
#define MS      1e-3
#define DEGREES (3.14159265358979323846 / 180.0)

/* ---- SPI1: a word comes back some looks at the status after one was sent */

static uint32_t spins, comes_after, sent;
static uint32_t wired[8], wired_count,
    silent_from; /* bytes while the chip is selected; from which on none comes back */

static void hardware_moves(void) {
    spins++;
    if (spins == comes_after) {
        port.SR |= SPI_SR_RXNE;
        port.DR = 0xA7U;
    }
}

static void hardware_takes(volatile uint32_t *address, uint32_t value) {
    if (address != &port.DR) {
        *address = value;
        return;
    }
    TEST_ASSERT_TRUE((port.CR1 & SPI_CR1_SPE) != 0U);
    sent = value;
    port.SR &= ~SPI_SR_RXNE;
    if (wires.MODER != 0U) { /* what comes back is the byte's number */
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(BIT(5) << 16U, wires.BSRR, "low: selected");
        wired[wired_count] = value;
        wired_count++;
        port.SR |= (wired_count < silent_from) ? SPI_SR_RXNE : 0U;
        port.DR = 0x100U + wired_count;
    }
}

/* ---- the chip: registers, and what it does with its power */

static struct {
    uint8_t registers[128];
    bool dead;      /* no answer on the bus */
    bool deaf;      /* takes no settings */
    bool frozen;    /* the same sample for ever */
    uint32_t tick;  /* now */
    uint32_t reset; /* tick of the last reset, */
    uint32_t power; /* and of the sensors' start */
    uint32_t accesses, resets;
    double acceleration[3]; /* g */
    double rate[3];         /* degrees/s */
} chip;

static void chip_reset(void) {
    memset(chip.registers, 0, sizeof chip.registers);
    chip.registers[0x75] = 0x47U;
    chip.registers[0x4C] = 0x30U;
    chip.registers[0x4F] = 0x06U;
    chip.registers[0x50] = 0x06U;
    chip.reset = chip.tick;
    chip.resets++;
}

static void put(uint32_t at, int32_t value) {
    chip.registers[at] = (uint8_t)((uint32_t)value >> 8U);
    chip.registers[at + 1U] = (uint8_t)value;
}

static bool powered(void) {
    return (chip.registers[0x4E] & 0x0FU) == 0x0FU;
}

/* A sample: at the scales that the registers set, with noise of a code; -32768 while a sensor is off. */
static void chip_measures(void) {
    const double g = 32768.0 / (16 >> (chip.registers[0x50] >> 5U));
    const double degree = 32768.0 / (2000 >> (chip.registers[0x4F] >> 5U));
    if (chip.frozen) {
        return;
    }
    for (uint32_t i = 0U; i < 3U; i++) {
        const int32_t noise = (int32_t)((chip.tick * (7U + i)) % 3U) - 1;
        put(0x1FU + (2U * i), powered() ? (int32_t)lround(chip.acceleration[i] * g) + noise : -32768);
        put(0x25U + (2U * i), powered() ? (int32_t)lround(chip.rate[i] * degree) + noise : -32768);
    }
}

static void written(uint8_t at, uint8_t value) {
    if ((at == 0x11U) && (value == 1U)) {
        chip_reset();
        return;
    }
    TEST_ASSERT_TRUE_MESSAGE(!powered() || (chip.tick > chip.power), "written while its sensors start");
    if (!chip.deaf) {
        chip.registers[at] = value;
    }
    chip.power = powered() ? chip.tick : chip.power;
}

bool imu_exchange(uint8_t address, uint8_t *bytes, uint32_t count) {
    const uint32_t first = address & 0x7FU;
    const bool reads = (address & 0x80U) != 0U;
    chip.accesses++;
    if (chip.dead) {
        return false;
    }
    TEST_ASSERT_TRUE_MESSAGE((chip.tick > chip.reset) || (address == 0x11U), "asked while it resets");
    TEST_ASSERT_TRUE_MESSAGE((first + count) <= 0x2BU || (count == 1U),
                             "no status behind the sample, which a read clears");
    for (uint32_t i = 0U; i < count; i++) {
        if (reads) {
            bytes[i] = chip.registers[first + i];
        } else {
            written((uint8_t)(first + i), bytes[i]);
        }
    }
    return true;
}

/* ---- the body */

static swing body;
static terrapin_inputs in;

/* Which of the chip's axes point forward and up: the chip then measures what the body does. */
static void mount(int32_t forward, int32_t forward_sign, int32_t up, int32_t up_sign) {
    const int32_t right = 3 - forward - up;
    const int32_t even = ((forward + 1) % 3) == up ? 1 : -1;
    body.forward = (imu_axis){(uint8_t)forward, (int8_t)forward_sign};
    body.up = (imu_axis){(uint8_t)up, (int8_t)up_sign};
    body.right = (imu_axis){(uint8_t)right, (int8_t)(forward_sign * up_sign * even)};
}

/* The chip at the axle of a body at `angle` that turns at `rate`, while the axle accelerates forward. */
static void feel(double angle, double rate, double axle) {
    const double forward = (axle * cos(angle) / G) + sin(angle);
    const double up = cos(angle) - (axle * sin(angle) / G);
    memset(chip.acceleration, 0, sizeof chip.acceleration);
    chip.acceleration[body.forward.axis] = body.forward.sign * forward;
    chip.acceleration[body.up.axis] = body.up.sign * up;
    chip.rate[body.right.axis] = body.right.sign * rate / DEGREES;
}

static bool tick(void) {
    chip.tick++;
    chip_measures();
    const uint32_t before = chip.accesses;
    const bool there = swing_sense(&body, &in);
    TEST_ASSERT_LESS_OR_EQUAL_UINT32(9U, chip.accesses - before); /* no tick waits for long */
    return there;
}

static void ticks(uint32_t count) {
    for (uint32_t i = 0U; i < count; i++) {
        (void)tick();
    }
}

void setUp(void) {
    memset(&chip, 0, sizeof chip);
    memset(&body, 0, sizeof body);
    memset(&in, 0, sizeof in);
    memset(&port, 0, sizeof port);
    memset(&wires, 0, sizeof wires);
    wired_count = 0U;
    silent_from = 8U;
    spins = comes_after = sent = 0U;
    chip.tick = 10U;
    chip_reset();
    chip.resets = 0U;
    chip.registers[0x4F] = 0x00U; /* as somebody left it */
    mount(0, 1, 2, 1);
    feel(0.0, 0.0, 0.0);
}

void tearDown(void) {}

/* ---- the bus */

static void test_it_is_a_master_of_mode_3_at_an_eighth(void) {
    spi_open(&port);
    TEST_ASSERT_EQUAL_HEX32(BIT(0) | BIT(1) | BIT(2) | (2U << 3U) | BIT(6) | BIT(8) | BIT(9), port.CR1);
}

static void test_a_byte_goes_and_comes_or_the_wait_ends(void) {
    uint8_t in_byte = 0U;
    spi_open(&port);
    comes_after = 20U;
    TEST_ASSERT_TRUE(spi_byte(&port, 0x9FU, &in_byte));
    TEST_ASSERT_EQUAL_HEX8(0x9F, sent);
    TEST_ASSERT_EQUAL_HEX8(0xA7, in_byte);
    comes_after = 0U;
    spins = 0U;
    TEST_ASSERT_FALSE(spi_byte(&port, 0U, &in_byte));
    TEST_ASSERT_EQUAL_UINT32(SPI_TRIES, spins);
}

/* Selected from the address to the last byte, at rest with the pin high: also where a byte stays away. */
static void test_the_chip_is_selected_for_an_exchange_alone(void) {
    uint8_t bytes[3] = {0x11, 0x22, 0x33};
    spi_open(&port);
    imu_bus_open();
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(BIT(5), wires.BSRR, "high before it is an output");
    TEST_ASSERT_EQUAL_HEX32((uint32_t)PIN_OUTPUT << 10U, wires.MODER);
    TEST_ASSERT_EQUAL_HEX32((uint32_t)PIN_UP << 10U, wires.PUPDR);
    TEST_ASSERT_TRUE(wired_exchange(0x9FU, bytes, 3U));
    TEST_ASSERT_EQUAL_UINT32(4U, wired_count);
    TEST_ASSERT_EQUAL_HEX32(0x9F, wired[0]);
    TEST_ASSERT_EQUAL_HEX32(0x11, wired[1]);
    TEST_ASSERT_EQUAL_HEX32(0x33, wired[3]);
    TEST_ASSERT_EQUAL_HEX8(2, bytes[0]);
    TEST_ASSERT_EQUAL_HEX8(4, bytes[2]);
    TEST_ASSERT_EQUAL_HEX32(BIT(5), wires.BSRR);
    wired_count = 0U;
    TEST_ASSERT_TRUE(wired_exchange(0x9FU, bytes, 0U));
    TEST_ASSERT_EQUAL_UINT32(1U, wired_count);
    for (silent_from = 1U; silent_from <= 4U; silent_from++) {
        wired_count = 0U;
        TEST_ASSERT_FALSE(wired_exchange(0x9FU, bytes, 3U));
        TEST_ASSERT_EQUAL_UINT32_MESSAGE(silent_from, wired_count, "it stops there");
        TEST_ASSERT_EQUAL_HEX32(BIT(5), wires.BSRR);
    }
}

/* ---- the chip */

static void test_it_is_set_up_and_valid_before_the_self_test_ends(void) {
    uint32_t first = 0U;
    for (uint32_t i = 1U; i <= 400U; i++) {
        (void)tick();
        first = ((first == 0U) && in.swing_valid) ? i : first;
        TEST_ASSERT_EQUAL((first != 0U), in.swing_valid); /* and stays */
    }
    TEST_ASSERT_GREATER_THAN_UINT32(45U, first); /* the gyroscopes' start */
    TEST_ASSERT_LESS_THAN_UINT32(190U, first);
    TEST_ASSERT_EQUAL_HEX8(0x06, chip.registers[0x4F]);
    TEST_ASSERT_EQUAL_HEX8(0x26, chip.registers[0x50]);
    TEST_ASSERT_EQUAL_HEX8(0x33, chip.registers[0x4C]);
    TEST_ASSERT_EQUAL_UINT32(1U, chip.resets);
}

static void never_runs(uint32_t resets) {
    for (uint32_t i = 0U; i < 1000U; i++) {
        TEST_ASSERT_FALSE(tick());
        TEST_ASSERT_FALSE(in.swing_valid);
    }
    TEST_ASSERT_EQUAL_UINT32(resets, chip.resets);
}

/* Asked again every 104 ticks; and taken when it is there at last. */
static void test_another_chip_is_refused(void) {
    for (uint32_t i = 0U; i < 1000U; i++) {
        chip.registers[0x75] = 0x70U; /* an MPU-6500 */
        TEST_ASSERT_FALSE(tick());
        TEST_ASSERT_FALSE(in.swing_valid);
    }
    TEST_ASSERT_EQUAL_UINT32(10U, chip.resets);
    ticks(400U);
    TEST_ASSERT_TRUE(in.swing_valid);
}

static void test_a_dead_bus_is_no_swing_and_comes_back(void) {
    chip.dead = true;
    never_runs(0U);
    chip.dead = false;
    ticks(400U);
    TEST_ASSERT_TRUE(in.swing_valid);
    chip.dead = true;
    ticks(1U);
    TEST_ASSERT_FALSE(in.swing_valid); /* at once */
    TEST_ASSERT_TRUE(imu_running(&body.chip));
    ticks(IMU_BAD_TICKS - 2U);
    TEST_ASSERT_TRUE(imu_running(&body.chip));
    ticks(1U);
    TEST_ASSERT_FALSE(imu_running(&body.chip));
}

/* What a chip did before it was reset is forgotten: its first sample may be lost as any other. */
static void test_a_chip_that_was_reset_begins_without_faults(void) {
    ticks(400U);
    chip.dead = true;
    ticks(IMU_BAD_TICKS);
    TEST_ASSERT_FALSE(imu_running(&body.chip));
    chip.dead = false;
    while (!imu_running(&body.chip) || (body.chip.wait > 0U)) {
        ticks(1U);
    }
    chip.dead = true;
    ticks(IMU_BAD_TICKS - 1U);
    TEST_ASSERT_TRUE(imu_running(&body.chip));
    chip.dead = false;
    TEST_ASSERT_TRUE(tick());
}

static void test_a_sample_that_is_lost_costs_that_tick_alone(void) {
    ticks(400U);
    for (uint32_t i = 0U; i < 10U; i++) { /* four in a row, again and again */
        chip.dead = true;
        ticks(IMU_BAD_TICKS - 1U);
        chip.dead = false;
        TEST_ASSERT_TRUE(tick());
        TEST_ASSERT_TRUE(in.swing_valid);
    }
}

static void test_settings_that_do_not_hold_are_seen(void) {
    chip.deaf = true;
    never_runs(10U);
}

static void test_a_chip_that_says_the_same_for_ever_is_none(void) {
    ticks(400U);
    chip.frozen = true;
    ticks(IMU_STUCK_TICKS - 1U);
    TEST_ASSERT_TRUE(in.swing_valid);
    ticks(1U);
    TEST_ASSERT_FALSE(in.swing_valid);
    TEST_ASSERT_FALSE(tick());
    chip.frozen = false;
    ticks(400U);
    TEST_ASSERT_TRUE(in.swing_valid);
    TEST_ASSERT_EQUAL_UINT32(2U, chip.resets);
}

/* Also by itself: what it says the last time is what it said before. */
static void test_the_sample_that_proves_it_stuck_is_not_fresh(void) {
    ticks(400U);
    chip.frozen = true;
    for (uint32_t i = 1U; i <= IMU_STUCK_TICKS; i++) {
        chip.tick++;
        TEST_ASSERT_EQUAL(i < IMU_STUCK_TICKS, imu_tick(&body.chip));
    }
}

static void test_a_chip_that_lost_its_power_is_set_up_again(void) {
    ticks(400U);
    chip_reset(); /* its supply dipped: the registers are as after power-on */
    ticks(1U);
    TEST_ASSERT_FALSE(in.swing_valid);
    ticks(400U);
    TEST_ASSERT_TRUE(in.swing_valid);
    TEST_ASSERT_EQUAL_HEX8(0x26, chip.registers[0x50]);
}

/* ---- the swing */

static void test_every_way_to_mount_it(void) {
    uint32_t ways = 0U;
    for (int32_t forward = 0; forward < 3; forward++) {
        for (int32_t up = 0; up < 3; up++) {
            for (int32_t signs = 0; (signs < 4) && (forward != up); signs++) {
                setUp();
                mount(forward, ((signs & 1) != 0) ? 1 : -1, up, ((signs & 2) != 0) ? 1 : -1);
                feel(0.7, 0.0, 0.0);
                ticks(400U);
                TEST_ASSERT_TRUE(in.swing_valid);
                TEST_ASSERT_INT_WITHIN(5, 700, in.swing_angle_mrad);
                feel(0.7, 2.0, 0.0);
                ticks(1U);
                TEST_ASSERT_INT_WITHIN(2, 200, in.swing_rate_centirad_s);
                TEST_ASSERT_GREATER_THAN_INT(700, in.swing_angle_mrad + 4);
                ways++;
            }
        }
    }
    TEST_ASSERT_EQUAL_UINT32(24U, ways);
}

static void test_far_from_the_vertical_when_it_starts(void) {
    for (int32_t degrees = -170; degrees <= 170; degrees += 10) {
        setUp();
        feel(degrees * DEGREES, 0.0, 0.0);
        ticks(3000U);
        TEST_ASSERT_INT_WITHIN(10, lround(1e3 * degrees * DEGREES), in.swing_angle_mrad);
    }
}

/* The 150 N sphere's bob swings at 4.37 rad/s while its axle is free to give way, the most that it can: k / M = 0.0765
 * m. The gyroscope's zero is off by half a degree a second, as the data sheet says is typical. Bounds: 3 degrees, since
 * the guard stands 25 degrees below the level; and 0.03 rad/s, a seventh of the slip's dead band on the shell. */
static void follow(double amplitude, double zero, double *worst_mrad, double *worst_centirad_s) {
    *worst_mrad = *worst_centirad_s = 0.0;
    for (uint32_t i = 0U; i < 60000U; i++) {
        const double w = 4.37;
        const double phase = w * MS * (chip.tick + 1U);
        const double angle = amplitude * sin(phase);
        const double rate = amplitude * w * cos(phase);
        const double jerk = -amplitude * w * w * sin(phase);
        feel(angle, rate + (zero * DEGREES), -0.0765 * ((cos(angle) * jerk) - (sin(angle) * rate * rate)));
        (void)tick();
        if (i > 30000U) {
            *worst_mrad = fmax(*worst_mrad, fabs(in.swing_angle_mrad - (1e3 * angle)));
            *worst_centirad_s = fmax(*worst_centirad_s, fabs(in.swing_rate_centirad_s - (1e2 * rate)));
            TEST_ASSERT_TRUE(in.swing_valid);
        }
    }
}

static void test_the_swing_of_a_free_axle(void) {
    const double amplitudes[] = {0.0, 0.2, 0.6, 1.1};
    for (uint32_t i = 0U; i < (sizeof amplitudes / sizeof amplitudes[0]); i++) {
        for (double zero = -0.5; zero <= 0.5; zero += 0.5) {
            double angle = 0.0;
            double rate = 0.0;
            setUp();
            follow(amplitudes[i], zero, &angle, &rate);
            TEST_ASSERT_LESS_OR_EQUAL_INT32(52, lround(angle));
            TEST_ASSERT_LESS_OR_EQUAL_INT32(3, lround(rate));
        }
    }
}

/* A zero beyond what a good chip has is not learnt away: the rate shows it. */
static void test_a_zero_that_no_good_chip_has_is_not_hidden(void) {
    double angle = 0.0;
    double rate = 0.0;
    follow(0.0, 6.0, &angle, &rate);
    TEST_ASSERT_GREATER_THAN_INT32(6, lround(rate)); /* 4 degrees/s are left */
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_it_is_a_master_of_mode_3_at_an_eighth);
    RUN_TEST(test_a_byte_goes_and_comes_or_the_wait_ends);
    RUN_TEST(test_the_chip_is_selected_for_an_exchange_alone);
    RUN_TEST(test_it_is_set_up_and_valid_before_the_self_test_ends);
    RUN_TEST(test_another_chip_is_refused);
    RUN_TEST(test_a_dead_bus_is_no_swing_and_comes_back);
    RUN_TEST(test_a_chip_that_was_reset_begins_without_faults);
    RUN_TEST(test_a_sample_that_is_lost_costs_that_tick_alone);
    RUN_TEST(test_settings_that_do_not_hold_are_seen);
    RUN_TEST(test_a_chip_that_says_the_same_for_ever_is_none);
    RUN_TEST(test_the_sample_that_proves_it_stuck_is_not_fresh);
    RUN_TEST(test_a_chip_that_lost_its_power_is_set_up_again);
    RUN_TEST(test_every_way_to_mount_it);
    RUN_TEST(test_far_from_the_vertical_when_it_starts);
    RUN_TEST(test_the_swing_of_a_free_axle);
    RUN_TEST(test_a_zero_that_no_good_chip_has_is_not_hidden);
    return UNITY_END();
}
