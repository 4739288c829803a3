#include "boot.h"

#include "layout.h"
#include "terrapin_interface.h"
#include "terrapin_assert.h"

#define NONE ((uint8_t)TERRAPIN_UPDATE_SLOT_NONE)
#define A    ((uint8_t)TERRAPIN_UPDATE_SLOT_A)
#define B    ((uint8_t)TERRAPIN_UPDATE_SLOT_B)

terrapin_flash_area terrapin_boot_slot(uint8_t slot) {
    const terrapin_flash_area area = {(slot == B) ? TERRAPIN_LAYOUT_SLOT_B : TERRAPIN_LAYOUT_SLOT_A,
                                      TERRAPIN_LAYOUT_SLOT_SIZE};
    return area;
}

/* The image is of the controller's robot, or of another one and made to take its place. */
static bool may_be_of(const terrapin_image *image, const terrapin_record *record) {
    return (record->robot == 0U) || (image->robot == record->robot) ||
           ((image->robot != 0U) && (image->replaces == record->robot));
}

terrapin_image_result terrapin_boot_check(const terrapin_boot *boot, uint8_t slot, const terrapin_record *record,
                                          bool update, terrapin_image *image) {
    TERRAPIN_ASSERT((slot == A) || (slot == B));
    const terrapin_flash_area area = terrapin_boot_slot(slot);
    terrapin_image_result result =
        terrapin_image_verify(boot->flash, area, TERRAPIN_LAYOUT_BASE + area.offset, boot->keys, image);
    if (result == (uint8_t)TERRAPIN_UPDATE_RESULT_OK) {
        if (record->revoked == (image->key + 1U)) {
            result = TERRAPIN_UPDATE_RESULT_REVOKED_KEY;
        } else if (image->security_counter < record->security_counter) {
            result = TERRAPIN_UPDATE_RESULT_COUNTER_TOO_LOW;
        } else if (update && (terrapin_image_compare(image->version, record->version) < 0)) {
            result = TERRAPIN_UPDATE_RESULT_VERSION_TOO_OLD;
        } else if (boot->release && (image->kind != (uint8_t)TERRAPIN_IMAGE_KIND_PRODUCTION) &&
                   !(image->for_unit && (image->unit == boot->unit))) {
            result = TERRAPIN_UPDATE_RESULT_DESK_IMAGE;
        } else if (!may_be_of(image, record)) {
            result = TERRAPIN_UPDATE_RESULT_WRONG_ROBOT;
        } else if ((image->board != 0U) && (boot->board != 0U) && (image->board != boot->board)) {
            result = TERRAPIN_UPDATE_RESULT_WRONG_BOARD;
        } else if ((image->interface != 0U) && (image->interface != (uint32_t)TERRAPIN_INTERFACE_VERSION)) {
            result = TERRAPIN_UPDATE_RESULT_WRONG_INTERFACE;
        } else {
            /* good */
        }
    }
    return result;
}

/* Whether the image in the slot may be started; then it is the choice. */
static bool take(const terrapin_boot *boot, uint8_t slot, const terrapin_record *record, bool update,
                 terrapin_boot_choice *choice) {
    const bool good = (slot != NONE) && (terrapin_boot_check(boot, slot, record, update, &choice->image) ==
                                         (uint8_t)TERRAPIN_UPDATE_RESULT_OK);
    if (good) {
        choice->slot = slot;
        choice->address = TERRAPIN_LAYOUT_BASE + terrapin_boot_slot(slot).offset + TERRAPIN_LAYOUT_HEADER_SIZE;
        TERRAPIN_ASSERT(choice->image.security_counter >= record->security_counter);
    }
    return good;
}

/* What a confirmed image says of the other key is written down once; if that fails, at its next start. */
static void revoke(const terrapin_boot *boot, const terrapin_image *image, terrapin_record *record) {
    TERRAPIN_ASSERT(image->key < TERRAPIN_IMAGE_KEYS);
    const uint32_t other = 1U - (uint32_t)image->key;
    if ((image->revokes == boot->key_ids[other]) && (record->revoked == 0U)) {
        record->revoked = (uint8_t)(other + 1U);
        (void)terrapin_records_append(boot->flash, record);
    }
}

