/* Which image is started: the two slots, and the records of what has become of them.
 *
 *     update:    the image is written into the slot that is not confirmed, verified  -> pending
 *     start:     a pending image is verified again, then started on trial            -> trial
 *     healthy:   the application calls terrapin_boot_confirm                         -> confirmed
 *     otherwise: it is started again, TERRAPIN_BOOT_TRIES times in all: who switches a robot off in its first seconds
 *                loses no update. Then the trial is over, and the confirmed image is started
 *
 * Nothing is ever written into the confirmed slot. The floor that an update needs (version, security counter) follows
 * one image behind: a confirmation raises it to what was confirmed before (the first to itself), so that the image
 * before is a way back; its counter never above that of the image which is confirmed.
 * An image is started only with a good signature and a security counter that is no lower than the floor's. Without any
 * such image the boot loader stays and serves updates.
 *
 * A controller is that of the first image that was confirmed. Another robot's is taken when it says, signed, that it
 * replaces this one; the controller is that robot's once it is confirmed, and what was confirmed before is the way back
 * until then.
 *
 * There are two keys. A confirmed image of one of them may name the other (image.revokes): from its next start on that
 * one starts nothing and updates nothing. The last key cannot be revoked, since none is left that could do it.
 */
#ifndef TERRAPIN_BOOT_H
#define TERRAPIN_BOOT_H

#include "records.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_BOOT_TRIES 3U

typedef struct {
    const terrapin_flash *flash;
    const uint8_t *keys;                   /* the public keys, 32 bytes each; of one key alone, twice that one */
    uint32_t key_ids[TERRAPIN_IMAGE_KEYS]; /* first four bytes of their terrapin_image_key_hash, little-endian */
    bool release;                          /* takes a desk image only when that names this chip */
    uint8_t board;                         /* takes images that say no other, unless 0 */
    uint32_t unit;                         /* the chip's unique number, as PORT_IDENTITY tells it */
} terrapin_boot;

typedef struct {
    uint8_t slot;     /* update_slot; none: stay in the boot loader */
    uint32_t address; /* of the image's vectors */
    terrapin_image image;
} terrapin_boot_choice;

/* Decide, and write down, what is started now. To be called once a start. */
void terrapin_boot_choose(const terrapin_boot *boot, terrapin_boot_choice *choice);

/* Application: this start is healthy. `running` is the slot that it runs from. True when it stands in the records,
 * which are written only when that is news: 0.1 ms, no erase. */
bool terrapin_boot_confirm(const terrapin_boot *boot, uint8_t running);

/* Application: the image in that slot was started on trial, and is not confirmed. */
bool terrapin_boot_on_trial(const terrapin_boot *boot, uint8_t running);

/* Verify the image in a slot, its counter, and, for an update, that its version is none before the confirmed one. */
terrapin_image_result terrapin_boot_check(const terrapin_boot *boot, uint8_t slot, const terrapin_record *record,
                                          bool update, terrapin_image *image);

/* The area of slot a or b. */
terrapin_flash_area terrapin_boot_slot(uint8_t slot);

#ifdef __cplusplus
}
#endif
#endif
