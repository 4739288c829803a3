/* What the boot loader keeps, reads and says: its records through changes of page and power cuts, an image's form byte
 * by byte, the update over a serial line. The rest of it is tested from Python (tests/boot). */
#include <string.h>

#include "unity.h"

#include "boot.h"
#include "crc32.h"
#include "flash_emulated.h"
#include "layout.h"
#include "records.h"
#include "serial.h"
#include "sha2.h"

#define SIZE     0x60000U /* up to the end of slot B */
#define SECTORS  7U
#define RECORDS0 (TERRAPIN_LAYOUT_RECORDS_SIZE_0 / TERRAPIN_RECORD_SIZE)
#define RECORDS1 (TERRAPIN_LAYOUT_RECORDS_SIZE_1 / TERRAPIN_RECORD_SIZE)

static uint8_t bytes[SIZE];
static uint8_t kept[SIZE];
static terrapin_flash_emulated memory;
static terrapin_flash flash;

void setUp(void) {
    memset(bytes, 0xFF, sizeof bytes);
    terrapin_flash_emulated_init(&memory, bytes, terrapin_flash_f405_sectors, SECTORS, 4U);
    flash = terrapin_flash_emulated_driver(&memory);
}

void tearDown(void) {
    TEST_ASSERT_EQUAL_UINT32(0, memory.misuse);
}

static uint32_t get(const uint8_t *from) {
    return (uint32_t)from[0] | ((uint32_t)from[1] << 8U) | ((uint32_t)from[2] << 16U) | ((uint32_t)from[3] << 24U);
}

static void put(uint8_t *to, uint32_t word, uint32_t size) {
    for (uint32_t i = 0U; i < size; i++) {
        to[i] = (uint8_t)(word >> (8U * i));
    }
}

/* ---- records */

/* One whose every byte differs from the others, and from one number to the next. */
static terrapin_record of(uint32_t number) {
    const terrapin_record record = {
        .confirmed = (uint8_t)(number % 3U),
        .candidate = (uint8_t)((number + 1U) % 3U),
        .phase = (uint8_t)((number + 2U) % 3U),
        .tries = (uint8_t)(3U + (number % 200U)),
        .security_counter = 0xA1B2C3D4U + number,
        .node = (uint8_t)(number % TERRAPIN_NODES),
        .revoked = (uint8_t)((number / 2U) % 3U),
        .robot = (0x00E5F607U + number) & 0x00FFFFFFU,
        .version = {(uint8_t)(0x18U + number), (uint8_t)(0x29U + number), (uint16_t)(0x3A4BU + number),
                    0x5C6D7E8FU + number},
    };
    return record;
}

static bool same(const terrapin_record *a, const terrapin_record *b) {
    return (a->confirmed == b->confirmed) && (a->candidate == b->candidate) && (a->phase == b->phase) &&
           (a->tries == b->tries) && (a->security_counter == b->security_counter) && (a->node == b->node) &&
           (a->revoked == b->revoked) && (a->robot == b->robot) &&
           (terrapin_image_compare(a->version, b->version) == 0);
}

static bool stands(uint32_t number) {
    const terrapin_record expected = of(number);
    terrapin_record found;
    terrapin_records_read(&flash, &found);
    return same(&found, &expected);
}

static bool append(uint32_t number) {
    const terrapin_record record = of(number);
    return terrapin_records_append(&flash, &record);
}

static void test_every_field_comes_back(void) {
    terrapin_record found;
    const terrapin_record nothing = {0};
    terrapin_records_read(&flash, &found);
    TEST_ASSERT_TRUE(same(&found, &nothing));
    for (uint32_t number = 0U; number < 300U; number++) {
        TEST_ASSERT_TRUE(append(number));
        TEST_ASSERT_TRUE(stands(number));
    }
    terrapin_record expected = of(299U);
    TEST_ASSERT_TRUE(terrapin_records_set_node(&flash, 6U));
    expected.node = 6U;
    terrapin_records_read(&flash, &found);
    TEST_ASSERT_TRUE(same(&found, &expected));
}

