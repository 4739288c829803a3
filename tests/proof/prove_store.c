/* The parameter store on a flash that holds anything and fails when it likes: what is read of it stays within the unit,
 * every piece of a save lies in its page, and never in the newest set. Bounded: the scan's pages have four units, and a
 * set that is read names at most three parameters (more of either are more turns of the same loops). */
#include "proof.h"

#include "store/parameters.c" /* and not the core's */

#define SCANNED 64U
#define NAMED   3U
#define SET     (16U + ((((uint32_t)TERRAPIN_PARAMETER_COUNT * 8U) + 4U + 15U) / 16U * 16U))

const uint32_t terrapin_parameter_hashes[TERRAPIN_PARAMETER_COUNT];

static terrapin_store store;
static int32_t values[TERRAPIN_PARAMETER_COUNT];

const int32_t *terrapin_parameter_values(const terrapin_state *state) {
    (void)state;
    return values;
}

terrapin_parameter_result terrapin_parameter_get(const terrapin_state *state, uint16_t index, int32_t *value) {
    (void)state;
    PROVE(index < TERRAPIN_PARAMETER_COUNT);
    *value = nondet_int();
    return TERRAPIN_PARAMETER_OK;
}

terrapin_parameter_entry terrapin_parameter(uint16_t index) {
    terrapin_parameter_entry entry;
    PROVE(index < TERRAPIN_PARAMETER_COUNT);
    ANYTHING(entry);
    return entry;
}

void terrapin_parameter_defaults(int32_t *to) {
    PROVE(__CPROVER_w_ok(to, sizeof values));
    __CPROVER_havoc_slice(to, sizeof values);
}

uint32_t terrapin_crc32(uint32_t crc, const uint8_t *bytes, size_t size) {
    (void)crc;
    PROVE(__CPROVER_r_ok(bytes, size));
    return nondet_word();
}

static bool read(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    (void)context;
    (void)offset; /* a driver refuses what is outside (flash.h) */
    PROVE((size == UNIT) && __CPROVER_w_ok(bytes, size));
    __CPROVER_havoc_slice(bytes, size);
    ASSUME((((uint32_t)bytes[7] << 8U) | bytes[6]) <= NAMED);
    return nondet_bool();
}

static bool write(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    (void)context;
    const terrapin_flash_area area = store.page[store.target];
    PROVE((size == UNIT) && __CPROVER_r_ok(bytes, size) && ((offset % UNIT) == 0U));
    PROVE((offset >= area.offset) && ((offset - area.offset) <= (area.size - size)));
    const bool stored = store.origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED;
    PROVE(!stored || (store.target != store.active) || (offset >= (area.offset + store.next[store.active])));
    return nondet_bool();
}

static bool may_erase;

static bool erase(void *context, terrapin_flash_area area) {
    (void)context;
    PROVE(may_erase && (area.offset == store.page[store.target].offset));
    PROVE((store.origin != (uint8_t)TERRAPIN_STORE_ORIGIN_STORED) || (store.target != store.active));
    return nondet_bool();
}

/* What terrapin_store_open makes so of pages that are usable, and every piece of a save leaves so. */
static bool sound(void) {
    bool good = (store.active < 2U) && (store.target < 2U) && (store.missing <= (uint16_t)PARAMETERS) &&
                (store.phase <= TERRAPIN_STORE_VERIFY);
    for (uint32_t i = 0U; i < 2U; i++) {
        good = good && (store.page[i].size >= SET) && (store.page[i].size <= 0x100000U) &&
               (store.page[i].offset <= 0x100000U) && ((store.page[i].offset % UNIT) == 0U) &&
               (store.next[i] <= store.page[i].size) &&
               (((store.next[i] % UNIT) == 0U) || (store.next[i] == store.page[i].size));
    }
    const bool stored = store.origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED;
    const bool writing = (store.phase == TERRAPIN_STORE_WRITE) || (store.phase == TERRAPIN_STORE_VERIFY);
    if (good && writing) {
        good = ((store.next[store.target] % UNIT) == 0U) &&
               ((store.page[store.target].size - store.next[store.target]) >= SET);
    }
    good = good && ((store.phase != TERRAPIN_STORE_ERASE) ||
                    ((store.written == 0U) && (!stored || (store.target != store.active))));
    good = good && ((store.phase != TERRAPIN_STORE_WRITE) || ((store.written < SET) && ((store.written % UNIT) == 0U)));
    return good && ((store.phase != TERRAPIN_STORE_VERIFY) || (store.written == SET));
}

int main(void) {
    terrapin_state *const state = (terrapin_state *)values; /* never looked into here */
    const terrapin_flash flash = {.write_size = 4U, .read = read, .write = write, .erase = erase};
    const uint8_t what = nondet_byte() % 3U;
    ANYTHING(store);
    ANYTHING(values);
    ANYTHING(terrapin_parameter_hashes);
    store.flash = &flash;
    may_erase = nondet_bool();
    if (what == 0U) { /* a page is looked through: any place, any contents */
        const uint8_t page = nondet_byte() % 2U;
        store.page[page].size = SCANNED;
        ASSUME(store.page[page].offset <= (UINT32_MAX - SCANNED));
        store.next[page] = 0U;
        scan(&store, page);
        PROVE(store.next[page] <= store.page[page].size);
        load(&store);
        (void)find(nondet_word(), nondet_word());
        (void)of_another(&store);
    } else {
        ASSUME(sound());
        if (what == 1U) {
            (void)terrapin_store_work(&store, may_erase);
        } else {
            (void)terrapin_store_save(&store, state);
        }
        PROVE(sound());
        (void)terrapin_store_differs(&store, state);
    }
    return 0;
}
