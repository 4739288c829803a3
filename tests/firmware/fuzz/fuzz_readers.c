/* Fuzz target: what stands in flash when the power comes: parameters, the boot loader's records, an image. The first
 * byte says which; for parameters also in which operation of the save the power fails, for an image what of its end is
 * made right, and whether the boot loader chooses by it. 20 bytes a record: where (page and place), repairs, then 16
 * bytes that are put there. A repair gives a set of parameters or a boot record its magic and the right CRC, and fills
 * a page with records, so that the search comes behind these. Checked beyond the sanitizers: what is read is within its
 * ranges, reading writes nothing, what is written afterwards is read back, and no image is good, or chosen, whose
 * digest, key and signature nobody made right.
 */
#include <stdlib.h>
#include <string.h>

#include "boot.h"
#include "check.h"
#include "crc32.h"
#include "flash_emulated.h"
#include "image.h"
#include "layout.h"
#include "parameters.h"
#include "records.h"
#include "sha2.h"
#include "terrapin_interface.h"

#define RECORD  20U
#define PAGE    2048U /* two sets of parameters */
#define SECTORS 7U
#define TAIL    144U /* TLVs behind the protected ones: digest, name of the key, signature, with their heads */
#define SIZE    (TERRAPIN_LAYOUT_SLOT_B + TERRAPIN_LAYOUT_SLOT_SIZE)

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static uint8_t cells[2U * PAGE];
static uint8_t boot_cells[SIZE];
static terrapin_flash_emulated memory;

static void put32(uint8_t *bytes, uint32_t value) {
    for (uint32_t i = 0; i < 4U; i++) {
        bytes[i] = (uint8_t)(value >> (8U * i));
    }
}

/* A whole set of parameters, its entries known ones, as the store writes it; values from the input. */
static void put_set(uint8_t *place, const uint8_t *bytes) {
    const uint32_t entries = 1U + (bytes[0] % TERRAPIN_PARAMETER_COUNT);
    put32(place, 0x4D525054U); /* as store/parameters.c has it */
    put32(&place[4], TERRAPIN_STORE_LAYOUT | (entries << 16U));
    put32(&place[8], bytes[1]);
    put32(&place[12], ((bytes[5] & 3U) == 3U) ? 0U : (uint32_t)TERRAPIN_ROBOT_IDENTITY); /* else another robot's */
    for (uint32_t i = 0; i < entries; i++) {
        const uint16_t index = (uint16_t)((i + bytes[2]) % TERRAPIN_PARAMETER_COUNT);
        const terrapin_parameter_entry entry = terrapin_parameter(index);
        put32(&place[16U + (8U * i)], terrapin_parameter_hashes[index] ^ (((bytes[3] & 0xFU) == 1U) ? 1U : 0U));
        put32(&place[20U + (8U * i)], (uint32_t)entry.maximum + ((bytes[4] == (uint8_t)i) ? 1U : 0U));
    }
    const uint32_t end = 16U + ((((8U * entries) + 4U) + 15U) & ~15U) - 4U; /* its last four bytes */
    put32(&place[end], terrapin_crc32(0U, place, end));
}

