/* GPIO lines through libgpiod 2. */
#include "gpio.h"

#if defined(TERRAPIN_LIBGPIOD) && (TERRAPIN_LIBGPIOD == 2)
#include <dirent.h>
#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EDGES_AT_ONCE 64
#define EVENTS_KEPT   1024 /* by the kernel, until they are read */

const char *const gpio_library = "libgpiod 2";

struct gpio_line {
    struct gpiod_chip *chip;
    struct gpiod_line_request *request;
    struct gpiod_edge_event_buffer *events;
    unsigned int offset;
};

static struct gpiod_chip *open_chip(const char *chip) {
    char path[GPIO_TEXT_MAX + 32];
    if (chip[0] == '/') {
        (void)snprintf(path, sizeof path, "%s", chip);
    } else if (gpio_offset(chip) >= 0) {
        (void)snprintf(path, sizeof path, "/dev/gpiochip%s", chip);
    } else {
        (void)snprintf(path, sizeof path, "/dev/%s", chip);
    }
    return gpiod_chip_open(path);
}

static bool find_on(gpio_line *result, const gpio_name *name) {
    const long given = gpio_offset(name->line);
    const int offset = (given >= 0) ? (int)given : gpiod_chip_get_line_offset_from_name(result->chip, name->line);
    result->offset = (unsigned int)offset;
    return offset >= 0;
}

/* A bare name: the first chip that has it. */
static bool find_anywhere(gpio_line *result, const gpio_name *name) {
    DIR *folder = opendir("/dev");
    bool found = false;
    const struct dirent *entry = NULL;
    while (!found && (folder != NULL) && ((entry = readdir(folder)) != NULL)) {
        if (strncmp(entry->d_name, "gpiochip", strlen("gpiochip")) == 0) {
            result->chip = open_chip(entry->d_name);
            found = (result->chip != NULL) && find_on(result, name);
            if (!found && (result->chip != NULL)) {
                gpiod_chip_close(result->chip);
                result->chip = NULL;
            }
        }
    }
    if (folder != NULL) {
        (void)closedir(folder);
    }
    return found;
}

static void set_up(struct gpiod_line_settings *settings, const gpio_name *name, gpio_direction direction) {
    gpiod_line_settings_set_active_low(settings, name->active_low);
    if (direction == GPIO_OUTPUT) {
        (void)gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_OUTPUT);
        (void)gpiod_line_settings_set_output_value(settings, GPIOD_LINE_VALUE_INACTIVE);
    } else {
        (void)gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_INPUT);
    }
    if (direction == GPIO_EDGES) {
        (void)gpiod_line_settings_set_edge_detection(settings, GPIOD_LINE_EDGE_BOTH);
    }
    if (name->pull == GPIO_PULL_UP) {
        (void)gpiod_line_settings_set_bias(settings, GPIOD_LINE_BIAS_PULL_UP);
    } else if (name->pull == GPIO_PULL_DOWN) {
        (void)gpiod_line_settings_set_bias(settings, GPIOD_LINE_BIAS_PULL_DOWN);
    } else {
        /* as it is */
    }
}

static struct gpiod_line_request *request(const gpio_line *line, const gpio_name *name, gpio_direction direction) {
    struct gpiod_line_request *made = NULL;
    struct gpiod_line_settings *settings = gpiod_line_settings_new();
    struct gpiod_line_config *lines = gpiod_line_config_new();
    struct gpiod_request_config *config = gpiod_request_config_new();
    if ((settings != NULL) && (lines != NULL) && (config != NULL)) {
        gpiod_request_config_set_consumer(config, "terrapin-controller");
        gpiod_request_config_set_event_buffer_size(config, EVENTS_KEPT);
        set_up(settings, name, direction);
        if (gpiod_line_config_add_line_settings(lines, &line->offset, 1, settings) == 0) {
            made = gpiod_chip_request_lines(line->chip, config, lines);
        }
    }
    gpiod_request_config_free(config);
    gpiod_line_config_free(lines);
    gpiod_line_settings_free(settings);
    return made;
}

gpio_line *gpio_open(const gpio_name *name, gpio_direction direction, char *why, size_t size) {
    gpio_line *result = calloc(1, sizeof *result);
    if (result == NULL) {
        (void)snprintf(why, size, "out of memory");
        return NULL;
    }
    errno = 0;
    bool found = false;
    if (name->chip[0] == '\0') {
        found = find_anywhere(result, name);
    } else {
        result->chip = open_chip(name->chip);
        found = (result->chip != NULL) && find_on(result, name);
    }
    if (!found) {
        const char *what = (result->chip == NULL) && (name->chip[0] != '\0') ? "chip" : "line";
        (void)snprintf(why, size, "no such %s%s%s", what, (errno != 0) ? ": " : "",
                       (errno != 0) ? strerror(errno) : "");
    } else {
        result->events = (direction == GPIO_EDGES) ? gpiod_edge_event_buffer_new(EDGES_AT_ONCE) : NULL;
        result->request = request(result, name, direction);
        if ((result->request != NULL) && ((direction != GPIO_EDGES) || (result->events != NULL))) {
            return result;
        }
        (void)snprintf(why, size, "cannot be had: %s", strerror(errno));
    }
    gpio_close(result);
    return NULL;
}

int gpio_get(gpio_line *line) {
    const enum gpiod_line_value value = gpiod_line_request_get_value(line->request, line->offset);
    return (value == GPIOD_LINE_VALUE_ERROR) ? -1 : ((value == GPIOD_LINE_VALUE_ACTIVE) ? 1 : 0);
}

bool gpio_set(gpio_line *line, bool active) {
    const enum gpiod_line_value value = active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
    return gpiod_line_request_set_value(line->request, line->offset, value) == 0;
}

int gpio_descriptor(const gpio_line *line) {
    return gpiod_line_request_get_fd(line->request);
}

int gpio_edges(gpio_line *line, gpio_edge *edges, int most) {
    const int waiting = gpiod_line_request_wait_edge_events(line->request, 0);
    if (waiting <= 0) {
        return waiting;
    }
    const size_t asked = (most < EDGES_AT_ONCE) ? (size_t)most : (size_t)EDGES_AT_ONCE;
    const int count = gpiod_line_request_read_edge_events(line->request, line->events, asked);
    for (int i = 0; i < count; i++) {
        struct gpiod_edge_event *event = gpiod_edge_event_buffer_get_event(line->events, (unsigned long)i);
        edges[i].time_ns = gpiod_edge_event_get_timestamp_ns(event);
        edges[i].active = gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_RISING_EDGE;
    }
    return count;
}

void gpio_close(gpio_line *line) {
    if (line != NULL) {
        gpiod_line_request_release(line->request);
        gpiod_edge_event_buffer_free(line->events);
        gpiod_chip_close(line->chip);
        free(line);
    }
}
#endif
