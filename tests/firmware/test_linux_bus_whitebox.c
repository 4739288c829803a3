/* What the Linux controller counts of a SocketCAN interface's losses. */
#define _GNU_SOURCE

#include "unity.h"

#include "../../firmware/ports/linux/bus_socketcan.c"

void setUp(void) {}
void tearDown(void) {}

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

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_losses_add_up);
    RUN_TEST(test_a_new_socket_counts_from_zero);
    return UNITY_END();
}
