/* GPIO lines through libgpiod 2: what is asked of it, what its answers become, and that all of it is given back. */
#define _GNU_SOURCE

#include "unity.h"

#define TERRAPIN_LIBGPIOD 2
#include "../../firmware/ports/linux/gpio.c"
#define opendir  fake_opendir
#define readdir  fake_readdir
#define closedir fake_closedir
#include <dirent.h>
#include "../../firmware/ports/linux/gpio_v2.c"
#undef opendir
#undef readdir
#undef closedir

struct gpiod_chip {
    char path[64];
};
struct gpiod_line_settings {
    enum gpiod_line_direction direction;
    enum gpiod_line_edge edge;
    enum gpiod_line_bias bias;
    enum gpiod_line_value output;
    bool active_low;
};
struct gpiod_line_config {
    struct gpiod_line_settings settings;
    unsigned int offset;
};
struct gpiod_request_config {
    char consumer[32];
    size_t kept;
};
struct gpiod_line_request {
    struct gpiod_line_settings settings;
    unsigned int offset;
};
struct gpiod_edge_event {
    uint64_t time_ns;
    enum gpiod_edge_event_type type;
};
struct gpiod_edge_event_buffer {
    struct gpiod_edge_event events[64];
};

static int had; /* what was made and not freed */
static const char *only_chip;
static int named_offset;
static bool taken_by_others, no_memory_for_events;
static struct gpiod_line_settings asked;
static unsigned int asked_offset;
static size_t asked_kept, asked_events;
static enum gpiod_line_value level;
static struct gpiod_edge_event waiting[64];
static int waits;
static int found_at;

static const char *const names[] = {".", "null", "gpiochip3", "gpiochip5", "tty"};
static struct dirent entry;
static DIR *fake_opendir_result = (DIR *)(void *)&entry;

DIR *fake_opendir(const char *name) {
    TEST_ASSERT_EQUAL_STRING("/dev", name);
    found_at = 0;
    had++;
    return fake_opendir_result;
}
struct dirent *fake_readdir(DIR *folder) {
    (void)folder;
    if (found_at >= (int)(sizeof names / sizeof names[0])) {
        return NULL;
    }
    (void)snprintf(entry.d_name, sizeof entry.d_name, "%s", names[found_at]);
    found_at++;
    return &entry;
}
int fake_closedir(DIR *folder) {
    (void)folder;
    had--;
    return 0;
}

