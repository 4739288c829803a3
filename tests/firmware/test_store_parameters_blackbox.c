/* The parameter store on an emulated flash: power cut at every write and erase, wear, full and damaged pages, sets of
 * another firmware. */
#include <stdlib.h>
#include <string.h>

#include "unity.h"

#include "crc32.h"
#include "flash_emulated.c"
#include "parameters.h"

#define PAGE     16384U
#define COUNT    TERRAPIN_PARAMETER_COUNT
#define SET_SIZE (16U + ((((uint32_t)COUNT * 8U) + 4U + 15U) / 16U * 16U))
#define A_PAGE   (PAGE / SET_SIZE) /* sets that fit in one */

static const uint32_t sectors[2] = {PAGE, PAGE};
static const terrapin_flash_area pages[3] = {{0U, PAGE}, {PAGE, PAGE}, {UINT32_MAX, 0U}}; /* two, and no third */
static uint8_t bytes[2U * PAGE];
static terrapin_flash_emulated memory;
static terrapin_flash flash;
static terrapin_store store;
static terrapin_state *state;

/* The state after a reset, with the stored parameters. */
static void restart(void) {
    terrapin_flash_emulated_power_on(&memory);
    terrapin_init(state);
    TEST_ASSERT_TRUE(terrapin_store_open(&store, &flash, pages));
    (void)terrapin_parameter_set_all(state, store.value);
}

static void virgin(uint32_t write_size) {
    memset(bytes, 0xFF, sizeof bytes);
    terrapin_flash_emulated_init(&memory, bytes, sectors, 2U, write_size);
    flash = terrapin_flash_emulated_driver(&memory);
    restart();
}

void setUp(void) {
    state = malloc(terrapin_state_size());
    TEST_ASSERT_NOT_NULL(state);
    virgin(4U);
}

void tearDown(void) {
    TEST_ASSERT_EQUAL_UINT32(0, memory.misuse);
    free(state);
}

/* A value of parameter i that is in range and differs from one generation to the next wherever the range allows it. */
static int32_t value_of(uint16_t i, uint32_t generation) {
    const terrapin_parameter_entry e = terrapin_parameter((uint16_t)i);
    const uint32_t span = (uint32_t)e.maximum - (uint32_t)e.minimum + 1U;
    return (int32_t)((uint32_t)e.minimum + ((generation + i) % span));
}

static void set_all(uint32_t generation) {
    for (uint16_t i = 0; i < COUNT; i++) {
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set(state, i, value_of(i, generation)));
    }
}

static bool has_all(uint32_t generation) {
    bool same = true;
    for (uint16_t i = 0; i < COUNT; i++) {
        int32_t value = 0;
        same = same && (terrapin_parameter_get(state, i, &value) == TERRAPIN_PARAMETER_OK) &&
               (value == value_of(i, generation));
    }
    return same;
}

static bool has_defaults(void) {
    bool same = true;
    for (uint16_t i = 0; i < COUNT; i++) {
        int32_t value = 0;
        same = same && (terrapin_parameter_get(state, i, &value) == TERRAPIN_PARAMETER_OK) &&
               (value == terrapin_parameter((uint16_t)i).default_value);
    }
    return same;
}

/* The save of what stands, to its end; the pieces that it took. */
static uint32_t save(void) {
    uint32_t pieces = 1U;
    TEST_ASSERT_TRUE(terrapin_store_save(&store, state));
    while (terrapin_store_work(&store, true)) {
        pieces++;
        TEST_ASSERT_LESS_THAN_UINT32(1000U, pieces);
    }
    return pieces;
}

static void save_generation(uint32_t generation) {
    set_all(generation);
    (void)save();
    TEST_ASSERT_FALSE(store.failed);
}

static void test_nothing_stored_is_blank_and_defaults(void) {
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_BLANK, store.origin);
    TEST_ASSERT_FALSE(store.foreign);
    TEST_ASSERT_TRUE(has_defaults());
    TEST_ASSERT_FALSE(terrapin_store_differs(&store, state));
    TEST_ASSERT_EQUAL_UINT32(0, memory.operations);
}

static void test_all_at_once_or_none(void) {
    int32_t values[COUNT];
    for (uint16_t i = 0; i < COUNT; i++) {
        values[i] = value_of(i, 3U);
    }
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set_all(state, values));
    TEST_ASSERT_TRUE(has_all(3U));
    for (uint16_t i = 0; i < COUNT; i++) {
        values[i] = terrapin_parameter((uint16_t)i).minimum - 1;
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_RANGE, terrapin_parameter_set_all(state, values));
        values[i] = terrapin_parameter((uint16_t)i).maximum + 1;
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_RANGE, terrapin_parameter_set_all(state, values));
        values[i] = value_of(i, 4U);
    }
    TEST_ASSERT_TRUE(has_all(3U));
    TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set_all(state, NULL));
    TEST_ASSERT_TRUE(has_defaults());
}

