/* The update's messages: any frame, from any state that an update can have. Every write lies in the slot that is being
 * written, and that is neither the running nor the confirmed one; nothing is written with the motor on. */
#include "proof.h"

#include "update.c"
#include "update_requests.c"
#include "terrapin_interface.c"

static terrapin_update update;
static terrapin_record record;
static bool motor_on;
static bool is_signed; /* what the frame announces, by a key that counts */
static uint8_t is_signed_by;
static bool is_good;      /* the image in the slot, as boot.c judges it */
static uint8_t authority; /* of the frame, as controller.toml has it */

static bool is_authentic(void) {
    return is_signed && (record.revoked != (is_signed_by + 1U));
}

/* Records are within their ranges (proof `records`), and do not change but by an append. */
void terrapin_records_read(const terrapin_flash *flash, terrapin_record *found) {
    (void)flash;
    *found = record;
}

static bool slot_ok(uint8_t slot) {
    return slot <= (uint8_t)TERRAPIN_UPDATE_SLOT_B;
}

bool terrapin_records_append(const terrapin_flash *flash, const terrapin_record *next) {
    (void)flash;
    PROVE(!motor_on && slot_ok(next->confirmed) && slot_ok(next->candidate));
    PROVE(next->confirmed ==
          record.confirmed); /* an update confirms nothing, and changes nobody's robot, node or key */
    PROVE((next->robot == record.robot) && (next->node == record.node) && (next->revoked == record.revoked));
    PROVE((next->phase == (uint8_t)TERRAPIN_UPDATE_PHASE_PENDING)
              ? ((authority == (uint8_t)TERRAPIN_AUTHORITY_UPDATE) && is_good)
              : ((authority == (uint8_t)TERRAPIN_AUTHORITY_SIGNATURE) && is_authentic()));
    const bool good = nondet_bool();
    if (good) {
        record = *next;
    }
    return good;
}

/* Whether what DATA brought before a BEGIN is signed. */
terrapin_image_result terrapin_image_signed(const uint8_t tlvs[TERRAPIN_IMAGE_TLVS], const uint8_t *keys,
                                            uint8_t *key) {
    (void)keys;
    PROVE(__CPROVER_r_ok(tlvs, TERRAPIN_IMAGE_TLVS));
    *key = nondet_byte();
    ASSUME(*key < TERRAPIN_IMAGE_KEYS);
    is_signed = nondet_bool();
    is_signed_by = *key;
    return is_signed ? (uint8_t)TERRAPIN_UPDATE_RESULT_OK : (uint8_t)TERRAPIN_UPDATE_RESULT_BAD_SIGNATURE;
}

terrapin_flash_area terrapin_boot_slot(uint8_t slot) {
    PROVE((slot == (uint8_t)TERRAPIN_UPDATE_SLOT_A) || (slot == (uint8_t)TERRAPIN_UPDATE_SLOT_B));
    const terrapin_flash_area area = {(slot == (uint8_t)TERRAPIN_UPDATE_SLOT_B) ? TERRAPIN_LAYOUT_SLOT_B
                                                                                : TERRAPIN_LAYOUT_SLOT_A,
                                      TERRAPIN_LAYOUT_SLOT_SIZE};
    return area;
}

terrapin_image_result terrapin_boot_check(const terrapin_boot *boot, uint8_t slot, const terrapin_record *now,
                                          bool strict, terrapin_image *image) {
    (void)boot;
    (void)now;
    PROVE(strict && (slot == update.slot));
    ANYTHING(*image);
    ASSUME(image->size <= TERRAPIN_LAYOUT_SLOT_SIZE); /* asserted in terrapin_image_read */
    const uint8_t result = nondet_byte();
    is_good = result == (uint8_t)TERRAPIN_UPDATE_RESULT_OK;
    return result;
}

bool terrapin_image_header_version(const uint8_t header[32], terrapin_image_version *version) {
    PROVE(__CPROVER_r_ok(header, 32U));
    ANYTHING(*version);
    return nondet_bool();
}

int32_t terrapin_image_compare(terrapin_image_version a, terrapin_image_version b) {
    (void)a;
    (void)b;
    return nondet_int();
}

uint32_t terrapin_crc32(uint32_t crc, const uint8_t *bytes, size_t size) {
    (void)crc;
    PROVE(__CPROVER_r_ok(bytes, size));
    return nondet_word();
}

static bool is_spare(uint32_t offset) {
    const uint8_t slot =
        (offset >= TERRAPIN_LAYOUT_SLOT_B) ? (uint8_t)TERRAPIN_UPDATE_SLOT_B : (uint8_t)TERRAPIN_UPDATE_SLOT_A;
    return (slot != record.confirmed) && (slot != update.running);
}

