/* What the Linux controller counts of a SocketCAN interface's losses and error frames. */
#define _GNU_SOURCE

#include <sys/socket.h>

#include "unity.h"

static int refuses(int descriptor, struct mmsghdr *messages, unsigned int count, int flags);
#define sendmmsg                                            refuses
#define recvmmsg(descriptor, messages, count, flags, limit) refuses(descriptor, messages, count, flags)
#include "../../firmware/ports/linux/bus_socketcan.c"
#include "node.c"
#include "terrapin_interface.c"

void setUp(void) {}
void tearDown(void) {}

static int refusal;
static int refuses(int descriptor, struct mmsghdr *messages, unsigned int count, int flags) {
    (void)descriptor, (void)messages, (void)count, (void)flags;
    errno = refusal;
    return -1;
}

void bus_enter(bus *b, bus_state state) {
    b->state = state;
}
void bus_lost(bus *b, int reason) {
    (void)reason;
    b->descriptor = -1;
}

static void note(bus *b, uint32_t lost) {
    _Alignas(struct cmsghdr) char control[CMSG_SPACE(sizeof lost)] = {0};
    struct msghdr header = {.msg_control = control, .msg_controllen = sizeof control};
    struct cmsghdr *c = CMSG_FIRSTHDR(&header);
    c->cmsg_level = SOL_SOCKET;
    c->cmsg_type = SO_RXQ_OVFL;
    c->cmsg_len = CMSG_LEN(sizeof lost);
    (void)memcpy(CMSG_DATA(c), &lost, sizeof lost);
    note_overflow(b, &header);
}

/* The kernel tells a socket's losses since it was opened; the interface tells its own, one at a time. */
static void test_losses_add_up(void) {
    bus b = {.name = "none"};
    note(&b, 3U);
    note(&b, 3U);
    TEST_ASSERT_EQUAL(3, b.counts.overflowed);
    controller_error(&b, CAN_ERR_CRTL_RX_OVERFLOW);
    TEST_ASSERT_EQUAL(4, b.counts.overflowed);
    note(&b, 5U);
    TEST_ASSERT_EQUAL(6, b.counts.overflowed);
}

static void test_a_new_socket_counts_from_zero(void) {
    bus b = {.name = "none", .descriptor = -1};
    note(&b, 100U);
    b.queue_lost = 0U; /* as socketcan_open leaves it */
    note(&b, 2U);
    TEST_ASSERT_EQUAL(102, b.counts.overflowed);
}

/* Its driver puts the chip's error counters into the frame and says so by a bit of its own (Linux 6.0 and later). */
static void test_error_counters_are_no_error(void) {
    bus b = {.name = "none"};
    struct can_frame frame = {.can_id = CAN_ERR_FLAG | CAN_ERR_CRTL | 0x200U, .can_dlc = CAN_ERR_DLC};
    frame.data[1] = CAN_ERR_CRTL_TX_PASSIVE;
    frame.data[6] = 128;
    take_error(&b, &frame);
    TEST_ASSERT_EQUAL(BUS_PASSIVE, b.state);
    TEST_ASSERT_EQUAL(1, b.counts.error_passive);
    TEST_ASSERT_EQUAL(0, b.counts.other_error);
    frame.can_id |= CAN_ERR_PROT;
    take_error(&b, &frame);
    TEST_ASSERT_EQUAL(1, b.counts.other_error);
}

/* The kernel tells it to the first call after it: a telemetry frame that goes out is as likely as one that comes. */
static void test_an_interface_that_goes_down_counts_whoever_sees_it_first(void) {
    bus b = {.name = "none", .state = BUS_ACTIVE};
    const terrapin_frame out = {.id = 0x180U};
    terrapin_frame in[BUS_AT_ONCE];
    refusal = ENETDOWN;
    socketcan_send(&b, &out, 1);
    TEST_ASSERT_EQUAL(BUS_DOWN, b.state);
    TEST_ASSERT_EQUAL(1, b.counts.went_down);
    TEST_ASSERT_EQUAL(0, socketcan_receive(&b, in));
    socketcan_send(&b, &out, 1);
    TEST_ASSERT_EQUAL(1, b.counts.went_down);
    TEST_ASSERT_EQUAL(2, b.counts.unsent);
    b.state = BUS_ACTIVE;
    TEST_ASSERT_EQUAL(0, socketcan_receive(&b, in));
    socketcan_send(&b, &out, 1);
    TEST_ASSERT_EQUAL(2, b.counts.went_down);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_losses_add_up);
    RUN_TEST(test_a_new_socket_counts_from_zero);
    RUN_TEST(test_error_counters_are_no_error);
    RUN_TEST(test_an_interface_that_goes_down_counts_whoever_sees_it_first);
    return UNITY_END();
}