/* What stands behind the values is none of them, whatever it is. */
static void test_equal_values_before_anything(void) {
    static struct {
        terrapin_store store;
        int32_t behind;
    } guarded;
    save_generation(1U);
    for (int fill = 0; fill < 2; fill++) {
        memset(&guarded, fill, sizeof guarded);
        memcpy(&guarded.store, &store, offsetof(terrapin_store, value) + sizeof store.value);
        TEST_ASSERT_FALSE(terrapin_store_differs(&guarded.store, state));
    }
}

static void test_saved_values_come_back(void) {
    save_generation(1U);
    TEST_ASSERT_FALSE(terrapin_store_differs(&store, state));
    set_all(2U);
    TEST_ASSERT_TRUE(terrapin_store_differs(&store, state));
    set_all(1U);
    for (int32_t i = 0; i < TERRAPIN_PARAMETER_COUNT; i++) { /* one bit of any one of them is enough */
        store.value[i] ^= 4;
        TEST_ASSERT_TRUE(terrapin_store_differs(&store, state));
        store.value[i] ^= 4;
    }
    restart();
    TEST_ASSERT_TRUE(has_all(1U));
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_STORED, store.origin);
    TEST_ASSERT_EQUAL_UINT32(1U, store.sequence);
    TEST_ASSERT_FALSE(store.remains);
    TEST_ASSERT_EQUAL_UINT16(0, store.missing);
    for (uint32_t i = 16U + ((uint32_t)COUNT * 8U); i < (SET_SIZE - 4U); i++) {
        TEST_ASSERT_EQUAL_HEX8(0xFFU, bytes[i]); /* between entries and CRC */
    }
}

static void test_every_width_of_write(void) {
    for (uint32_t width = 1U; width <= 16U; width *= 2U) {
        virgin(width);
        save_generation(width);
        restart();
        TEST_ASSERT_TRUE(has_all(width));
    }
}

static void test_pieces_are_bounded(void) {
    for (uint32_t generation = 0U; generation < (2U * A_PAGE); generation++) {
        set_all(generation);
        TEST_ASSERT_TRUE(terrapin_store_save(&store, state));
        TEST_ASSERT_FALSE(terrapin_store_save(&store, state)); /* one at a time */
        bool more = true;
        while (more) {
            const uint32_t before = memory.operations;
            more = terrapin_store_work(&store, true);
            TEST_ASSERT_LESS_OR_EQUAL_UINT32(4U, memory.operations - before); /* 16 bytes, or one erase */
        }
    }
}

static void test_erase_waits_for_the_bridge(void) {
    set_all(1U);
    TEST_ASSERT_TRUE(terrapin_store_save(&store, state));
    for (int i = 0; i < 1000; i++) {
        TEST_ASSERT_TRUE(terrapin_store_work(&store, false));
    }
    TEST_ASSERT_EQUAL_UINT32(0, memory.operations);
    set_all(2U); /* after the save was asked for: not of this set */
    while (terrapin_store_work(&store, true)) {
    }
    set_all(3U);
    TEST_ASSERT_TRUE(terrapin_store_save(&store, state));
    while (terrapin_store_work(&store, false)) { /* room is left: nothing to erase */
    }
    restart();
    TEST_ASSERT_TRUE(has_all(3U));
    memory.cut_at = TERRAPIN_FLASH_EMULATED_NEVER;
    memset(&bytes[SET_SIZE], 0xFF, PAGE - SET_SIZE); /* as if the second save had not been */
    restart();
    TEST_ASSERT_TRUE(has_all(1U));
}

/* ---- power cuts */

static const terrapin_flash_cut cuts[] = {TERRAPIN_FLASH_CUT_BEFORE, TERRAPIN_FLASH_CUT_AFTER, TERRAPIN_FLASH_CUT_TORN,
                                          TERRAPIN_FLASH_CUT_PART, TERRAPIN_FLASH_CUT_NOISE};
static uint32_t starts; /* after a cut, in all tests */

/* After `before` good saves (the last is generation `before`), a save of the next generation whose operation `at` is
 * cut. Returns false when the save ended before that operation. The memory is left as the cut left it. */
static bool cut_save(const uint8_t *image, uint32_t before, uint32_t at, terrapin_flash_cut cut, uint32_t random) {
    memcpy(bytes, image, sizeof bytes);
    restart();
    set_all(before + 1U);
    memory.random = random;
    memory.cut = cut;
    memory.operations = 0U;
    memory.cut_at = at;
    (void)save();
    const bool happened = memory.off;
    TEST_ASSERT_EQUAL(happened, store.failed);
    starts++;
    restart();
    return happened;
}

