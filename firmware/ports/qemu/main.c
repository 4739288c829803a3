/* The controller on an emulated Cortex-M4: SLCAN over two files of the host (named pipes), nothing else.
 *
 *     qemu-system-arm -M netduinoplus2 -nographic -semihosting-config enable=on,target=native,arg=x,arg=IN,arg=OUT \
 *                     -kernel terrapin-qemu.elf
 *
 * Further words: `node N` gives it a node number, `count` makes it count.
 *
 * It ends when IN ends (status 0), when a file cannot be opened or written (1), on a bad command line (2) or a
 * processor fault (3). Its last lines are "stack BYTES", the stack that the run took, and, with `count`
 * and -icount shift=7, the instructions of the steps: "step STEPS MINIMUM MEDIAN MAXIMUM", "step-without-telemetry
 * ...", and "frame ..." of taking in frames.
 */
#include <string.h>

#include "count.h"
#include "semihosting.h"
#include "service.h"
#include "stack.h"
#include "state.h"

#define IN_SIZE 512U
/* As in the host's process: the shortest line with the longest answer decides. */
#define OUT_SIZE     ((4U * IN_SIZE) + TERRAPIN_SERVICE_ANSWER_MAX)
#define COMMAND_SIZE 512U

static terrapin_state state;
static terrapin_service service;
static terrapin_identity identity;
static uint8_t in[IN_SIZE];
static uint8_t out[OUT_SIZE];
static char command[COMMAND_SIZE];

/* The word after the first space at or after *at, ended by a zero there; *at moves behind it. "" when there is none. */
static const char *next_word(size_t *at) {
    while ((command[*at] != ' ') && (command[*at] != '\0')) {
        (*at)++;
    }
    if (command[*at] == '\0') {
        return &command[*at];
    }
    command[*at] = '\0';
    (*at)++;
    return &command[*at];
}

/* Appends a space and a number to the text of *length bytes. */
static void put_number(char *text, size_t *length, uint32_t number) {
    char digits[10] = {0};
    size_t count = 0;
    uint32_t value = number;
    do {
        digits[count] = (char)('0' + (char)(value % 10U));
        count++;
        value /= 10U;
    } while (value > 0U);
    text[*length] = ' ';
    (*length)++;
    while (count > 0U) {
        count--;
        text[*length] = digits[count];
        (*length)++;
    }
}

/* One line: a word and its numbers. */
static void say(int32_t file, const char *word, const uint32_t *numbers, size_t count) {
    char text[80] = {0};
    size_t length = 0;
    while (word[length] != '\0') {
        text[length] = word[length];
        length++;
    }
    for (size_t i = 0; i < count; i++) {
        put_number(text, &length, numbers[i]);
    }
    text[length] = '\n';
    (void)semihosting_write(file, (const uint8_t *)text, length + 1U);
}

static void say_counts(int32_t file, const char *word, count_summary counts) {
    const uint32_t numbers[4] = {counts.steps, counts.minimum, counts.median, counts.maximum};
    say(file, word, numbers, 4U);
}

static int serve(int32_t from, int32_t to) {
    for (size_t n = semihosting_read(from, in, IN_SIZE); n > 0U; n = semihosting_read(from, in, IN_SIZE)) {
        size_t length = 0;
        for (size_t i = 0; i < n; i++) {
            length += terrapin_service_take(&service, in[i], &out[length]);
        }
        if ((length > 0U) && (semihosting_write(to, out, length) != 0)) {
            return 1;
        }
    }
    return 0;
}

int main(void) {
    stack_paint();
    size_t at = 0;
    if (semihosting_command_line(command, sizeof command) != 0) {
        return 2;
    }
    const char *source = next_word(&at);
    const char *sink = next_word(&at);
    const char *option = next_word(&at);
    uint8_t node = 0;
    bool count = false;
    while (option[0] != '\0') {
        if (strcmp(option, "node") == 0) {
            node = (uint8_t)(next_word(&at)[0] - '0'); /* more than a node's digit: 0 */
        } else {
            count = count || (strcmp(option, "count") == 0);
        }
        option = next_word(&at);
    }
    if ((source[0] == '\0') || (sink[0] == '\0')) {
        return 2;
    }
    const int32_t from = semihosting_open(source, 0);
    const int32_t to = semihosting_open(sink, 1);
    if ((from < 0) || (to < 0)) {
        return 1;
    }
    terrapin_service_init(&service, &state);
    terrapin_identity_init(&identity, 0U, (node < (uint8_t)TERRAPIN_NODES) ? node : 0U);
    terrapin_service_use_identity(&service, &identity);
    if (count) {
        count_start();
    }
    const int result = serve(from, to);
    const uint32_t used = stack_used();
    say(to, "stack", &used, 1U);
    say_counts(to, "step", count_whole());
    say_counts(to, "step-without-telemetry", count_without_telemetry());
    say_counts(to, "frame", count_frame());
    return result;
}