static bool write(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    (void)context;
    const terrapin_flash_area area = terrapin_boot_slot(update.slot);
    PROVE(!motor_on && (size > 0U) && __CPROVER_r_ok(bytes, size));
    PROVE((offset >= area.offset) && (size <= area.size) && ((offset - area.offset) <= (area.size - size)));
    PROVE(is_spare(offset) && (authority == (uint8_t)TERRAPIN_AUTHORITY_UPDATE) && update.active);
    return nondet_bool();
}

static bool erase(void *context, terrapin_flash_area area) {
    (void)context;
    PROVE(!motor_on && (area.size == TERRAPIN_LAYOUT_SLOT_SIZE) && is_spare(area.offset));
    PROVE((authority == (uint8_t)TERRAPIN_AUTHORITY_SIGNATURE) && is_authentic());
    return nondet_bool();
}

static bool counter(uint8_t value) {
    return (value <= TERRAPIN_E2E_COUNTER_MAX) || (value == TERRAPIN_E2E_NO_COUNTER);
}

/* What terrapin_update_init makes so, and every frame leaves so. */
static bool sound(void) {
    const bool counters = counter(update.begin_counter) && counter(update.end_counter) &&
                          counter(update.reset_counter) && counter(update.robot_counter) &&
                          (update.reply_counter <= TERRAPIN_E2E_COUNTER_MAX);
    const bool sizes = (update.filled <= (TERRAPIN_UPDATE_BLOCK + 8U)) && ((update.filled % 8U) == 0U) &&
                       (update.written <= TERRAPIN_LAYOUT_SLOT_SIZE);
    const bool slot =
        (update.slot == (uint8_t)TERRAPIN_UPDATE_SLOT_A) || (update.slot == (uint8_t)TERRAPIN_UPDATE_SLOT_B);
    const bool open =
        !update.active || (slot && (update.slot != record.confirmed) && (update.slot != update.running) &&
                           (update.size <= TERRAPIN_LAYOUT_SLOT_SIZE) && (update.written <= update.size) &&
                           ((update.written == update.size) || ((update.written % TERRAPIN_UPDATE_BLOCK) == 0U)));
    return counters && sizes && open && slot_ok(update.running);
}

int main(void) {
    terrapin_frame frame;
    terrapin_frame replies[TERRAPIN_UPDATE_REPLIES];
    terrapin_boot boot;
    ANYTHING(update);
    ANYTHING(record);
    ANYTHING(boot);
    ANYTHING(frame);
    const terrapin_flash flash = {.write_size = 4U, .write = write, .erase = erase};
    boot.flash = &flash;
    update.boot = &boot;
    motor_on = nondet_bool();
    ASSUME(slot_ok(record.confirmed) && slot_ok(record.candidate) && (record.phase <= TERRAPIN_UPDATE_PHASE_TRIAL));
    ASSUME(sound());
    static const uint8_t authorities[] = TERRAPIN_UPDATES_AUTHORITY;
    const uint32_t place = (uint32_t)frame.id - TERRAPIN_UPDATE_ID_FIRST;
    authority = (place < sizeof authorities) ? authorities[place] : (uint8_t)TERRAPIN_AUTHORITY_NOTHING;
    is_signed = false;
    is_good = false;
    const bool reset = update.reset;
    const bool active = update.active;
    const bool verified = update.ended && (update.end_result == (uint8_t)TERRAPIN_UPDATE_RESULT_OK);
    const uint32_t written = update.written;
    const uint32_t erases = update.erases;
    const bool application = nondet_bool();
    const uint32_t count = application ? terrapin_update_application(&update, &frame, motor_on, replies)
                                       : terrapin_update_accept(&update, &frame, motor_on, replies);
    PROVE(count <= TERRAPIN_UPDATE_REPLIES);
    PROVE(sound());
    PROVE(!motor_on || reset || !update.reset);
    if (!application) { /* an application's port asks itself who may */
        const bool of_loader = update.running == (uint8_t)TERRAPIN_UPDATE_SLOT_NONE;
        PROVE(reset || !update.reset || (authority == (uint8_t)TERRAPIN_AUTHORITY_IMAGE));
        PROVE(reset || !update.reset || !of_loader || verified);
        PROVE(active || !update.active || is_authentic()); /* opened */
        PROVE((update.erases == erases) || is_authentic());
        PROVE((authority != (uint8_t)TERRAPIN_AUTHORITY_NOTHING) ||
              ((update.active == active) && (update.written == written) && (update.reset == reset)));
        PROVE(is_authentic() || (authority == (uint8_t)TERRAPIN_AUTHORITY_UPDATE) ||
              ((update.active == active) && (update.written == written)));
        const bool now = update.ended && (update.end_result == (uint8_t)TERRAPIN_UPDATE_RESULT_OK);
        PROVE(verified || !now || (is_good && (authority == (uint8_t)TERRAPIN_AUTHORITY_UPDATE)));
    }
    return 0;
}