static bool old_or_new(uint32_t before) {
    const bool old_stands = (before == 0U) ? has_defaults() : has_all(before);
    return old_stands || has_all(before + 1U);
}

/* Cut at every operation of the save that follows `before` good ones. */
static void cut_everywhere(uint32_t before, uint32_t write_size) {
    static uint8_t image[sizeof bytes];
    virgin(write_size);
    for (uint32_t generation = 1U; generation <= before; generation++) {
        save_generation(generation);
    }
    memcpy(image, bytes, sizeof image);
    uint32_t points = 0U;
    for (uint32_t kind = 0U; kind < (sizeof cuts / sizeof cuts[0]); kind++) {
        uint32_t at = 0U;
        while (cut_save(image, before, at, cuts[kind], 77U + (at * 5U) + kind)) {
            TEST_ASSERT_TRUE_MESSAGE(old_or_new(before), "a set that is neither the old nor the new one");
            TEST_ASSERT_TRUE((before == 0U) || (store.origin == (uint8_t)TERRAPIN_STORE_ORIGIN_STORED));
            save_generation(before + 2U); /* no brick */
            restart();
            TEST_ASSERT_TRUE(has_all(before + 2U));
            at++;
        }
        TEST_ASSERT_TRUE(has_all(before + 1U)); /* no cut: the new one */
        points = at;
    }
    const uint32_t writes = SET_SIZE / write_size;
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(writes, points); /* every write, and the erase where there is one */
    TEST_ASSERT_EQUAL_UINT32(writes + (((before % A_PAGE) == 0U) ? 1U : 0U), points);
}

static void test_power_cut_in_the_first_save_ever(void) {
    cut_everywhere(0U, 4U);
}

static void test_power_cut_in_a_save_that_appends(void) {
    cut_everywhere(1U, 4U);
    cut_everywhere(A_PAGE + 3U, 4U);
    cut_everywhere(2U, 16U);
    cut_everywhere(2U, 1U);
}

static void test_power_cut_in_a_save_that_erases(void) {
    cut_everywhere(A_PAGE, 4U);
    cut_everywhere(2U * A_PAGE, 4U);
    cut_everywhere(3U * A_PAGE, 8U);
}

/* The save after a cut one is cut as well. */
static void cut_twice(uint32_t before) {
    static uint8_t image[sizeof bytes];
    static uint8_t after[sizeof bytes];
    virgin(4U);
    for (uint32_t generation = 1U; generation <= before; generation++) {
        save_generation(generation);
    }
    memcpy(image, bytes, sizeof image);
    for (uint32_t first = 0U; first <= (SET_SIZE / 4U); first += 7U) {
        for (uint32_t second = first % 5U; second <= (SET_SIZE / 4U); second += 17U) {
            const terrapin_flash_cut cut = cuts[(first + second) % 5U];
            if (cut_save(image, before, first, cut, 3U + first + second)) {
                const uint32_t stands = has_all(before + 1U) ? (before + 1U) : before;
                memcpy(after, bytes, sizeof after);
                (void)cut_save(after, stands, second, cuts[(first + (3U * second)) % 5U], 9U + first + second);
                TEST_ASSERT_TRUE_MESSAGE(old_or_new(stands), "a set that is neither the old nor the new one");
                save_generation(before + 3U);
                restart();
                TEST_ASSERT_TRUE(has_all(before + 3U));
            }
        }
    }
}

static void test_power_cut_again_in_the_next_save(void) {
    cut_twice(3U);
    cut_twice(A_PAGE);
    cut_twice(A_PAGE - 1U);
    char text[80];
    (void)snprintf(text, sizeof text, "%lu starts after a cut", (unsigned long)starts);
    TEST_MESSAGE(text);
}

/* ---- wear and damage */

static void test_a_thousand_saves(void) {
    uint32_t erased = 0U;
    for (uint32_t generation = 1U; generation <= 1000U; generation++) {
        const uint32_t before = memory.operations;
        save_generation(generation);
        erased += (memory.operations - before) - (SET_SIZE / 4U);
        if ((generation % 37U) == 0U) {
            restart();
            TEST_ASSERT_TRUE(has_all(generation));
        }
    }
    restart();
    TEST_ASSERT_TRUE(has_all(1000U));
    TEST_ASSERT_EQUAL_UINT32(1000U, store.sequence);
    TEST_ASSERT_EQUAL_UINT32((1000U + A_PAGE - 1U) / A_PAGE, erased); /* shared by two pages */
}

static void test_garbage_in_both_pages_gives_defaults_and_says_so(void) {
    for (uint32_t seed = 1U; seed <= 20U; seed++) {
        uint32_t x = seed;
        for (uint32_t i = 0U; i < sizeof bytes; i++) {
            x = (x * 1664525U) + 1013904223U;
            bytes[i] = (uint8_t)(x >> 24U);
        }
        restart();
        TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_DAMAGED, store.origin);
        TEST_ASSERT_TRUE(has_defaults());
        save_generation(5U);
        restart();
        TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_STORED, store.origin);
        TEST_ASSERT_TRUE(has_all(5U));
    }
}