/* As older boot loaders left them in flash: magic, number, the fields, CRC. */
static void make(uint32_t place, uint32_t sequence, const terrapin_record *record) {
    uint8_t *to = &bytes[TERRAPIN_LAYOUT_RECORDS_0 + (place * TERRAPIN_RECORD_SIZE)];
    put(to, 0x00015442U, 4U);
    put(&to[4], sequence, 4U);
    to[8] = record->confirmed;
    to[9] = record->candidate;
    to[10] = record->phase;
    to[11] = record->tries;
    put(&to[12], record->security_counter, 4U);
    to[16] = record->version.major;
    to[17] = record->version.minor;
    put(&to[18], record->version.revision, 2U);
    put(&to[20], record->version.build, 4U);
    to[24] = (uint8_t)(record->node | (record->revoked << 4U)); /* older ones: the node alone */
    put(&to[25], record->robot, 3U);
    put(&to[28], terrapin_crc32(0U, to, 28U), 4U);
}

static void test_the_format(void) {
    terrapin_record record = of(7U);
    make(0U, 1U, &record);
    memcpy(kept, bytes, sizeof kept);
    setUp();
    TEST_ASSERT_TRUE(append(7U));
    TEST_ASSERT_EQUAL_MEMORY(kept, bytes, sizeof kept);
}

/* Behind records that are whole, but not the boot loader's: of no slot, phase, node or key, of another format. */
static void test_a_record_out_of_its_ranges_is_none(void) {
    for (uint32_t kind = 0U; kind < 7U; kind++) {
        setUp();
        TEST_ASSERT_TRUE(append(4U));
        terrapin_record bad = of(5U);
        bad.confirmed = (uint8_t)((kind == 0U) ? 3U : bad.confirmed);
        bad.candidate = (uint8_t)((kind == 1U) ? 3U : bad.candidate);
        bad.phase = (uint8_t)((kind == 2U) ? 3U : bad.phase);
        bad.node = (uint8_t)((kind == 3U) ? TERRAPIN_NODES : bad.node);
        bad.revoked = (uint8_t)((kind == 6U) ? 3U : bad.revoked);
        make(1U, 2U, &bad);
        uint8_t *at = &bytes[TERRAPIN_LAYOUT_RECORDS_0 + TERRAPIN_RECORD_SIZE];
        if (kind == 4U) {
            at[2] = 2U; /* format 2, with its right checksum */
            put(&at[28], terrapin_crc32(0U, at, 28U), 4U);
        } else if (kind == 5U) {
            at[31] ^= 1U;
        } else {
            /* with its right checksum */
        }
        TEST_ASSERT_TRUE(stands(4U));
        TEST_ASSERT_TRUE(append(6U)); /* behind it */
        TEST_ASSERT_TRUE(stands(6U));
    }
}

static void test_of_two_with_one_number_the_first_counts(void) {
    const terrapin_record first = of(1U);
    const terrapin_record second = of(2U);
    make(0U, 5U, &first);
    make(1U, 5U, &second);
    TEST_ASSERT_TRUE(stands(1U));
    make(2U, 4U, &second);
    TEST_ASSERT_TRUE(stands(1U));
    make(3U, 6U, &second);
    TEST_ASSERT_TRUE(stands(2U));
}

/* Both pages are filled to the last place and left, several times; each erase is of the page that is not in use. */
static void test_pages_change_when_they_are_full(void) {
    const uint32_t round = RECORDS0 + RECORDS1;
    for (uint32_t number = 0U; number < ((2U * round) + 3U); number++) {
        const uint32_t before = memory.operations;
        TEST_ASSERT_TRUE(append(number));
        const bool first = ((number % round) == 0U) || ((number % round) == RECORDS0);
        TEST_ASSERT_EQUAL_UINT32((TERRAPIN_RECORD_SIZE / 4U) + (first ? 1U : 0U), memory.operations - before);
        if (first || ((number % 97U) == 0U)) {
            TEST_ASSERT_TRUE(stands(number));
        }
    }
}

/* Room is made as soon as fewer than eight places are left, and not before; it costs one record and one erase. */
static void test_room_for_an_update(void) {
    for (uint32_t used = 0U; used <= RECORDS0; used++) {
        const uint32_t before = memory.operations;
        TEST_ASSERT_TRUE(terrapin_records_make_room(&flash));
        const bool full = used > (RECORDS0 - 8U);
        TEST_ASSERT_EQUAL_UINT32(full ? (1U + (TERRAPIN_RECORD_SIZE / 4U)) : 0U, memory.operations - before);
        if (full) {
            TEST_ASSERT_TRUE(stands(used - 1U));
            TEST_ASSERT_TRUE(append(used));
            TEST_ASSERT_TRUE(stands(used));
            return;
        }
        TEST_ASSERT_TRUE(append(used));
    }
    TEST_FAIL_MESSAGE("no room was made");
}

