/* Built without libgpiod: a line can be named, but none can be had. */
#include "gpio.h"

#ifndef TERRAPIN_LIBGPIOD
#include <stdio.h>

const char *const gpio_library = "without libgpiod";

gpio_line *gpio_open(const gpio_name *name, gpio_direction direction, char *why, size_t size) {
    (void)name;
    (void)direction;
    (void)snprintf(why, size, "this program was built without libgpiod");
    return NULL;
}

int gpio_get(gpio_line *line) {
    (void)line;
    return -1;
}

bool gpio_set(gpio_line *line, bool active) {
    (void)line;
    (void)active;
    return false;
}

int gpio_descriptor(const gpio_line *line) {
    (void)line;
    return -1;
}

int gpio_edges(gpio_line *line, gpio_edge *edges, int most) {
    (void)line;
    (void)edges;
    (void)most;
    return -1;
}

void gpio_close(gpio_line *line) {
    (void)line;
}
#endif