/* A flash that corrects errors, and says of one unit that it could not, brings bytes all the same: good or not. */
static uint32_t doubtful;
static bool read_doubtfully(void *context, uint32_t offset, uint8_t *to, uint32_t size) {
    const bool good = flash.read(context, offset, to, size);
    return good && ((doubtful < offset) || (doubtful >= (offset + size)));
}

static void test_what_the_flash_does_not_stand_for_is_not_read(void) {
    terrapin_flash other = flash;
    other.read = read_doubtfully;
    save_generation(1U);
    save_generation(2U);
    const uint32_t newest = store.newest;
    for (doubtful = newest + SET_SIZE - 1U; doubtful > newest; doubtful -= 16U) {
        TEST_ASSERT_TRUE(terrapin_store_open(&store, &other, pages));
        TEST_ASSERT_NOT_EQUAL(newest, store.newest);
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_set_all(state, store.value));
        TEST_ASSERT_TRUE(has_all(1U));
    }
    doubtful = newest + SET_SIZE;
    TEST_ASSERT_TRUE(terrapin_store_open(&store, &other, pages));
    TEST_ASSERT_EQUAL_UINT32(newest, store.newest);
}

static void test_zeros_everywhere_are_damage(void) {
    memset(bytes, 0, sizeof bytes);
    restart();
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_DAMAGED, store.origin);
    save_generation(1U);
    restart();
    TEST_ASSERT_TRUE(has_all(1U));
}

static void test_each_flipped_bit_of_the_newest_set_leaves_the_one_before(void) {
    save_generation(1U);
    save_generation(2U);
    for (uint32_t bit = 0U; bit < (SET_SIZE * 8U); bit += 3U) {
        uint8_t *byte = &bytes[SET_SIZE + (bit / 8U)];
        const bool padding = (bit / 8U) >= (16U + ((uint32_t)COUNT * 8U)); /* covered by the CRC as well */
        *byte ^= (uint8_t)(1U << (bit % 8U));
        restart();
        TEST_ASSERT_TRUE_MESSAGE(has_all(1U), padding ? "in the padding or the CRC" : "in the head or an entry");
        TEST_ASSERT_TRUE(store.remains);
        *byte ^= (uint8_t)(1U << (bit % 8U));
    }
    restart();
    TEST_ASSERT_TRUE(has_all(2U));
}

static uint32_t bad_from, bad_to; /* writes in here do not succeed */

static bool bad_write(void *context, uint32_t offset, const uint8_t *data, uint32_t size) {
    return !((offset >= bad_from) && (offset < bad_to)) &&
           terrapin_flash_emulated_driver(context).write(context, offset, data, size);
}

static bool lying_write(void *context, uint32_t offset, const uint8_t *data, uint32_t size) {
    const bool bad = (offset >= bad_from) && (offset < bad_to);
    return bad || terrapin_flash_emulated_driver(context).write(context, offset, data, size);
}

static void test_a_bad_spot_moves_the_set_to_the_other_page(void) {
    bool (*const drivers[])(void *, uint32_t, const uint8_t *, uint32_t) = {bad_write, lying_write};
    for (uint32_t i = 0U; i < 2U; i++) { /* a write that is refused, and one that only says it succeeded */
        virgin(4U);
        save_generation(1U);
        flash.write = drivers[i];
        bad_from = SET_SIZE + 160U;
        bad_to = bad_from + 16U;
        save_generation(2U);
        TEST_ASSERT_EQUAL_UINT8(1U, store.active);
        restart();
        TEST_ASSERT_TRUE(has_all(2U));
        bad_from = 0U;
        bad_to = 2U * PAGE; /* and now nothing can be written at all */
        set_all(3U);
        (void)save();
        TEST_ASSERT_TRUE(store.failed);
        TEST_ASSERT_TRUE(terrapin_store_differs(&store, state));
        restart();
        TEST_ASSERT_TRUE(has_all(2U));
    }
}

/* A page takes the last set for which there is room to the byte. */
static void test_a_page_is_filled_to_its_last_byte(void) {
    const terrapin_flash_area two_each[2] = {{0U, 2U * SET_SIZE}, {PAGE, 2U * SET_SIZE}};
    const uint32_t four[4] = {2U * SET_SIZE, PAGE - (2U * SET_SIZE), 2U * SET_SIZE, PAGE - (2U * SET_SIZE)};
    terrapin_flash_emulated_init(&memory, bytes, four, 4U, 4U);
    for (uint32_t generation = 1U; generation <= 5U; generation++) {
        if (generation == 1U) {
            TEST_ASSERT_TRUE(terrapin_store_open(&store, &flash, two_each));
        }
        const uint32_t before = memory.operations;
        save_generation(generation);
        const bool erases = (generation % 2U) == 1U;
        TEST_ASSERT_EQUAL_UINT32((SET_SIZE / 4U) + (erases ? 1U : 0U), memory.operations - before);
    }
}