/* Power fails at each write and erase of a record that changes the page, one way and back. */
static void test_a_cut_while_the_page_changes(void) {
    static const terrapin_flash_cut cuts[] = {TERRAPIN_FLASH_CUT_BEFORE, TERRAPIN_FLASH_CUT_AFTER,
                                              TERRAPIN_FLASH_CUT_TORN, TERRAPIN_FLASH_CUT_PART,
                                              TERRAPIN_FLASH_CUT_NOISE};
    uint32_t number = 0U;
    const uint32_t full[] = {RECORDS0, RECORDS0 + RECORDS1};
    for (uint32_t page = 0U; page < 2U; page++) {
        while (number < full[page]) {
            TEST_ASSERT_TRUE(append(number));
            number++;
        }
        memcpy(kept, bytes, sizeof kept);
        for (uint32_t kind = 0U; kind < (sizeof cuts / sizeof cuts[0]); kind++) {
            for (uint32_t at = 0U; at <= (TERRAPIN_RECORD_SIZE / 4U); at++) {
                memcpy(bytes, kept, sizeof kept);
                memory.cut = cuts[kind];
                memory.random = 1U + (at * 7U) + kind;
                memory.cut_at = memory.operations + at;
                TEST_ASSERT_FALSE(append(number));
                TEST_ASSERT_TRUE(memory.off);
                terrapin_flash_emulated_power_on(&memory);
                TEST_ASSERT_TRUE(stands(number - 1U) || stands(number));
                TEST_ASSERT_TRUE(append(number + 1U));
                TEST_ASSERT_TRUE(stands(number + 1U));
            }
        }
        memcpy(bytes, kept, sizeof kept);
    }
}

/* A page that another program filled, or that lost its charge: what cannot be read is no record, nor the end. */
static void test_what_is_no_record_is_passed_over(void) {
    memset(&bytes[TERRAPIN_LAYOUT_RECORDS_0], 0, TERRAPIN_LAYOUT_RECORDS_SIZE_0 + TERRAPIN_LAYOUT_RECORDS_SIZE_1);
    const terrapin_record record = of(3U);
    make(RECORDS0 - 1U, 9U, &record);
    TEST_ASSERT_TRUE(stands(3U));
    TEST_ASSERT_TRUE(append(4U));
    TEST_ASSERT_TRUE(stands(4U));
    for (uint32_t i = TERRAPIN_RECORD_SIZE; i < TERRAPIN_LAYOUT_RECORDS_SIZE_1; i++) {
        TEST_ASSERT_EQUAL_HEX8(0xFFU, bytes[TERRAPIN_LAYOUT_RECORDS_1 + i]); /* it was erased first */
    }
}

static bool bad_write(void *context, uint32_t offset, const uint8_t *from, uint32_t size) {
    uint8_t wrong[TERRAPIN_RECORD_SIZE];
    memcpy(wrong, from, TERRAPIN_RECORD_SIZE);
    wrong[11] &= 0xFEU; /* a bit that does not stay */
    return terrapin_flash_emulated_driver(context).write(context, offset, wrong, size);
}

static void test_a_write_that_only_says_it_succeeded(void) {
    TEST_ASSERT_TRUE(append(1U));
    flash.write = bad_write;
    TEST_ASSERT_FALSE(append(2U)); /* its tries are odd */
    TEST_ASSERT_TRUE(stands(1U));
}

/* ---- an image's form */

static const terrapin_flash_area slot = {TERRAPIN_LAYOUT_SLOT_A, TERRAPIN_LAYOUT_SLOT_SIZE};

#define CODE    100U
#define ADDRESS (TERRAPIN_LAYOUT_BASE + TERRAPIN_LAYOUT_SLOT_A)
#define LAST    144U /* bytes of digest, key and signature, with their heads */

static uint8_t *const image = &bytes[TERRAPIN_LAYOUT_SLOT_A];
static uint32_t protected_size;

