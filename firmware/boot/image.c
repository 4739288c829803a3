#include "image.h"

#include "ed25519.h"
#include "layout.h"
#include "terrapin_interface.h"
#include "terrapin_assert.h"

#define MAGIC           0x96F3B83DU
#define FLAG_ROM_FIXED  0x00000100U
#define PROTECTED_MAGIC 0x6908U
#define TLV_MAGIC       0x6907U
#define TLV_KEY_HASH    0x01U
#define TLV_SHA256      0x10U
#define TLV_ED25519     0x24U
#define TLV_COUNTER     0x50U
#define TLV_KIND        0xA0U /* one byte: image_kind */
#define TLV_UNIT        0xA1U /* four bytes: the chip that a desk image is allowed on */
#define TLV_MADE_FOR    0xA2U /* robot_identity, board */
#define TLV_INTERFACE   0xA3U
#define TLV_REVOKES     0xA4U /* four bytes: first of the hash of the key that shall count no more */
#define TLV_REPLACES    0xA5U /* four bytes: robot_identity of the controller that it may be put on */
#define ERASED          0xFFU
#define TLV_HEAD        4U /* bytes before a TLV's value, and before the first TLV */

/* The TLVs after the protected ones, in imgtool's order: their places from the start of the area. */
#define PLACE_SHA256  TLV_HEAD
#define PLACE_KEY     (PLACE_SHA256 + TLV_HEAD + 32U)
#define PLACE_ED25519 (PLACE_KEY + TLV_HEAD + 32U)
#define TLV_SIZE      (PLACE_ED25519 + TLV_HEAD + 64U)
_Static_assert(TLV_SIZE == TERRAPIN_IMAGE_TLVS, "as the header says");

static uint16_t get16(const uint8_t *bytes) {
    return (uint16_t)(((uint32_t)bytes[1] << 8U) | bytes[0]);
}

static uint32_t get32(const uint8_t *bytes) {
    return ((uint32_t)bytes[3] << 24U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[1] << 8U) | bytes[0];
}

bool terrapin_image_header_version(const uint8_t header[32], terrapin_image_version *version) {
    version->major = header[20];
    version->minor = header[21];
    version->revision = get16(&header[22]);
    version->build = get32(&header[24]);
    return get32(header) == MAGIC;
}

/* What the protected TLVs say, `size` bytes at `offset`: one security counter, of the others the last. */
static bool read_protected(const terrapin_flash *flash, uint32_t offset, uint32_t size, terrapin_image *image) {
    uint8_t bytes[8];
    uint32_t place = TLV_HEAD;
    uint32_t found = 0U;
    bool good = (size > TLV_HEAD) && flash->read(flash->context, offset, bytes, TLV_HEAD) &&
                (get16(bytes) == PROTECTED_MAGIC) && (get16(&bytes[2]) == size);
    image->kind = (uint8_t)TERRAPIN_IMAGE_KIND_DESK;
    image->for_unit = false;
    image->robot = 0U;
    image->board = 0U;
    image->interface = 0U;
    image->revokes = 0U;
    image->replaces = 0U;
    while (good && (place < size)) { /* each turn advances by TLV_HEAD or more */
        good = ((size - place) >= TLV_HEAD) && flash->read(flash->context, offset + place, bytes, TLV_HEAD);
        const uint16_t type = get16(bytes);
        const uint32_t length = get16(&bytes[2]);
        good = good && (length <= (size - place - TLV_HEAD));
        if (good && ((type == TLV_COUNTER) || ((type >= TLV_KIND) && (type <= TLV_REPLACES)))) {
            uint32_t expected = 4U;
            if (type == TLV_KIND) {
                expected = 1U;
            }
            good = (length == expected) && flash->read(flash->context, offset + place + TLV_HEAD, bytes, expected);
            if (type == TLV_COUNTER) {
                found++;
                image->security_counter = get32(bytes);
            } else if (type == TLV_UNIT) {
                image->for_unit = true;
                image->unit = get32(bytes);
            } else if (type == TLV_MADE_FOR) {
                image->robot = get32(bytes) & 0x00FFFFFFU;
                image->board = bytes[3];
            } else if (type == TLV_INTERFACE) {
                image->interface = get32(bytes);
            } else if (type == TLV_REVOKES) {
                image->revokes = get32(bytes);
            } else if (type == TLV_REPLACES) {
                image->replaces = get32(bytes);
            } else {
                image->kind = bytes[0];
            }
        }
        place += TLV_HEAD + length;
        TERRAPIN_ASSERT(!good || (place <= size));
    }
    return good && (found == 1U);
}