/* The power fails in the operation `cut` of the save, counted from 1. */
static void check_store(const uint8_t *bytes, size_t size, uint32_t cut) {
    static const uint32_t sectors[2] = {PAGE, PAGE};
    static const terrapin_flash_area pages[2] = {{0U, PAGE}, {PAGE, PAGE}};
    static terrapin_state *state;
    terrapin_store store;
    terrapin_store again;
    if (state == NULL) {
        state = malloc(terrapin_state_size());
        CHECK(state != NULL);
    }
    (void)memset(cells, 0xFF, sizeof cells);
    for (size_t at = 0; (at + RECORD) <= size; at += RECORD) {
        const uint32_t place = (bytes[at] | ((uint32_t)bytes[at + 1U] << 8U)) % (2U * PAGE / 16U) * 16U;
        if (((bytes[at + 3U] & 1U) != 0U) && ((place % PAGE) <= (PAGE - 1024U))) {
            put_set(&cells[place], &bytes[at + 4U]);
        } else {
            (void)memcpy(&cells[place], &bytes[at + 4U], 16U);
        }
    }
    terrapin_flash_emulated_init(&memory, cells, sectors, 2U, 4U);
    memory.cut_at = (cut > 0U) ? (cut - 1U) : TERRAPIN_FLASH_EMULATED_NEVER;
    const terrapin_flash flash = terrapin_flash_emulated_driver(&memory);
    terrapin_init(state);
    CHECK(terrapin_store_open(&store, &flash, pages));
    CHECK(memory.operations == 0U);
    const terrapin_store before = store;
    const bool stored = store.origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED;
    CHECK(terrapin_parameter_set_all(state, stored ? store.value : NULL) == TERRAPIN_PARAMETER_OK);
    for (uint16_t i = 0; i < TERRAPIN_PARAMETER_COUNT; i++) {
        const terrapin_parameter_entry entry = terrapin_parameter(i);
        int32_t value = 0;
        CHECK(terrapin_parameter_get(state, i, &value) == TERRAPIN_PARAMETER_OK);
        CHECK((value >= entry.minimum) && (value <= entry.maximum));
    }
    CHECK(terrapin_store_save(&store, state));
    CHECK(!terrapin_store_save(&store, state)); /* one at a time */
    (void)terrapin_store_work(&store, false);
    for (uint32_t i = 0; terrapin_store_work(&store, true); i++) {
        CHECK(i < 1000U);
    }
    CHECK(!terrapin_store_work(&store, true));
    const bool off = memory.off;
    CHECK((off || !store.failed) && (memory.misuse == 0U));
    terrapin_flash_emulated_power_on(&memory);
    CHECK(terrapin_store_open(&again, &flash, pages));
    if (!off) {
        CHECK((again.sequence == store.sequence) && !terrapin_store_differs(&again, state));
    } else if (before.sequence != 0U) { /* what was there, or what was being saved */
        CHECK((again.sequence == before.sequence) || (again.sequence == (before.sequence + 1U)));
    } else {
        /* nothing was there that could be lost */
    }
}

/* Pages that hold no set are refused, and nothing is saved there. */
static void check_small_pages(void) {
    static const uint32_t sectors[2] = {PAGE, PAGE};
    static const terrapin_flash_area pages[2] = {{0U, 16U}, {PAGE, 16U}};
    static terrapin_state *state;
    terrapin_store store;
    if (state == NULL) {
        state = malloc(terrapin_state_size());
        CHECK(state != NULL);
        terrapin_init(state);
    }
    terrapin_flash_emulated_init(&memory, cells, sectors, 2U, 4U);
    const terrapin_flash flash = terrapin_flash_emulated_driver(&memory);
    CHECK(!terrapin_store_open(&store, &flash, pages));
    CHECK(!terrapin_store_save(&store, state) && (memory.operations == 0U));
}

/* The key whose secret is 1 is the base point itself. With the neutral point for R, S is the challenge. */
static const uint8_t keys[2U * TERRAPIN_IMAGE_KEY_SIZE] = {
    0x58U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U,
    0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U, 0x66U,
};

/* 64 bytes, the least first, modulo the order of the group (RFC 8032), into 32. */
static void reduce(const uint8_t *wide, uint8_t *narrow) {
    static const uint32_t order[8] = {0x5CF5D3EDU, 0x5812631AU, 0xA2F79CD6U, 0x14DEF9DEU, 0U, 0U, 0U, 0x10000000U};
    uint32_t rest[8] = {0};
    for (uint32_t bit = 512U; bit > 0U; bit--) {
        uint32_t carry = ((uint32_t)wide[(bit - 1U) / 8U] >> ((bit - 1U) % 8U)) & 1U;
        for (uint32_t i = 0; i < 8U; i++) { /* below twice the order: 2^254 */
            const uint32_t top = rest[i] >> 31U;
            rest[i] = (rest[i] << 1U) | carry;
            carry = top;
        }
        uint32_t less[8];
        uint64_t borrow = 0;
        for (uint32_t i = 0; i < 8U; i++) {
            const uint64_t difference = (uint64_t)rest[i] - order[i] - borrow;
            less[i] = (uint32_t)difference;
            borrow = (difference >> 32U) & 1U;
        }
        if (borrow == 0U) {
            (void)memcpy(rest, less, sizeof rest);
        }
    }
    for (uint32_t i = 0; i < 8U; i++) {
        put32(&narrow[4U * i], rest[i]);
    }
}

