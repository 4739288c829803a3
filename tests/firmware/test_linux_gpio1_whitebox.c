/* GPIO lines through libgpiod 1.6: what is asked of it, and what its answers become. */
#define _GNU_SOURCE

#include <unistd.h>

#include "unity.h"

#define TERRAPIN_LIBGPIOD 1
#include "../../firmware/ports/linux/gpio.c"
#include "../../firmware/ports/linux/gpio_v1.c"

struct gpiod_chip {
    int opened;
};
struct gpiod_line {
    int value;
};

static struct gpiod_chip chip;
static struct gpiod_line the_line;
static char asked[160];
static bool no_chip, no_line, taken_by_others;
static int value_told;
static struct gpiod_line_event events[100];
static int event_count, event_at, events_good;
static int ends[2];

static void note(const char *what) {
    (void)snprintf(&asked[strlen(asked)], sizeof asked - strlen(asked), "%s ", what);
}

struct gpiod_chip *gpiod_chip_open_lookup(const char *descr) {
    note(descr);
    chip.opened += no_chip ? 0 : 1;
    errno = no_chip ? ENOENT : 0;
    return no_chip ? NULL : &chip;
}
void gpiod_chip_close(struct gpiod_chip *which) {
    which->opened--;
}
struct gpiod_line *gpiod_chip_get_line(struct gpiod_chip *which, unsigned int offset) {
    (void)which;
    char text[16];
    (void)snprintf(text, sizeof text, "#%u", offset);
    note(text);
    return no_line ? NULL : &the_line;
}
struct gpiod_line *gpiod_chip_find_line(struct gpiod_chip *which, const char *name) {
    (void)which;
    note("named");
    note(name);
    return no_line ? NULL : &the_line;
}
struct gpiod_line *gpiod_line_find(const char *name) {
    note("anywhere");
    note(name);
    chip.opened += no_line ? 0 : 1;
    return no_line ? NULL : &the_line;
}
struct gpiod_chip *gpiod_line_get_chip(struct gpiod_line *line) {
    TEST_ASSERT_EQUAL_PTR(&the_line, line);
    return &chip;
}
static int request_of(const char *what, const char *consumer, int all) {
    char text[64];
    TEST_ASSERT_EQUAL_STRING("terrapin-controller", consumer);
    (void)snprintf(text, sizeof text, "%s/%d", what, all);
    note(text);
    errno = taken_by_others ? EBUSY : 0;
    return taken_by_others ? -1 : 0;
}
int gpiod_line_request_input_flags(struct gpiod_line *line, const char *consumer, int all) {
    (void)line;
    return request_of("input", consumer, all);
}
int gpiod_line_request_output_flags(struct gpiod_line *line, const char *consumer, int all, int default_val) {
    TEST_ASSERT_EQUAL_MESSAGE(0, default_val, "an output begins inactive");
    (void)line;
    return request_of("output", consumer, all);
}
int gpiod_line_request_both_edges_events_flags(struct gpiod_line *line, const char *consumer, int all) {
    (void)line;
    return request_of("edges", consumer, all);
}
int gpiod_line_get_value(struct gpiod_line *line) {
    return line->value;
}
int gpiod_line_set_value(struct gpiod_line *line, int value) {
    line->value = value;
    value_told++;
    return taken_by_others ? -1 : 0;
}
int gpiod_line_event_get_fd(struct gpiod_line *line) {
    (void)line;
    return ends[0];
}
int gpiod_line_event_read(struct gpiod_line *line, struct gpiod_line_event *event) {
    (void)line;
    if (event_at >= events_good) {
        return -1;
    }
    *event = events[event_at];
    event_at++;
    if (event_at == event_count) {
        char byte = 0;
        TEST_ASSERT_EQUAL(1, read(ends[0], &byte, 1)); /* nothing waits any more */
    }
    return 0;
}

void setUp(void) {
    asked[0] = '\0';
    chip.opened = 0;
    no_chip = no_line = taken_by_others = false;
    event_count = event_at = 0;
    events_good = 100;
    TEST_ASSERT_EQUAL(0, pipe(ends));
}
void tearDown(void) {
    (void)close(ends[0]);
    (void)close(ends[1]);
}

static gpio_line *has(const char *text, gpio_direction direction) {
    char why[160] = "";
    gpio_name name;
    TEST_ASSERT_TRUE(gpio_parse(text, &name, why, sizeof why));
    return gpio_open(&name, direction, why, sizeof why);
}