struct gpiod_chip *gpiod_chip_open(const char *path) {
    if ((only_chip != NULL) && (strcmp(path, only_chip) != 0)) {
        errno = ENOENT;
        return NULL;
    }
    struct gpiod_chip *made = calloc(1, sizeof *made);
    (void)snprintf(made->path, sizeof made->path, "%s", path);
    had++;
    return made;
}
void gpiod_chip_close(struct gpiod_chip *chip) {
    had -= (chip != NULL) ? 1 : 0;
    free(chip);
}
int gpiod_chip_get_line_offset_from_name(struct gpiod_chip *chip, const char *name) {
    TEST_ASSERT_EQUAL_STRING("ESTOP", name);
    return (strcmp(chip->path, "/dev/gpiochip5") == 0) ? named_offset : -1;
}
struct gpiod_line_request *gpiod_chip_request_lines(struct gpiod_chip *chip, struct gpiod_request_config *req_cfg,
                                                    struct gpiod_line_config *line_cfg) {
    TEST_ASSERT_NOT_NULL(chip);
    TEST_ASSERT_EQUAL_STRING("terrapin-controller", req_cfg->consumer);
    asked_kept = req_cfg->kept;
    asked = line_cfg->settings;
    asked_offset = line_cfg->offset;
    if (taken_by_others) {
        errno = EBUSY;
        return NULL;
    }
    struct gpiod_line_request *made = calloc(1, sizeof *made);
    made->offset = line_cfg->offset;
    had++;
    return made;
}
struct gpiod_line_settings *gpiod_line_settings_new(void) {
    struct gpiod_line_settings *made = calloc(1, sizeof *made);
    made->direction = GPIOD_LINE_DIRECTION_AS_IS;
    made->edge = GPIOD_LINE_EDGE_NONE;
    made->bias = GPIOD_LINE_BIAS_AS_IS;
    made->output = GPIOD_LINE_VALUE_ERROR; /* not said */
    had++;
    return made;
}
void gpiod_line_settings_free(struct gpiod_line_settings *settings) {
    had--;
    free(settings);
}
int gpiod_line_settings_set_direction(struct gpiod_line_settings *settings, enum gpiod_line_direction direction) {
    settings->direction = direction;
    return 0;
}
int gpiod_line_settings_set_edge_detection(struct gpiod_line_settings *settings, enum gpiod_line_edge edge) {
    settings->edge = edge;
    return 0;
}
int gpiod_line_settings_set_bias(struct gpiod_line_settings *settings, enum gpiod_line_bias bias) {
    settings->bias = bias;
    return 0;
}
void gpiod_line_settings_set_active_low(struct gpiod_line_settings *settings, bool active_low) {
    settings->active_low = active_low;
}
int gpiod_line_settings_set_output_value(struct gpiod_line_settings *settings, enum gpiod_line_value value) {
    settings->output = value;
    return 0;
}
struct gpiod_line_config *gpiod_line_config_new(void) {
    had++;
    return calloc(1, sizeof(struct gpiod_line_config));
}
void gpiod_line_config_free(struct gpiod_line_config *config) {
    had--;
    free(config);
}
int gpiod_line_config_add_line_settings(struct gpiod_line_config *config, const unsigned int *offsets,
                                        size_t num_offsets, struct gpiod_line_settings *settings) {
    TEST_ASSERT_EQUAL(1, num_offsets);
    config->offset = offsets[0];
    config->settings = *settings;
    return 0;
}
struct gpiod_request_config *gpiod_request_config_new(void) {
    had++;
    return calloc(1, sizeof(struct gpiod_request_config));
}
void gpiod_request_config_free(struct gpiod_request_config *config) {
    had--;
    free(config);
}
void gpiod_request_config_set_consumer(struct gpiod_request_config *config, const char *consumer) {
    (void)snprintf(config->consumer, sizeof config->consumer, "%s", consumer);
}
void gpiod_request_config_set_event_buffer_size(struct gpiod_request_config *config, size_t event_buffer_size) {
    config->kept = event_buffer_size;
}
void gpiod_line_request_release(struct gpiod_line_request *made) {
    had -= (made != NULL) ? 1 : 0;
    free(made);
}
enum gpiod_line_value gpiod_line_request_get_value(struct gpiod_line_request *made, unsigned int offset) {
    TEST_ASSERT_EQUAL(made->offset, offset);
    return level;
}
int gpiod_line_request_set_value(struct gpiod_line_request *made, unsigned int offset, enum gpiod_line_value value) {
    TEST_ASSERT_EQUAL(made->offset, offset);
    level = value;
    return taken_by_others ? -1 : 0;
}
int gpiod_line_request_get_fd(struct gpiod_line_request *made) {
    return (int)made->offset;
}
int gpiod_line_request_wait_edge_events(struct gpiod_line_request *made, int64_t timeout_ns) {
    (void)made;
    TEST_ASSERT_EQUAL_MESSAGE(0, timeout_ns, "the loop does not wait here");
    return (waits > 0) ? 1 : waits;
}
int gpiod_line_request_read_edge_events(struct gpiod_line_request *made, struct gpiod_edge_event_buffer *buffer,
                                        size_t max_events) {
    (void)made;
    asked_events = max_events;
    const int count = (waits < (int)max_events) ? waits : (int)max_events;
    for (int i = 0; i < count; i++) {
        buffer->events[i] = waiting[i];
    }
    return count;
}
struct gpiod_edge_event_buffer *gpiod_edge_event_buffer_new(size_t capacity) {
    TEST_ASSERT_EQUAL(64, capacity);
    had += no_memory_for_events ? 0 : 1;
    return no_memory_for_events ? NULL : calloc(1, sizeof(struct gpiod_edge_event_buffer));
}
void gpiod_edge_event_buffer_free(struct gpiod_edge_event_buffer *buffer) {
    had -= (buffer != NULL) ? 1 : 0;
    free(buffer);
}
struct gpiod_edge_event *gpiod_edge_event_buffer_get_event(struct gpiod_edge_event_buffer *buffer,
                                                           unsigned long index) {
    return &buffer->events[index];
}
enum gpiod_edge_event_type gpiod_edge_event_get_event_type(struct gpiod_edge_event *event) {
    return event->type;
}
uint64_t gpiod_edge_event_get_timestamp_ns(struct gpiod_edge_event *event) {
    return event->time_ns;
}

