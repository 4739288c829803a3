#include "update.h"

#include "crc32.h"
#include "layout.h"
#include "terrapin_interface.h"

#define NONE ((uint8_t)TERRAPIN_UPDATE_SLOT_NONE)
#define A    ((uint8_t)TERRAPIN_UPDATE_SLOT_A)
#define B    ((uint8_t)TERRAPIN_UPDATE_SLOT_B)
#define OK   ((uint8_t)TERRAPIN_UPDATE_RESULT_OK)

void terrapin_update_init(terrapin_update *update, const terrapin_boot *boot, uint8_t running) {
    static const terrapin_update fresh = {
        .begin_counter = TERRAPIN_E2E_NO_COUNTER,
        .end_counter = TERRAPIN_E2E_NO_COUNTER,
        .reset_counter = TERRAPIN_E2E_NO_COUNTER,
    };
    *update = fresh;
    update->boot = boot;
    update->running = running;
}

/* The slot that an update may write: not the confirmed one, not the one that runs. */
static bool writable(const terrapin_update *update, const terrapin_record *record, uint8_t slot) {
    return ((slot == A) || (slot == B)) && (slot != record->confirmed) && (slot != update->running);
}

static uint32_t status(terrapin_update *update, uint8_t request, uint8_t result, terrapin_frame *reply) {
    const terrapin_update_status_t answer = {
        .request = (int32_t)request,
        .result = (int32_t)result,
        .next = (int32_t)(update->written / TERRAPIN_UPDATE_BLOCK),
    };
    (void)terrapin_encode_update_status(&answer, reply); /* cannot saturate: 512 blocks at most */
    terrapin_e2e_protect(reply, update->reply_counter);
    update->reply_counter =
        (update->reply_counter < TERRAPIN_E2E_COUNTER_MAX) ? (uint8_t)(update->reply_counter + 1U) : 0U;
    return 1U;
}

static bool genuine(terrapin_update *update, const terrapin_frame *frame, uint8_t *last_counter) {
    const terrapin_e2e_result result = terrapin_e2e_check(frame, last_counter);
    if (result == TERRAPIN_E2E_BAD_CRC) {
        update->bad_crc++;
    } else if (result == TERRAPIN_E2E_REPEATED) {
        update->repeated++;
    } else {
        /* good */
    }
    return result == TERRAPIN_E2E_OK;
}

