/* What tells one chip from another: the link key beside the boot loader, the generator of random numbers, the unique
 * number. A key that is damaged must not open what was sealed, nor a generator that stands still repeat a session. */
#include <string.h>

#include "unity.h"

static void hardware_moves(void);
#define TERRAPIN_SPIN() hardware_moves()

#include "registers.h"

static rng_registers *generator(void);
static rcc_registers rcc;
#undef RCC
#undef RNG
#define RCC (&rcc)
#define RNG generator()

#include "../../firmware/store/crc32.c"
#include "../../firmware/ports/stm32f405/link_key.c"
#include "../../firmware/ports/stm32f405/unique.c"

/* ---- the chip: what answers a probe; a generator whose words come some looks after it runs or the last was read */

static bool generator_there, number_there[3];
static const uint32_t unique_words[3] = {0x04030201U, 0x08070605U, 0x0C0B0A09U};
static rng_registers rng;
static uint32_t words[2], which_word, comes_after, errors, spins;
static bool was_read;

bool probe_read(uint32_t address, uint32_t *value) {
    if (address == RNG_STATUS) {
        TEST_ASSERT_NOT_EQUAL(0U, rcc.AHB2ENR & RCC_AHB2ENR_RNG); /* without its clock nothing answers */
        return generator_there;
    }
    const uint32_t at = address - 0x1FFF7A10U; /* RM0090, 39.1 */
    TEST_ASSERT_TRUE(((at % 4U) == 0U) && (at < 12U));
    *value = unique_words[at / 4U];
    return number_there[at / 4U];
}

/* Reading the data takes the word away: DR is read by whoever asks for it while a word is there. */
static rng_registers *generator(void) {
    if (was_read) {
        rng.SR = 0U;
        rng.DR = 0U;
        spins = 0U;
        which_word++;
        was_read = false;
    } else if ((rng.SR & RNG_SR_DRDY) != 0U) {
        was_read = true;
    } else { /* set up, or its status looked for */
    }
    return &rng;
}

static void hardware_moves(void) {
    spins++;
    if (((rng.CR & RNG_CR_RNGEN) != 0U) && (which_word < 2U) && (spins == comes_after)) {
        rng.DR = words[which_word];
        rng.SR = RNG_SR_DRDY | errors;
    }
}

void setUp(void) {
    (void)memset(&rcc, 0, sizeof rcc);
    (void)memset(&rng, 0, sizeof rng);
    generator_there = true;
    number_there[0] = number_there[1] = number_there[2] = true;
    words[0] = 0xAAAAAAAAU;
    words[1] = 0x5A5A1234U;
    which_word = comes_after = errors = spins = 0U;
    was_read = false;
}

void tearDown(void) {}

/* ---- the key */

static void block(uint32_t made[LINK_KEY_WORDS], uint32_t generation) {
    uint8_t bytes[24];
    const uint32_t first[6] = {0x59454B4CU, generation, 0x11111111U, 0x22222222U, 0x33333333U, 0x44444444U};
    for (uint32_t i = 0U; i < 6U; i++) {
        made[i] = first[i];
        for (uint32_t k = 0U; k < 4U; k++) {
            bytes[(4U * i) + k] = (uint8_t)(first[i] >> (8U * k)); /* the probe's writer has the lowest byte first */
        }
    }
    made[6] = terrapin_crc32(0U, bytes, sizeof bytes);
}

static void test_a_sound_key_comes_with_its_generation(void) {
    uint32_t made[LINK_KEY_WORDS];
    uint32_t generation = 99U;
    block(made, 7U);
    TEST_ASSERT_EQUAL_PTR(&made[2], link_key(made, &generation));
    TEST_ASSERT_EQUAL(7U, generation);
}

static void test_flash_that_was_never_written_has_no_key(void) {
    const uint32_t kinds[2] = {0xFFFFFFFFU, 0U};
    for (uint32_t i = 0U; i < 2U; i++) {
        uint32_t made[LINK_KEY_WORDS];
        uint32_t generation = 99U;
        for (uint32_t k = 0U; k < LINK_KEY_WORDS; k++) {
            made[k] = kinds[i];
        }
        TEST_ASSERT_NULL(link_key(made, &generation));
        TEST_ASSERT_EQUAL(0U, generation);
    }
}