/* A TLV of that type and length stands there. */
static bool tlv_is(const uint8_t *bytes, uint32_t type, uint32_t length) {
    return get32(bytes) == (type | (length << 16U));
}

terrapin_image_result terrapin_image_read(const terrapin_flash *flash, terrapin_flash_area slot, uint32_t address,
                                          terrapin_image *image) {
    uint8_t header[32];
    if (!flash->read(flash->context, slot.offset, header, sizeof header)) {
        return TERRAPIN_UPDATE_RESULT_FLASH;
    }
    const uint32_t protected_size = get16(&header[10]);
    image->code_size = get32(&header[12]);
    if (!terrapin_image_header_version(header, &image->version) || (get16(&header[8]) != TERRAPIN_LAYOUT_HEADER_SIZE) ||
        (get32(&header[16]) != FLAG_ROM_FIXED) || (image->code_size == 0U) ||
        (slot.size < TERRAPIN_LAYOUT_HEADER_SIZE) || (image->code_size > (slot.size - TERRAPIN_LAYOUT_HEADER_SIZE))) {
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE;
    }
    if (get32(&header[4]) != address) {
        return TERRAPIN_UPDATE_RESULT_WRONG_SLOT;
    }
    const uint32_t code_end = TERRAPIN_LAYOUT_HEADER_SIZE + image->code_size;
    if ((protected_size + TLV_SIZE) > (slot.size - code_end)) {
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE;
    }
    image->hashed_size = code_end + protected_size;
    image->size = image->hashed_size + TLV_SIZE;
    TERRAPIN_ASSERT(image->size <= slot.size);
    if (!read_protected(flash, slot.offset + code_end, protected_size, image)) {
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE;
    }
    return TERRAPIN_UPDATE_RESULT_OK;
}

void terrapin_image_key_hash(const uint8_t key[TERRAPIN_IMAGE_KEY_SIZE], uint8_t hash[TERRAPIN_SHA256_SIZE]) {
    TERRAPIN_ASSERT((key != NULL) && (hash != NULL));
    static const uint8_t head[12] = {0x30U, 0x2AU, 0x30U, 0x05U, 0x06U, 0x03U,
                                     0x2BU, 0x65U, 0x70U, 0x03U, 0x21U, 0x00U};
    terrapin_sha2 sha;
    terrapin_sha2_begin(&sha, TERRAPIN_SHA256);
    terrapin_sha2_take(&sha, head, sizeof head);
    terrapin_sha2_take(&sha, key, TERRAPIN_IMAGE_KEY_SIZE);
    terrapin_sha2_end(&sha, hash);
}

static bool same32(const uint8_t *a, const uint8_t *b) {
    uint32_t difference = 0U;
    for (uint32_t i = 0U; i < 32U; i++) {
        difference |= (uint32_t)a[i] ^ b[i];
    }
    return difference == 0U;
}

/* The name of a key is this one. */
static bool is_named(const uint8_t *key, const uint8_t *name) {
    uint8_t hash[TERRAPIN_SHA256_SIZE];
    terrapin_image_key_hash(key, hash);
    return same32(name, hash);
}

/* SHA-256 of `size` bytes of flash. */
static bool digest_of(const terrapin_flash *flash, uint32_t offset, uint32_t size, uint8_t *digest) {
    terrapin_sha2 sha;
    uint8_t bytes[64];
    bool good = true;
    terrapin_sha2_begin(&sha, TERRAPIN_SHA256);
    for (uint32_t done = 0U; good && (done < size); done += sizeof bytes) {
        const uint32_t rest = size - done;
        const uint32_t count = (rest < sizeof bytes) ? rest : (uint32_t)sizeof bytes;
        good = flash->read(flash->context, offset + done, bytes, count);
        TERRAPIN_ASSERT((count > 0U) && (count <= sizeof bytes));
        terrapin_sha2_take(&sha, bytes, count);
    }
    terrapin_sha2_end(&sha, digest);
    return good;
}

