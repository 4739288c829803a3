/* The Linux controller's bus, whatever its kind, and the SLCAN adapter on a serial port: what is told and counted when
 * it goes, what is written to it and what of its words is a frame. The port's calls are stand-ins. */
#define _GNU_SOURCE

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#include "unity.h"

#include "node.c"
#include "slcan.c"
#include "terrapin_interface.c"

static FILE *said;
static char *told_text;
static size_t told_size;
#undef stderr
#define stderr said
static ssize_t fake_write(int descriptor, const void *bytes, size_t size);
static int fake_close(int descriptor);
#define write(descriptor, bytes, size) fake_write(descriptor, bytes, size)
#define close(descriptor)              fake_close(descriptor)
#include "../../firmware/ports/linux/bus.c"
static int fake_open(const char *name, int flags);
static ssize_t fake_read(int descriptor, void *bytes, size_t size);
static int fake_tcgetattr(int descriptor, struct termios *settings);
static int fake_tcsetattr(int descriptor, int when, const struct termios *settings);
#define open(name, flags)                     fake_open(name, flags)
#define read(descriptor, bytes, size)         fake_read(descriptor, bytes, size)
#define tcgetattr(descriptor, settings)       fake_tcgetattr(descriptor, settings)
#define tcsetattr(descriptor, when, settings) fake_tcsetattr(descriptor, when, settings)
#include "../../firmware/ports/linux/bus_adapter.c"
#undef write
#undef close
#undef open
#undef read
#undef tcgetattr
#undef tcsetattr

/* ---- the port */

static bus b;
static int given;         /* descriptor that is opened */
static const char *fails; /* one of open, get, set, read, write; NULL: none */
static int reason;        /* errno of what fails */
static int opened, closed, asked_to_write;
static char written[512];
static size_t written_size, most_at_once; /* bytes that a write takes */
static const char *incoming;              /* read next */
static bool ended;                        /* a read gives 0 bytes */
static size_t read_size;
static struct termios before, after;

static bool failing(const char *call) {
    errno = reason;
    return (fails != NULL) && (strcmp(fails, call) == 0);
}

static int fake_open(const char *name, int flags) {
    TEST_ASSERT_EQUAL_STRING("/dev/ttyACM0", name);
    TEST_ASSERT_EQUAL_HEX(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC, flags);
    opened++;
    return failing("open") ? -1 : given;
}
static int fake_close(int descriptor) {
    TEST_ASSERT_EQUAL(given, descriptor);
    closed++;
    errno = EBADMSG; /* what went wrong before is what is told */
    return 0;
}
static int fake_tcgetattr(int descriptor, struct termios *settings) {
    TEST_ASSERT_EQUAL(given, descriptor);
    *settings = before;
    return failing("get") ? -1 : 0;
}
static int fake_tcsetattr(int descriptor, int when, const struct termios *settings) {
    TEST_ASSERT_EQUAL(given, descriptor);
    TEST_ASSERT_EQUAL(TCSANOW, when);
    after = *settings;
    return failing("set") ? -1 : 0;
}
static ssize_t fake_write(int descriptor, const void *bytes, size_t size) {
    TEST_ASSERT_EQUAL(given, descriptor);
    TEST_ASSERT_GREATER_THAN(0U, size);
    asked_to_write++;
    if (failing("write")) {
        return -1;
    }
    const size_t taken = (size < most_at_once) ? size : most_at_once;
    TEST_ASSERT_LESS_THAN(sizeof written - written_size, taken);
    (void)memcpy(&written[written_size], bytes, taken);
    written_size += taken;
    written[written_size] = '\0';
    return (ssize_t)taken;
}
static ssize_t fake_read(int descriptor, void *bytes, size_t size) {
    TEST_ASSERT_EQUAL(given, descriptor);
    read_size = size;
    if (failing("read")) {
        return -1;
    }
    if (ended) {
        return 0;
    }
    const size_t length = strlen(incoming);
    const size_t taken = (length < size) ? length : size;
    (void)memcpy(bytes, incoming, taken);
    incoming += taken;
    errno = EAGAIN;
    return (taken > 0U) ? (ssize_t)taken : -1;
}

