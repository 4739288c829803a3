/* Fuzz target: any frames of an update, in any order. Each ten bytes of the input are one: identifier and repairs,
 * length, data. A repair gives a frame the right E2E counter and CRC, or a block the checksum of what was sent, so that
 * the search comes behind these. Checked beyond the sanitizers: the flash is used as it may be, nothing but the free
 * slot and the records is ever touched, replies are well-formed, and no image that nobody signed becomes pending or is
 * started. */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "crc32.h"
#include "flash_emulated.h"
#include "layout.h"
#include "terrapin_interface.h"
#include "update.h"

#define SECTORS     7U
#define FLASH_SIZE  (TERRAPIN_LAYOUT_SLOT_B + TERRAPIN_LAYOUT_SLOT_SIZE)
#define FRAME_SIZE  10U
#define REPAIR      0x80U
#define MOTOR_ON    0x40U
#define APPLICATION 0x20U /* the frame comes while an image runs */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static uint8_t memory_bytes[FLASH_SIZE];
static terrapin_flash_emulated memory;
static terrapin_flash emulated;

static bool may_touch(uint32_t offset) {
    return (offset >= TERRAPIN_LAYOUT_SLOT_B) ||
           ((offset >= TERRAPIN_LAYOUT_RECORDS_0) && (offset < TERRAPIN_LAYOUT_SLOT_A));
}

static bool erase(void *context, terrapin_flash_area area) {
    CHECK(may_touch(area.offset));
    return emulated.erase(context, area);
}

static bool write(void *context, uint32_t offset, const uint8_t *data, uint32_t size) {
    CHECK(may_touch(offset));
    return emulated.write(context, offset, data, size);
}

static void repair(terrapin_frame *frame, const terrapin_update *update, uint32_t counter) {
    if (frame->id == TERRAPIN_ID_UPDATE_BLOCK) {
        const uint32_t count = (uint32_t)frame->data[2] | ((uint32_t)frame->data[3] << 8U);
        const uint32_t crc =
            terrapin_crc32(0U, update->block, (count < TERRAPIN_UPDATE_BLOCK) ? count : TERRAPIN_UPDATE_BLOCK);
        for (uint32_t i = 0; i < 4U; i++) {
            frame->data[4U + i] = (uint8_t)(crc >> (8U * i));
        }
    } else if (frame->id == TERRAPIN_ID_UPDATE_END) {
        for (uint32_t i = 0; i < 4U; i++) {
            frame->data[i] = (uint8_t)(update->checksum >> (8U * i));
        }
        terrapin_e2e_protect(frame, counter);
    } else {
        terrapin_e2e_protect(frame, counter);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static const uint8_t keys[64] = {0x0BU, 0xB9U, 0x92U};
    static const terrapin_record confirmed = {.confirmed = TERRAPIN_UPDATE_SLOT_A, .security_counter = 1U};
    static terrapin_update update;
    (void)memset(memory_bytes, 0xFF, sizeof memory_bytes);
    terrapin_flash_emulated_init(&memory, memory_bytes, terrapin_flash_f405_sectors, SECTORS, 4U);
    emulated = terrapin_flash_emulated_driver(&memory);
    terrapin_flash flash = emulated;
    flash.erase = erase;
    flash.write = write;
    const terrapin_boot boot = {.flash = &flash, .keys = keys};
    CHECK(terrapin_records_append(&flash, &confirmed));
    terrapin_update_init(&update, &boot, TERRAPIN_UPDATE_SLOT_NONE);

    uint32_t counter = 0;
    for (size_t at = 0; (at + FRAME_SIZE) <= size; at += FRAME_SIZE) {
        terrapin_frame replies[TERRAPIN_UPDATE_REPLIES];
        terrapin_frame frame = {.id = (uint16_t)(TERRAPIN_UPDATE_ID_FIRST + (bytes[at] & 7U)),
                                .length = (uint8_t)(bytes[at + 1U] % 9U)};
        (void)memcpy(frame.data, &bytes[at + 2U], sizeof frame.data);
        if ((bytes[at] & REPAIR) != 0U) {
            repair(&frame, &update, counter);
            counter++;
        }
        const bool motor_on = (bytes[at] & MOTOR_ON) != 0U;
        const uint32_t count = ((bytes[at] & APPLICATION) != 0U)
                                   ? terrapin_update_application(&update, &frame, motor_on, replies)
                                   : terrapin_update_accept(&update, &frame, motor_on, replies);
        CHECK(count <= TERRAPIN_UPDATE_REPLIES);
        for (uint32_t i = 0; i < count; i++) {
            CHECK((replies[i].length >= 6U) && (replies[i].length <= 8U));
            CHECK((replies[i].id >= TERRAPIN_ID_UPDATE_STATUS) && (replies[i].id <= TERRAPIN_ID_UPDATE_IDENTITY));
        }
        CHECK(update.written <= update.size);
        CHECK(memory.misuse == 0U);
    }
    terrapin_record record;
    terrapin_records_read(&flash, &record);
    CHECK((record.confirmed == (uint8_t)TERRAPIN_UPDATE_SLOT_A) &&
          (record.phase == (uint8_t)TERRAPIN_UPDATE_PHASE_NONE));
    terrapin_boot_choice choice;
    terrapin_boot_choose(&boot, &choice);
    CHECK(choice.slot == (uint8_t)TERRAPIN_UPDATE_SLOT_NONE);
    return 0;
}
