/* The Linux controller with a step, a bus and a command line that are stand-ins; descriptors, poll, signals and the
 * clock are the system's. */
#ifndef LINUX_RIG_H
#define LINUX_RIG_H

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include "unity.h"

#include "terrapin_interface.c"

/* What it says goes to `told_to`, where a test wants to read it. */
static FILE *told_to;
static FILE *its_stderr(void) {
    return (told_to != NULL) ? told_to : stderr;
}
#undef stderr
#define stderr its_stderr()

#include "../../firmware/link/intake.c"
#include "../../firmware/ports/linux/clock.c"
#include "../../firmware/ports/linux/controller.c"
#define main    linux_main
#define options linux_options
int linux_main(int argc, char **argv);
#include "../../firmware/ports/linux/main.c"
#undef main
#undef options

struct gpio_line {
    int descriptor;
    int level;
    int looks;             /* for edges */
    bool gone;             /* reading fails, and its descriptor hangs up */
    volatile bool *output; /* as last set */
    char letter;           /* in outputs_set */
    gpio_edge edge;
    bool has_edge;
};

static int steps;
static int steps_with_estop;
static int steps_until_the_end;
static int brought;
static int last_taken;
static int idle_at = -1; /* step */
static int idle_taken_at;
static int taken_in[1000]; /* reads, by the steps before them */
static volatile bool *enable_output;
static char outputs_set[64]; /* E, D: enable, direction active, e, d: inactive; +, 0, -: duty */
static char opened[64];      /* first letters of what was asked for */
static char refused;         /* that one of them which cannot be had */
static gpio_line *offered;   /* what any line is, when it can be had */
static bool pwm_refuses, zero_refuses, enable_refuses;
static bool bridge_forbidden, stop_was_kept;
static int modes_to_change; /* commands of test mode that come */
static int stops_kept, frames_sent, reopened;
static char told_systemd[64];
static options_result read_as = OPTIONS_DONE;
static controller_options read_options;

static const void *closed[32]; /* in the order in which it was */
static int closed_count;

static void note_closed(const void *what) {
    closed[closed_count % 32] = what;
    closed_count++;
}

static void note_output(char what) {
    const size_t length = strlen(outputs_set);
    if (length < (sizeof outputs_set - 1U)) {
        outputs_set[length] = what;
        outputs_set[length + 1U] = '\0';
    }
}

static bool open_of(char what) {
    const size_t length = strlen(opened);
    if (length < (sizeof opened - 1U)) {
        opened[length] = what;
        opened[length + 1U] = '\0';
    }
    return what != refused;
}

/* ---- stand-ins */

