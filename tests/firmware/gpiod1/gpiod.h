/* What gpio_v1.c calls of libgpiod 1.6, declared as its gpiod.h declares it: a test has the functions. */
#ifndef FAKE_GPIOD_1_H
#define FAKE_GPIOD_1_H

#include <time.h>

struct gpiod_chip;
struct gpiod_line;
enum { GPIOD_LINE_EVENT_RISING_EDGE = 1, GPIOD_LINE_EVENT_FALLING_EDGE };
enum {
    GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW = 1 << 2,
    GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN = 1 << 4,
    GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP = 1 << 5
};
struct gpiod_line_event {
    struct timespec ts;
    int event_type;
    int offset;
};

struct gpiod_chip *gpiod_chip_open_lookup(const char *descr);
void gpiod_chip_close(struct gpiod_chip *chip);
struct gpiod_line *gpiod_chip_get_line(struct gpiod_chip *chip, unsigned int offset);
struct gpiod_line *gpiod_chip_find_line(struct gpiod_chip *chip, const char *name);
struct gpiod_line *gpiod_line_find(const char *name);
struct gpiod_chip *gpiod_line_get_chip(struct gpiod_line *line);
int gpiod_line_request_input_flags(struct gpiod_line *line, const char *consumer, int flags);
int gpiod_line_request_output_flags(struct gpiod_line *line, const char *consumer, int flags, int default_val);
int gpiod_line_request_both_edges_events_flags(struct gpiod_line *line, const char *consumer, int flags);
int gpiod_line_get_value(struct gpiod_line *line);
int gpiod_line_set_value(struct gpiod_line *line, int value);
int gpiod_line_event_get_fd(struct gpiod_line *line);
int gpiod_line_event_read(struct gpiod_line *line, struct gpiod_line_event *event);

#endif
