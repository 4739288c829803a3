/* An image's header and protected TLVs, any bytes: nothing is read outside of the slot, and what is accepted fits in
 * it. Bounded: the protected TLVs have at most PROTECTED_MOST bytes (more of them are more turns of the same loop). */
#include "proof.h"

#include "image.c"

#define PROTECTED_MOST 32U

static terrapin_flash_area slot;

void terrapin_sha2_begin(terrapin_sha2 *sha, terrapin_sha2_kind kind) {
    (void)sha;
    (void)kind;
}

void terrapin_sha2_take(terrapin_sha2 *sha, const uint8_t *bytes, uint32_t size) {
    (void)sha;
    PROVE(__CPROVER_r_ok(bytes, size));
}

void terrapin_sha2_end(terrapin_sha2 *sha, uint8_t *digest) {
    (void)sha;
    (void)digest;
}

/* A flash that holds anything, and fails when it likes. */
static bool read(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    (void)context;
    PROVE(__CPROVER_w_ok(bytes, size));
    PROVE((offset >= slot.offset) && (size <= slot.size) && ((offset - slot.offset) <= (slot.size - size)));
    __CPROVER_havoc_slice(bytes, size);
    return nondet_bool();
}

int main(void) {
    const terrapin_flash flash = {.read = read};
    terrapin_image image;
    slot.offset = TERRAPIN_LAYOUT_SLOT_A;
    slot.size = TERRAPIN_LAYOUT_SLOT_SIZE;
    const uint32_t protected_size = nondet_word();
    ASSUME(protected_size <= PROTECTED_MOST);
    const uint32_t offset = nondet_word();
    ASSUME((offset >= slot.offset) && (offset <= (slot.offset + slot.size - PROTECTED_MOST)));
    (void)read_protected(&flash, offset, protected_size, &image);
    if (nondet_bool()) {
        uint8_t header[32];
        terrapin_image_version version;
        ANYTHING(header);
        (void)terrapin_image_header_version(header, &version);
    }
    return 0;
}
