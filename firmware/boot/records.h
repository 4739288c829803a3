/* What the boot loader remembers, as an append-only log in two pages of flash.
 *
 * Each record is the whole state, with a sequence number and a CRC-32: the newest whole one counts, a torn one never
 * was. A full page is left for the other one, which is erased first; until its first record is whole, the old page
 * counts. So power may fail anywhere, and the state is the old one or the new one.
 */
#ifndef TERRAPIN_RECORDS_H
#define TERRAPIN_RECORDS_H

#include "flash.h"
#include "image.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_RECORD_SIZE 32U

typedef struct {
    uint8_t confirmed;              /* update_slot: started well and is started from now on */
    uint8_t candidate;              /* update_slot: the newest image that was put in; rejected when its phase is none */
    uint8_t phase;                  /* update_phase of the candidate */
    uint8_t tries;                  /* starts on trial that it still has */
    uint32_t security_counter;      /* an image needs at least this one */
    uint8_t node;                   /* the controller's number on its bus */
    uint8_t revoked;                /* the key that starts nothing any more: 1 the first, 2 the second; 0 none */
    uint32_t robot;                 /* whose images are taken, 24 bits; 0: that of the first which is confirmed */
    terrapin_image_version version; /* an update needs at least this one */
} terrapin_record;

/* The newest record; all zero when there is none yet. */
void terrapin_records_read(const terrapin_flash *flash, terrapin_record *record);

/* Append a record; false when the flash refuses. May erase a page, unless terrapin_records_make_room came before. */
bool terrapin_records_append(const terrapin_flash *flash, const terrapin_record *record);

/* Append the newest record with another node number; false as above. */
bool terrapin_records_set_node(const terrapin_flash *flash, uint8_t node);

/* Change pages now when the present one has no room for the records of one update, so that the next appends take
 * 0.1 ms and no erase. */
bool terrapin_records_make_room(const terrapin_flash *flash);

#ifdef __cplusplus
}
#endif
#endif