static void tlv(uint32_t type, uint32_t length, uint32_t value) {
    uint8_t *at = &image[TERRAPIN_LAYOUT_HEADER_SIZE + CODE + protected_size];
    put(at, type, 2U);
    put(&at[2], length, 2U);
    put(&at[4], value, (length < 4U) ? length : 4U);
    protected_size += 4U + length;
}

static void header(void) {
    put(image, 0x96F3B83DU, 4U);
    put(&image[4], ADDRESS, 4U);
    put(&image[8], TERRAPIN_LAYOUT_HEADER_SIZE, 2U);
    put(&image[10], protected_size, 2U);
    put(&image[12], CODE, 4U);
    put(&image[16], 0x100U, 4U);
    put(&image[20], 0x04030201U, 4U);
    put(&image[24], 0x08070605U, 4U);
    put(&image[TERRAPIN_LAYOUT_HEADER_SIZE + CODE], 0x6908U, 2U);
    put(&image[TERRAPIN_LAYOUT_HEADER_SIZE + CODE + 2U], protected_size, 2U);
}

static terrapin_image_result read_image(terrapin_image *found) {
    memset(found, 0xA5, sizeof *found);
    return terrapin_image_read(&flash, slot, ADDRESS, found);
}

static void begin(void) {
    setUp();
    protected_size = 4U;
}

static void test_what_an_image_says(void) {
    terrapin_image found;
    begin();
    tlv(0x50U, 4U, 0x11223344U);
    header();
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_OK, read_image(&found));
    TEST_ASSERT_EQUAL_HEX32(0x11223344U, found.security_counter);
    TEST_ASSERT_EQUAL_UINT8(1U, found.version.major);
    TEST_ASSERT_EQUAL_UINT8(2U, found.version.minor);
    TEST_ASSERT_EQUAL_HEX16(0x0403U, found.version.revision);
    TEST_ASSERT_EQUAL_HEX32(0x08070605U, found.version.build);
    TEST_ASSERT_EQUAL_UINT32(CODE, found.code_size);
    TEST_ASSERT_EQUAL_UINT32(TERRAPIN_LAYOUT_HEADER_SIZE + CODE + protected_size, found.hashed_size);
    TEST_ASSERT_EQUAL_UINT32(found.hashed_size + LAST, found.size);
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_IMAGE_KIND_DESK, found.kind);
    TEST_ASSERT_FALSE(found.for_unit);
    TEST_ASSERT_EQUAL_HEX32(0U, found.robot);
    TEST_ASSERT_EQUAL_HEX8(0U, found.board);
    TEST_ASSERT_EQUAL_HEX32(0U, found.interface);
    TEST_ASSERT_EQUAL_HEX32(0U, found.revokes);
    begin();
    tlv(0xA0U, 1U, TERRAPIN_IMAGE_KIND_PRODUCTION);
    tlv(0xA1U, 4U, 0xC1C2C3C4U);
    tlv(0xA2U, 4U, 0xD1D2D3D4U);
    tlv(0xA3U, 4U, 0xE1E2E3E4U);
    tlv(0xA4U, 4U, 0xF1F2F3F4U);
    tlv(0xA5U, 4U, 0x01020304U); /* another's */
    tlv(0x9FU, 2U, 0x0102U);
    tlv(0x60U, 3U, 0x010203U); /* another's */
    tlv(0x60U, 0U, 0U);
    tlv(0x50U, 4U, 5U);
    header();
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_OK, read_image(&found));
    TEST_ASSERT_EQUAL_HEX32(5U, found.security_counter);
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_IMAGE_KIND_PRODUCTION, found.kind);
    TEST_ASSERT_TRUE(found.for_unit);
    TEST_ASSERT_EQUAL_HEX32(0xC1C2C3C4U, found.unit);
    TEST_ASSERT_EQUAL_HEX32(0x00D2D3D4U, found.robot);
    TEST_ASSERT_EQUAL_HEX8(0xD1U, found.board);
    TEST_ASSERT_EQUAL_HEX32(0xE1E2E3E4U, found.interface);
    TEST_ASSERT_EQUAL_HEX32(0xF1F2F3F4U, found.revokes);
}

static void no_image(void) {
    terrapin_image found;
    header();
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, read_image(&found));
}