/* A kind of the test's own, for bus.c alone. */
static bool kind_opens = true;
static int kind_brings, kind_asked;
static terrapin_frame kind_frames[BUS_AT_ONCE], kind_sent[TERRAPIN_MAX_FRAMES];
static uint8_t kind_count;
static bool kind_open(bus *of) {
    TEST_ASSERT_EQUAL_PTR(&b, of);
    TEST_ASSERT_EQUAL_MESSAGE(-1, of->descriptor, "it has none while it is opened");
    errno = EACCES;
    of->descriptor = kind_opens ? given : -1;
    kind_asked++;
    return kind_opens;
}
static int kind_receive(bus *of, terrapin_frame frames[BUS_AT_ONCE]) {
    TEST_ASSERT_EQUAL_PTR(&b, of);
    (void)memcpy(frames, kind_frames, sizeof kind_frames);
    kind_asked++;
    return kind_brings;
}
static void kind_send(bus *of, const terrapin_frame *frames, uint8_t count) {
    TEST_ASSERT_EQUAL_PTR(&b, of);
    (void)memcpy(kind_sent, frames, count * sizeof frames[0]);
    kind_count = count;
    kind_asked++;
}
static const bus_kind plain = {.open = kind_open, .receive = kind_receive, .send = kind_send};

void setUp(void) {
    said = open_memstream(&told_text, &told_size);
    TEST_ASSERT_NOT_NULL(said);
    (void)memset(&b, 0, sizeof b);
    b.name = "/dev/ttyACM0";
    b.kind = &plain;
    b.bitrate = 500000;
    b.descriptor = -1;
    terrapin_node_init(&b.node, 0U);
    given = 0; /* a controller that was started without standard input gets it */
    fails = NULL;
    reason = EIO;
    opened = closed = asked_to_write = 0;
    written_size = 0U;
    written[0] = '\0';
    most_at_once = sizeof written;
    incoming = "";
    ended = false;
    (void)memset(&before, 0, sizeof before);
    kind_opens = true;
    kind_brings = kind_asked = 0;
    kind_count = 0U;
}

void tearDown(void) {
    (void)fclose(said);
    free(told_text);
}

static const char *told(void) {
    (void)fflush(said);
    return told_text;
}

static void forget_what_was_told(void) {
    (void)fclose(said);
    free(told_text);
    said = open_memstream(&told_text, &told_size);
    TEST_ASSERT_NOT_NULL(said);
}

/* ---- bus.c */

static void test_a_bus_that_cannot_be_opened_says_why(void) {
    b.descriptor = 7;
    b.state = BUS_DOWN;
    kind_opens = false;
    TEST_ASSERT_FALSE(bus_open(&b));
    TEST_ASSERT_EQUAL(-1, b.descriptor);
    TEST_ASSERT_EQUAL_STRING("terrapin-controller: cannot open /dev/ttyACM0: Permission denied\n", told());
    kind_opens = true;
    forget_what_was_told();
    TEST_ASSERT_TRUE(bus_open(&b));
    TEST_ASSERT_EQUAL(given, b.descriptor);
    TEST_ASSERT_EQUAL(BUS_ACTIVE, b.state);
    TEST_ASSERT_EQUAL_STRING("", told());
}

static void test_a_bus_that_went_away_is_told_and_opened_again(void) {
    b.descriptor = given;
    b.state = BUS_PASSIVE;
    bus_lost(&b, ENODEV);
    TEST_ASSERT_EQUAL(-1, b.descriptor);
    TEST_ASSERT_EQUAL(BUS_DOWN, b.state);
    TEST_ASSERT_EQUAL(1, b.counts.went_down);
    TEST_ASSERT_EQUAL(1, closed);
    TEST_ASSERT_EQUAL_STRING("terrapin-controller: /dev/ttyACM0 went away: No such device\n", told());
    kind_opens = false;
    TEST_ASSERT_FALSE(bus_reopen(&b));
    TEST_ASSERT_EQUAL(BUS_DOWN, b.state);
    kind_opens = true;
    forget_what_was_told();
    TEST_ASSERT_TRUE(bus_reopen(&b));
    TEST_ASSERT_EQUAL_STRING("terrapin-controller: /dev/ttyACM0: error active\n", told());
    TEST_ASSERT_EQUAL(2, kind_asked);
    TEST_ASSERT_TRUE_MESSAGE(bus_reopen(&b), "there already");
    TEST_ASSERT_EQUAL(2, kind_asked);
}