static void test_what_is_asked_for(void) {
    static const struct {
        const char *text;
        gpio_direction direction;
        const char *asked;
    } cases[] = {
        {"gpiochip0:17", GPIO_OUTPUT, "gpiochip0 #17 output/0 "},
        {"gpiochip0:17,active-low", GPIO_OUTPUT, "gpiochip0 #17 output/4 "},
        {"gpiochip1:ESTOP,pull-down", GPIO_EDGES, "gpiochip1 named ESTOP edges/16 "},
        {"ESTOP,pull-up,active-low", GPIO_EDGES, "anywhere ESTOP edges/36 "},
        {"KEY", GPIO_INPUT, "anywhere KEY input/0 "},
    };
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        asked[0] = '\0';
        gpio_line *line = has(cases[i].text, cases[i].direction);
        TEST_ASSERT_NOT_NULL(line);
        TEST_ASSERT_EQUAL_STRING(cases[i].asked, asked);
        TEST_ASSERT_EQUAL(1, chip.opened);
        gpio_close(line);
        TEST_ASSERT_EQUAL(0, chip.opened);
    }
    gpio_close(NULL);
}

static void test_what_cannot_be_had_is_said_and_given_back(void) {
    char why[160] = "";
    gpio_name name;
    no_chip = true;
    TEST_ASSERT_TRUE(gpio_parse("c:1", &name, why, sizeof why));
    TEST_ASSERT_NULL(gpio_open(&name, GPIO_OUTPUT, why, sizeof why));
    TEST_ASSERT_EQUAL_STRING("no such chip: No such file or directory", why);
    no_chip = false;
    no_line = true;
    TEST_ASSERT_NULL(gpio_open(&name, GPIO_OUTPUT, why, sizeof why));
    TEST_ASSERT_EQUAL_STRING("no such line", why);
    TEST_ASSERT_EQUAL(0, chip.opened);
    TEST_ASSERT_NULL(has("NAME", GPIO_OUTPUT));
    no_line = false;
    taken_by_others = true;
    TEST_ASSERT_NULL(gpio_open(&name, GPIO_OUTPUT, why, sizeof why));
    TEST_ASSERT_EQUAL_STRING("cannot be had: Device or resource busy", why);
    TEST_ASSERT_EQUAL(0, chip.opened);
}

static void test_values(void) {
    gpio_line *line = has("c:1", GPIO_OUTPUT);
    value_told = 0;
    TEST_ASSERT_TRUE(gpio_set(line, true));
    TEST_ASSERT_EQUAL(1, gpio_get(line));
    TEST_ASSERT_TRUE(gpio_set(line, false));
    TEST_ASSERT_EQUAL(0, gpio_get(line));
    TEST_ASSERT_EQUAL(2, value_told);
    taken_by_others = true;
    TEST_ASSERT_FALSE(gpio_set(line, true));
    the_line.value = -1;
    TEST_ASSERT_EQUAL(-1, gpio_get(line));
    TEST_ASSERT_EQUAL(ends[0], gpio_descriptor(line));
    gpio_close(line);
}

static void test_edges(void) {
    gpio_line *line = has("c:1", GPIO_EDGES);
    gpio_edge edges[8];
    TEST_ASSERT_EQUAL(0, gpio_edges(line, edges, 8));
    events[0] = (struct gpiod_line_event){.ts = {2, 500}, .event_type = GPIOD_LINE_EVENT_RISING_EDGE};
    events[1] = (struct gpiod_line_event){.ts = {3, 7}, .event_type = GPIOD_LINE_EVENT_FALLING_EDGE};
    events[2] = events[0];
    event_count = 3;
    TEST_ASSERT_EQUAL(1, write(ends[1], "x", 1));
    TEST_ASSERT_EQUAL(2, gpio_edges(line, edges, 2)); /* no more than asked for */
    TEST_ASSERT_TRUE(edges[0].active);
    TEST_ASSERT_EQUAL_UINT64(2000000500U, edges[0].time_ns);
    TEST_ASSERT_FALSE(edges[1].active);
    TEST_ASSERT_EQUAL_UINT64(3000000007U, edges[1].time_ns);
    TEST_ASSERT_EQUAL(1, gpio_edges(line, edges, 8));
    TEST_ASSERT_EQUAL(0, gpio_edges(line, edges, 8));
    gpio_close(line);
}

/* A chip that is pulled out: what came before it is told first. */
static void test_a_line_that_is_gone(void) {
    gpio_line *line = has("c:1", GPIO_EDGES);
    gpio_edge edges[8];
    TEST_ASSERT_EQUAL(1, write(ends[1], "x", 1));
    event_count = 5;
    events_good = 1;
    TEST_ASSERT_EQUAL(1, gpio_edges(line, edges, 8));
    TEST_ASSERT_EQUAL(-1, gpio_edges(line, edges, 8));
    gpio_close(line);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_is_asked_for);
    RUN_TEST(test_what_cannot_be_had_is_said_and_given_back);
    RUN_TEST(test_values);
    RUN_TEST(test_edges);
    RUN_TEST(test_a_line_that_is_gone);
    return UNITY_END();
}
