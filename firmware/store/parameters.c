#include "parameters.h"

#include "crc32.h"
#include "terrapin_assert.h"

#define MAGIC      0x4D525054U /* "TPRM" */
#define UNIT       TERRAPIN_STORE_UNIT
#define ENTRY_SIZE 8U
#define CRC_SIZE   4U
#define CRC_AT     (UNIT - CRC_SIZE) /* in a set's last unit */
#define ERASED     0xFFU
#define PARAMETERS ((uint32_t)TERRAPIN_PARAMETER_COUNT)
#define MADE_FOR   ((uint32_t)TERRAPIN_ROBOT_IDENTITY | ((uint32_t)TERRAPIN_ROBOT_BOARD << 24U))

typedef struct {
    uint32_t entries;
    uint32_t sequence;
    uint32_t size; /* bytes of the whole set */
} set_head;

/* Bytes of a set: the head, the entries, and the CRC at the end of the last unit. */
static uint32_t set_size(uint32_t entries) {
    TERRAPIN_ASSERT(entries <= 0xFFFFU);
    return UNIT + (((entries * ENTRY_SIZE) + CRC_SIZE + (UNIT - 1U)) & ~(UNIT - 1U));
}

static uint32_t get_word(const uint8_t *bytes) {
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[3] << 24U);
}

static void put_word(uint8_t *bytes, uint32_t word) {
    for (uint32_t i = 0U; i < 4U; i++) {
        bytes[i] = (uint8_t)(word >> (8U * i));
    }
}

static bool read_unit(const terrapin_store *store, uint32_t offset, uint8_t unit[TERRAPIN_STORE_UNIT]) {
    return store->flash->read(store->flash->context, offset, unit, UNIT);
}

/* The head at an offset in flash, with `room` bytes left in its page. False when there is none of this layout. */
static bool read_head(const terrapin_store *store, uint32_t offset, uint32_t room, set_head *head) {
    uint8_t unit[TERRAPIN_STORE_UNIT];
    bool good = false;
    if (read_unit(store, offset, unit) && (get_word(unit) == MAGIC)) {
        const uint32_t kind = get_word(&unit[4]);
        head->entries = kind >> 16U;
        head->sequence = get_word(&unit[8]);
        head->size = set_size(head->entries);
        good = ((kind & 0xFFFFU) == TERRAPIN_STORE_LAYOUT) && (head->size <= room);
    }
    return good;
}

/* True when the CRC of the set at an offset in flash is right. */
static bool whole(const terrapin_store *store, uint32_t offset, uint32_t size) {
    TERRAPIN_ASSERT((size >= (2U * UNIT)) && ((size % UNIT) == 0U));
    uint8_t unit[TERRAPIN_STORE_UNIT] = {0};
    uint32_t crc = 0U;
    bool good = true;
    for (uint32_t at = 0U; good && (at < size); at += UNIT) {
        good = read_unit(store, offset + at, unit);
        crc = terrapin_crc32(crc, unit, ((at + UNIT) < size) ? UNIT : CRC_AT);
    }
    return good && (get_word(&unit[CRC_AT]) == crc);
}

/* True when the unit at an offset in flash can be written. */
static bool is_erased(const terrapin_store *store, uint32_t offset) {
    uint8_t unit[TERRAPIN_STORE_UNIT];
    bool erased = read_unit(store, offset, unit);
    for (uint32_t i = 0U; erased && (i < UNIT); i++) {
        erased = unit[i] == ERASED;
    }
    return erased;
}

/* Number of the parameter with this hash, PARAMETERS when there is none. Mostly it stands where it stood: at `guess`.
 */
static uint32_t find(uint32_t hash, uint32_t guess) {
    uint32_t index = PARAMETERS;
    if ((guess < PARAMETERS) && (terrapin_parameter_hashes[guess] == hash)) {
        index = guess;
    }
    for (uint32_t i = 0U; (index == PARAMETERS) && (i < PARAMETERS); i++) {
        if (terrapin_parameter_hashes[i] == hash) {
            index = i;
        }
    }
    return index;
}

