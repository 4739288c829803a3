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

/* A key, and the end of an image that it signed: what BEGIN wants to have seen. The image itself is not here. */
static const uint8_t keys[64] = {0xFFU, 0xD0U, 0xA8U, 0xF6U, 0x5CU, 0x46U, 0x00U, 0x91U, 0x25U, 0x82U, 0x8DU,
                                 0x2FU, 0x04U, 0xF9U, 0xD2U, 0x6DU, 0x08U, 0xBFU, 0x48U, 0xD8U, 0x48U, 0x7CU,
                                 0xC1U, 0xF8U, 0xA7U, 0xA1U, 0xCFU, 0xC1U, 0xE1U, 0xF5U, 0xA9U, 0x34U};
static const uint8_t announced[TERRAPIN_IMAGE_TLVS] = {
    0x07U, 0x69U, 0x90U, 0x00U, 0x10U, 0x00U, 0x20U, 0x00U, 0xFDU, 0xB1U, 0xA5U, 0x37U, 0xD0U, 0xB4U, 0xE1U, 0x8EU,
    0xBCU, 0x22U, 0x2FU, 0x57U, 0xCDU, 0xC4U, 0x21U, 0x65U, 0x5AU, 0xC4U, 0x3BU, 0x71U, 0x96U, 0x55U, 0x06U, 0x95U,
    0xEEU, 0xE9U, 0xF8U, 0x36U, 0x77U, 0xEAU, 0x4FU, 0xD8U, 0x01U, 0x00U, 0x20U, 0x00U, 0xE1U, 0x59U, 0x8EU, 0x77U,
    0x54U, 0x86U, 0x54U, 0x89U, 0xCAU, 0x2AU, 0x31U, 0x05U, 0xFBU, 0x4DU, 0x48U, 0x22U, 0x09U, 0x0AU, 0x46U, 0x8FU,
    0xA0U, 0x49U, 0xA8U, 0xCFU, 0x29U, 0x61U, 0x1EU, 0x19U, 0x3EU, 0xEAU, 0xF3U, 0x21U, 0x24U, 0x00U, 0x40U, 0x00U,
    0x57U, 0x61U, 0x67U, 0x3CU, 0x0BU, 0x46U, 0x17U, 0x28U, 0xD7U, 0x6BU, 0x35U, 0x4DU, 0x31U, 0x3AU, 0x13U, 0xCCU,
    0xDEU, 0x20U, 0xBAU, 0x86U, 0x18U, 0xF3U, 0x66U, 0xCBU, 0x88U, 0x90U, 0xE6U, 0x72U, 0x47U, 0x71U, 0x2FU, 0xF1U,
    0x17U, 0x77U, 0x67U, 0x17U, 0x85U, 0xCBU, 0x95U, 0x75U, 0x0EU, 0x75U, 0x46U, 0x3BU, 0x16U, 0x81U, 0x5CU, 0xDDU,
    0x68U, 0x17U, 0x0AU, 0x9BU, 0x48U, 0x74U, 0xD1U, 0xCAU, 0xE8U, 0x3EU, 0xB0U, 0x60U, 0x08U, 0x52U, 0x40U, 0x0FU};

static void repair(terrapin_frame *frame, terrapin_update *update, uint32_t counter) {
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
    } else if ((frame->id == TERRAPIN_ID_UPDATE_BEGIN) && ((frame->data[0] & 3U) == 0U)) { /* a signature takes long */
        (void)memcpy(update->block, announced, sizeof announced);
        update->filled = TERRAPIN_IMAGE_TLVS;
        terrapin_e2e_protect(frame, counter);
    } else {
        terrapin_e2e_protect(frame, counter);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
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
