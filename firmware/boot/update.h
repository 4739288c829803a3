/* The update over CAN frames, UPDATE_* of controller.toml: what boot loader and application (motor off) both serve.
 *
 *     terrapin_update_init(&update, &boot, running);
 *     for each received frame:
 *         n = terrapin_update_accept(&update, &frame, motor_on, replies);
 *         send the n replies; after that, reset if update.reset
 *
 *     host                                   controller
 *     UPDATE_QUERY                           UPDATE_INFO, UPDATE_FLOOR: slots, versions
 *     UPDATE_BLOCK of nothing                UPDATE_STATUS `sequence`: what DATA brought before is dropped
 *     18 x UPDATE_DATA: the image's TLVs
 *     UPDATE_BEGIN size, version, slot       UPDATE_STATUS, once the slot is erased (1 s, 2 s at most)
 *     32 x UPDATE_DATA, UPDATE_BLOCK crc     UPDATE_STATUS, once the 256 bytes are written (1 ms, 7 ms at most)
 *     ...                                    `again`: send the block `next` (again)
 *     UPDATE_END crc                         UPDATE_STATUS, once the image is verified
 *     UPDATE_RESET                           UPDATE_STATUS, then the reset
 *     UPDATE_ROBOT                           UPDATE_IDENTITY: whose images are taken
 *
 * A host whose answer does not come sends its request again, with its next E2E counter: the same BEGIN before the first
 * block, the last block and the same END are answered as before and do nothing again.
 *
 * Anybody may send, and a boot loader has no session.
 * What a frame may do follows from a signature that came before it (`authority` of controller.toml;
 * tests/proof/prove_update.c shows it of every frame in every state):
 *     BEGIN erases for who sends the end of an image that one of the keys signed: SHA-256, key's name, signature
 *     DATA and BLOCK fill the slot that such a BEGIN opened, and nothing else; END verifies the whole
 *     RESET is taken when END found the image good. A boot loader that is left alone resets by itself
 * Who has recorded the end of a signed image can still have the spare slot erased: at most once in
 * TERRAPIN_UPDATE_ERASE_MS, and TERRAPIN_UPDATE_ERASES times between two starts, which no frame can shorten; more is
 * answered `busy`. What is refused stays where it is: without a signature nothing of it ever starts.
 *
 * The window is one block: a block is answered before the next may be sent, so that no frame comes while the flash is
 * written, for which the processor stands still. terrapin_update_accept takes that time too: a caller with a watchdog
 * whose time is shorter than an erase resets into the boot loader for an update instead (UPDATE_RESET with `stay`).
 */
#ifndef TERRAPIN_UPDATE_H
#define TERRAPIN_UPDATE_H

#include "boot.h"
#include "terrapin.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_UPDATE_ID_FIRST 0x0A0U
#define TERRAPIN_UPDATE_ID_LAST  0x0A7U
#define TERRAPIN_UPDATE_PROTOCOL 2U /* 1: BEGIN needed no signature, UPDATE_ROBOT wrote */
#define TERRAPIN_UPDATE_BLOCK    256U
#define TERRAPIN_UPDATE_REPLIES  2U /* at most, to one frame */
#define TERRAPIN_UPDATE_ERASES   20U
#define TERRAPIN_UPDATE_ERASE_MS 10000U

typedef struct {
    const terrapin_boot *boot;
    uint8_t running;    /* update_slot that the caller runs from; none: the boot loader */
    bool reset;         /* send the replies, then reset */
    bool stay;          /* and stay in the boot loader */
    uint32_t now_ms;    /* the caller's clock, set before each frame; wraps */
    uint32_t erases;    /* since the start, */
    uint32_t erased_ms; /* and when the last one was */

    bool active;                    /* between BEGIN and END */
    uint8_t slot;                   /* being written */
    uint32_t size;                  /* announced */
    terrapin_image_version version; /* announced, build number apart */
    uint32_t written;               /* bytes, a multiple of the block's size until the last */
    uint32_t checksum;              /* CRC-32 of those */
    uint32_t block_checksum;        /* of the last block written, to know it again */
    uint32_t filled;                /* bytes of `block`; more than its size when too many came */
    bool ended;                     /* since the last BEGIN; */
    uint8_t end_result;             /* what END was answered, */
    uint32_t end_checksum;          /* and of which END */
    uint8_t block[TERRAPIN_UPDATE_BLOCK];

    uint8_t begin_counter; /* E2E counters of the last accepted frames, and of the next answer */
    uint8_t end_counter;
    uint8_t reset_counter;
    uint8_t robot_counter;
    uint8_t reply_counter;
    uint32_t malformed; /* frames dropped, by cause; these wrap */
    uint32_t bad_crc;
    uint32_t repeated;
} terrapin_update;

/* `boot` must outlive it. */
void terrapin_update_init(terrapin_update *update, const terrapin_boot *boot, uint8_t running);

/* Take one frame; the number of replies to send. A frame that is no message of an update changes nothing. */
uint32_t terrapin_update_accept(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                                terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]);

/* The same for an application that leaves the writing to the boot loader (its watchdog is shorter than an erase):
 * UPDATE_QUERY and UPDATE_RESET are served, the others refused as `boot_loader_only`. The host then resets with `stay`.
 * Links neither signatures nor the flash's writing. */
uint32_t terrapin_update_application(terrapin_update *update, const terrapin_frame *frame, bool motor_on,
                                     terrapin_frame replies[TERRAPIN_UPDATE_REPLIES]);

#ifdef __cplusplus
}
#endif
#endif
