/* The file as flash, on a disk that loses what was not synced when the power fails. */
#define _GNU_SOURCE

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

#include "unity.h"

static ssize_t disk_pwrite(int descriptor, const void *bytes, size_t size, off_t at);
static int disk_fdatasync(int descriptor);
#define pwrite    disk_pwrite
#define fdatasync disk_fdatasync
#include "../../firmware/ports/host/flash_file.c"
#undef pwrite
#undef fdatasync

static uint8_t disk[SIZE]; /* what outlives the power */
static char folder[] = "/tmp/terrapin-flash-XXXXXX";
static char path[64];
static int writes;
static int syncs;
static bool refuse;
static int room; /* writes until the disk is full */
static terrapin_flash_file file;

static ssize_t disk_pwrite(int descriptor, const void *bytes, size_t size, off_t at) {
    writes++;
    if (writes > room) {
        errno = ENOSPC;
        return -1;
    }
    return pwrite(descriptor, bytes, size, at);
}

static int disk_fdatasync(int descriptor) {
    syncs++;
    if (refuse) {
        errno = EIO;
        return -1;
    }
    return (pread(descriptor, disk, sizeof disk, 0) == (ssize_t)sizeof disk) ? 0 : -1;
}

void setUp(void) {
    writes = 0;
    syncs = 0;
    refuse = false;
    room = INT_MAX;
    memset(disk, 0, sizeof disk);
    TEST_ASSERT_EQUAL(0, terrapin_flash_file_open(&file, path));
}

void tearDown(void) {
    terrapin_flash_file_close(&file);
    (void)unlink(path);
}

/* What an earlier version made holds parameters alone: they stay, and it grows; also when that is cut short. */
static void test_a_file_of_parameters_grows(void) {
    for (uint32_t size = NODE_PAGE; size < SIZE; size += 5000U) {
        const uint8_t value[4] = {1, 2, 3, 4};
        uint8_t back[4] = {0};
        TEST_ASSERT_TRUE(file.flash.write(&file, 16U, value, 4U) || (size > NODE_PAGE));
        terrapin_flash_file_close(&file);
        TEST_ASSERT_EQUAL(0, truncate(path, (off_t)size));
        TEST_ASSERT_EQUAL(0, terrapin_flash_file_open(&file, path));
        TEST_ASSERT_EQUAL(SIZE, lseek(file.descriptor, 0, SEEK_END));
        TEST_ASSERT_TRUE(file.flash.read(&file, 16U, back, 4U));
        TEST_ASSERT_EQUAL_MEMORY(value, back, 4U);
        TEST_ASSERT_EQUAL(0, terrapin_flash_file_node(&file));
    }
    terrapin_flash_file_close(&file);
    TEST_ASSERT_EQUAL(0, truncate(path, (off_t)NODE_PAGE - 1));
    TEST_ASSERT_EQUAL(EINVAL, terrapin_flash_file_open(&file, path));
}

static void test_the_node_number_is_kept(void) {
    for (uint32_t i = 0; i < ((PAGE / WRITE_SIZE) - 1U); i++) { /* the last unit is not a number's */
        const uint8_t node = (uint8_t)(1U + (i % 7U));
        TEST_ASSERT_TRUE(terrapin_flash_file_set_node(&file, node));
        TEST_ASSERT_EQUAL(node, terrapin_flash_file_node(&file));
    }
    const uint8_t last = terrapin_flash_file_node(&file);
    TEST_ASSERT_FALSE(terrapin_flash_file_set_node(&file, 0U)); /* full, after four thousand */
    TEST_ASSERT_EQUAL(last, terrapin_flash_file_node(&file));
    TEST_ASSERT_EQUAL_MEMORY_MESSAGE("N", &disk[NODE_PAGE], 1U, "it is on the disk");
}

/* As often as it changes, beside the numbers, and for whoever opens the file next. */
static void test_a_stop_is_kept(void) {
    TEST_ASSERT_FALSE(terrapin_flash_file_stopped(&file));
    for (uint32_t i = 0; i < 5000U; i++) {
        const bool stopped = (i % 2U) == 0U;
        terrapin_flash_file_set_stopped(&file, stopped);
        TEST_ASSERT_EQUAL(stopped, terrapin_flash_file_stopped(&file));
    }
    TEST_ASSERT_TRUE(terrapin_flash_file_set_node(&file, 5U));
    terrapin_flash_file_set_stopped(&file, true);
    terrapin_flash_file_close(&file);
    TEST_ASSERT_EQUAL(0, terrapin_flash_file_open(&file, path));
    TEST_ASSERT_TRUE(terrapin_flash_file_stopped(&file));
    TEST_ASSERT_EQUAL(5, terrapin_flash_file_node(&file));
}

