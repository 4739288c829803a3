#include "serial.h"

#include "terrapin_assert.h"

void terrapin_boot_serial_init(terrapin_boot_serial *serial, const terrapin_boot *boot, uint8_t running) {
    terrapin_record record;
    terrapin_records_read(boot->flash, &record);
    terrapin_node_init(&serial->node, record.node);
    terrapin_slcan_init(&serial->parser);
    terrapin_update_init(&serial->update, boot, running);
}

uint32_t terrapin_boot_frame(terrapin_boot_serial *serial, terrapin_frame *frame, bool motor_on,
                             terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]) {
    uint32_t count = 0U;
    if (terrapin_node_receive(&serial->node, frame)) {
        count = terrapin_update_accept(&serial->update, frame, motor_on, replies);
    }
    for (uint32_t i = 0U; i < count; i++) {
        terrapin_node_send(&serial->node, &replies[i]);
    }
    return count;
}

uint32_t terrapin_boot_serial_take(terrapin_boot_serial *serial, uint8_t byte, bool motor_on,
                                   uint8_t answer[TERRAPIN_BOOT_SERIAL_ANSWER_MAX]) {
    terrapin_frame frame = {0};
    terrapin_slcan_reply reply = {0};
    terrapin_frame frames[TERRAPIN_UPDATE_REPLIES];
    uint32_t length = 0U;
    const terrapin_slcan_event event = terrapin_slcan_feed(&serial->parser, byte, &frame, &reply);
    if (event == TERRAPIN_SLCAN_FRAME) {
        const uint32_t count = terrapin_boot_frame(serial, &frame, motor_on, frames);
        TERRAPIN_ASSERT(count <= TERRAPIN_UPDATE_REPLIES);
        for (uint32_t i = 0U; i < count; i++) {
            length += (uint32_t)terrapin_slcan_encode(&frames[i], &answer[length]);
        }
    }
    if (event != TERRAPIN_SLCAN_MORE) {
        for (uint32_t i = 0U; i < reply.length; i++) {
            answer[length] = reply.text[i];
            length++;
        }
    }
    TERRAPIN_ASSERT(length <= TERRAPIN_BOOT_SERIAL_ANSWER_MAX);
    return length;
}