gpio_line *gpio_open(const gpio_name *name, gpio_direction direction, char *why, size_t size) {
    (void)snprintf(why, size, "refused");
    const bool good = open_of(direction == GPIO_OUTPUT ? name->line[0] : (char)(name->line[0] | 0x20));
    return good ? offered : NULL;
}
int gpio_get(gpio_line *line) {
    return line->gone ? -1 : line->level;
}
bool gpio_set(gpio_line *line, bool active) {
    note_output((char)(active ? line->letter : (line->letter | 0x20)));
    if (active && enable_refuses) {
        errno = EIO;
        return false;
    }
    *line->output = active;
    return true;
}
int gpio_descriptor(const gpio_line *line) {
    return line->descriptor;
}
int gpio_edges(gpio_line *line, gpio_edge *edges, int most) {
    line->looks++;
    if (line->has_edge && (most > 0)) {
        char byte = 0;
        edges[0] = line->edge;
        line->has_edge = false;
        return (read(line->descriptor, &byte, 1) == 1) ? 1 : -1;
    }
    return line->gone ? -1 : 0;
}
void gpio_close(gpio_line *line) {
    note_closed(line);
}
bool analog_open(analog_input *input, const char *path, unsigned int bits) {
    (void)input;
    TEST_ASSERT_EQUAL(read_options.adc_bits, bits);
    return (path == NULL) || open_of(path[0]);
}
uint16_t analog_read(const analog_input *input) {
    (void)input;
    return 2048;
}
void analog_close(analog_input *input) {
    note_closed(input);
}
bool quadrature_open(quadrature *encoder, const gpio_name names[2], char *why, size_t size) {
    (void)encoder;
    (void)snprintf(why, size, "refused");
    return open_of(names[0].line[0]);
}
void quadrature_update(quadrature *encoder) {
    (void)encoder;
}
void quadrature_close(quadrature *encoder) {
    note_closed(encoder);
}
bool pwm_open(pwm_output *pwm, const char *folder) {
    (void)pwm;
    return (folder == NULL) || open_of(folder[0]);
}
bool pwm_set(pwm_output *pwm, int16_t duty_q15) {
    (void)pwm;
    note_output((char)((duty_q15 > 0) ? '+' : ((duty_q15 < 0) ? '-' : '0')));
    return (duty_q15 == 0) ? !zero_refuses : !pwm_refuses;
}
void pwm_close(pwm_output *pwm) {
    note_closed(pwm);
}
const bus_kind bus_socketcan = {0};
const bus_kind bus_adapter = {0};
bool bus_open(bus *b) {
    (void)b;
    return open_of('*');
}
bool bus_reopen(bus *b) {
    (void)b;
    reopened++;
    return true;
}
/* A flood: 64 reads of parameters a tick, numbered; as the last of 16 an IDLE. */
int bus_receive(bus *b, terrapin_frame frames[BUS_AT_ONCE]) {
    (void)b;
    if (brought > ((steps + 1) * 64)) {
        return 0;
    }
    for (uint16_t i = 0; i < BUS_AT_ONCE; i++) {
        const terrapin_parameter_read_t read = {.index = brought};
        TEST_ASSERT_TRUE(terrapin_encode_parameter_read(&read, &frames[i]));
        brought++;
    }
    if (idle_at == steps) {
        const terrapin_command_t idle = {.request = TERRAPIN_REQUEST_IDLE};
        TEST_ASSERT_TRUE(terrapin_encode_command(&idle, &frames[BUS_AT_ONCE - 1]));
        idle_at = -1;
    }
    return BUS_AT_ONCE;
}
void bus_send(bus *b, const terrapin_frame *frames, uint8_t count) {
    (void)b, (void)frames;
    frames_sent += count;
}
void bus_close(bus *b) {
    note_closed(b);
}
void bus_report(const bus *b, FILE *to) {
    (void)b, (void)to;
}
size_t terrapin_state_size(void) {
    return 1;
}
void terrapin_link_init(terrapin_link *link, terrapin_state *state, terrapin_inputs *inputs) {
    (void)link, (void)state, (void)inputs;
}
void terrapin_link_use_store(terrapin_link *link, terrapin_state *state, struct terrapin_store *store) {
    (void)link, (void)state, (void)store;
}
terrapin_accept_result terrapin_accept(terrapin_link *link, terrapin_state *state, const terrapin_frame *frame,
                                       terrapin_inputs *inputs, terrapin_frame *reply) {
    (void)state, (void)inputs, (void)reply;
    terrapin_parameter_read_t read;
    if (frame->id == TERRAPIN_ID_COMMAND) {
        link->command_counter = 0U;
        idle_taken_at = steps;
        if (modes_to_change > 0) {
            modes_to_change--;
            link->test_mode = !link->test_mode;
        }
    } else {
        TEST_ASSERT_TRUE(terrapin_decode_parameter_read(frame, &read));
        TEST_ASSERT_GREATER_THAN_MESSAGE(last_taken, read.index, "in the order in which they came");
        last_taken = read.index;
        taken_in[steps]++;
    }
    return TERRAPIN_ACCEPT_NOTHING;
}
bool terrapin_bridge_on(const terrapin_state *state) {
    (void)state;
    return true;
}
bool terrapin_link_store_work(terrapin_link *link, const terrapin_state *state) {
    (void)link, (void)state;
    return false;
}
bool terrapin_link_bridge_allowed(const terrapin_link *link) {
    (void)link;
    return !bridge_forbidden;
}
void terrapin_link_drive(terrapin_state *state, const terrapin_inputs *inputs, terrapin_outputs *outputs) {
    (void)state;
    steps++;
    steps_with_estop += inputs->estop ? 1 : 0;
    outputs->enable = !inputs->estop;
}
void terrapin_link_think(terrapin_state *state, terrapin_inputs *inputs, terrapin_outputs *outputs) {
    (void)state, (void)inputs;
    TEST_ASSERT_TRUE_MESSAGE((*enable_output == outputs->enable) || enable_refuses || pwm_refuses,
                             "the bridge is set before anything else is done");
    if (steps >= steps_until_the_end) {
        (void)raise(SIGTERM); /* blocked: it waits in the signalfd */
    }
}
bool terrapin_process_store(terrapin_flash_file *file, terrapin_store *store, const char *name) {
    (void)file, (void)store, (void)name;
    return true;
}
void terrapin_process_identity(terrapin_identity *identity, int node, terrapin_flash_file *file) {
    (void)identity, (void)node, (void)file;
}
bool terrapin_process_take_stop(const terrapin_flash_file *file, terrapin_state *state) {
    (void)file, (void)state;
    return stop_was_kept;
}
void terrapin_process_keep_stop(terrapin_flash_file *file, const terrapin_state *state, bool *kept) {
    (void)file, (void)state, (void)kept;
    stops_kept++;
}
bool terrapin_process_option(const char *word) {
    return strcmp(word, "--flash") == 0;
}
void terrapin_seal_at(terrapin_seal *seal, uint32_t now_ms) {
    seal->now_ms = now_ms;
}

bool terrapin_process_seal(terrapin_link *link, const char *path) {
    (void)link;
    return open_of(path[0]);
}
uint32_t terrapin_process_ms(void) {
    return 0U;
}
void terrapin_node_init(terrapin_node *node, uint8_t number) {
    (void)node, (void)number;
}
void terrapin_flash_file_close(terrapin_flash_file *file) {
    note_closed(file);
}
int terrapin_process(int argc, char **argv) {
    (void)argv;
    return 40 + argc;
}
options_result options_read(int argc, char **argv, controller_options *read) {
    (void)argc, (void)argv;
    *read = read_options;
    return read_as;
}
void systemd_tell(const char *state) {
    (void)snprintf(told_systemd, sizeof told_systemd, "%s", state);
}
void real_time(int priority) {
    (void)priority;
}

#endif