/* The end of an image of `size` bytes, as it is signed; of its parts those that `repairs` names. */
static void sign(uint8_t *image, uint32_t size, uint32_t repairs) {
    uint8_t *tail = &image[size];
    uint8_t *signature = &tail[80];
    uint8_t digest[TERRAPIN_SHA256_SIZE];
    uint8_t challenge[TERRAPIN_SHA512_SIZE];
    terrapin_sha2 sha;
    terrapin_sha2_begin(&sha, TERRAPIN_SHA256);
    terrapin_sha2_take(&sha, image, size);
    terrapin_sha2_end(&sha, digest);
    if ((repairs & 1U) != 0U) {
        put32(tail, 0x6907U | (TAIL << 16U)); /* as image.c has them */
        put32(&tail[4], 0x10U | (32U << 16U));
        put32(&tail[40], 0x01U | (32U << 16U));
        put32(&tail[76], 0x24U | (64U << 16U));
    }
    if ((repairs & 2U) != 0U) {
        (void)memcpy(&tail[8], digest, sizeof digest);
    }
    if ((repairs & 4U) != 0U) {
        terrapin_image_key_hash(keys, &tail[44]);
    }
    if ((repairs & 8U) != 0U) {
        (void)memset(signature, 0, 64U);
        signature[0] = 1U;
        terrapin_sha2_begin(&sha, TERRAPIN_SHA512);
        terrapin_sha2_take(&sha, signature, 32U);
        terrapin_sha2_take(&sha, keys, TERRAPIN_IMAGE_KEY_SIZE);
        terrapin_sha2_take(&sha, digest, sizeof digest);
        terrapin_sha2_end(&sha, challenge);
        reduce(challenge, &signature[32]);
    }
}

/* Whatever stands there, the boot loader starts nothing but an image that is signed, and what it decides stands. */
static void check_choice(const terrapin_flash *flash, bool is_signed, bool release, bool has_board) {
    const terrapin_boot boot = {.flash = flash,
                                .keys = keys,
                                .key_ids = {0x01010101U, 0x02020202U},
                                .release = release,
                                .board = has_board ? 1U : 0U,
                                .unit = 1U};
    terrapin_boot_choice choice;
    terrapin_boot_choose(&boot, &choice);
    CHECK((choice.slot == TERRAPIN_UPDATE_SLOT_NONE) || ((choice.slot == TERRAPIN_UPDATE_SLOT_A) && is_signed));
    terrapin_record before;
    terrapin_records_read(flash, &before);
    if (terrapin_boot_confirm(&boot, choice.slot)) {
        terrapin_record record;
        terrapin_records_read(flash, &record);
        CHECK((choice.slot != TERRAPIN_UPDATE_SLOT_NONE) && (record.confirmed == choice.slot));
        CHECK((before.confirmed == choice.slot) || !terrapin_boot_on_trial(&boot, choice.slot));
    }
}

