/* Runs a fuzz target without libFuzzer: every file of the corpus, then a bounded number of mutations of them, the same
 * ones in every run.
 *
 *     fuzz_target MUTATIONS CORPUS_FOLDER
 *
 * An input that fails is the last one: it is written to the file fuzz-input in the current folder before it runs when
 * the environment variable FUZZ_KEEP is set. */
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef FILES_MAX
#define FILES_MAX 256
#endif
#define SIZE_MAX_ 4096

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

typedef struct {
    char name[256];
    uint8_t bytes[SIZE_MAX_];
    size_t size;
} input;

static input corpus[FILES_MAX]; /* untouched pages of it cost nothing */
static uint64_t random_state = 1;

/* xorshift64*: the same numbers everywhere. */
static uint32_t next_random(uint32_t bound) {
    random_state ^= random_state >> 12U;
    random_state ^= random_state << 25U;
    random_state ^= random_state >> 27U;
    return (uint32_t)((random_state * 0x2545F4914F6CDD1DULL) >> 33U) % bound;
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const input *)a)->name, ((const input *)b)->name);
}

static size_t read_corpus(const char *folder) {
    size_t count = 0;
    DIR *dir = opendir(folder);
    if (dir == NULL) {
        return 0;
    }
    for (const struct dirent *entry = readdir(dir); (entry != NULL) && (count < FILES_MAX); entry = readdir(dir)) {
        char path[1024];
        if (entry->d_name[0] == '.') {
            continue;
        }
        (void)snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        FILE *file = fopen(path, "rb");
        if (file == NULL) {
            continue;
        }
        (void)snprintf(corpus[count].name, sizeof corpus[count].name, "%s", entry->d_name);
        corpus[count].size = fread(corpus[count].bytes, 1, SIZE_MAX_, file);
        (void)fclose(file);
        count++;
    }
    (void)closedir(dir);
    qsort(corpus, count, sizeof corpus[0], by_name); /* folders have no order of their own */
    return count;
}

static void run(const input *one) {
    if (getenv("FUZZ_KEEP") != NULL) {
        FILE *file = fopen("fuzz-input", "wb");
        if (file != NULL) {
            (void)fwrite(one->bytes, 1, one->size, file);
            (void)fclose(file);
        }
    }
    (void)LLVMFuzzerTestOneInput(one->bytes, one->size);
}

/* Change, insert, remove or copy some bytes, or append part of another input. */
static void mutate(input *one, size_t count) {
    const uint32_t changes = 1U + next_random(8U);
    for (uint32_t i = 0; i < changes; i++) {
        const size_t at = (one->size > 0U) ? next_random((uint32_t)one->size) : 0U;
        const input *other = &corpus[next_random((uint32_t)count)];
        const size_t room = SIZE_MAX_ - one->size;
        size_t length = (other->size > 0U) ? next_random((uint32_t)other->size) : 0U;
        switch (next_random(5U)) {
        case 0:
            one->bytes[at] = (uint8_t)next_random(256U);
            break;
        case 1:
            one->bytes[at] ^= (uint8_t)(1U << next_random(8U));
            break;
        case 2:
            if (room > 0U) {
                memmove(&one->bytes[at + 1U], &one->bytes[at], one->size - at);
                one->bytes[at] = (uint8_t)next_random(256U);
                one->size++;
            }
            break;
        case 3:
            if (one->size > 0U) {
                memmove(&one->bytes[at], &one->bytes[at + 1U], one->size - at - 1U);
                one->size--;
            }
            break;
        default:
            length = (length < room) ? length : room;
            memcpy(&one->bytes[one->size], other->bytes, length);
            one->size += length;
            break;
        }
    }
}

int main(int argc, char **argv) {
    static input work;
    if (argc != 3) {
        (void)fprintf(stderr, "usage: %s MUTATIONS CORPUS_FOLDER\n", argv[0]);
        return 2;
    }
    const long mutations = strtol(argv[1], NULL, 10);
    const size_t count = read_corpus(argv[2]);
    if (count == 0U) {
        (void)fprintf(stderr, "%s: no corpus in %s\n", argv[0], argv[2]);
        return 1;
    }
    for (size_t i = 0; i < count; i++) {
        run(&corpus[i]);
    }
    for (long i = 0; i < mutations; i++) {
        work = corpus[next_random((uint32_t)count)];
        mutate(&work, count);
        run(&work);
    }
    (void)printf("%zu files and %ld mutations, all well\n", count, mutations);
    return 0;
}