static char why[160];

void setUp(void) {
    had = 0;
    only_chip = NULL;
    named_offset = 4;
    taken_by_others = no_memory_for_events = false;
    level = GPIOD_LINE_VALUE_INACTIVE;
    waits = 0;
    why[0] = '\0';
}
void tearDown(void) {
    TEST_ASSERT_EQUAL_MESSAGE(0, had, "all is given back");
}

static gpio_line *has(const char *text, gpio_direction direction) {
    gpio_name name;
    TEST_ASSERT_TRUE(gpio_parse(text, &name, why, sizeof why));
    return gpio_open(&name, direction, why, sizeof why);
}

static void test_an_output_begins_inactive(void) {
    gpio_line *line = has("gpiochip0:17,active-low", GPIO_OUTPUT);
    TEST_ASSERT_NOT_NULL(line);
    TEST_ASSERT_EQUAL(GPIOD_LINE_DIRECTION_OUTPUT, asked.direction);
    TEST_ASSERT_EQUAL(GPIOD_LINE_VALUE_INACTIVE, asked.output);
    TEST_ASSERT_EQUAL(GPIOD_LINE_EDGE_NONE, asked.edge);
    TEST_ASSERT_EQUAL(GPIOD_LINE_BIAS_AS_IS, asked.bias);
    TEST_ASSERT_TRUE(asked.active_low);
    TEST_ASSERT_EQUAL(17, asked_offset);
    gpio_close(line);
}

static void test_inputs_and_edges(void) {
    gpio_line *line = has("gpiochip0:3,pull-up", GPIO_EDGES);
    TEST_ASSERT_EQUAL(GPIOD_LINE_DIRECTION_INPUT, asked.direction);
    TEST_ASSERT_EQUAL(GPIOD_LINE_EDGE_BOTH, asked.edge);
    TEST_ASSERT_EQUAL(GPIOD_LINE_BIAS_PULL_UP, asked.bias);
    TEST_ASSERT_FALSE(asked.active_low);
    TEST_ASSERT_EQUAL(1024, asked_kept);
    gpio_close(line);
    line = has("gpiochip0:3,pull-down", GPIO_INPUT);
    TEST_ASSERT_EQUAL(GPIOD_LINE_DIRECTION_INPUT, asked.direction);
    TEST_ASSERT_EQUAL(GPIOD_LINE_EDGE_NONE, asked.edge);
    TEST_ASSERT_EQUAL(GPIOD_LINE_BIAS_PULL_DOWN, asked.bias);
    gpio_close(line);
}

static void test_chips_by_name_number_and_path(void) {
    static const char *const texts[] = {"gpiochip5:1", "5:1", "/dev/gpiochip5:1", "ESTOP", "gpiochip5:ESTOP"};
    only_chip = "/dev/gpiochip5";
    for (size_t i = 0; i < (sizeof texts / sizeof texts[0]); i++) {
        gpio_line *line = has(texts[i], GPIO_INPUT);
        TEST_ASSERT_NOT_NULL(line);
        TEST_ASSERT_EQUAL((i < 3U) ? 1 : 4, asked_offset);
        gpio_close(line);
    }
    only_chip = NULL; /* the chip before it has no line of that name */
    gpio_line *line = has("ESTOP", GPIO_INPUT);
    TEST_ASSERT_EQUAL(4, asked_offset);
    gpio_close(line);
}