/* Every byte from `offset` to `end` reads erased. */
static bool erased(const terrapin_flash *flash, uint32_t offset, uint32_t end) {
    uint8_t bytes[64];
    bool good = true;
    for (uint32_t at = offset; good && (at < end); at += sizeof bytes) {
        const uint32_t rest = end - at;
        const uint32_t count = (rest < sizeof bytes) ? rest : (uint32_t)sizeof bytes;
        good = flash->read(flash->context, at, bytes, count);
        for (uint32_t i = 0U; i < count; i++) {
            good = good && (bytes[i] == ERASED);
        }
    }
    return good;
}

static bool has_digest(const uint8_t *tlvs) {
    return (get16(tlvs) == TLV_MAGIC) && tlv_is(&tlvs[PLACE_SHA256], TLV_SHA256, 32U);
}

terrapin_image_result terrapin_image_signed(const uint8_t tlvs[TERRAPIN_IMAGE_TLVS], const uint8_t *keys,
                                            uint8_t *key) {
    TERRAPIN_ASSERT((tlvs != NULL) && (keys != NULL) && (key != NULL));
    if (!tlv_is(tlvs, TLV_MAGIC, TLV_SIZE) || !tlv_is(&tlvs[PLACE_SHA256], TLV_SHA256, 32U) ||
        !tlv_is(&tlvs[PLACE_KEY], TLV_KEY_HASH, 32U) || !tlv_is(&tlvs[PLACE_ED25519], TLV_ED25519, 64U)) {
        return TERRAPIN_UPDATE_RESULT_BAD_SIGNATURE; /* not signed, or in another way */
    }
    const uint8_t *candidate = keys;
    uint8_t place = 0U;
    while ((place < TERRAPIN_IMAGE_KEYS) && !is_named(candidate, &tlvs[PLACE_KEY + TLV_HEAD])) {
        place++;
        candidate = &candidate[TERRAPIN_IMAGE_KEY_SIZE];
    }
    terrapin_image_result result = TERRAPIN_UPDATE_RESULT_OK;
    if (place == TERRAPIN_IMAGE_KEYS) {
        result = TERRAPIN_UPDATE_RESULT_WRONG_KEY;
    } else if (!terrapin_ed25519_verify(candidate, &tlvs[PLACE_ED25519 + TLV_HEAD], &tlvs[PLACE_SHA256 + TLV_HEAD],
                                        TERRAPIN_SHA256_SIZE)) {
        result = TERRAPIN_UPDATE_RESULT_BAD_SIGNATURE;
    } else {
        *key = place;
    }
    return result;
}

terrapin_image_result terrapin_image_verify(const terrapin_flash *flash, terrapin_flash_area slot, uint32_t address,
                                            const uint8_t *keys, terrapin_image *image) {
    uint8_t tlv[TLV_SIZE];
    uint8_t hash[TERRAPIN_SHA256_SIZE];
    const terrapin_image_result form = terrapin_image_read(flash, slot, address, image);
    if (form != (uint8_t)TERRAPIN_UPDATE_RESULT_OK) {
        return form;
    }
    if (!flash->read(flash->context, slot.offset + image->hashed_size, tlv, sizeof tlv) ||
        !digest_of(flash, slot.offset, image->hashed_size, hash)) {
        return TERRAPIN_UPDATE_RESULT_FLASH;
    }
    if (!has_digest(tlv)) {
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE;
    }
    if (!same32(&tlv[PLACE_SHA256 + TLV_HEAD], hash)) {
        return TERRAPIN_UPDATE_RESULT_CORRUPTED;
    }
    const terrapin_image_result origin = terrapin_image_signed(tlv, keys, &image->key);
    if (origin != (uint8_t)TERRAPIN_UPDATE_RESULT_OK) {
        return origin;
    }
    if (!erased(flash, slot.offset + image->size, slot.offset + slot.size)) {
        return TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE; /* something follows it */
    }
    return TERRAPIN_UPDATE_RESULT_OK;
}

static int32_t order(uint32_t a, uint32_t b) {
    int32_t result = 0;
    if (a < b) {
        result = -1;
    } else if (a > b) {
        result = 1;
    } else {
        /* same */
    }
    return result;
}

int32_t terrapin_image_compare(terrapin_image_version a, terrapin_image_version b) {
    int32_t result = order(a.major, b.major);
    if (result == 0) {
        result = order(a.minor, b.minor);
    }
    if (result == 0) {
        result = order(a.revision, b.revision);
    }
    if (result == 0) {
        result = order(a.build, b.build);
    }
    return result;
}