static void count(uint16_t *counter) {
    *counter = (*counter < UINT16_MAX) ? (uint16_t)(*counter + 1U) : UINT16_MAX;
}

static void take_entry(terrapin_store *store, const uint8_t *bytes, uint32_t guess) {
    TERRAPIN_ASSERT(store->missing <= (uint16_t)PARAMETERS);
    const uint32_t index = find(get_word(bytes), guess);
    if (index == PARAMETERS) {
        count(&store->dropped);
    } else {
        const int32_t value = (int32_t)get_word(&bytes[4]);
        const terrapin_parameter_entry entry = terrapin_parameter((uint16_t)index);
        store->missing = (store->missing > 0U) ? (uint16_t)(store->missing - 1U) : 0U; /* each is named once */
        if ((value < entry.minimum) || (value > entry.maximum)) {
            count(&store->replaced);
        } else {
            store->value[index] = value;
        }
    }
}

/* The values of the newest set, over the defaults. */
static void load(terrapin_store *store) {
    set_head head = {0};
    store->dropped = 0U;
    store->replaced = 0U;
    store->missing = (uint16_t)PARAMETERS;
    terrapin_parameter_defaults(store->value);
    if ((store->origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED) && !store->foreign &&
        read_head(store, store->newest, UINT32_MAX, &head)) {
        for (uint32_t i = 0U; i < head.entries; i++) {
            uint8_t unit[TERRAPIN_STORE_UNIT];
            if (read_unit(store, store->newest + UNIT + ((i / 2U) * UNIT), unit)) {
                take_entry(store, ((i % 2U) == 0U) ? unit : &unit[ENTRY_SIZE], i);
            }
        }
    }
}

/* Look at every unit of a page: its newest whole set, where it ends, and whether there is anything else. */
static void scan(terrapin_store *store, uint8_t page) {
    TERRAPIN_ASSERT(page < 2U);
    const terrapin_flash_area area = store->page[page];
    uint32_t at = 0U;
    TERRAPIN_ASSERT(store->next[page] == 0U);
    while ((at + UNIT) <= area.size) {
        const uint32_t offset = area.offset + at;
        set_head head = {0};
        if (read_head(store, offset, area.size - at, &head) && whole(store, offset, head.size)) {
            const uint32_t ahead = head.sequence - store->sequence;
            if ((store->origin != (uint8_t)TERRAPIN_STORE_ORIGIN_STORED) || ((ahead - 1U) < 0x7FFFFFFFU)) {
                store->origin = (uint8_t)TERRAPIN_STORE_ORIGIN_STORED;
                store->newest = offset;
                store->sequence = head.sequence;
                store->active = page;
            }
            at += head.size;
            store->next[page] = at;
        } else {
            at += UNIT;
            if (!is_erased(store, offset)) {
                store->remains = true;
                store->next[page] = at;
            }
        }
    }
    TERRAPIN_ASSERT(store->next[page] <= area.size);
}

static bool usable(const terrapin_flash *flash, const terrapin_flash_area pages[2]) {
    const uint32_t needed = set_size(PARAMETERS);
    const terrapin_flash_area low = pages[(pages[0].offset <= pages[1].offset) ? 0 : 1];
    const terrapin_flash_area high = pages[(pages[0].offset <= pages[1].offset) ? 1 : 0];
    return (pages[0].size >= needed) && (pages[1].size >= needed) && ((high.offset - low.offset) >= low.size) &&
           (flash->write_size > 0U) && ((UNIT % flash->write_size) == 0U);
}

/* Whether the newest set is another robot's, whose values mean another body, in steps of another size, or another
 * board's, whose shunt and divider they hold. Before sets named a robot, 1 stood in that place; before they named a
 * board, 0 in its top byte. */