static void test_protected_tlvs_that_lie(void) {
    begin();
    no_image(); /* no counter */
    begin();
    tlv(0x50U, 4U, 1U);
    tlv(0x50U, 4U, 1U);
    no_image(); /* two */
    const uint32_t fixed[] = {0x50U, 0xA0U, 0xA1U, 0xA2U, 0xA3U};
    for (uint32_t i = 0U; i < 5U; i++) {
        for (uint32_t length = 0U; length < 6U; length++) {
            begin();
            tlv(fixed[i], length, 0U);
            if (fixed[i] != 0x50U) {
                tlv(0x50U, 4U, 1U);
            }
            if (length != ((fixed[i] == 0xA0U) ? 1U : 4U)) {
                no_image(); /* a value of another length */
            }
        }
    }
    for (uint32_t more = 1U; more < 12U; more++) { /* a value that reaches behind the TLVs' end */
        begin();
        tlv(0x50U, 4U, 1U);
        tlv(0x60U, 2U, 0U);
        put(&image[TERRAPIN_LAYOUT_HEADER_SIZE + CODE + protected_size - 4U], 2U + more, 2U);
        no_image();
    }
    for (uint32_t left = 1U; left < 4U; left++) { /* half a head */
        begin();
        tlv(0x50U, 4U, 1U);
        protected_size += left;
        no_image();
    }
    begin();
    protected_size = 0U; /* none at all */
    no_image();
    terrapin_image found;
    for (uint32_t at = 0U; at < 4U; at++) { /* another magic, another size than the header's */
        begin();
        tlv(0x50U, 4U, 1U);
        header();
        image[TERRAPIN_LAYOUT_HEADER_SIZE + CODE + at] ^= 1U;
        TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, read_image(&found));
    }
}

static void test_headers(void) {
    static const uint8_t places[] = {0U, 3U, 8U, 9U, 16U, 17U, 18U, 19U};
    terrapin_image found;
    for (uint32_t i = 0U; i < sizeof places; i++) {
        begin();
        tlv(0x50U, 4U, 1U);
        header();
        image[places[i]] ^= 1U;
        TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, read_image(&found));
    }
    begin();
    tlv(0x50U, 4U, 1U);
    header();
    image[6] ^= 1U;
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_WRONG_SLOT, read_image(&found));
}

/* The largest code that leaves room for what stands behind it, and one byte more; all in a slot as small as that. */
static void test_the_largest_image(void) {
    terrapin_image found;
    begin();
    tlv(0x50U, 4U, 1U);
    header();
    const terrapin_flash_area exact = {slot.offset, TERRAPIN_LAYOUT_HEADER_SIZE + CODE + protected_size + LAST};
    const terrapin_flash_area small = {slot.offset, exact.size - 1U};
    const terrapin_flash_area tiny = {slot.offset, TERRAPIN_LAYOUT_HEADER_SIZE - 1U};
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_OK, terrapin_image_read(&flash, exact, ADDRESS, &found));
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, terrapin_image_read(&flash, small, ADDRESS, &found));
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, terrapin_image_read(&flash, tiny, ADDRESS, &found));
    put(&image[12], 0U, 4U);
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, read_image(&found));
    put(&image[12], UINT32_MAX, 4U);
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, read_image(&found));
    put(&image[12], slot.size - TERRAPIN_LAYOUT_HEADER_SIZE, 4U);
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE, read_image(&found));
}

/* A flash that cannot be read says so, wherever it fails. */
static uint32_t readable; /* calls */

static bool failing_read(void *context, uint32_t offset, uint8_t *to, uint32_t size) {
    const bool good = readable > 0U;
    readable -= good ? 1U : 0U;
    return good && terrapin_flash_emulated_driver(context).read(context, offset, to, size);
}

static void test_a_flash_that_cannot_be_read(void) {
    terrapin_image found;
    begin();
    tlv(0xA0U, 1U, TERRAPIN_IMAGE_KIND_PRODUCTION);
    tlv(0x50U, 4U, 1U);
    header();
    flash.read = failing_read;
    for (uint32_t calls = 0U; calls < 6U; calls++) { /* header, head of the TLVs, two of each */
        readable = calls;
        TEST_ASSERT_EQUAL_UINT8((calls == 0U) ? TERRAPIN_UPDATE_RESULT_FLASH : TERRAPIN_UPDATE_RESULT_NOT_AN_IMAGE,
                                read_image(&found));
    }
    readable = 6U;
    TEST_ASSERT_EQUAL_UINT8(TERRAPIN_UPDATE_RESULT_OK, read_image(&found));
}