static void test_a_state_is_told_when_it_changes(void) {
    static const char *const names[] = {"error active", "error warning", "error passive", "bus-off", "down"};
    for (int state = BUS_ACTIVE; state <= BUS_DOWN; state++) {
        TEST_ASSERT_EQUAL_STRING(names[state], bus_state_name((bus_state)state));
    }
    bus_enter(&b, BUS_ACTIVE);
    TEST_ASSERT_EQUAL_STRING("", told());
    bus_enter(&b, BUS_OFF);
    bus_enter(&b, BUS_OFF);
    TEST_ASSERT_EQUAL(BUS_OFF, b.state);
    TEST_ASSERT_EQUAL_STRING("terrapin-controller: /dev/ttyACM0: bus-off\n", told());
}

/* The identifier on the bus of what node 0 has at `id`. */
static uint16_t on_the_bus(uint16_t id) {
    for (uint16_t candidate = 0U; candidate < 0x800U; candidate++) {
        terrapin_frame frame = {.id = candidate, .length = 8U};
        if (terrapin_node_receive(&b.node, &frame) && (frame.id == id)) {
            return candidate;
        }
    }
    TEST_FAIL_MESSAGE("no such identifier");
    return 0U;
}

static void test_only_frames_for_this_node_are_brought(void) {
    terrapin_frame frames[BUS_AT_ONCE];
    b.descriptor = given;
    terrapin_node_init(&b.node, 3U);
    kind_frames[0] = (terrapin_frame){.id = TERRAPIN_ID_COMMAND, .length = 8U, .data = {1}}; /* node 0's */
    kind_frames[1] = (terrapin_frame){.id = on_the_bus(TERRAPIN_ID_COMMAND), .length = 8U, .data = {2}};
    kind_frames[2] = (terrapin_frame){.id = TERRAPIN_ID_PARAMETER_READ, .length = 8U, .data = {3}};
    kind_frames[3] = (terrapin_frame){.id = on_the_bus(TERRAPIN_ID_PARAMETER_READ), .length = 8U, .data = {4}};
    kind_brings = 4;
    TEST_ASSERT_EQUAL(2, bus_receive(&b, frames));
    TEST_ASSERT_EQUAL_HEX(TERRAPIN_ID_COMMAND, frames[0].id);
    TEST_ASSERT_EQUAL(2, frames[0].data[0]);
    TEST_ASSERT_EQUAL_HEX(TERRAPIN_ID_PARAMETER_READ, frames[1].id);
    TEST_ASSERT_EQUAL(4, frames[1].data[0]);
    kind_brings = 0;
    TEST_ASSERT_EQUAL(0, bus_receive(&b, frames));
    kind_brings = 4;
    kind_asked = 0;
    b.descriptor = -1;
    TEST_ASSERT_EQUAL(0, bus_receive(&b, frames));
    TEST_ASSERT_EQUAL_MESSAGE(0, kind_asked, "a bus that is gone is not asked");
}

static void test_what_is_sent_has_this_node_s_identifiers(void) {
    const terrapin_frame out[TERRAPIN_MAX_FRAMES] = {{.id = TERRAPIN_ID_STATUS, .length = 8U, .data = {1}},
                                                     {.id = TERRAPIN_ID_MOTION, .length = 8U, .data = {2}}};
    terrapin_node_init(&b.node, 5U);
    b.descriptor = given;
    bus_send(&b, out, 0U);
    TEST_ASSERT_EQUAL(0, kind_asked);
    bus_send(&b, out, TERRAPIN_MAX_FRAMES);
    TEST_ASSERT_EQUAL(1, kind_asked);
    TEST_ASSERT_EQUAL(TERRAPIN_MAX_FRAMES, kind_count);
    for (int i = 0; i < TERRAPIN_MAX_FRAMES; i++) {
        terrapin_frame wanted = out[i];
        terrapin_node_send(&b.node, &wanted);
        TEST_ASSERT_EQUAL_HEX(wanted.id, kind_sent[i].id);
        TEST_ASSERT_NOT_EQUAL(out[i].id, kind_sent[i].id);
        TEST_ASSERT_EQUAL_MEMORY(wanted.data, kind_sent[i].data, 8);
    }
    TEST_ASSERT_EQUAL(0, b.counts.unsent);
    b.descriptor = -1;
    bus_send(&b, out, TERRAPIN_MAX_FRAMES);
    bus_send(&b, out, 1U);
    TEST_ASSERT_EQUAL(1, kind_asked);
    TEST_ASSERT_EQUAL(3, b.counts.unsent);
}