static bool of_another(const terrapin_store *store) {
    uint8_t unit[TERRAPIN_STORE_UNIT];
    bool other = false;
    if ((store->origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED) && read_unit(store, store->newest, unit)) {
        const uint32_t named = get_word(&unit[12]);
        other = (named != 1U) && (named != MADE_FOR) && (named != (uint32_t)TERRAPIN_ROBOT_IDENTITY);
    }
    return other;
}

bool terrapin_store_open(terrapin_store *store, const terrapin_flash *flash, const terrapin_flash_area pages[2]) {
    TERRAPIN_ASSERT((store != NULL) && (flash != NULL));
    static const terrapin_store fresh = {.origin = (uint8_t)TERRAPIN_STORE_ORIGIN_BLANK};
    *store = fresh;
    store->flash = flash;
    const bool good = usable(flash, pages);
    if (good) {
        store->page[0] = pages[0];
        store->page[1] = pages[1];
        scan(store, 0U);
        scan(store, 1U);
    }
    if (store->remains && (store->origin != (uint8_t)TERRAPIN_STORE_ORIGIN_STORED)) {
        store->origin = (uint8_t)TERRAPIN_STORE_ORIGIN_DAMAGED;
    }
    store->foreign = of_another(store);
    load(store);
    return good;
}

/* Where equal sets are the dear case, four at a time take two thirds of what one by one does. 0: they are equal. */
static inline uint32_t four_differ(const int32_t *a, const int32_t *b) {
    const uint32_t first = ((uint32_t)a[0] ^ (uint32_t)b[0]) | ((uint32_t)a[1] ^ (uint32_t)b[1]);
    return first | ((uint32_t)a[2] ^ (uint32_t)b[2]) | ((uint32_t)a[3] ^ (uint32_t)b[3]);
}

bool terrapin_store_differs(const terrapin_store *store, const terrapin_state *state) {
    const int32_t *now = terrapin_parameter_values(state); /* without a call for each: floods must cost little */
    const uint32_t last = PARAMETERS - 4U; /* some of them are looked at twice where they are no multiple of four */
    uint32_t bits = four_differ(&now[last], &store->value[last]);
    for (uint32_t i = 0U; i < last; i += 4U) {
        bits |= four_differ(&now[i], &store->value[i]);
    }
    return bits != 0U;
}

/* The other page than the newest set's, from its start. */
static void begin_page(terrapin_store *store) {
    TERRAPIN_ASSERT(store->active < 2U);
    const bool stored = store->origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED;
    store->target = (stored && (store->active == 0U)) ? 1U : 0U;
    store->phase = TERRAPIN_STORE_ERASE;
}

bool terrapin_store_save(terrapin_store *store, const terrapin_state *state) {
    TERRAPIN_ASSERT((store != NULL) && (state != NULL));
    if (store->page[0].size == 0U) { /* terrapin_store_open refused the pages */
        store->failed = true;
        return false;
    }
    if (store->phase != TERRAPIN_STORE_IDLE) {
        return false;
    }
    for (uint32_t i = 0U; i < PARAMETERS; i++) {
        (void)terrapin_parameter_get(state, (uint16_t)i, &store->value[i]); /* known */
    }
    store->failed = false;
    store->written = 0U;
    store->crc = 0U;
    const uint32_t room = store->page[store->active].size - store->next[store->active];
    if ((store->origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED) && (room >= set_size(PARAMETERS))) {
        store->target = store->active;
        store->phase = TERRAPIN_STORE_WRITE;
    } else {
        begin_page(store);
    }
    return true;
}

/* Where the set that is being written begins. */
static uint32_t place(const terrapin_store *store) {
    TERRAPIN_ASSERT(store->target < 2U);
    TERRAPIN_ASSERT((store->next[store->target] + set_size(PARAMETERS)) <= store->page[store->target].size);
    return store->page[store->target].offset + store->next[store->target];
}

/* A write went wrong. In the newest set's page there may be a bad spot: the other page is tried. It is never the one
 * that holds the newest whole set that is erased. */