/* Any word but erased is a key: that of nobody, so that the link stays closed. */
static void test_a_damaged_key_opens_nothing_by_itself(void) {
    uint32_t made[LINK_KEY_WORDS];
    uint32_t generation = 0U;
    for (uint32_t word = 0U; word < LINK_KEY_WORDS; word++) {
        for (uint32_t bit = 0U; bit < 32U; bit++) {
            block(made, 7U);
            made[word] ^= (uint32_t)1U << bit;
            generation = 99U;
            TEST_ASSERT_EQUAL_PTR(&made[2], link_key(made, &generation));
            TEST_ASSERT_EQUAL(0U, generation);
        }
    }
    for (uint32_t word = 0U; word < LINK_KEY_WORDS; word++) { /* one word alone of erased flash is written */
        (void)memset(made, 0xFF, sizeof made);
        made[word] = 0U;
        TEST_ASSERT_EQUAL_PTR(&made[2], link_key(made, &generation));
        (void)memset(made, 0, sizeof made);
        made[word] = 1U;
        TEST_ASSERT_EQUAL_PTR(&made[2], link_key(made, &generation));
    }
    for (uint32_t word = 0U; word < LINK_KEY_WORDS; word++) { /* all the same, but erased by no flash */
        made[word] = 0x12345678U;
    }
    TEST_ASSERT_EQUAL_PTR(&made[2], link_key(made, &generation));
    TEST_ASSERT_EQUAL(0U, generation);
}

/* ---- random numbers */

static void test_the_second_word_is_the_random_one(void) {
    uint32_t word = 0U;
    comes_after = 20U;
    TEST_ASSERT_TRUE(random_word(&word));
    TEST_ASSERT_EQUAL_HEX32(0x5A5A1234U, word); /* the first after the start is not to be used */
}

static void test_a_generator_that_repeats_itself_is_not_believed(void) {
    uint32_t word = 0U;
    comes_after = 1U;
    words[1] = words[0];
    TEST_ASSERT_FALSE(random_word(&word));
}

static void test_a_word_with_an_error_is_not_taken(void) {
    const uint32_t kinds[2] = {(uint32_t)1U << 5U, (uint32_t)1U << 6U}; /* of its clock, of its seed */
    for (uint32_t i = 0U; i < 2U; i++) {
        uint32_t word = 0xC0FFEEU;
        setUp();
        comes_after = 1U;
        errors = kinds[i];
        TEST_ASSERT_FALSE(random_word(&word));
        TEST_ASSERT_EQUAL_HEX32(0xC0FFEEU, word);
    }
}

static void test_a_generator_that_is_not_there_or_hangs_gives_nothing(void) {
    uint32_t word = 0xC0FFEEU;
    generator_there = false;
    TEST_ASSERT_FALSE(random_word(&word));
    TEST_ASSERT_EQUAL_HEX32(0U, rng.CR); /* what is not there is not written: it would fault */
    generator_there = true;
    TEST_ASSERT_FALSE(random_word(&word));
    TEST_ASSERT_GREATER_OR_EQUAL(1000U, spins); /* 40 cycles of 48 MHz are waited for, with much to spare */
    TEST_ASSERT_EQUAL_HEX32(0xC0FFEEU, word);
    setUp();
    comes_after = 1000U;
    TEST_ASSERT_TRUE(random_word(&word));
}

/* ---- the unique number */

static void test_the_unique_number_is_that_of_all_twelve_bytes(void) {
    static const uint8_t bytes[12] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    TEST_ASSERT_EQUAL_HEX32(terrapin_crc32(0U, bytes, sizeof bytes), unique_number());
    for (uint32_t i = 0U; i < 3U; i++) {
        number_there[i] = false;
        TEST_ASSERT_EQUAL_HEX32(0U, unique_number()); /* a part of it would be another chip's */
        number_there[i] = true;
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_sound_key_comes_with_its_generation);
    RUN_TEST(test_flash_that_was_never_written_has_no_key);
    RUN_TEST(test_a_damaged_key_opens_nothing_by_itself);
    RUN_TEST(test_the_second_word_is_the_random_one);
    RUN_TEST(test_a_generator_that_repeats_itself_is_not_believed);
    RUN_TEST(test_a_word_with_an_error_is_not_taken);
    RUN_TEST(test_a_generator_that_is_not_there_or_hangs_gives_nothing);
    RUN_TEST(test_the_unique_number_is_that_of_all_twelve_bytes);
    return UNITY_END();
}
