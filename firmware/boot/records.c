#include "records.h"

#include "crc32.h"
#include "layout.h"
#include "terrapin_interface.h"
#include "terrapin_assert.h"

#define MAGIC       0x00015442U /* "BT", format 1 */
#define PAGES       2U
#define CRC_PLACE   (TERRAPIN_RECORD_SIZE - 4U)
#define ROOM        8U /* records kept free for an update and its confirmation */
#define ERASED_BYTE 0xFFU

static const terrapin_flash_area pages[PAGES] = {
    {TERRAPIN_LAYOUT_RECORDS_0, TERRAPIN_LAYOUT_RECORDS_SIZE_0},
    {TERRAPIN_LAYOUT_RECORDS_1, TERRAPIN_LAYOUT_RECORDS_SIZE_1},
};

/* Where the log stands. */
typedef struct {
    bool any;          /* there is a whole record */
    uint32_t sequence; /* of the newest */
    uint32_t page;     /* of the newest */
    uint32_t next;     /* place in that page behind everything that was ever written there */
    terrapin_record newest;
} position;

static void put32(uint8_t *bytes, uint32_t value) {
    for (uint32_t i = 0U; i < 4U; i++) {
        bytes[i] = (uint8_t)((value >> (8U * i)) & 0xFFU);
    }
}

static uint32_t get32(const uint8_t *bytes) {
    return ((uint32_t)bytes[3] << 24U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[1] << 8U) | bytes[0];
}