void terrapin_boot_choose(const terrapin_boot *boot, terrapin_boot_choice *choice) {
    TERRAPIN_ASSERT((boot != NULL) && (choice != NULL));
    static const terrapin_boot_choice stay = {0};
    terrapin_record record;
    *choice = stay;
    (void)terrapin_records_make_room(boot->flash); /* when it fails, so does the append below, which is seen */
    terrapin_records_read(boot->flash, &record);
    TERRAPIN_ASSERT((record.confirmed <= B) && (record.candidate <= B));
    TERRAPIN_ASSERT(record.phase <= (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL);

    const bool first = record.phase == (uint8_t)TERRAPIN_UPDATE_PHASE_PENDING;
    if (first || ((record.phase == (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL) && (record.tries > 0U))) {
        const bool good = take(boot, record.candidate, &record, true, choice);
        record.tries = first ? (uint8_t)(TERRAPIN_BOOT_TRIES - 1U) : (uint8_t)(record.tries - 1U);
        record.phase = good ? (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL : (uint8_t)TERRAPIN_UPDATE_PHASE_NONE;
        if (terrapin_records_append(boot->flash, &record) && good) {
            return;
        }
        *choice = stay; /* what cannot be written down is not tried: it might be tried for ever */
    } else if (record.phase == (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL) {
        /* The last try was not confirmed. */
        record.phase = TERRAPIN_UPDATE_PHASE_NONE;
        (void)terrapin_records_append(boot->flash, &record); /* if not, it is dropped again at the next start */
    } else {
        /* nothing new */
    }

    if (record.confirmed != NONE) {
        if (!take(boot, record.confirmed, &record, false, choice)) {
            record.confirmed = NONE; /* the flash has lost it: whatever starts well now takes its place */
            (void)terrapin_records_append(boot->flash, &record);
        } else {
            revoke(boot, &choice->image, &record);
        }
    }
    if (choice->slot == NONE) { /* nothing is confirmed: what there is, a rejected image last */
        const uint8_t last = (record.candidate == A) ? A : B;
        const uint8_t other = (last == A) ? B : A;
        if (!take(boot, other, &record, false, choice)) {
            (void)take(boot, last, &record, false, choice);
        }
    }
}

bool terrapin_boot_on_trial(const terrapin_boot *boot, uint8_t running) {
    terrapin_record record;
    terrapin_records_read(boot->flash, &record);
    return (record.phase == (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL) && (record.candidate == running);
}

/* To the version and counter of the image in a slot. */
static void raise_floor(const terrapin_boot *boot, uint8_t slot, terrapin_record *record) {
    terrapin_image image;
    const terrapin_flash_area area = terrapin_boot_slot(slot);
    if (terrapin_image_read(boot->flash, area, TERRAPIN_LAYOUT_BASE + area.offset, &image) !=
        (uint8_t)TERRAPIN_UPDATE_RESULT_OK) {
        return;
    }
    if (terrapin_image_compare(image.version, record->version) > 0) {
        record->version = image.version;
    }
    if (image.security_counter > record->security_counter) {
        record->security_counter = image.security_counter;
    }
}

bool terrapin_boot_confirm(const terrapin_boot *boot, uint8_t running) {
    TERRAPIN_ASSERT(boot != NULL);
    terrapin_record record;
    terrapin_image image;
    const terrapin_flash_area area = terrapin_boot_slot(running);
    terrapin_records_read(boot->flash, &record);
    if ((record.confirmed == running) && (running != NONE)) {
        return true;
    }
    const bool trial = (record.phase == (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL) && (record.candidate == running);
    if (((running != A) && (running != B)) || (!trial && (record.confirmed != NONE)) ||
        (terrapin_image_read(boot->flash, area, TERRAPIN_LAYOUT_BASE + area.offset, &image) !=
         (uint8_t)TERRAPIN_UPDATE_RESULT_OK)) {
        return false;
    }
    raise_floor(boot, (record.confirmed != NONE) ? record.confirmed : running, &record);
    if (record.security_counter > image.security_counter) { /* it went back: a floor above it would lock it out */
        record.security_counter = image.security_counter;
    }
    record.confirmed = running;
    if (may_be_of(&image, &record)) { /* the first image that starts well says whose this controller is, */
        record.robot = image.robot;   /* and one that replaces that robot says so anew */
    }
    if (trial) {
        record.candidate = NONE;
        record.phase = TERRAPIN_UPDATE_PHASE_NONE;
        record.tries = 0U;
    }
    return terrapin_records_append(boot->flash, &record);
}
