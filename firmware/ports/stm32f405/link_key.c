#include "link_key.h"

#include "crc32.h"
#include "processor.h"
#include "registers.h"
#include "wait.h"

#define ERASED_WORD 0xFFFFFFFFU
#define CRC_AT      (LINK_KEY_WORDS - 1U)
#define TRIES       2000U /* a word takes 40 cycles of 48 MHz (RM0090, 24.2) */

const uint32_t *link_key(const uint32_t words[LINK_KEY_WORDS], uint32_t *generation) {
    uint8_t bytes[4U * CRC_AT];
    bool erased = (words[0] == ERASED_WORD) || (words[0] == 0U); /* an emulator's flash begins as zeros */
    for (uint32_t i = 0U; i < LINK_KEY_WORDS; i++) {
        erased = erased && (words[i] == words[0]);
    }
    for (uint32_t i = 0U; i < sizeof bytes; i++) {
        bytes[i] = (uint8_t)(words[i / 4U] >> (8U * (i % 4U)));
    }
    *generation = 0U;
    if (erased) {
        return NULL;
    }
    if ((words[0] == LINK_KEY_MARK) && (words[CRC_AT] == terrapin_crc32(0U, bytes, sizeof bytes))) {
        *generation = words[1];
    }
    return &words[2];
}

static bool next_word(uint32_t *word) {
    const bool ready = wait_for(&RNG->SR, RNG_SR_DRDY | RNG_SR_ERRORS, RNG_SR_DRDY, TRIES);
    if (ready) {
        *word = RNG->DR;
    }
    return ready;
}

bool random_word(uint32_t *word) {
    uint32_t first = 0U; /* the first one after the start is not to be used (RM0090, 24.3.1) */
    uint32_t there = 0U;
    RCC->AHB2ENR |= RCC_AHB2ENR_RNG;
    if (!probe_read(RNG_STATUS, &there)) { /* emulators have none */
        return false;
    }
    RNG->CR = RNG_CR_RNGEN;
    return next_word(&first) && next_word(word) && (*word != first);
}
