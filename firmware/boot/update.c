#include "update.h"

#include "crc32.h"
#include "layout.h"
#include "terrapin_interface.h"
#include "update_requests.h"
#include "terrapin_assert.h"

#define OK ((uint8_t)TERRAPIN_UPDATE_RESULT_OK)

/* Nothing of the slot counts any more, then it is erased. */
static uint8_t clear_slot(const terrapin_update *update, uint8_t slot) {
    TERRAPIN_ASSERT(slot != update->running);
    terrapin_record record;
    bool good = true;
    terrapin_records_read(update->boot->flash, &record);
    if ((record.candidate == slot) && (record.phase != (uint8_t)TERRAPIN_UPDATE_PHASE_NONE)) {
        record.phase = TERRAPIN_UPDATE_PHASE_NONE;
        good = terrapin_records_append(update->boot->flash, &record);
    }
    good = good && update->boot->flash->erase(update->boot->flash->context, terrapin_boot_slot(slot));
    return good ? OK : (uint8_t)TERRAPIN_UPDATE_RESULT_FLASH;
}

/* The BEGIN that was accepted last, and nothing was written since: its answer was lost. */
static bool begun(const terrapin_update *update, uint8_t slot, uint32_t size, terrapin_image_version version) {
    return update->active && (update->written == 0U) && (update->slot == slot) && (update->size == size) &&
           (terrapin_image_compare(update->version, version) == 0);
}

/* The end of an image came whole before a BEGIN, is signed, and with a key that counts. */
static uint8_t announced(const terrapin_update *update, const terrapin_record *record) {
    uint8_t result = TERRAPIN_UPDATE_RESULT_AGAIN;
    if (update->filled == TERRAPIN_IMAGE_TLVS) {
        uint8_t key = 0U;
        result = terrapin_image_signed(update->block, update->boot->keys, &key);
        if ((result == OK) && (record->revoked == (key + 1U))) {
            result = TERRAPIN_UPDATE_RESULT_REVOKED_KEY;
        }
    }
    return result;
}

static bool too_soon(const terrapin_update *update) {
    return (update->erases >= TERRAPIN_UPDATE_ERASES) ||
           ((update->erases > 0U) && ((update->now_ms - update->erased_ms) < TERRAPIN_UPDATE_ERASE_MS));
}

/* What is refused leaves an update that is under way alone. */
static uint8_t begin(terrapin_update *update, const terrapin_update_begin_t *message, bool motor_on) {
    terrapin_record record;
    const uint8_t slot = (uint8_t)message->slot;
    const uint32_t size = (uint32_t)message->size * 4U;
    const terrapin_image_version version = {(uint8_t)message->major, (uint8_t)message->minor,
                                            (uint16_t)message->revision, 0U};
    terrapin_records_read(update->boot->flash, &record);
    terrapin_image_version least = record.version;
    least.build = 0U; /* is not announced */
    uint8_t result = OK;
    if (motor_on) {
        result = TERRAPIN_UPDATE_RESULT_MOTOR_ON;
    } else if (begun(update, slot, size, version)) {
        /* answered as before */
    } else if (!update_writable(update, &record, slot)) {
        result = TERRAPIN_UPDATE_RESULT_SLOT_IN_USE;
    } else if ((size > TERRAPIN_LAYOUT_SLOT_SIZE) || (size <= TERRAPIN_LAYOUT_HEADER_SIZE)) {
        result = TERRAPIN_UPDATE_RESULT_TOO_LARGE;
    } else if (terrapin_image_compare(version, least) < 0) {
        result = TERRAPIN_UPDATE_RESULT_VERSION_TOO_OLD;
    } else if (too_soon(update)) {
        result = TERRAPIN_UPDATE_RESULT_BUSY;
    } else {
        result = announced(update, &record);
        if (result == OK) {
            update->erases++;
            update->erased_ms = update->now_ms;
            update->ended = false;
            update->written = 0U;
            update->checksum = 0U;
            update->version = version;
            update->slot = slot;
            update->size = size;
            result = clear_slot(update, slot);
            update->active = result == OK;
        }
    }
    update->filled = 0U;
    return result;
}