static void encode(const terrapin_record *record, uint32_t sequence, uint8_t *bytes) {
    TERRAPIN_ASSERT((record->confirmed <= (uint8_t)TERRAPIN_UPDATE_SLOT_B) &&
                    (record->candidate <= (uint8_t)TERRAPIN_UPDATE_SLOT_B));
    TERRAPIN_ASSERT((record->node < TERRAPIN_NODES) && (record->revoked <= TERRAPIN_IMAGE_KEYS));
    TERRAPIN_ASSERT(record->phase <= (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL);
    put32(bytes, MAGIC);
    put32(&bytes[4], sequence);
    bytes[8] = record->confirmed;
    bytes[9] = record->candidate;
    bytes[10] = record->phase;
    bytes[11] = record->tries;
    put32(&bytes[12], record->security_counter);
    bytes[16] = record->version.major;
    bytes[17] = record->version.minor;
    bytes[18] = (uint8_t)(record->version.revision & 0xFFU);
    bytes[19] = (uint8_t)(record->version.revision >> 8U);
    put32(&bytes[20], record->version.build);
    put32(&bytes[24], record->node | ((uint32_t)record->revoked << 4U) | (record->robot << 8U));
    put32(&bytes[CRC_PLACE], terrapin_crc32(0U, bytes, CRC_PLACE));
}

static bool decode(const uint8_t *bytes, terrapin_record *record, uint32_t *sequence) {
    record->confirmed = bytes[8];
    record->candidate = bytes[9];
    record->phase = bytes[10];
    record->tries = bytes[11];
    record->node = bytes[24] & 0x0FU;
    record->revoked = bytes[24] >> 4U;
    record->robot = get32(&bytes[24]) >> 8U;
    record->security_counter = get32(&bytes[12]);
    record->version.major = bytes[16];
    record->version.minor = bytes[17];
    record->version.revision = (uint16_t)(((uint32_t)bytes[19] << 8U) | bytes[18]);
    record->version.build = get32(&bytes[20]);
    *sequence = get32(&bytes[4]);
    return (get32(bytes) == MAGIC) && (get32(&bytes[CRC_PLACE]) == terrapin_crc32(0U, bytes, CRC_PLACE)) &&
           (record->confirmed <= (uint8_t)TERRAPIN_UPDATE_SLOT_B) &&
           (record->candidate <= (uint8_t)TERRAPIN_UPDATE_SLOT_B) &&
           (record->phase <= (uint8_t)TERRAPIN_UPDATE_PHASE_TRIAL) && (record->node < TERRAPIN_NODES) &&
           (record->revoked <= TERRAPIN_IMAGE_KEYS);
}

static bool blank(const uint8_t *bytes) {
    bool all = true;
    for (uint32_t i = 0U; i < TERRAPIN_RECORD_SIZE; i++) {
        all = all && (bytes[i] == ERASED_BYTE);
    }
    return all;
}

/* A page that holds the newest record was erased whole before its first one, and is filled in order: its first blank
 * place ends it. What stands behind one in the other page (an erase that was cut) is older. */
static void find(const terrapin_flash *flash, position *where) {
    static const position nothing = {0};
    uint32_t used[PAGES] = {0};
    *where = nothing;
    for (uint32_t page = 0U; page < PAGES; page++) {
        const uint32_t count = pages[page].size / TERRAPIN_RECORD_SIZE;
        bool ended = false;
        while (!ended && (used[page] < count)) { /* each turn but the last takes a place */
            uint8_t bytes[TERRAPIN_RECORD_SIZE];
            terrapin_record record;
            uint32_t sequence = 0U;
            const uint32_t offset = pages[page].offset + (used[page] * TERRAPIN_RECORD_SIZE);
            const bool readable = flash->read(flash->context, offset, bytes, sizeof bytes);
            if (readable && blank(bytes)) {
                ended = true;
            } else {
                if (readable && decode(bytes, &record, &sequence) && (!where->any || (sequence > where->sequence))) {
                    where->any = true;
                    where->sequence = sequence;
                    where->page = page;
                    where->newest = record;
                }
                used[page]++;
            }
        }
    }
    where->next = used[where->page];
    TERRAPIN_ASSERT(where->next <= (pages[where->page].size / TERRAPIN_RECORD_SIZE));
}

static bool append(const terrapin_flash *flash, const position *where, uint32_t room, const terrapin_record *record) {
    TERRAPIN_ASSERT((where->page < PAGES) && (room >= 1U) && (room <= ROOM));
    uint8_t bytes[TERRAPIN_RECORD_SIZE];
    uint8_t back[TERRAPIN_RECORD_SIZE] = {0};
    uint32_t page = where->page;
    uint32_t place = where->next;
    bool good = true;
    if (!where->any || ((place + room) > (pages[page].size / TERRAPIN_RECORD_SIZE))) {
        page = where->any ? ((page + 1U) % PAGES) : 0U;
        place = 0U;
        good = flash->erase(flash->context, pages[page]);
    }
    TERRAPIN_ASSERT(place < (pages[page].size / TERRAPIN_RECORD_SIZE));
    const uint32_t offset = pages[page].offset + (place * TERRAPIN_RECORD_SIZE);
    encode(record, where->sequence + 1U, bytes);
    good = good && flash->write(flash->context, offset, bytes, sizeof bytes) &&
           flash->read(flash->context, offset, back, sizeof back);
    for (uint32_t i = 0U; i < TERRAPIN_RECORD_SIZE; i++) {
        good = good && (back[i] == bytes[i]);
    }
    return good;
}

void terrapin_records_read(const terrapin_flash *flash, terrapin_record *record) {
    position where;
    find(flash, &where);
    *record = where.newest;
}

bool terrapin_records_append(const terrapin_flash *flash, const terrapin_record *record) {
    position where;
    find(flash, &where);
    return append(flash, &where, 1U, record);
}

bool terrapin_records_set_node(const terrapin_flash *flash, uint8_t node) {
    terrapin_record record;
    terrapin_records_read(flash, &record);
    record.node = node;
    return terrapin_records_append(flash, &record);
}

bool terrapin_records_make_room(const terrapin_flash *flash) {
    position where;
    find(flash, &where);
    bool good = true;
    if (where.any && ((where.next + ROOM) > (pages[where.page].size / TERRAPIN_RECORD_SIZE))) {
        good = append(flash, &where, ROOM, &where.newest);
    }
    return good;
}