static void test_what_cannot_be_had_is_said_and_given_back(void) {
    only_chip = "/dev/other";
    TEST_ASSERT_NULL(has("c:1", GPIO_OUTPUT));
    TEST_ASSERT_EQUAL_STRING("no such chip: No such file or directory", why);
    only_chip = NULL;
    named_offset = -1;
    TEST_ASSERT_NULL(has("gpiochip5:ESTOP", GPIO_OUTPUT));
    TEST_ASSERT_EQUAL_STRING_LEN("no such line", why, 12);
    TEST_ASSERT_NULL(has("ESTOP", GPIO_OUTPUT));
    TEST_ASSERT_EQUAL_STRING_LEN("no such line", why, 12);
    taken_by_others = true;
    TEST_ASSERT_NULL(has("c:1", GPIO_OUTPUT));
    TEST_ASSERT_EQUAL_STRING("cannot be had: Device or resource busy", why);
    TEST_ASSERT_NULL(has("c:1", GPIO_EDGES));
    taken_by_others = false;
    no_memory_for_events = true;
    TEST_ASSERT_NULL(has("c:1", GPIO_EDGES));
    gpio_line *line = has("c:1", GPIO_OUTPUT); /* which has no use for it */
    TEST_ASSERT_NOT_NULL(line);
    gpio_close(line);
    gpio_close(NULL);
}

static void test_values(void) {
    gpio_line *line = has("c:9", GPIO_OUTPUT);
    TEST_ASSERT_TRUE(gpio_set(line, true));
    TEST_ASSERT_EQUAL(GPIOD_LINE_VALUE_ACTIVE, level);
    TEST_ASSERT_EQUAL(1, gpio_get(line));
    TEST_ASSERT_TRUE(gpio_set(line, false));
    TEST_ASSERT_EQUAL(GPIOD_LINE_VALUE_INACTIVE, level);
    TEST_ASSERT_EQUAL(0, gpio_get(line));
    level = GPIOD_LINE_VALUE_ERROR;
    TEST_ASSERT_EQUAL(-1, gpio_get(line));
    taken_by_others = true;
    TEST_ASSERT_FALSE(gpio_set(line, true));
    TEST_ASSERT_EQUAL(9, gpio_descriptor(line));
    gpio_close(line);
}

static void test_edges(void) {
    gpio_line *line = has("c:1", GPIO_EDGES);
    gpio_edge edges[80];
    TEST_ASSERT_EQUAL(0, gpio_edges(line, edges, 80));
    waiting[0] = (struct gpiod_edge_event){2000000500U, GPIOD_EDGE_EVENT_RISING_EDGE};
    waiting[1] = (struct gpiod_edge_event){3000000007U, GPIOD_EDGE_EVENT_FALLING_EDGE};
    waits = 2;
    TEST_ASSERT_EQUAL(2, gpio_edges(line, edges, 80));
    TEST_ASSERT_EQUAL_MESSAGE(64, asked_events, "no more than the buffer has");
    TEST_ASSERT_TRUE(edges[0].active);
    TEST_ASSERT_EQUAL_UINT64(2000000500U, edges[0].time_ns);
    TEST_ASSERT_FALSE(edges[1].active);
    TEST_ASSERT_EQUAL_UINT64(3000000007U, edges[1].time_ns);
    TEST_ASSERT_EQUAL(1, gpio_edges(line, edges, 1));
    TEST_ASSERT_EQUAL(1, asked_events);
    waits = -1; /* its chip was pulled out */
    TEST_ASSERT_EQUAL(-1, gpio_edges(line, edges, 80));
    gpio_close(line);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_an_output_begins_inactive);
    RUN_TEST(test_inputs_and_edges);
    RUN_TEST(test_chips_by_name_number_and_path);
    RUN_TEST(test_what_cannot_be_had_is_said_and_given_back);
    RUN_TEST(test_values);
    RUN_TEST(test_edges);
    return UNITY_END();
}