static void test_a_torn_number_is_none(void) {
    TEST_ASSERT_TRUE(terrapin_flash_file_set_node(&file, 5U));
    const uint8_t torn[4] = {(uint8_t)'N', 3U, 0xFFU, 0xFFU};
    TEST_ASSERT_EQUAL(4, pwrite(file.descriptor, torn, 4U, NODE_PAGE + 4U));
    TEST_ASSERT_EQUAL(5, terrapin_flash_file_node(&file));
    TEST_ASSERT_TRUE(terrapin_flash_file_set_node(&file, 4U));
    TEST_ASSERT_EQUAL(4, terrapin_flash_file_node(&file));
    refuse = true;
    TEST_ASSERT_FALSE(terrapin_flash_file_set_node(&file, 6U));
}

static void test_a_file_that_could_not_be_made_is_made_next_time(void) {
    terrapin_flash_file_close(&file);
    TEST_ASSERT_EQUAL(0, truncate(path, 0));
    room = writes + 3;
    TEST_ASSERT_EQUAL(ENOSPC, terrapin_flash_file_open(&file, path));
    room = INT_MAX;
    TEST_ASSERT_EQUAL(0, terrapin_flash_file_open(&file, path));
    TEST_ASSERT_EQUAL(SIZE, lseek(file.descriptor, 0, SEEK_END));
}

static void test_a_new_file_is_on_the_disk(void) {
    TEST_ASSERT_EQUAL(1, syncs);
    for (size_t i = 0; i < sizeof disk; i++) {
        TEST_ASSERT_EQUAL_HEX8(0xFF, disk[i]);
    }
}

static void test_what_was_read_back_stays(void) {
    const uint8_t words[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    uint8_t back[8] = {0};
    const int before = syncs;
    for (uint32_t at = 0; at < 256U; at += 8U) {
        TEST_ASSERT_TRUE(file.flash.write(&file, at, words, 8U));
    }
    TEST_ASSERT_EQUAL_MESSAGE(before, syncs, "a unit does not wait for the disk");
    TEST_ASSERT_TRUE(file.flash.read(&file, 0U, back, 8U));
    TEST_ASSERT_EQUAL(before + 1, syncs);
    TEST_ASSERT_EQUAL_MEMORY(words, back, 8);
    TEST_ASSERT_EQUAL_MEMORY(words, &disk[248], 8);
    TEST_ASSERT_TRUE(file.flash.read(&file, 8U, back, 8U));
    TEST_ASSERT_EQUAL_MESSAGE(before + 1, syncs, "nothing new was written");
}

/* An erase of the older page must not reach the disk before the newer set does. */
static void test_an_erase_waits_for_what_was_written_before(void) {
    const uint8_t word[4] = {9, 9, 9, 9};
    TEST_ASSERT_TRUE(file.flash.write(&file, 0U, word, 4U));
    TEST_ASSERT_TRUE(file.flash.write(&file, PAGE, word, 4U));
    writes = 0;
    refuse = true;
    TEST_ASSERT_FALSE(file.flash.erase(&file, file.pages[1]));
    TEST_ASSERT_EQUAL_MESSAGE(0, writes, "the disk did not take what stood before");
    refuse = false;
    TEST_ASSERT_TRUE(file.flash.erase(&file, file.pages[1]));
    TEST_ASSERT_EQUAL_HEX8(9, disk[0]);
    TEST_ASSERT_EQUAL_HEX8(0xFF, disk[PAGE]);
}

static void test_a_disk_that_refuses_is_no_success(void) {
    const uint8_t word[4] = {9, 9, 9, 9};
    uint8_t back[4] = {0};
    TEST_ASSERT_TRUE(file.flash.write(&file, 0U, word, 4U));
    refuse = true;
    TEST_ASSERT_FALSE(file.flash.read(&file, 0U, back, 4U));
    TEST_ASSERT_FALSE(file.flash.read(&file, 0U, back, 4U));
    refuse = false;
    TEST_ASSERT_TRUE(file.flash.read(&file, 0U, back, 4U));
}

int main(void) {
    if (mkdtemp(folder) == NULL) {
        return 1;
    }
    (void)snprintf(path, sizeof path, "%s/flash", folder);
    UNITY_BEGIN();
    RUN_TEST(test_a_file_of_parameters_grows);
    RUN_TEST(test_the_node_number_is_kept);
    RUN_TEST(test_a_torn_number_is_none);
    RUN_TEST(test_a_stop_is_kept);
    RUN_TEST(test_a_file_that_could_not_be_made_is_made_next_time);
    RUN_TEST(test_a_new_file_is_on_the_disk);
    RUN_TEST(test_what_was_read_back_stays);
    RUN_TEST(test_an_erase_waits_for_what_was_written_before);
    RUN_TEST(test_a_disk_that_refuses_is_no_success);
    (void)rmdir(folder);
    return UNITY_END();
}
