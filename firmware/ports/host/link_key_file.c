#define _GNU_SOURCE /* getentropy */

#include "link_key_file.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <time.h>

#define LINE_MAX_LENGTH 256
#define OTHERS          (S_IRWXG | S_IRWXO)
#define HEX_DIGITS      ((size_t)8 * TERRAPIN_CHASKEY_WORDS)

static const char *after_blanks(const char *text) {
    while ((*text == ' ') || (*text == '\t') || (*text == '\r') || (*text == '\n')) {
        text++;
    }
    return text;
}

/* What follows `name =` in a line; NULL when the line says something else. */
static const char *value_of(const char *line, const char *name) {
    const size_t length = strlen(name);
    if (strncmp(line, name, length) != 0) {
        return NULL;
    }
    const char *sign = after_blanks(&line[length]);
    return (*sign == '=') ? after_blanks(&sign[1]) : NULL;
}

/* Nothing more stands in the line but a comment. */
static bool ends(const char *text) {
    const char *rest = after_blanks(text);
    return (*rest == '\0') || (*rest == '#');
}

static bool read_generation(const char *text, uint32_t *generation) {
    char *end = NULL;
    errno = 0;
    const unsigned long long value = strtoull(text, &end, 10);
    *generation = (uint32_t)value;
    return (isdigit((unsigned char)text[0]) != 0) && ends(end) && (errno == 0) && (value > 0U) && (value <= UINT32_MAX);
}

static bool read_key(const char *text, uint32_t key[TERRAPIN_CHASKEY_WORDS]) {
    if ((text[0] != '"') || (strspn(&text[1], "0123456789abcdefABCDEF") != HEX_DIGITS) ||
        (text[1U + HEX_DIGITS] != '"') || !ends(&text[2U + HEX_DIGITS])) {
        return false;
    }
    for (size_t i = 0; i < TERRAPIN_CHASKEY_WORDS; i++) {
        key[i] = 0U;
        for (size_t k = 0; k < 4U; k++) { /* bytes as they stand, words little-endian */
            const char digits[3] = {text[1U + (8U * i) + (2U * k)], text[2U + (8U * i) + (2U * k)], '\0'};
            key[i] |= (uint32_t)strtoul(digits, NULL, 16) << (8U * k);
        }
    }
    return true;
}

bool terrapin_process_link_key(const char *path, uint32_t key[TERRAPIN_CHASKEY_WORDS], uint32_t *generation) {
    char line[LINE_MAX_LENGTH];
    bool has_key = false;
    bool has_generation = false;
    FILE *file = fopen(path, "re");
    if (file == NULL) {
        (void)fprintf(stderr, "terrapin-controller: cannot read the link key %s: %s\n", path, strerror(errno));
        return false;
    }
    struct stat found = {0};
    if ((fstat(fileno(file), &found) == 0) && S_ISREG(found.st_mode) && ((found.st_mode & OTHERS) != 0U)) {
        (void)fprintf(stderr,
                      "terrapin-controller: %s: a secret that others may read or write (mode %04o): chmod 600 %s\n",
                      path, found.st_mode & 07777U, path);
        (void)fclose(file);
        return false;
    }
    bool good = true;
    while (good && (fgets(line, sizeof line, file) != NULL)) {
        const char *key_text = value_of(line, "key");
        const char *generation_text = value_of(line, "generation");
        if (key_text != NULL) {
            good = !has_key && read_key(key_text, key);
            has_key = true;
        } else if (generation_text != NULL) {
            good = !has_generation && read_generation(generation_text, generation);
            has_generation = true;
        } else {
            good = ends(line);
        }
    }
    (void)fclose(file);
    if (!good || !has_key || !has_generation) {
        (void)fprintf(stderr,
                      "terrapin-controller: %s: expected generation = N and key = \"32 hexadecimal digits\", as "
                      "terrapin keys link makes them\n",
                      path);
        return false;
    }
    return true;
}

bool terrapin_process_seal(terrapin_link *link, const char *path) {
    static uint32_t key[TERRAPIN_CHASKEY_WORDS];
    uint32_t generation = 0U;
    uint32_t start = 0U;
    if (!terrapin_process_link_key(path, key, &generation)) {
        return false;
    }
    if (getentropy(&start, sizeof start) != 0) {
        (void)fprintf(stderr, "terrapin-controller: no random number for the sessions of %s: %s\n", path,
                      strerror(errno));
        return false;
    }
    terrapin_link_seal(link, key, generation, start);
    return true;
}

uint32_t terrapin_process_ms(void) {
    struct timespec now = {0};
    (void)clock_gettime(CLOCK_BOOTTIME, &now);
    return (uint32_t)(((uint64_t)now.tv_sec * 1000U) + ((uint64_t)now.tv_nsec / 1000000U));
}