static void give_up(terrapin_store *store) {
    TERRAPIN_ASSERT(store->phase != TERRAPIN_STORE_IDLE);
    const bool stored = store->origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED;
    if (stored && (store->target == store->active)) {
        store->next[store->active] = store->page[store->active].size; /* nothing is written here before an erase */
        store->written = 0U;
        store->crc = 0U;
        begin_page(store);
    } else {
        store->phase = TERRAPIN_STORE_IDLE;
        store->failed = true;
        load(store); /* what stands in flash counts again */
    }
}

static void make_unit(terrapin_store *store, uint8_t unit[TERRAPIN_STORE_UNIT]) {
    TERRAPIN_ASSERT((store->written % UNIT) == 0U);
    TERRAPIN_ASSERT(store->written < set_size(PARAMETERS));
    for (uint32_t i = 0U; i < UNIT; i++) {
        unit[i] = ERASED;
    }
    if (store->written == 0U) {
        put_word(unit, MAGIC);
        put_word(&unit[4], TERRAPIN_STORE_LAYOUT | (PARAMETERS << 16U));
        put_word(&unit[8], store->sequence + 1U);
        put_word(&unit[12], MADE_FOR);
    } else {
        const uint32_t first = ((store->written - UNIT) / UNIT) * 2U;
        uint8_t *entry = unit;
        for (uint32_t i = first; (i < (first + 2U)) && (i < PARAMETERS); i++) {
            put_word(entry, terrapin_parameter_hashes[i]);
            put_word(&entry[4], (uint32_t)store->value[i]);
            entry = &unit[ENTRY_SIZE];
        }
    }
    const bool last = (store->written + UNIT) == set_size(PARAMETERS);
    store->crc = terrapin_crc32(store->crc, unit, UNIT - (last ? CRC_SIZE : 0U));
    if (last) {
        put_word(&unit[CRC_AT], store->crc);
    }
}

static void write_piece(terrapin_store *store) {
    uint8_t unit[TERRAPIN_STORE_UNIT];
    make_unit(store, unit);
    if (store->flash->write(store->flash->context, place(store) + store->written, unit, UNIT)) {
        store->written += UNIT;
        store->phase = (store->written == set_size(PARAMETERS)) ? TERRAPIN_STORE_VERIFY : TERRAPIN_STORE_WRITE;
    } else {
        give_up(store);
    }
}

static void verify(terrapin_store *store) {
    TERRAPIN_ASSERT(store->written == set_size(PARAMETERS));
    const uint32_t size = set_size(PARAMETERS);
    const uint32_t offset = place(store);
    set_head head = {0};
    if (read_head(store, offset, size, &head) && whole(store, offset, size) &&
        (head.sequence == (store->sequence + 1U))) {
        store->newest = offset;
        store->sequence = head.sequence;
        store->active = store->target;
        store->next[store->active] += size;
        store->origin = (uint8_t)TERRAPIN_STORE_ORIGIN_STORED;
        store->foreign = false;
        store->phase = TERRAPIN_STORE_IDLE;
        store->dropped = 0U;
        store->replaced = 0U;
        store->missing = 0U;
    } else {
        give_up(store);
    }
}

bool terrapin_store_work(terrapin_store *store, bool may_erase) {
    TERRAPIN_ASSERT(store->phase <= TERRAPIN_STORE_VERIFY);
    TERRAPIN_ASSERT((store->active < 2U) && (store->target < 2U));
    switch (store->phase) {
    case TERRAPIN_STORE_ERASE:
        if (!may_erase) {
            /* waits for the bridge to go off */
        } else if (store->flash->erase(store->flash->context, store->page[store->target])) {
            store->next[store->target] = 0U;
            store->phase = TERRAPIN_STORE_WRITE;
        } else {
            store->next[store->target] = store->page[store->target].size;
            give_up(store);
        }
        break;
    case TERRAPIN_STORE_WRITE:
        write_piece(store);
        break;
    case TERRAPIN_STORE_VERIFY:
        verify(store);
        break;
    case TERRAPIN_STORE_IDLE:
    default:
        break;
    }
    return store->phase != TERRAPIN_STORE_IDLE;
}