static void test_a_bus_is_closed_once_with_its_last_words(void) {
    b.descriptor = given;
    bus_close(&b);
    TEST_ASSERT_EQUAL(1, closed);
    TEST_ASSERT_EQUAL(-1, b.descriptor);
    TEST_ASSERT_EQUAL(0, asked_to_write);
    bus_close(&b);
    TEST_ASSERT_EQUAL(1, closed);
    b.kind = &bus_adapter;
    b.descriptor = given;
    bus_close(&b);
    TEST_ASSERT_EQUAL_STRING_MESSAGE("C\r", written, "the adapter leaves the bus");
    TEST_ASSERT_EQUAL(2, closed);
    TEST_ASSERT_EQUAL(-1, b.descriptor);
}

static void test_the_report_has_each_count_in_its_place(void) {
    char *text = NULL;
    size_t size = 0U;
    FILE *to = open_memstream(&text, &size);
    b.state = BUS_WARNING;
    b.counts = (bus_counts){1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    b.parser.malformed = 13;
    bus_report(&b, to);
    b.kind = &bus_adapter;
    bus_report(&b, to);
    (void)fclose(to);
    TEST_ASSERT_EQUAL_STRING(
        "terrapin-controller: /dev/ttyACM0 error warning: 1 frames received, 2 lost to a full queue, 3 sent, 4 not "
        "sent; errors: 5 warning, 6 passive, 7 bus-off, 8 restarted, 9 no acknowledge, 10 other; down 11 times\n"
        "terrapin-controller: /dev/ttyACM0 error warning: 1 frames received, 2 lost to a full queue, 3 sent, 4 not "
        "sent; errors: 5 warning, 6 passive, 7 bus-off, 8 restarted, 9 no acknowledge, 10 other; down 11 times; "
        "adapter: 12 lines refused, 13 malformed\n",
        text);
    free(text);
}

/* ---- bus_adapter.c */

static void test_each_bit_rate_has_its_digit(void) {
    static const struct {
        unsigned int bitrate;
        const char *hello;
    } cases[] = {{10000, "\rC\rS0\rO\r"},  {20000, "\rC\rS1\rO\r"},  {50000, "\rC\rS2\rO\r"},
                 {100000, "\rC\rS3\rO\r"}, {125000, "\rC\rS4\rO\r"}, {250000, "\rC\rS5\rO\r"},
                 {500000, "\rC\rS6\rO\r"}, {800000, "\rC\rS7\rO\r"}, {1000000, "\rC\rS8\rO\r"}};
    for (size_t i = 0; i < (sizeof cases / sizeof cases[0]); i++) {
        b.descriptor = -1;
        b.bitrate = cases[i].bitrate;
        written_size = 0U;
        TEST_ASSERT_TRUE(adapter_open(&b));
        TEST_ASSERT_EQUAL_STRING(cases[i].hello, written);
        TEST_ASSERT_EQUAL(given, b.descriptor);
    }
    opened = 0;
    b.descriptor = -1;
    b.bitrate = 300000;
    TEST_ASSERT_FALSE(adapter_open(&b));
    TEST_ASSERT_EQUAL(EINVAL, errno);
    TEST_ASSERT_EQUAL(0, opened);
}

static void test_its_line_is_raw_and_without_modem_control(void) {
    before.c_lflag = ECHO | ICANON | ISIG;
    before.c_iflag = ICRNL | IXON;
    before.c_oflag = OPOST;
    before.c_cflag = CS7 | PARENB;
    b.parser.length = 9U; /* of an adapter that was unplugged in the middle of a line */
    b.rest_length = 5U;
    TEST_ASSERT_TRUE(adapter_open(&b));
    TEST_ASSERT_EQUAL_HEX(0, after.c_lflag & (ECHO | ICANON | ISIG));
    TEST_ASSERT_EQUAL_HEX(0, after.c_iflag & (ICRNL | IXON));
    TEST_ASSERT_EQUAL_HEX(0, after.c_oflag & OPOST);
    TEST_ASSERT_EQUAL_HEX(CS8 | CLOCAL | CREAD, after.c_cflag & (CSIZE | PARENB | CLOCAL | CREAD));
    TEST_ASSERT_EQUAL(0, b.parser.length);
    TEST_ASSERT_TRUE(b.parser.open);
    TEST_ASSERT_EQUAL(0, b.rest_length);
    TEST_ASSERT_EQUAL(0, closed);
}

/* Whatever fails, the port is closed again and the reason is that of what failed. */
static void test_a_port_that_refuses_is_no_bus(void) {
    static const char *const calls[] = {"open", "get", "set", "write"};
    for (size_t i = 0; i < 4U; i++) {
        fails = calls[i];
        closed = 0;
        TEST_ASSERT_FALSE_MESSAGE(adapter_open(&b), calls[i]);
        TEST_ASSERT_EQUAL_MESSAGE(EIO, errno, calls[i]);
        TEST_ASSERT_EQUAL_MESSAGE((i == 0U) ? 0 : 1, closed, calls[i]);
        TEST_ASSERT_EQUAL_MESSAGE(-1, b.descriptor, calls[i]);
    }
    fails = NULL;
    most_at_once = 7U; /* of 8: whether it opened nobody knows */
    TEST_ASSERT_FALSE(adapter_open(&b));
    TEST_ASSERT_EQUAL(4, opened - 1);
}

static int hears(const char *text, terrapin_frame frames[BUS_AT_ONCE]) {
    incoming = text;
    return adapter_receive(&b, frames);
}

static void test_what_of_an_adapter_s_words_is_a_frame(void) {
    terrapin_frame frames[BUS_AT_ONCE];
    TEST_ASSERT_TRUE(adapter_open(&b));
    TEST_ASSERT_EQUAL(2, hears("t1232ABCD\rt7FF0\r", frames));
    TEST_ASSERT_EQUAL_HEX(0x123, frames[0].id);
    TEST_ASSERT_EQUAL(2, frames[0].length);
    TEST_ASSERT_EQUAL_HEX8(0xCD, frames[0].data[1]);
    TEST_ASSERT_EQUAL_HEX(0x7FF, frames[1].id);
    TEST_ASSERT_EQUAL(2, b.counts.received);
    TEST_ASSERT_EQUAL(0, hears("t12", frames)); /* in portions */
    TEST_ASSERT_EQUAL(1, hears("30\r", frames));
    TEST_ASSERT_EQUAL_HEX(0x123, frames[0].id);
    TEST_ASSERT_EQUAL(3, b.counts.received);
    TEST_ASSERT_EQUAL(0, b.parser.malformed);
}

/* "z\r" and "Z\r" for a frame that went out, "\r" for a command, "\a" for what it did not take. */
static void test_acknowledgements_are_no_lines(void) {
    terrapin_frame frames[BUS_AT_ONCE];
    TEST_ASSERT_TRUE(adapter_open(&b));
    TEST_ASSERT_EQUAL(1, hears("\rz\rZ\r\a\at1230\r", frames));
    TEST_ASSERT_EQUAL(2, b.counts.refused);
    TEST_ASSERT_EQUAL(0, b.parser.malformed);
    TEST_ASSERT_EQUAL(1, hears("t12\a30\r", frames)); /* in between */
    TEST_ASSERT_EQUAL(3, b.counts.refused);
    TEST_ASSERT_EQUAL(0, hears("t1z30\r", frames));
    TEST_ASSERT_EQUAL(0, hears("t1Z30\r", frames));
    TEST_ASSERT_EQUAL_MESSAGE(2, b.parser.malformed, "inside a line they are what should not be there");
    /* a line of 33 is one, and ends at its \r; only then begins another */
    TEST_ASSERT_EQUAL(1, hears("tttttttttttttttttttttttttttttttttt\rt1230\r", frames));
    TEST_ASSERT_EQUAL(3, b.parser.malformed);
}

static void test_what_the_adapter_says_opens_and_closes_nothing(void) {
    terrapin_frame frames[BUS_AT_ONCE];
    TEST_ASSERT_TRUE(adapter_open(&b));
    TEST_ASSERT_EQUAL(1, hears("C\rt1230\r", frames));
    TEST_ASSERT_EQUAL(1, hears("O\rt1230\r", frames));
    TEST_ASSERT_TRUE(b.parser.open);
}

/* The shortest frame has 6 bytes. */
static void test_no_read_brings_more_frames_than_there_is_place_for(void) {
    static char flood[1000];
    terrapin_frame frames[BUS_AT_ONCE];
    for (int i = 0; i < 100; i++) {
        (void)snprintf(&flood[6 * i], 7, "t%03X0\r", (unsigned int)i);
    }
    TEST_ASSERT_TRUE(adapter_open(&b));
    TEST_ASSERT_EQUAL(0, hears("t7770", frames)); /* whose end comes with the flood */
    (void)memmove(&flood[1], flood, sizeof flood - 1U);
    flood[0] = '\r';
    const int first = hears(flood, frames);
    TEST_ASSERT_LESS_OR_EQUAL(BUS_AT_ONCE, first);
    TEST_ASSERT_EQUAL(BUS_AT_ONCE - 1, first); /* a byte is missing to the sixteenth */
    TEST_ASSERT_EQUAL(90, read_size);
    TEST_ASSERT_EQUAL_HEX(0x777, frames[0].id);
    TEST_ASSERT_EQUAL_HEX(0x00D, frames[14].id);
}

static void test_a_port_that_ends_is_gone(void) {
    static const struct {
        int reason;
        bool lost;
    } cases[] = {{EAGAIN, false}, {EINTR, false}, {EIO, true}, {ENXIO, true}};
    terrapin_frame frames[BUS_AT_ONCE];
    for (size_t i = 0; i < 4U; i++) {
        b.descriptor = given;
        fails = "read";
        reason = cases[i].reason;
        forget_what_was_told();
        TEST_ASSERT_EQUAL(0, adapter_receive(&b, frames));
        TEST_ASSERT_EQUAL(cases[i].lost ? -1 : given, b.descriptor);
        TEST_ASSERT_EQUAL(cases[i].lost, strstr(told(), strerror(reason)) != NULL);
    }
    fails = NULL;
    ended = true;
    b.descriptor = given;
    TEST_ASSERT_EQUAL(0, adapter_receive(&b, frames));
    TEST_ASSERT_EQUAL_MESSAGE(-1, b.descriptor, "hung up");
    TEST_ASSERT_NOT_NULL(strstr(told(), strerror(ENODEV)));
    TEST_ASSERT_EQUAL(3, b.counts.went_down);
}

static const terrapin_frame two[2] = {{.id = 0x101U, .length = 2U, .data = {0x11, 0x22}},
                                      {.id = 0x102U, .length = 1U, .data = {0x33}}};

static void test_frames_go_out_as_lines_in_one_write(void) {
    TEST_ASSERT_TRUE(adapter_open(&b));
    written_size = 0U;
    asked_to_write = 0;
    adapter_send(&b, two, 2U);
    TEST_ASSERT_EQUAL_STRING("t10121122\rt102133\r", written);
    TEST_ASSERT_EQUAL(1, asked_to_write);
    TEST_ASSERT_EQUAL(2, b.counts.sent);
    TEST_ASSERT_EQUAL(0, b.counts.unsent);
    TEST_ASSERT_EQUAL(0, b.rest_length);
}

/* The rest goes before anything else: a line is not cut by another. */
static void test_a_line_that_was_taken_in_part_is_finished_first(void) {
    TEST_ASSERT_TRUE(adapter_open(&b));
    written_size = 0U;
    most_at_once = 12U; /* of 18 */
    adapter_send(&b, two, 2U);
    TEST_ASSERT_EQUAL_STRING("t10121122\rt1", written);
    TEST_ASSERT_EQUAL(6, b.rest_length);
    TEST_ASSERT_EQUAL(2, b.counts.sent);
    most_at_once = 2U;
    adapter_send(&b, two, 1U);
    TEST_ASSERT_EQUAL_STRING("t10121122\rt102", written);
    TEST_ASSERT_EQUAL(4, b.rest_length);
    TEST_ASSERT_EQUAL(1, b.counts.unsent);
    fails = "write";
    reason = EAGAIN;
    adapter_send(&b, two, 2U);
    TEST_ASSERT_EQUAL(4, b.rest_length);
    TEST_ASSERT_EQUAL(3, b.counts.unsent);
    TEST_ASSERT_EQUAL(given, b.descriptor);
    fails = NULL;
    most_at_once = sizeof written;
    adapter_send(&b, two, 1U);
    TEST_ASSERT_EQUAL_STRING("t10121122\rt102133\rt10121122\r", written);
    TEST_ASSERT_EQUAL(0, b.rest_length);
    TEST_ASSERT_EQUAL(3, b.counts.sent);
    TEST_ASSERT_EQUAL(3, b.counts.unsent);
    most_at_once = 1U; /* the least that is taken */
    adapter_send(&b, two, 1U);
    TEST_ASSERT_EQUAL(4, b.counts.sent);
    TEST_ASSERT_EQUAL(9, b.rest_length);
    TEST_ASSERT_EQUAL(1, finish_line(&b) ? 0 : 1);
    TEST_ASSERT_EQUAL(8, b.rest_length);
}

static void test_a_full_port_costs_the_frames_and_a_broken_one_the_bus(void) {
    static const struct {
        int reason;
        bool lost;
    } cases[] = {{EAGAIN, false}, {EINTR, false}, {EIO, true}, {EBADF, true}};
    for (size_t i = 0; i < 4U; i++) {
        b.descriptor = given;
        fails = "write";
        reason = cases[i].reason;
        adapter_send(&b, two, 2U);
        TEST_ASSERT_EQUAL(cases[i].lost ? -1 : given, b.descriptor);
        TEST_ASSERT_EQUAL(2U * (i + 1U), b.counts.unsent);
    }
    TEST_ASSERT_EQUAL(2, b.counts.went_down);
    fails = NULL;
    most_at_once = 0U;
    b.descriptor = given;
    reason = EIO;
    adapter_send(&b, two, 2U);
    TEST_ASSERT_EQUAL_MESSAGE(given, b.descriptor, "nothing taken is no error");
    TEST_ASSERT_EQUAL(10, b.counts.unsent);
    TEST_ASSERT_EQUAL(0, b.counts.sent);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_bus_that_cannot_be_opened_says_why);
    RUN_TEST(test_a_bus_that_went_away_is_told_and_opened_again);
    RUN_TEST(test_a_state_is_told_when_it_changes);
    RUN_TEST(test_only_frames_for_this_node_are_brought);
    RUN_TEST(test_what_is_sent_has_this_node_s_identifiers);
    RUN_TEST(test_a_bus_is_closed_once_with_its_last_words);
    RUN_TEST(test_the_report_has_each_count_in_its_place);
    RUN_TEST(test_each_bit_rate_has_its_digit);
    RUN_TEST(test_its_line_is_raw_and_without_modem_control);
    RUN_TEST(test_a_port_that_refuses_is_no_bus);
    RUN_TEST(test_what_of_an_adapter_s_words_is_a_frame);
    RUN_TEST(test_acknowledgements_are_no_lines);
    RUN_TEST(test_what_the_adapter_says_opens_and_closes_nothing);
    RUN_TEST(test_no_read_brings_more_frames_than_there_is_place_for);
    RUN_TEST(test_a_port_that_ends_is_gone);
    RUN_TEST(test_frames_go_out_as_lines_in_one_write);
    RUN_TEST(test_a_line_that_was_taken_in_part_is_finished_first);
    RUN_TEST(test_a_full_port_costs_the_frames_and_a_broken_one_the_bus);
    return UNITY_END();
}