/* Both pages fail under a save; the next one begins with an erase and writes over nothing (tearDown counts that). What
 * stands in flash counts meanwhile. */
static void test_after_a_save_that_failed_in_both_pages(void) {
    save_generation(1U);
    save_generation(2U);
    flash.write = bad_write;
    bad_from = (2U * SET_SIZE) + 160U; /* some units of the third set are written, in either page */
    bad_to = 2U * PAGE;
    set_all(3U);
    (void)save();
    TEST_ASSERT_TRUE(store.failed);
    set_all(2U);
    TEST_ASSERT_FALSE(terrapin_store_differs(&store, state));
    bad_to = 0U;
    save_generation(4U);
    TEST_ASSERT_EQUAL_UINT8(1U, store.active);
    restart();
    TEST_ASSERT_TRUE(has_all(4U));
}

static void test_pages_of_one_set_in_either_order(void) {
    const terrapin_flash_area one_each[2] = {{PAGE, SET_SIZE}, {PAGE - SET_SIZE, SET_SIZE}};
    const uint32_t four[4] = {PAGE - SET_SIZE, SET_SIZE, SET_SIZE, PAGE - SET_SIZE};
    terrapin_flash_emulated_init(&memory, bytes, four, 4U, 4U);
    for (uint32_t generation = 1U; generation < 4U; generation++) {
        TEST_ASSERT_TRUE(terrapin_store_open(&store, &flash, one_each));
        save_generation(generation);
        TEST_ASSERT_TRUE(terrapin_store_open(&store, &flash, one_each));
        (void)terrapin_parameter_set_all(state, store.value);
        TEST_ASSERT_TRUE(has_all(generation));
    }
}

static void test_pages_that_cannot_be_used_are_never_touched(void) {
    const terrapin_flash_area bad[][2] = {
        {{0U, SET_SIZE - 16U}, {PAGE, PAGE}},   {{0U, PAGE}, {PAGE, SET_SIZE - 16U}}, /* too small */
        {{0U, PAGE}, {PAGE - 16U, PAGE}},       {{PAGE - 16U, PAGE}, {0U, PAGE}},     /* one reaches into the other */
        {{PAGE / 2U, PAGE}, {PAGE, PAGE / 2U}}, {{PAGE, PAGE}, {PAGE, PAGE}},
    };
    for (uint32_t i = 0U; i < (sizeof bad / sizeof bad[0]); i++) {
        TEST_ASSERT_FALSE(terrapin_store_open(&store, &flash, bad[i]));
        TEST_ASSERT_FALSE(terrapin_store_save(&store, state));
        TEST_ASSERT_TRUE(store.failed);
    }
    const uint32_t widths[] = {0U, 3U, 32U};
    for (uint32_t i = 0U; i < 3U; i++) { /* no unit is so many writes */
        flash.write_size = widths[i];
        TEST_ASSERT_FALSE(terrapin_store_open(&store, &flash, pages));
        TEST_ASSERT_FALSE(terrapin_store_save(&store, state));
    }
    TEST_ASSERT_FALSE(terrapin_store_work(&store, true));
    (void)terrapin_parameter_set_all(state, store.value);
    TEST_ASSERT_TRUE(has_defaults());
    TEST_ASSERT_EQUAL_UINT32(0, memory.operations);
}

/* ---- sets of other firmware, made by hand from the layout in parameters.h */

static uint8_t *made;
static uint32_t made_entries;

static void put(uint8_t *to, uint32_t word) {
    for (uint32_t i = 0U; i < 4U; i++) {
        to[i] = (uint8_t)(word >> (8U * i));
    }
}

static void make_begin(uint32_t offset) {
    made = &bytes[offset];
    made_entries = 0U;
}

static void make_entry(uint32_t hash, int32_t value) {
    put(&made[16U + (8U * made_entries)], hash);
    put(&made[20U + (8U * made_entries)], (uint32_t)value);
    made_entries++;
}

static void make_end_for(uint32_t robot, uint32_t layout, uint32_t sequence) {
    const uint32_t size = 16U + (((made_entries * 8U) + 4U + 15U) / 16U * 16U);
    put(made, 0x4D525054U);
    put(&made[4], layout | (made_entries << 16U));
    put(&made[8], sequence);
    put(&made[12], robot);
    put(&made[size - 4U], terrapin_crc32(0U, made, size - 4U));
}

static void make_end(uint32_t layout, uint32_t sequence) {
    make_end_for(TERRAPIN_ROBOT_IDENTITY, layout, sequence);
}

