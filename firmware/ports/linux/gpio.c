#include "gpio.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool option(const char *text, gpio_name *name) {
    bool known = true;
    if (strcmp(text, "active-low") == 0) {
        name->active_low = true;
    } else if (strcmp(text, "pull-up") == 0) {
        name->pull = GPIO_PULL_UP;
    } else if (strcmp(text, "pull-down") == 0) {
        name->pull = GPIO_PULL_DOWN;
    } else {
        known = false;
    }
    return known;
}

bool gpio_parse(const char *text, gpio_name *name, char *why, size_t size) {
    char copy[2 * GPIO_TEXT_MAX];
    if (strlen(text) >= sizeof copy) {
        (void)snprintf(why, size, "the name is too long");
        return false;
    }
    (void)memcpy(copy, text, strlen(text) + 1U);
    (void)memset(name, 0, sizeof *name);
    char *rest = strchr(copy, ',');
    if (rest != NULL) {
        *rest++ = '\0';
    }
    while (rest != NULL) {
        char *next = strchr(rest, ',');
        if (next != NULL) {
            *next++ = '\0';
        }
        if (!option(rest, name)) {
            (void)snprintf(why, size, "'%s' is none of active-low, pull-up, pull-down", rest);
            return false;
        }
        rest = next;
    }
    const char *line = copy;
    char *colon = strchr(copy, ':');
    if (colon != NULL) {
        *colon = '\0';
        line = colon + 1;
    }
    const size_t chip_length = (colon != NULL) ? strlen(copy) : 0U;
    if ((*line == '\0') || (strlen(line) >= GPIO_TEXT_MAX) || (chip_length >= GPIO_TEXT_MAX) ||
        ((colon != NULL) && (chip_length == 0U))) {
        (void)snprintf(why, size, "expected LINE or CHIP:LINE");
        return false;
    }
    if ((colon == NULL) && (gpio_offset(line) >= 0)) {
        (void)snprintf(why, size, "an offset needs its chip, as in gpiochip0:%s", line);
        return false;
    }
    (void)memcpy(name->chip, copy, chip_length);
    (void)memcpy(name->line, line, strlen(line) + 1U);
    return true;
}

long gpio_offset(const char *line) {
    char *end = NULL;
    const long offset = strtol(line, &end, 10);
    return ((*line >= '0') && (*line <= '9') && (*end == '\0')) ? offset : -1;
}
