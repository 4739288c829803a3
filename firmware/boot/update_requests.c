#include "update_requests.h"

#include "layout.h"
#include "terrapin_interface.h"
#include "terrapin_assert.h"

#define NONE ((uint8_t)TERRAPIN_UPDATE_SLOT_NONE)
#define A    ((uint8_t)TERRAPIN_UPDATE_SLOT_A)
#define B    ((uint8_t)TERRAPIN_UPDATE_SLOT_B)

void terrapin_update_init(terrapin_update *update, const terrapin_boot *boot, uint8_t running) {
    TERRAPIN_ASSERT((update != NULL) && (boot != NULL));
    TERRAPIN_ASSERT(running <= B);
    *update = (terrapin_update){
        .boot = boot,
        .running = running,
        .begin_counter = TERRAPIN_E2E_NO_COUNTER,
        .end_counter = TERRAPIN_E2E_NO_COUNTER,
        .reset_counter = TERRAPIN_E2E_NO_COUNTER,
        .robot_counter = TERRAPIN_E2E_NO_COUNTER,
    };
}

bool update_writable(const terrapin_update *update, const terrapin_record *record, uint8_t slot) {
    return ((slot == A) || (slot == B)) && (slot != record->confirmed) && (slot != update->running);
}

uint32_t update_status(terrapin_update *update, uint8_t request, uint8_t result, terrapin_frame *reply) {
    TERRAPIN_ASSERT(update->reply_counter <= TERRAPIN_E2E_COUNTER_MAX);
    TERRAPIN_ASSERT(update->written <= TERRAPIN_LAYOUT_SLOT_SIZE);
    const uint32_t next = update->written / TERRAPIN_UPDATE_BLOCK;
    const terrapin_update_status_t answer = {
        .request = (int32_t)request,
        .result = (int32_t)result,
        .next = (int32_t)next,
    };
    (void)terrapin_encode_update_status(&answer, reply); /* cannot saturate: 512 blocks at most */
    terrapin_e2e_protect(reply, update->reply_counter);
    update->reply_counter =
        (update->reply_counter < TERRAPIN_E2E_COUNTER_MAX) ? (uint8_t)(update->reply_counter + 1U) : 0U;
    return 1U;
}

bool update_genuine(terrapin_update *update, const terrapin_frame *frame, uint8_t *last_counter) {
    TERRAPIN_ASSERT((*last_counter <= TERRAPIN_E2E_COUNTER_MAX) || (*last_counter == TERRAPIN_E2E_NO_COUNTER));
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

uint32_t update_reset(terrapin_update *update, const terrapin_frame *frame, bool motor_on, terrapin_frame *reply) {
    terrapin_update_reset_t message;
    if (!update_genuine(update, frame, &update->reset_counter) || !terrapin_decode_update_reset(frame, &message)) {
        return 0U;
    }
    if (message.key != (uint32_t)TERRAPIN_UPDATE_RESET_KEY) {
        update->malformed++;
        return 0U;
    }
    update->reset = !motor_on;
    update->stay = message.stay != 0;
    return update_status(update, TERRAPIN_UPDATE_REQUEST_RESET,
                         motor_on ? (uint8_t)TERRAPIN_UPDATE_RESULT_MOTOR_ON : (uint8_t)TERRAPIN_UPDATE_RESULT_OK,
                         reply);
}

/* A new host asks first: its counters begin anew. */
uint32_t update_query(terrapin_update *update, const terrapin_frame *frame,
                      terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]) {
    terrapin_record record;
    terrapin_update_query_t message;
    if (!terrapin_decode_update_query(frame, &message)) {
        update->malformed++;
        return 0U;
    }
    (void)message.protocol; /* whichever the host speaks: the answer says ours */
    update->begin_counter = TERRAPIN_E2E_NO_COUNTER;
    update->end_counter = TERRAPIN_E2E_NO_COUNTER;
    update->reset_counter = TERRAPIN_E2E_NO_COUNTER;
    terrapin_records_read(update->boot->flash, &record);
    uint8_t target = NONE;
    if (update_writable(update, &record, A)) {
        target = A;
    } else if (update_writable(update, &record, B)) {
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
        .revoked = (int32_t)record.revoked,
    };
    const uint32_t key = update->boot->key_ids[0] & 0xFFFFU;
    const uint32_t next_key = update->boot->key_ids[1] & 0xFFFFU;
    const terrapin_update_floor_t least = {
        .security_counter = record.security_counter,
        .key = (int32_t)key,
        .next_key = (int32_t)next_key,
    };
    (void)terrapin_encode_update_info(&info, &replies[0]); /* the fields have the signals' widths */
    (void)terrapin_encode_update_floor(&least, &replies[1]);
    return TERRAPIN_UPDATE_REPLIES;
}

/* The request that a frame makes which only the boot loader serves. */
static uint8_t of_loader(uint16_t id) {
    uint8_t request = TERRAPIN_UPDATE_REQUEST_NONE;
    switch (id) {
    case TERRAPIN_ID_UPDATE_BEGIN:
        request = TERRAPIN_UPDATE_REQUEST_BEGIN;
        break;
    case TERRAPIN_ID_UPDATE_BLOCK:
        request = TERRAPIN_UPDATE_REQUEST_BLOCK;
        break;
    case TERRAPIN_ID_UPDATE_END:
        request = TERRAPIN_UPDATE_REQUEST_END;
        break;
    default:
        /* none */
        break;
    }
    return request;
}

uint32_t terrapin_update_application(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                                     terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]) {
    uint32_t count = 0U;
    const uint8_t request = of_loader(frame->id);
    if (frame->id == TERRAPIN_ID_UPDATE_QUERY) {
        count = update_query(update, frame, replies);
    } else if (frame->id == TERRAPIN_ID_UPDATE_RESET) {
        count = update_reset(update, frame, motor_on, &replies[0]);
    } else if (request != (uint8_t)TERRAPIN_UPDATE_REQUEST_NONE) {
        const uint8_t result =
            motor_on ? (uint8_t)TERRAPIN_UPDATE_RESULT_MOTOR_ON : (uint8_t)TERRAPIN_UPDATE_RESULT_BOOT_LOADER_ONLY;
        count = update_status(update, request, result, &replies[0]);
    } else {
        /* data, or another's */
    }
    TERRAPIN_ASSERT(count <= TERRAPIN_UPDATE_REPLIES);
    return count;
}
