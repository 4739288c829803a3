/* Fuzz target: what stands in flash when the power comes: parameters, the boot loader's records, an image's header and
 * TLVs. 20 bytes a record: where (page and place), repairs, then 16 bytes that are put there. A repair gives a set of
 * parameters or a boot record its magic and the right CRC, so that the search comes behind these. Checked beyond the
 * sanitizers: what is read is within its ranges, reading writes nothing, and what is written afterwards is read back.
 */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "crc32.h"
#include "flash_emulated.h"
#include "image.h"
#include "layout.h"
#include "parameters.h"
#include "records.h"
#include "terrapin_interface.h"

#define RECORD  20U
#define PAGE    2048U /* two sets of parameters */
#define SECTORS 7U
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
    for (uint32_t i = 0; terrapin_store_work(&store, true); i++) {
        CHECK(i < 1000U);
    }
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

static void check_boot(const uint8_t *bytes, size_t size) {
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
        } else {
            /* as it is */
        }
    }
    terrapin_flash_emulated_init(&memory, boot_cells, terrapin_flash_f405_sectors, SECTORS, 4U);
    const terrapin_flash flash = terrapin_flash_emulated_driver(&memory);
    const uint8_t result = terrapin_image_read(&flash, slot, TERRAPIN_LAYOUT_BASE + slot.offset, &image);
    CHECK((result != TERRAPIN_UPDATE_RESULT_OK) || (image.size <= slot.size));
    terrapin_records_read(&flash, &record);
    CHECK((record.confirmed <= TERRAPIN_UPDATE_SLOT_B) && (record.candidate <= TERRAPIN_UPDATE_SLOT_B) &&
          (record.phase <= TERRAPIN_UPDATE_PHASE_TRIAL));
    CHECK((memory.misuse == 0U) && (memory.operations == 0U));
    (void)terrapin_records_make_room(&flash);
    record.security_counter++;
    (void)terrapin_records_append(&flash, &record); /* may be refused: pages as no power cut leaves them */
    (void)terrapin_records_set_node(&flash, (uint8_t)(record.tries % TERRAPIN_NODES));
    (void)terrapin_records_set_robot(&flash, record.security_counter & 0x00FFFFFFU);
    terrapin_records_read(&flash, &back);
    CHECK((back.confirmed <= TERRAPIN_UPDATE_SLOT_B) && (back.candidate <= TERRAPIN_UPDATE_SLOT_B) &&
          (back.phase <= TERRAPIN_UPDATE_PHASE_TRIAL));
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    if (size > 0U) {
        if ((bytes[0] & 1U) != 0U) {
            check_store(&bytes[1], size - 1U, bytes[0] / 2U);
        } else {
            check_boot(&bytes[1], size - 1U);
        }
    }
    return 0;
}