static void test_versions_in_order(void) {
    static const terrapin_image_version rising[] = {
        {0U, 0U, 0U, 0U},     {0U, 0U, 0U, 1U}, {0U, 0U, 1U, 0U},
        {0U, 0U, 0x100U, 0U}, {0U, 1U, 0U, 0U}, {0U, 1U, 0U, 255U},
        {1U, 0U, 0U, 0U},     {2U, 0U, 0U, 0U}, {2U, 255U, 0xFFFFU, UINT32_MAX},
    };
    for (uint32_t a = 0U; a < 9U; a++) {
        for (uint32_t b = 0U; b < 9U; b++) {
            const int32_t order = terrapin_image_compare(rising[a], rising[b]);
            TEST_ASSERT_EQUAL((a < b) ? -1 : ((a > b) ? 1 : 0), (order < 0) ? -1 : ((order > 0) ? 1 : 0));
        }
    }
}

/* ---- the update over a serial line */

static const uint8_t keys[64];
static terrapin_boot boot;
static terrapin_boot_serial serial;
static uint8_t answer[TERRAPIN_BOOT_SERIAL_ANSWER_MAX + 1U];

/* What the text is answered; each byte before the last has no answer. */
static uint32_t say(const uint8_t *text, uint32_t length) {
    uint32_t count = 0U;
    memset(answer, '#', sizeof answer);
    for (uint32_t i = 0U; i < length; i++) {
        TEST_ASSERT_EQUAL_UINT32(0U, count);
        count = terrapin_boot_serial_take(&serial, text[i], false, answer);
    }
    TEST_ASSERT_EQUAL_HEX8('#', answer[count]); /* no more than it says */
    return count;
}

static void open_line(uint8_t node) {
    terrapin_record record = {.node = node, .confirmed = (uint8_t)TERRAPIN_UPDATE_SLOT_A};
    setUp();
    boot = (terrapin_boot){.flash = &flash, .keys = keys, .key_ids = {0x01020304U, 0x05060708U}};
    TEST_ASSERT_TRUE(terrapin_records_append(&flash, &record));
    terrapin_boot_serial_init(&serial, &boot, (uint8_t)TERRAPIN_UPDATE_SLOT_A);
    TEST_ASSERT_EQUAL_UINT32(1U, say((const uint8_t *)"O\r", 2U));
    TEST_ASSERT_EQUAL_UINT8('\r', answer[0]);
}

static void test_a_query_over_the_line(void) {
    for (uint8_t number = 0U; number < 3U; number++) {
        open_line(number);
        terrapin_node node;
        terrapin_node_init(&node, number);
        /* The same query straight into the update: its two answers as text, and the end of the line behind them. */
        terrapin_update other;
        terrapin_update_init(&other, &boot, (uint8_t)TERRAPIN_UPDATE_SLOT_A);
        terrapin_frame query = {.id = TERRAPIN_ID_UPDATE_QUERY, .length = 1U, .data = {TERRAPIN_UPDATE_PROTOCOL}};
        terrapin_frame replies[TERRAPIN_UPDATE_REPLIES];
        TEST_ASSERT_EQUAL_UINT32(2U, terrapin_update_accept(&other, &query, false, replies));
        uint8_t expected[TERRAPIN_BOOT_SERIAL_ANSWER_MAX];
        uint32_t length = 0U;
        for (uint32_t i = 0U; i < 2U; i++) {
            terrapin_node_send(&node, &replies[i]);
            length += (uint32_t)terrapin_slcan_encode(&replies[i], &expected[length]);
        }
        expected[length] = (uint8_t)'\r';
        uint8_t text[TERRAPIN_SLCAN_TEXT_MAX];
        uint8_t in_node_0[TERRAPIN_SLCAN_TEXT_MAX];
        const uint32_t asked_0 = (uint32_t)terrapin_slcan_encode(&query, in_node_0);
        for (uint32_t i = 0U; i < TERRAPIN_BLOCK_RECEIVED; i++) { /* the block that has the updates' identifiers */
            terrapin_node zero;
            terrapin_node_init(&zero, 0U);
            const uint32_t offset = (uint32_t)TERRAPIN_ID_UPDATE_QUERY - zero.first[i];
            if (offset < 64U) {
                query.id = (uint16_t)(node.first[i] + offset);
            }
        }
        const uint32_t asked = (uint32_t)terrapin_slcan_encode(&query, text);
        TEST_ASSERT_EQUAL_UINT32(length + 1U, say(text, asked));
        TEST_ASSERT_EQUAL_MEMORY(expected, answer, length + 1U);
        if (number > 0U) { /* another node's: acknowledged by the adapter's protocol, answered by nobody */
            TEST_ASSERT_EQUAL_UINT32(1U, say(in_node_0, asked_0));
            TEST_ASSERT_EQUAL_UINT8('\r', answer[0]);
        }
    }
}