/* Nothing of the slot counts any more, then it is erased. */
static uint8_t clear_slot(const terrapin_update *update, uint8_t slot) {
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

static uint8_t begin(terrapin_update *update, const terrapin_update_begin_t *message, bool motor_on) {
    terrapin_record record;
    const uint8_t slot = (uint8_t)message->slot;
    const uint32_t size = (uint32_t)message->size * 4U;
    update->version.major = (uint8_t)message->major;
    update->version.minor = (uint8_t)message->minor;
    update->version.revision = (uint16_t)message->revision;
    terrapin_records_read(update->boot->flash, &record);
    terrapin_image_version least = record.version;
    least.build = 0U; /* is not announced */
    update->active = false;
    uint8_t result = OK;
    if (motor_on) {
        result = TERRAPIN_UPDATE_RESULT_MOTOR_ON;
    } else if (!writable(update, &record, slot)) {
        result = TERRAPIN_UPDATE_RESULT_SLOT_IN_USE;
    } else if ((size > TERRAPIN_LAYOUT_SLOT_SIZE) || (size <= TERRAPIN_LAYOUT_HEADER_SIZE)) {
        result = TERRAPIN_UPDATE_RESULT_TOO_LARGE;
    } else if (terrapin_image_compare(update->version, least) < 0) {
        result = TERRAPIN_UPDATE_RESULT_VERSION_TOO_OLD;
    } else {
        result = clear_slot(update, slot);
    }
    if (result == OK) {
        update->active = true;
        update->slot = slot;
        update->size = size;
    }
    update->written = 0U;
    update->checksum = 0U;
    update->filled = 0U;
    return result;
}

static uint32_t accept_begin(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                             terrapin_frame *reply) {
    terrapin_update_begin_t message;
    if (!genuine(update, frame, &update->begin_counter) || !terrapin_decode_update_begin(frame, &message)) {
        return 0U;
    }
    return status(update, TERRAPIN_UPDATE_REQUEST_BEGIN, begin(update, &message, motor_on), reply);
}

static void accept_data(terrapin_update *update, const terrapin_frame *frame) {
    if (frame->length != 8U) {
        update->malformed++;
        return;
    }
    if (update->filled < TERRAPIN_UPDATE_BLOCK) {
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
    if ((!terrapin_image_header_version(update->block, &version)) || (version.major != update->version.major) ||
        (version.minor != update->version.minor) || (version.revision != update->version.revision)) {
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE;
    }
    return OK;
}

static uint8_t take_block(terrapin_update *update, const terrapin_update_block_t *message) {
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
    if ((index != next) || (size != expected)) {
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
    return status(update, TERRAPIN_UPDATE_REQUEST_BLOCK, result, reply);
}

static uint8_t end(terrapin_update *update, uint32_t checksum) {
    terrapin_record record;
    terrapin_image image = {0};
    if (!update->active || (update->written != update->size)) {
        return TERRAPIN_UPDATE_RESULT_SEQUENCE;
    }
    update->active = false;
    terrapin_records_read(update->boot->flash, &record);
    uint8_t result = (checksum == update->checksum) ? OK : (uint8_t)TERRAPIN_UPDATE_RESULT_CORRUPTED;
    if (result == OK) {
        result = terrapin_boot_check(update->boot, update->slot, &record, true, &image);
    }
    if ((result == OK) && (((image.size + 3U) & ~3U) != update->size)) {
        result = TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE; /* something follows the image */
    }
    if (result == OK) {
        record.candidate = update->slot;
        record.phase = TERRAPIN_UPDATE_PHASE_PENDING;
        result = terrapin_records_append(update->boot->flash, &record) ? OK : (uint8_t)TERRAPIN_UPDATE_RESULT_FLASH;
    } else {
        (void)clear_slot(update, update->slot); /* what was refused does not stay; the reason is the answer */
    }
    return result;
}

static uint32_t accept_end(terrapin_update *update, const terrapin_frame *frame, bool motor_on, terrapin_frame *reply) {
    terrapin_update_end_t message;
    if (!genuine(update, frame, &update->end_counter) || !terrapin_decode_update_end(frame, &message)) {
        return 0U;
    }
    const uint8_t result = motor_on ? (uint8_t)TERRAPIN_UPDATE_RESULT_MOTOR_ON : end(update, message.checksum);
    return status(update, TERRAPIN_UPDATE_REQUEST_END, result, reply);
}

static uint32_t accept_reset(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                             terrapin_frame *reply) {
    terrapin_update_reset_t message;
    if (!genuine(update, frame, &update->reset_counter) || !terrapin_decode_update_reset(frame, &message)) {
        return 0U;
    }
    if (message.key != TERRAPIN_UPDATE_RESET_KEY) {
        update->malformed++;
        return 0U;
    }
    update->reset = !motor_on;
    update->stay = message.stay != 0;
    return status(update, TERRAPIN_UPDATE_REQUEST_RESET, motor_on ? (uint8_t)TERRAPIN_UPDATE_RESULT_MOTOR_ON : OK,
                  reply);
}

/* A new host asks first: its counters begin anew. */
static uint32_t accept_query(terrapin_update *update, const terrapin_frame *frame,
                             terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]) {
    terrapin_record record;
    terrapin_update_query_t message;
    uint8_t hash[TERRAPIN_SHA256_SIZE];
    if (!terrapin_decode_update_query(frame, &message)) {
        update->malformed++;
        return 0U;
    }
    update->begin_counter = TERRAPIN_E2E_NO_COUNTER;
    update->end_counter = TERRAPIN_E2E_NO_COUNTER;
    update->reset_counter = TERRAPIN_E2E_NO_COUNTER;
    terrapin_records_read(update->boot->flash, &record);
    uint8_t target = NONE;
    if (writable(update, &record, A)) {
        target = A;
    } else if (writable(update, &record, B)) {
        target = B;
    } else {
        /* a trial runs: it must be confirmed first */
    }
    const terrapin_update_info_t info = {
        .protocol = (int32_t)TERRAPIN_UPDATE_PROTOCOL,
        .running = (int32_t)update->running,
        .confirmed = (int32_t)record.confirmed,
        .candidate = (int32_t)record.candidate,
        .phase = (int32_t)record.phase,
        .major = (int32_t)record.version.major,
        .minor = (int32_t)record.version.minor,
        .revision = (int32_t)record.version.revision,
        .target = (int32_t)target,
    };
    terrapin_image_key_hash(update->boot->key, hash);
    const terrapin_update_floor_t least = {
        .security_counter = record.security_counter,
        .key = ((uint32_t)hash[3] << 24U) | ((uint32_t)hash[2] << 16U) | ((uint32_t)hash[1] << 8U) | hash[0],
    };
    (void)terrapin_encode_update_info(&info, &replies[0]); /* the fields have the signals' widths */
    (void)terrapin_encode_update_floor(&least, &replies[1]);
    return TERRAPIN_UPDATE_REPLIES;
}

uint32_t terrapin_update_accept(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                                terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]) {
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
        count = accept_query(update, frame, replies);
        break;
    case TERRAPIN_ID_UPDATE_RESET:
        count = accept_reset(update, frame, motor_on, &replies[0]);
        break;
    default:
        /* another's */
        break;
    }
    return count;
}