static uint32_t accept_begin(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                             terrapin_frame *reply) {
    terrapin_update_begin_t message;
    if (!update_genuine(update, frame, &update->begin_counter) || !terrapin_decode_update_begin(frame, &message)) {
        return 0U;
    }
    return update_status(update, TERRAPIN_UPDATE_REQUEST_BEGIN, begin(update, &message, motor_on), reply);
}

static void accept_data(terrapin_update *update, const terrapin_frame *frame) {
    if (frame->length != 8U) {
        update->malformed++;
        return;
    }
    TERRAPIN_ASSERT((update->filled <= (TERRAPIN_UPDATE_BLOCK + 8U)) && ((update->filled % 8U) == 0U));
    if (update->filled < TERRAPIN_UPDATE_BLOCK) {
        TERRAPIN_ASSERT((update->filled + 8U) <= TERRAPIN_UPDATE_BLOCK);
        for (uint32_t i = 0U; i < 8U; i++) {
            update->block[update->filled + i] = frame->data[i];
        }
        update->filled += 8U;
    } else {
        update->filled = TERRAPIN_UPDATE_BLOCK + 8U; /* too many: the block's end will say so */
    }
}

/* The header must be that of the image that was announced; so an old one is refused before anything is written. */
static uint8_t check_header(const terrapin_update *update) {
    terrapin_image_version version;
    const bool header = terrapin_image_header_version(update->block, &version);
    version.build = 0U; /* is not announced */
    if (!header || (terrapin_image_compare(update->version, version) != 0)) {
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE;
    }
    return OK;
}

static uint8_t take_block(terrapin_update *update, const terrapin_update_block_t *message) {
    TERRAPIN_ASSERT(!update->active || (update->written <= update->size));
    const uint32_t next = update->written / TERRAPIN_UPDATE_BLOCK;
    const uint32_t index = (uint32_t)message->index;
    const uint32_t size = (uint32_t)message->size;
    const uint32_t rest = update->size - update->written;
    const uint32_t expected = (rest < TERRAPIN_UPDATE_BLOCK) ? rest : TERRAPIN_UPDATE_BLOCK;
    const uint32_t filled = update->filled;
    update->filled = 0U;
    if (!update->active) {
        return TERRAPIN_UPDATE_RESULT_SEQUENCE;
    }
    if ((update->written > 0U) && (message->checksum == update->block_checksum) &&
        (index == ((update->written - 1U) / TERRAPIN_UPDATE_BLOCK))) {
        return OK; /* our answer was lost: it is written already */
    }
    if ((index != next) || (size != expected) || (size == 0U)) { /* none is left once all is written */
        return TERRAPIN_UPDATE_RESULT_SEQUENCE;
    }
    /* Data comes in eights: a last block may end in the middle of one. */
    if ((filled != ((size + 7U) & ~7U)) || (terrapin_crc32(0U, update->block, size) != message->checksum)) {
        return TERRAPIN_UPDATE_RESULT_AGAIN;
    }
    if ((index == 0U) && (check_header(update) != OK)) {
        update->active = false;
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE;
    }
    TERRAPIN_ASSERT((size > 0U) && (size <= TERRAPIN_UPDATE_BLOCK));
    TERRAPIN_ASSERT((update->written + size) <= TERRAPIN_LAYOUT_SLOT_SIZE);
    const terrapin_flash *flash = update->boot->flash;
    if (!flash->write(flash->context, terrapin_boot_slot(update->slot).offset + update->written, update->block, size)) {
        update->active = false;
        return TERRAPIN_UPDATE_RESULT_FLASH;
    }
    update->checksum = terrapin_crc32(update->checksum, update->block, size);
    update->block_checksum = message->checksum;
    update->written += size;
    return OK;
}

static uint32_t accept_block(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                             terrapin_frame *reply) {
    terrapin_update_block_t message;
    if (!terrapin_decode_update_block(frame, &message)) {
        update->malformed++;
        return 0U;
    }
    const uint8_t result = motor_on ? (uint8_t)TERRAPIN_UPDATE_RESULT_MOTOR_ON : take_block(update, &message);
    return update_status(update, TERRAPIN_UPDATE_REQUEST_BLOCK, result, reply);
}