static void test_the_motor_is_on_over_the_line(void) {
    open_line(0U);
    terrapin_update_reset_t message = {.key = (uint32_t)TERRAPIN_UPDATE_RESET_KEY};
    terrapin_frame frame;
    uint8_t text[TERRAPIN_SLCAN_TEXT_MAX];
    (void)terrapin_encode_update_reset(&message, &frame);
    terrapin_e2e_protect(&frame, 1U);
    const uint32_t length = (uint32_t)terrapin_slcan_encode(&frame, text);
    for (uint32_t i = 0U; i < length; i++) {
        (void)terrapin_boot_serial_take(&serial, text[i], true, answer);
    }
    TEST_ASSERT_FALSE(serial.update.reset);
    terrapin_e2e_protect(&frame, 2U);
    (void)terrapin_slcan_encode(&frame, text);
    TEST_ASSERT_GREATER_THAN_UINT32(2U, say(text, length));
    TEST_ASSERT_TRUE(serial.update.reset);
}

/* ---- SHA-2: FIPS 180-4's own example */

static void test_digests(void) {
    static const uint8_t abc256[32] = {0xBAU, 0x78U, 0x16U, 0xBFU, 0x8FU, 0x01U, 0xCFU, 0xEAU, 0x41U, 0x41U, 0x40U,
                                       0xDEU, 0x5DU, 0xAEU, 0x22U, 0x23U, 0xB0U, 0x03U, 0x61U, 0xA3U, 0x96U, 0x17U,
                                       0x7AU, 0x9CU, 0xB4U, 0x10U, 0xFFU, 0x61U, 0xF2U, 0x00U, 0x15U, 0xADU};
    uint8_t digest[TERRAPIN_SHA512_SIZE];
    terrapin_sha2 sha;
    terrapin_sha2_begin(&sha, TERRAPIN_SHA256);
    terrapin_sha2_take(&sha, (const uint8_t *)"abc", 3U);
    terrapin_sha2_end(&sha, digest);
    TEST_ASSERT_EQUAL_MEMORY(abc256, digest, 32U);
    terrapin_sha2_begin(&sha, TERRAPIN_SHA512);
    terrapin_sha2_take(&sha, (const uint8_t *)"abc", 3U);
    terrapin_sha2_end(&sha, digest);
    TEST_ASSERT_EQUAL_HEX32(0xA135AFDDU, get(digest)); /* ddaf35a1 93617aba ... a54ca49f */
    TEST_ASSERT_EQUAL_HEX32(0x9FA44CA5U, get(&digest[60]));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_every_field_comes_back);
    RUN_TEST(test_the_format);
    RUN_TEST(test_a_record_out_of_its_ranges_is_none);
    RUN_TEST(test_of_two_with_one_number_the_first_counts);
    RUN_TEST(test_pages_change_when_they_are_full);
    RUN_TEST(test_room_for_an_update);
    RUN_TEST(test_a_cut_while_the_page_changes);
    RUN_TEST(test_what_is_no_record_is_passed_over);
    RUN_TEST(test_a_write_that_only_says_it_succeeded);
    RUN_TEST(test_what_an_image_says);
    RUN_TEST(test_protected_tlvs_that_lie);
    RUN_TEST(test_headers);
    RUN_TEST(test_the_largest_image);
    RUN_TEST(test_a_flash_that_cannot_be_read);
    RUN_TEST(test_versions_in_order);
    RUN_TEST(test_a_query_over_the_line);
    RUN_TEST(test_the_motor_is_on_over_the_line);
    RUN_TEST(test_digests);
    return UNITY_END();
}