static void make_one_for(uint32_t robot, uint32_t offset, uint32_t sequence) {
    make_begin(offset);
    make_entry(terrapin_parameter_hashes[0], value_of(0U, 1U));
    make_end_for(robot, 1U, sequence);
}

/* Its values are in range here, and mean another body. */
static void test_a_set_of_another_robot_gives_defaults_and_says_so(void) {
    make_one_for(TERRAPIN_ROBOT_IDENTITY, 0U, 1U);
    make_one_for(TERRAPIN_ROBOT_IDENTITY + 1U, 64U, 2U);
    restart();
    TEST_ASSERT_TRUE(store.foreign);
    TEST_ASSERT_TRUE(has_defaults());
    save_generation(6U);
    restart();
    TEST_ASSERT_FALSE(store.foreign);
    TEST_ASSERT_EQUAL_UINT32(3U, store.sequence);
    TEST_ASSERT_TRUE(has_all(6U));
}

/* Its shunt and divider are others. */
static void test_a_set_of_another_board_gives_defaults_and_says_so(void) {
    const uint32_t own = (uint32_t)TERRAPIN_ROBOT_IDENTITY | ((uint32_t)TERRAPIN_ROBOT_BOARD << 24U);
    make_one_for(own + (1U << 24U), 0U, 1U);
    restart();
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_STORED, store.origin);
    TEST_ASSERT_TRUE(store.foreign);
    TEST_ASSERT_TRUE(has_defaults());
    make_one_for(own, 64U, 2U);
    restart();
    TEST_ASSERT_FALSE(store.foreign);
    TEST_ASSERT_FALSE(has_defaults());
    save_generation(6U);
    uint8_t named[4];
    TEST_ASSERT_TRUE(flash.read(flash.context, store.newest + 12U, named, 4U));
    TEST_ASSERT_EQUAL_HEX32(own, (uint32_t)named[0] | ((uint32_t)named[1] << 8U) | ((uint32_t)named[2] << 16U) |
                                     ((uint32_t)named[3] << 24U));
}

/* As firmware wrote it before sets named a board. */
static void test_a_set_that_names_no_board_is_taken(void) {
    make_one_for(TERRAPIN_ROBOT_IDENTITY, 0U, 1U);
    restart();
    TEST_ASSERT_FALSE(store.foreign);
    TEST_ASSERT_FALSE(has_defaults());
}

/* As firmware wrote it before sets named a robot. */
static void test_a_set_that_names_no_robot_is_taken(void) {
    make_one_for(1U, 0U, 1U);
    restart();
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_STORED, store.origin);
    TEST_ASSERT_FALSE(store.foreign);
    TEST_ASSERT_EQUAL_INT32(value_of(0U, 1U), store.value[0]); /* its only entry */
    TEST_ASSERT_EQUAL_UINT16(COUNT - 1U, store.missing);
}

/* A number that stands there twice, and one that is as far ahead as behind: what was found first stands. */
static void test_of_two_sets_neither_of_which_is_newer_the_first_counts(void) {
    const uint32_t second[] = {7U, 7U + 0x80000000U, 7U - 1U};
    for (uint32_t i = 0U; i < 3U; i++) {
        memset(bytes, 0xFF, sizeof bytes);
        make_one_for(1U, 0U, 7U);
        make_begin(64U);
        make_entry(terrapin_parameter_hashes[0], value_of(0U, 2U));
        make_end_for(1U, 1U, second[i]);
        restart();
        TEST_ASSERT_EQUAL_UINT32(7U, store.sequence);
        TEST_ASSERT_EQUAL_INT32(value_of(0U, 1U), store.value[0]);
    }
    make_begin(64U);
    make_entry(terrapin_parameter_hashes[0], value_of(0U, 2U));
    make_end_for(1U, 1U, 7U + 0x7FFFFFFFU); /* the farthest that is ahead */
    restart();
    TEST_ASSERT_EQUAL_INT32(value_of(0U, 2U), store.value[0]);
}

static void test_a_set_that_names_a_parameter_twice(void) {
    make_begin(0U);
    for (uint16_t i = 0; i < COUNT; i++) {
        make_entry(terrapin_parameter_hashes[i], value_of(i, 1U));
    }
    make_entry(terrapin_parameter_hashes[0], value_of(0U, 2U));
    make_end(1U, 1U);
    restart();
    TEST_ASSERT_EQUAL_UINT16(0U, store.missing);
    TEST_ASSERT_EQUAL_INT32(value_of(0U, 2U), store.value[0]);
}

