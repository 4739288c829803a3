/* The update behind a serial line: SLCAN in, SLCAN out. What boot loaders with a serial port are made of.
 *
 *     terrapin_boot_serial_init(&serial, &boot, running);
 *     for each received byte:
 *         send the terrapin_boot_serial_take(&serial, byte, motor_on, answer) bytes of answer
 *         reset if serial.update.reset
 */
#ifndef TERRAPIN_BOOT_SERIAL_H
#define TERRAPIN_BOOT_SERIAL_H

#include "node.h"
#include "slcan.h"
#include "update.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Longest answer to one byte: two frames and the end of the line. */
#define TERRAPIN_BOOT_SERIAL_ANSWER_MAX ((TERRAPIN_UPDATE_REPLIES * TERRAPIN_SLCAN_TEXT_MAX) + TERRAPIN_SLCAN_REPLY_MAX)

typedef struct {
    terrapin_slcan parser;
    terrapin_update update;
    terrapin_node node; /* as the records say */
} terrapin_boot_serial;

void terrapin_boot_serial_init(terrapin_boot_serial *serial, const terrapin_boot *boot, uint8_t running);

/* Take one frame with identifiers of the bus, from there or from the line; the number of replies, with identifiers of
 * the bus. */
uint32_t terrapin_boot_frame(terrapin_boot_serial *serial, terrapin_frame *frame, bool motor_on,
                             terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]);

uint32_t terrapin_boot_serial_take(terrapin_boot_serial *serial, uint8_t byte, bool motor_on,
                                   uint8_t answer[TERRAPIN_BOOT_SERIAL_ANSWER_MAX]);

#ifdef __cplusplus
}
#endif
#endif
