/* GPIO lines through libgpiod, 1.6 or 2 (gpio_v1.c, gpio_v2.c; CMake chooses), or none (gpio_none.c).
 *
 * A line is named as "LINE" or "CHIP:LINE", then options after commas: "gpiochip0:17,active-low,pull-up" or
 * "ESTOP,pull-down". CHIP is a name, a number or a path, LINE its name or offset; a bare name is looked for on all
 * chips. Values are logical: 1 is active.
 */
#ifndef TERRAPIN_LINUX_GPIO_H
#define TERRAPIN_LINUX_GPIO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define GPIO_TEXT_MAX 64

typedef struct gpio_line gpio_line;

typedef enum { GPIO_INPUT, GPIO_EDGES, GPIO_OUTPUT } gpio_direction;
typedef enum { GPIO_PULL_AS_IS, GPIO_PULL_UP, GPIO_PULL_DOWN } gpio_pull;

typedef struct {
    char chip[GPIO_TEXT_MAX]; /* empty: any */
    char line[GPIO_TEXT_MAX];
    bool active_low;
    gpio_pull pull;
} gpio_name;

typedef struct {
    uint64_t time_ns; /* the kernel's monotonic time of the edge */
    bool active;      /* what the line became */
} gpio_edge;

/* The libgpiod that this program was built with, for --version. */
extern const char *const gpio_library;

/* Read a name as above. False, and in `why` what is wrong, when it is none. */
bool gpio_parse(const char *text, gpio_name *name, char *why, size_t size);

/* The offset that a name of digits is, or -1. */
long gpio_offset(const char *line);

/* Request a line; an output begins inactive. NULL, and in `why` the reason, when that fails. */
gpio_line *gpio_open(const gpio_name *name, gpio_direction direction, char *why, size_t size);

/* 1 active, 0 inactive, -1 the line cannot be read. */
int gpio_get(gpio_line *line);

/* False when the line cannot be set. Called from handlers of fatal signals as well: one ioctl, no allocation. */
bool gpio_set(gpio_line *line, bool active);

/* To poll for edges. */
int gpio_descriptor(const gpio_line *line);

/* Takes edges that wait (GPIO_EDGES): their number, 0 when there is none, -1 when the line is gone. */
int gpio_edges(gpio_line *line, gpio_edge *edges, int most);

/* Give the line back. NULL is allowed. */
void gpio_close(gpio_line *line);

#endif
