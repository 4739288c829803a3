/* Signed images in MCUboot's format, as imgtool writes them:
 *
 *     imgtool sign -k KEY.pem -v 1.2.3 -s COUNTER -H 0x200 --pad-header -S 0x20000 -F 0x08020000 --align 4 IN OUT
 *
 * header (0x200 bytes), code, protected TLVs (security counter; where they are needed, kind, unit, revoked key and
 * replaced robot, in MCUboot's range for vendors), TLVs: SHA-256, hash of the key, Ed25519 signature of the SHA-256.
 * Strict: ROM_FIXED to its slot and no other flag, one security counter, those three TLVs in that order and no other.
 * So an image that differs in any bit from the signed one is refused. Format: MCUboot, docs/design.md.
 */
#ifndef TERRAPIN_IMAGE_H
#define TERRAPIN_IMAGE_H

#include "flash.h"
#include "sha2.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_IMAGE_KEYS     2U   /* that a boot loader knows */
#define TERRAPIN_IMAGE_KEY_SIZE 32U  /* bytes of a public key */
#define TERRAPIN_IMAGE_TLVS     144U /* bytes behind what is hashed: SHA-256, key's hash, signature */

typedef struct {
    uint8_t major;
    uint8_t minor;
    uint16_t revision;
    uint32_t build;
} terrapin_image_version;

typedef struct {
    terrapin_image_version version;
    uint32_t security_counter;
    uint32_t code_size;   /* bytes of code */
    uint32_t hashed_size; /* header, code, protected TLVs */
    uint32_t size;        /* of all, first byte of the header to last byte of the TLVs */
    uint8_t kind;         /* image_kind of controller.toml: desk unless the image says production */
    bool for_unit;        /* the image names a chip: */
    uint32_t unit;        /* its unique number, as PORT_IDENTITY tells it */
    uint32_t robot;       /* robot_identity that it is made for, */
    uint8_t board;        /* board, */
    uint32_t interface;   /* and version of the interface; each 0 when the image does not say */
    uint32_t replaces;    /* robot_identity whose controller it may become the image of; 0: none */
    uint32_t revokes;     /* first four bytes of the hash of a key that shall count no more; 0: none */
    uint8_t key;          /* once it is verified: the place of the key that signed it */
} terrapin_image;

/* Results are values of update_result in controller.toml: TERRAPIN_UPDATE_RESULT_OK, _NOT_AN_IMAGE, ... */
typedef uint8_t terrapin_image_result;

/* What an image says about itself; nothing of it is verified but its form. `address` is that of slot.offset. */
terrapin_image_result terrapin_image_read(const terrapin_flash *flash, terrapin_flash_area slot, uint32_t address,
                                          terrapin_image *image);

/* Read it and verify digest, key and signature. `keys`: the public keys, 32 bytes each; one of them signed it. */
terrapin_image_result terrapin_image_verify(const terrapin_flash *flash, terrapin_flash_area slot, uint32_t address,
                                            const uint8_t *keys, terrapin_image *image);

/* The SHA-256 in an image's last TLVs is signed with one of the keys, whose place is then in *key. What was signed is
 * not looked at: it proves that somebody who has a key made an image with that digest. */
terrapin_image_result terrapin_image_signed(const uint8_t tlvs[TERRAPIN_IMAGE_TLVS], const uint8_t *keys, uint8_t *key);

/* The version in the first 32 bytes of an image; false when they are no header. */
bool terrapin_image_header_version(const uint8_t header[32], terrapin_image_version *version);

/* SHA-256 of the key as SubjectPublicKeyInfo (RFC 8410), by which images name it. */
void terrapin_image_key_hash(const uint8_t key[TERRAPIN_IMAGE_KEY_SIZE], uint8_t hash[TERRAPIN_SHA256_SIZE]);

/* Negative, 0, positive: a before, same as, after b. The build number counts last. */
int32_t terrapin_image_compare(terrapin_image_version a, terrapin_image_version b);

#ifdef __cplusplus
}
#endif
#endif