/* A wrong checksum ends nothing: whoever knows the right one asks for what the signature decides. */
static uint8_t end(terrapin_update *update, uint32_t checksum) {
    terrapin_record record;
    terrapin_image image = {0};
    if (!update->active || (update->written != update->size)) {
        return TERRAPIN_UPDATE_RESULT_SEQUENCE;
    }
    if (checksum != update->checksum) {
        return TERRAPIN_UPDATE_RESULT_CORRUPTED;
    }
    update->active = false;
    update->ended = true;
    update->end_checksum = checksum;
    terrapin_records_read(update->boot->flash, &record);
    uint8_t result = terrapin_boot_check(update->boot, update->slot, &record, true, &image);
    if ((result == OK) && (((image.size + 3U) & ~3U) != update->size)) {
        result = TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE; /* something follows the image */
    }
    if (result == OK) {
        record.candidate = update->slot;
        record.phase = TERRAPIN_UPDATE_PHASE_PENDING;
        record.tries = 0U; /* counted from its first start on */
        result = terrapin_records_append(update->boot->flash, &record) ? OK : (uint8_t)TERRAPIN_UPDATE_RESULT_FLASH;
    }
    update->end_result = result;
    return result;
}

static uint32_t accept_end(terrapin_update *update, const terrapin_frame *frame, bool motor_on, terrapin_frame *reply) {
    terrapin_update_end_t message;
    if (!update_genuine(update, frame, &update->end_counter) || !terrapin_decode_update_end(frame, &message)) {
        return 0U;
    }
    uint8_t result = TERRAPIN_UPDATE_RESULT_MOTOR_ON;
    if (motor_on) {
        /* refused */
    } else if (update->ended && (update->end_checksum == message.checksum)) {
        result = update->end_result; /* our answer was lost */
    } else {
        result = end(update, message.checksum);
    }
    return update_status(update, TERRAPIN_UPDATE_REQUEST_END, result, reply);
}

/* Whose images are taken is asked here, and changed by an image alone. */
static uint32_t accept_robot(terrapin_update *update, const terrapin_frame *frame, terrapin_frame *reply) {
    terrapin_record record;
    if (!update_genuine(update, frame, &update->robot_counter)) {
        return 0U;
    }
    terrapin_records_read(update->boot->flash, &record);
    const terrapin_update_identity_t answer = {
        .robot = (int32_t)record.robot,
        .board = (int32_t)update->boot->board,
        .interface = TERRAPIN_INTERFACE_VERSION,
        .result = (int32_t)OK,
    };
    (void)terrapin_encode_update_identity(&answer, reply); /* the fields have the signals' widths */
    return 1U;
}

/* In the boot loader only a verified image is a reason to reset; an application says itself who may ask it. */
static uint32_t accept_reset(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                             terrapin_frame *reply) {
    const bool verified = update->ended && (update->end_result == OK);
    return (verified || (update->running != (uint8_t)TERRAPIN_UPDATE_SLOT_NONE))
               ? update_reset(update, frame, motor_on, reply)
               : update_status(update, TERRAPIN_UPDATE_REQUEST_RESET, TERRAPIN_UPDATE_RESULT_SEQUENCE, reply);
}

uint32_t terrapin_update_accept(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                                terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]) {
    TERRAPIN_ASSERT((update != NULL) && (frame != NULL) && (replies != NULL));
    uint32_t count = 0U;
    switch (frame->id) {
    case TERRAPIN_ID_UPDATE_BEGIN:
        count = accept_begin(update, frame, motor_on, &replies[0]);
        break;
    case TERRAPIN_ID_UPDATE_DATA:
        accept_data(update, frame);
        break;
    case TERRAPIN_ID_UPDATE_BLOCK:
        count = accept_block(update, frame, motor_on, &replies[0]);
        break;
    case TERRAPIN_ID_UPDATE_END:
        count = accept_end(update, frame, motor_on, &replies[0]);
        break;
    case TERRAPIN_ID_UPDATE_QUERY:
        count = update_query(update, frame, replies);
        break;
    case TERRAPIN_ID_UPDATE_ROBOT:
        count = accept_robot(update, frame, &replies[0]);
        break;
    case TERRAPIN_ID_UPDATE_RESET:
        count = accept_reset(update, frame, motor_on, &replies[0]);
        break;
    default:
        /* another's */
        break;
    }
    TERRAPIN_ASSERT(count <= TERRAPIN_UPDATE_REPLIES);
    return count;
}