static void check_boot(const uint8_t *bytes, size_t size, uint32_t repairs) {
    const terrapin_flash_area slot = {TERRAPIN_LAYOUT_SLOT_A, TERRAPIN_LAYOUT_SLOT_SIZE};
    terrapin_record record;
    terrapin_record back;
    terrapin_image image;
    (void)memset(boot_cells, 0xFF, sizeof boot_cells);
    for (size_t at = 0; (at + RECORD) <= size; at += RECORD) {
        const uint32_t where = bytes[at] | ((uint32_t)bytes[at + 1U] << 8U);
        uint8_t *place = &boot_cells[TERRAPIN_LAYOUT_SLOT_A + ((where * 4U) % 2048U)];
        if ((bytes[at + 2U] & 1U) == 0U) {
            const uint32_t page = ((bytes[at + 2U] & 2U) != 0U) ? TERRAPIN_LAYOUT_RECORDS_1 : TERRAPIN_LAYOUT_RECORDS_0;
            place = &boot_cells[page + ((where % 512U) * 32U)];
        }
        (void)memcpy(place, &bytes[at + 4U], 16U);
        if ((bytes[at + 3U] & 3U) == 1U) { /* a whole record */
            put32(place, 0x00015442U);     /* as records.c has it */
            place[7] = 0U;                 /* no flash lives to see its 2^32nd record */
            (void)memset(&place[16], 0, 12U);
            if ((bytes[at + 2U] & 4U) != 0U) { /* its second half too: version, node, robot, revoked key */
                (void)memcpy(&place[16], &bytes[at + 8U], 12U);
            }
            put32(&place[28], terrapin_crc32(0U, place, 28U));
        } else if ((bytes[at + 3U] & 3U) == 2U) { /* a header, and protected TLVs with a counter behind it */
            uint8_t *header = &boot_cells[TERRAPIN_LAYOUT_SLOT_A];
            (void)memset(header, 0, 32U);
            put32(header, 0x96F3B83DU);
            put32(&header[4], TERRAPIN_LAYOUT_BASE + TERRAPIN_LAYOUT_SLOT_A);
            put32(&header[8], TERRAPIN_LAYOUT_HEADER_SIZE | ((uint32_t)bytes[at + 4U] << 16U));
            put32(&header[12], (bytes[at + 5U] & 0x7FU) + 1U);
            put32(&header[16], 0x00000100U);
            uint8_t *tlvs = &header[TERRAPIN_LAYOUT_HEADER_SIZE + (bytes[at + 5U] & 0x7FU) + 1U];
            put32(tlvs, 0x6908U | ((uint32_t)bytes[at + 4U] << 16U));
            (void)memcpy(&tlvs[4], &bytes[at + 6U], 14U);
        } else if ((bytes[at + 3U] & 3U) == 3U) { /* a page that is full up to there, or beyond what is kept free */
            const uint32_t page = ((bytes[at + 2U] & 2U) != 0U) ? TERRAPIN_LAYOUT_RECORDS_1 : TERRAPIN_LAYOUT_RECORDS_0;
            for (uint32_t i = 0; i <= (where % 512U); i++) {
                (void)memset(&boot_cells[page + (i * 32U)], 0, 32U); /* no record, but written */
            }
        } else {
            /* as it is */
        }
    }
    terrapin_flash_emulated_init(&memory, boot_cells, terrapin_flash_f405_sectors, SECTORS, 4U);
    const terrapin_flash flash = terrapin_flash_emulated_driver(&memory);
    const uint8_t result = terrapin_image_read(&flash, slot, TERRAPIN_LAYOUT_BASE + slot.offset, &image);
    CHECK((result != TERRAPIN_UPDATE_RESULT_OK) || (image.size <= slot.size));
    if (result == TERRAPIN_UPDATE_RESULT_OK) {
        sign(&boot_cells[slot.offset], image.hashed_size, repairs);
    }
    const bool is_signed = (repairs & 15U) == 15U;
    const uint8_t good = terrapin_image_verify(&flash, slot, TERRAPIN_LAYOUT_BASE + slot.offset, keys, &image);
    CHECK((good != TERRAPIN_UPDATE_RESULT_OK) || ((result == TERRAPIN_UPDATE_RESULT_OK) && is_signed));
    terrapin_records_read(&flash, &record);
    CHECK((record.confirmed <= TERRAPIN_UPDATE_SLOT_B) && (record.candidate <= TERRAPIN_UPDATE_SLOT_B) &&
          (record.phase <= TERRAPIN_UPDATE_PHASE_TRIAL));
    CHECK((memory.misuse == 0U) && (memory.operations == 0U));
    if ((repairs & 16U) != 0U) {
        check_choice(&flash, is_signed, (repairs & 32U) != 0U, (repairs & 64U) != 0U);
        return;
    }
    (void)terrapin_records_make_room(&flash);
    record.security_counter++;
    (void)terrapin_records_append(&flash, &record); /* may be refused: pages as no power cut leaves them */
    (void)terrapin_records_set_node(&flash, (uint8_t)(record.tries % TERRAPIN_NODES));
    terrapin_records_read(&flash, &back);
    CHECK((back.confirmed <= TERRAPIN_UPDATE_SLOT_B) && (back.candidate <= TERRAPIN_UPDATE_SLOT_B) &&
          (back.phase <= TERRAPIN_UPDATE_PHASE_TRIAL));
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    if (size > 0U) {
        if ((bytes[0] & 1U) != 0U) {
            check_store(&bytes[1], size - 1U, bytes[0] / 2U);
        } else {
            check_boot(&bytes[1], size - 1U, bytes[0] / 2U);
        }
    } else {
        check_small_pages();
    }
    return 0;
}
