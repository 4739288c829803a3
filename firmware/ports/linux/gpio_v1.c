/* GPIO lines through libgpiod 1.6. */
#include "gpio.h"

#if defined(TERRAPIN_LIBGPIOD) && (TERRAPIN_LIBGPIOD == 1)
#include <errno.h>
#include <gpiod.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *const gpio_library = "libgpiod 1";

struct gpio_line {
    struct gpiod_chip *chip;
    struct gpiod_line *line;
};

static int flags(const gpio_name *name) {
    int all = name->active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0;
    if (name->pull == GPIO_PULL_UP) {
        all |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
    } else if (name->pull == GPIO_PULL_DOWN) {
        all |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
    } else {
        /* as it is */
    }
    return all;
}

/* The line, and in *chip its open chip; NULL when there is none. */
static struct gpiod_line *find(const gpio_name *name, struct gpiod_chip **chip) {
    struct gpiod_line *line = NULL;
    const long offset = gpio_offset(name->line);
    *chip = NULL;
    if (name->chip[0] == '\0') {
        line = gpiod_line_find(name->line);
        *chip = (line != NULL) ? gpiod_line_get_chip(line) : NULL;
    } else {
        *chip = gpiod_chip_open_lookup(name->chip);
        if (*chip != NULL) {
            line = (offset >= 0) ? gpiod_chip_get_line(*chip, (unsigned int)offset)
                                 : gpiod_chip_find_line(*chip, name->line);
        }
    }
    return line;
}

static int request(struct gpiod_line *line, const gpio_name *name, gpio_direction direction) {
    static const char consumer[] = "terrapin-controller";
    switch (direction) {
    case GPIO_INPUT:
        return gpiod_line_request_input_flags(line, consumer, flags(name));
    case GPIO_EDGES:
        return gpiod_line_request_both_edges_events_flags(line, consumer, flags(name));
    case GPIO_OUTPUT:
    default:
        return gpiod_line_request_output_flags(line, consumer, flags(name), 0);
    }
}

gpio_line *gpio_open(const gpio_name *name, gpio_direction direction, char *why, size_t size) {
    gpio_line *result = calloc(1, sizeof *result);
    if (result == NULL) {
        (void)snprintf(why, size, "out of memory");
        return NULL;
    }
    errno = 0;
    result->line = find(name, &result->chip);
    if (result->line == NULL) {
        const char *what = (result->chip == NULL) && (name->chip[0] != '\0') ? "chip" : "line";
        (void)snprintf(why, size, "no such %s%s%s", what, (errno != 0) ? ": " : "",
                       (errno != 0) ? strerror(errno) : "");
    } else if (request(result->line, name, direction) != 0) {
        (void)snprintf(why, size, "cannot be had: %s", strerror(errno));
    } else {
        return result;
    }
    if (result->chip != NULL) {
        gpiod_chip_close(result->chip);
    }
    free(result);
    return NULL;
}

int gpio_get(gpio_line *line) {
    return gpiod_line_get_value(line->line);
}

bool gpio_set(gpio_line *line, bool active) {
    return gpiod_line_set_value(line->line, active ? 1 : 0) == 0;
}

int gpio_descriptor(const gpio_line *line) {
    return gpiod_line_event_get_fd(line->line);
}

int gpio_edges(gpio_line *line, gpio_edge *edges, int most) {
    int count = 0;
    struct pollfd waiting = {.fd = gpio_descriptor(line), .events = POLLIN};
    while ((count < most) && (poll(&waiting, 1, 0) == 1)) {
        struct gpiod_line_event event;
        if (gpiod_line_event_read(line->line, &event) != 0) {
            return (count > 0) ? count : -1;
        }
        edges[count].time_ns = ((uint64_t)event.ts.tv_sec * 1000000000U) + (uint64_t)event.ts.tv_nsec;
        edges[count].active = event.event_type == GPIOD_LINE_EVENT_RISING_EDGE;
        count++;
    }
    return count;
}

void gpio_close(gpio_line *line) {
    if (line != NULL) {
        gpiod_chip_close(line->chip); /* releases the line */
        free(line);
    }
}
#endif