static void test_reordered_unknown_and_impossible_values(void) {
    make_begin(64U); /* a set may begin at any unit */
    make_entry(0x12345678U, 7);
    for (uint16_t i = COUNT; i > 2U; i--) { /* in reverse, and without the first two */
        const uint16_t index = (uint16_t)(i - 1U);
        const bool impossible = (index == 5U) || (index == 9U);
        const int32_t bad = (index == 5U) ? (terrapin_parameter((uint16_t)5).maximum + 1)
                                          : (terrapin_parameter((uint16_t)9).minimum - 1);
        const int32_t value = impossible ? bad : value_of(index, 4U);
        make_entry(terrapin_parameter_hashes[index], value);
    }
    make_entry(0xFFFFFFFFU, -1);
    make_end(1U, 41U);
    restart();
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_STORED, store.origin);
    TEST_ASSERT_EQUAL_UINT16(2U, store.dropped);
    TEST_ASSERT_EQUAL_UINT16(2U, store.replaced);
    TEST_ASSERT_EQUAL_UINT16(2U, store.missing);
    for (uint16_t i = 0; i < COUNT; i++) {
        const bool defaulted = (i < 2U) || (i == 5U) || (i == 9U);
        int32_t value = 0;
        TEST_ASSERT_EQUAL(TERRAPIN_PARAMETER_OK, terrapin_parameter_get(state, i, &value));
        TEST_ASSERT_EQUAL_INT32(defaulted ? terrapin_parameter((uint16_t)i).default_value : value_of(i, 4U), value);
    }
    flash.write = bad_write;
    bad_from = 0U;
    bad_to = 2U * PAGE;
    (void)save();
    TEST_ASSERT_TRUE(store.failed); /* what was found is read and counted anew */
    TEST_ASSERT_EQUAL_UINT16(2U, store.dropped);
    TEST_ASSERT_EQUAL_UINT16(2U, store.replaced);
    TEST_ASSERT_EQUAL_UINT16(2U, store.missing);
    bad_to = 0U;
    save_generation(6U);
    TEST_ASSERT_EQUAL_UINT16(0U, store.dropped);
    TEST_ASSERT_EQUAL_UINT16(0U, store.replaced);
    TEST_ASSERT_EQUAL_UINT16(0U, store.missing);
    restart();
    TEST_ASSERT_EQUAL_UINT32(42U, store.sequence);
    TEST_ASSERT_TRUE(has_all(6U));
    TEST_ASSERT_EQUAL_UINT16(0U, store.dropped);
}

static void test_another_layout_is_not_read(void) {
    make_begin(0U);
    make_entry(terrapin_parameter_hashes[0], value_of(0U, 1U));
    make_end(2U, 1U);
    restart();
    TEST_ASSERT_EQUAL(TERRAPIN_STORE_ORIGIN_DAMAGED, store.origin);
    TEST_ASSERT_TRUE(has_defaults());
}

static void test_absurd_heads_are_survived(void) {
    for (uint32_t entries = 0U; entries <= 0xFFFFU; entries += 771U) { /* up to sets far beyond the page's end */
        memset(bytes, 0xFF, sizeof bytes);
        put(&bytes[PAGE - 16U], 0x4D525054U);
        put(&bytes[PAGE - 12U], 1U | (entries << 16U));
        put(&bytes[(2U * PAGE) - 16U], 0x4D525054U);
        put(&bytes[(2U * PAGE) - 12U], 1U | (entries << 16U));
        restart();
        TEST_ASSERT_TRUE(has_defaults());
    }
    make_begin(0U); /* a whole set that names nothing */
    make_end(1U, 3U);
    restart();
    TEST_ASSERT_TRUE(has_defaults());
    TEST_ASSERT_EQUAL_UINT16(COUNT, store.missing);
}

static bool lies_erase(void *context, terrapin_flash_area area) {
    (void)context, (void)area;
    return true;
}
static bool lies_write(void *context, uint32_t offset, const uint8_t *from, uint32_t size) {
    (void)context, (void)offset, (void)from, (void)size;
    return true;
}

/* A flash that says yes and does nothing: the old set that is whole where the new one should stand is not it. */
static void test_an_old_set_in_the_new_one_s_place_is_no_save(void) {
    for (uint32_t generation = 1U; generation <= (A_PAGE + 1U); generation++) { /* sets in both pages */
        save_generation(generation);
    }
    const terrapin_flash good = flash;
    while ((store.page[store.active].size - store.next[store.active]) >= SET_SIZE) {
        save_generation(2U); /* until the next one needs an erase */
    }
    const uint32_t newest = store.newest;
    const uint32_t sequence = store.sequence;
    flash.erase = lies_erase;
    flash.write = lies_write;
    set_all(9U);
    TEST_ASSERT_TRUE(terrapin_store_save(&store, state));
    for (uint32_t i = 0U; terrapin_store_work(&store, true); i++) {
        TEST_ASSERT_LESS_THAN_UINT32(1000U, i);
    }
    flash = good;
    TEST_ASSERT_TRUE(store.failed);
    TEST_ASSERT_EQUAL_UINT32(newest, store.newest);
    TEST_ASSERT_EQUAL_UINT32(sequence, store.sequence);
}

static void test_sequence_numbers_wrap(void) {
    memset(bytes, 0xFF, sizeof bytes);
    for (uint32_t i = 0U; i < 3U; i++) { /* 0xFFFFFFFE, 0xFFFFFFFF, 0 */
        make_begin(i * SET_SIZE);
        for (uint16_t k = 0; k < COUNT; k++) {
            make_entry(terrapin_parameter_hashes[k], value_of(k, i + 1U));
        }
        make_end(1U, 0xFFFFFFFEU + i);
    }
    restart();
    TEST_ASSERT_TRUE(has_all(3U));
}

/* CRC-32 of ITU-T V.42, bit by bit; the check value is the catalogue's. */
static void test_the_crc_is_that_of_v42(void) {
    uint8_t every[256];
    uint32_t crc = 0xFFFFFFFFU;
    for (uint32_t i = 0U; i < 256U; i++) {
        every[i] = (uint8_t)i;
        crc ^= i;
        for (uint32_t bit = 0U; bit < 8U; bit++) {
            crc = (crc >> 1U) ^ (((crc & 1U) != 0U) ? 0xEDB88320U : 0U);
        }
    }
    TEST_ASSERT_EQUAL_HEX32(~crc, terrapin_crc32(0U, every, 256U));
    TEST_ASSERT_EQUAL_HEX32(~crc, terrapin_crc32(terrapin_crc32(0U, every, 100U), &every[100], 156U));
    TEST_ASSERT_EQUAL_HEX32(0xCBF43926U, terrapin_crc32(0U, (const uint8_t *)"123456789", 9U));
    TEST_ASSERT_EQUAL_HEX32(0U, terrapin_crc32(0U, NULL, 0U));
}

static void test_hashes_are_fnv1a_of_name_unit_and_scale(void) {
    const char *text = "radius|m|1e-06";
    uint32_t hash = 0x811C9DC5U;
    for (const char *c = text; *c != '\0'; c++) {
        hash = (hash ^ (uint8_t)*c) * 0x01000193U;
    }
    TEST_ASSERT_EQUAL_HEX32(hash, terrapin_parameter_hashes[TERRAPIN_PARAMETER_RADIUS]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_nothing_stored_is_blank_and_defaults);
    RUN_TEST(test_all_at_once_or_none);
    RUN_TEST(test_equal_values_before_anything);
    RUN_TEST(test_saved_values_come_back);
    RUN_TEST(test_every_width_of_write);
    RUN_TEST(test_pieces_are_bounded);
    RUN_TEST(test_erase_waits_for_the_bridge);
    RUN_TEST(test_power_cut_in_the_first_save_ever);
    RUN_TEST(test_power_cut_in_a_save_that_appends);
    RUN_TEST(test_power_cut_in_a_save_that_erases);
    RUN_TEST(test_power_cut_again_in_the_next_save);
    RUN_TEST(test_a_thousand_saves);
    RUN_TEST(test_garbage_in_both_pages_gives_defaults_and_says_so);
    RUN_TEST(test_what_the_flash_does_not_stand_for_is_not_read);
    RUN_TEST(test_zeros_everywhere_are_damage);
    RUN_TEST(test_each_flipped_bit_of_the_newest_set_leaves_the_one_before);
    RUN_TEST(test_a_bad_spot_moves_the_set_to_the_other_page);
    RUN_TEST(test_a_page_is_filled_to_its_last_byte);
    RUN_TEST(test_after_a_save_that_failed_in_both_pages);
    RUN_TEST(test_pages_of_one_set_in_either_order);
    RUN_TEST(test_pages_that_cannot_be_used_are_never_touched);
    RUN_TEST(test_reordered_unknown_and_impossible_values);
    RUN_TEST(test_a_set_of_another_robot_gives_defaults_and_says_so);
    RUN_TEST(test_a_set_of_another_board_gives_defaults_and_says_so);
    RUN_TEST(test_a_set_that_names_no_board_is_taken);
    RUN_TEST(test_a_set_that_names_no_robot_is_taken);
    RUN_TEST(test_of_two_sets_neither_of_which_is_newer_the_first_counts);
    RUN_TEST(test_a_set_that_names_a_parameter_twice);
    RUN_TEST(test_another_layout_is_not_read);
    RUN_TEST(test_absurd_heads_are_survived);
    RUN_TEST(test_an_old_set_in_the_new_one_s_place_is_no_save);
    RUN_TEST(test_sequence_numbers_wrap);
    RUN_TEST(test_the_crc_is_that_of_v42);
    RUN_TEST(test_hashes_are_fnv1a_of_name_unit_and_scale);
    return UNITY_END();
}
