/* What the Linux controller counts of a SocketCAN interface's losses and error frames. */
#define _GNU_SOURCE

#include <net/if.h>
#include <stdarg.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "unity.h"

static int refuses(int descriptor, struct mmsghdr *messages, unsigned int count, int flags);
#define sendmmsg                                            refuses
#define recvmmsg(descriptor, messages, count, flags, limit) refuses(descriptor, messages, count, flags)
static int fake_setsockopt(int s, int level, int option, const void *value, socklen_t size);
static int fake_ioctl(int s, unsigned long request, ...);
static int fake_bind(int s, const struct sockaddr *address, socklen_t size);
#define setsockopt fake_setsockopt
#define ioctl      fake_ioctl
#define bind       fake_bind
#include "../../firmware/ports/linux/bus_socketcan.c"
#undef setsockopt
#undef ioctl
#undef bind
#include "node.c"
#include "terrapin_interface.c"

void setUp(void) {}
void tearDown(void) {}

static int refusal; /* 0: what waits is brought, or what is given taken */
static struct can_frame waiting[4], taken[4];
static uint32_t waiting_lost[4]; /* the kernel's count that comes with it */
static int waiting_count, takes;
static size_t waiting_size; /* bytes of each */

static void bring(struct mmsghdr *message, int i) {
    TEST_ASSERT_EQUAL(1, message->msg_hdr.msg_iovlen);
    TEST_ASSERT_EQUAL(sizeof waiting[0], message->msg_hdr.msg_iov->iov_len);
    (void)memcpy(message->msg_hdr.msg_iov->iov_base, &waiting[i], sizeof waiting[0]);
    message->msg_len = (unsigned int)waiting_size;
    struct cmsghdr *c = CMSG_FIRSTHDR(&message->msg_hdr);
    TEST_ASSERT_NOT_NULL(c);
    c->cmsg_level = SOL_SOCKET;
    c->cmsg_type = SO_RXQ_OVFL;
    c->cmsg_len = CMSG_LEN(sizeof waiting_lost[0]);
    (void)memcpy(CMSG_DATA(c), &waiting_lost[i], sizeof waiting_lost[0]);
}

static int refuses(int descriptor, struct mmsghdr *messages, unsigned int count, int flags) {
    (void)descriptor;
    TEST_ASSERT_NOT_NULL(messages);
    TEST_ASSERT_EQUAL_MESSAGE(MSG_DONTWAIT, flags, "the loop does not wait here");
    if (refusal != 0) {
        TEST_ASSERT_TRUE((count == 1U) || (count == BUS_AT_ONCE));
        errno = refusal;
        return -1;
    }
    if (count == BUS_AT_ONCE) {
        for (int i = 0; i < waiting_count; i++) {
            bring(&messages[i], i);
        }
        return waiting_count;
    }
    for (int i = 0; i < takes; i++) {
        (void)memcpy(&taken[i], messages[i].msg_hdr.msg_iov->iov_base, sizeof taken[0]);
    }
    return takes;
}

static char asked[128];
static const char *refused_call;
static unsigned int interface_flags = IFF_UP;
static struct can_filter filters_asked[TERRAPIN_BLOCK_RECEIVED];

static int call(const char *name) {
    (void)snprintf(&asked[strlen(asked)], sizeof asked - strlen(asked), "%s ", name);
    errno = EPERM;
    return ((refused_call != NULL) && (strcmp(name, refused_call) == 0)) ? -1 : 0;
}

static int fake_setsockopt(int s, int level, int option, const void *value, socklen_t size) {
    TEST_ASSERT_EQUAL(7, s);
    if (level == SOL_SOCKET) {
        int number = 0;
        TEST_ASSERT_EQUAL(sizeof number, size);
        (void)memcpy(&number, value, sizeof number);
        TEST_ASSERT_EQUAL((option == SO_RCVBUF) ? QUEUE_BYTES : 1, number);
        return call((option == SO_RCVBUF) ? "queue" : ((option == SO_RXQ_OVFL) ? "losses" : "?"));
    }
    TEST_ASSERT_EQUAL(SOL_CAN_RAW, level);
    if (option == CAN_RAW_FILTER) {
        TEST_ASSERT_EQUAL(sizeof filters_asked, size);
        (void)memcpy(filters_asked, value, size);
        return call("filters");
    }
    can_err_mask_t mask = 0;
    TEST_ASSERT_EQUAL(CAN_RAW_ERR_FILTER, option);
    TEST_ASSERT_EQUAL(sizeof mask, size);
    (void)memcpy(&mask, value, sizeof mask);
    TEST_ASSERT_EQUAL_HEX32(CAN_ERR_MASK, mask);
    return call("errors");
}

static int fake_ioctl(int s, unsigned long request, ...) {
    va_list rest;
    va_start(rest, request);
    struct ifreq *interface = va_arg(rest, struct ifreq *);
    va_end(rest);
    TEST_ASSERT_EQUAL(7, s);
    TEST_ASSERT_EQUAL_STRING("can0", interface->ifr_name);
    if (request == SIOCGIFINDEX) {
        interface->ifr_ifindex = 42;
        return call("index");
    }
    TEST_ASSERT_EQUAL(SIOCGIFFLAGS, request);
    interface->ifr_flags = (short)interface_flags;
    return call("flags");
}

static int fake_bind(int s, const struct sockaddr *address, socklen_t size) {
    struct sockaddr_can can;
    TEST_ASSERT_EQUAL(7, s);
    TEST_ASSERT_EQUAL(sizeof can, size);
    (void)memcpy(&can, address, sizeof can);
    TEST_ASSERT_EQUAL(AF_CAN, can.can_family);
    TEST_ASSERT_EQUAL_MESSAGE(42, can.can_ifindex, "that interface, not all of them");
    return call("bind");
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

/* What is asked of the kernel, and that each refusal is one: no controller runs with half of it. */
static void test_a_socket_has_its_filters_errors_and_losses_before_it_is_bound(void) {
    static const char *const calls[] = {"index", "flags", "filters", "errors", "queue", "losses", "bind"};
    terrapin_node node;
    terrapin_filter wanted[TERRAPIN_BLOCK_RECEIVED];
    terrapin_node_init(&node, 3U);
    terrapin_node_filters(&node, wanted);
    asked[0] = '\0';
    refused_call = NULL;
    TEST_ASSERT_TRUE(set_up(7, "can0", &node));
    TEST_ASSERT_EQUAL_STRING("index flags filters errors queue losses bind ", asked);
    for (uint32_t i = 0; i < TERRAPIN_BLOCK_RECEIVED; i++) { /* of 11 bits, no remote frame */
        TEST_ASSERT_EQUAL_HEX32(wanted[i].id, filters_asked[i].can_id);
        TEST_ASSERT_EQUAL_HEX32(wanted[i].mask | CAN_EFF_FLAG | CAN_RTR_FLAG, filters_asked[i].can_mask);
    }
    for (size_t i = 0; i < (sizeof calls / sizeof calls[0]); i++) {
        refused_call = calls[i];
        TEST_ASSERT_FALSE_MESSAGE(set_up(7, "can0", &node), calls[i]);
    }
    refused_call = NULL;
    interface_flags = 0U;
    TEST_ASSERT_FALSE(set_up(7, "can0", &node));
    TEST_ASSERT_EQUAL(ENETDOWN, errno);
    interface_flags = IFF_UP;
    TEST_ASSERT_FALSE(set_up(7, "an_interface_name_that_is_too_long", &node));
    TEST_ASSERT_EQUAL(ENODEV, errno);
}

static void told(bus *b, uint32_t kind, uint8_t problem) {
    struct can_frame frame = {.can_id = CAN_ERR_FLAG | kind, .can_dlc = CAN_ERR_DLC};
    terrapin_frame out;
    frame.data[1] = problem;
    TEST_ASSERT_FALSE_MESSAGE(take_frame(b, &frame, &out), "an error is no frame");
}

/* linux/can/error.h, class by class; a controller that was restarted is active again. */
static void test_error_frames_one_by_one(void) {
    bus b = {.name = "none", .state = BUS_ACTIVE};
    told(&b, CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING);
    TEST_ASSERT_EQUAL(BUS_WARNING, b.state);
    told(&b, CAN_ERR_CRTL, CAN_ERR_CRTL_RX_WARNING);
    TEST_ASSERT_EQUAL(2, b.counts.error_warning);
    told(&b, CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_WARNING);
    TEST_ASSERT_EQUAL(BUS_PASSIVE, b.state);
    TEST_ASSERT_EQUAL(1, b.counts.error_passive);
    TEST_ASSERT_EQUAL(2, b.counts.error_warning);
    told(&b, CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE);
    TEST_ASSERT_EQUAL(BUS_ACTIVE, b.state);
    told(&b, CAN_ERR_BUSOFF, 0U);
    TEST_ASSERT_EQUAL(BUS_OFF, b.state);
    TEST_ASSERT_EQUAL(1, b.counts.bus_off);
    told(&b, CAN_ERR_RESTARTED, 0U);
    TEST_ASSERT_EQUAL(BUS_ACTIVE, b.state);
    TEST_ASSERT_EQUAL(1, b.counts.restarted);
    told(&b, CAN_ERR_BUSOFF | CAN_ERR_RESTARTED, 0U); /* off again since */
    TEST_ASSERT_EQUAL(BUS_OFF, b.state);
    told(&b, CAN_ERR_ACK, 0U);
    TEST_ASSERT_EQUAL(1, b.counts.no_acknowledge);
    told(&b, CAN_ERR_CRTL, CAN_ERR_CRTL_TX_OVERFLOW);
    TEST_ASSERT_EQUAL(1, b.counts.overflowed);
    TEST_ASSERT_EQUAL(0, b.counts.other_error);
    told(&b, CAN_ERR_CRTL, 0U);
    told(&b, CAN_ERR_PROT | CAN_ERR_ACK, 0U);
    TEST_ASSERT_EQUAL(2, b.counts.other_error);
    TEST_ASSERT_EQUAL(2, b.counts.no_acknowledge);
    TEST_ASSERT_EQUAL(0, b.counts.received);
}

static void test_frames_that_are_ours_to_read(void) {
    bus b = {.name = "none"};
    terrapin_frame out = {0};
    struct can_frame frame = {.can_id = CAN_SFF_MASK, .can_dlc = 8, .data = {1, 2, 3, 4, 5, 6, 7, 8}};
    TEST_ASSERT_TRUE(take_frame(&b, &frame, &out));
    TEST_ASSERT_EQUAL_HEX(CAN_SFF_MASK, out.id);
    TEST_ASSERT_EQUAL(8, out.length);
    TEST_ASSERT_EQUAL_MEMORY(frame.data, out.data, 8);
    frame.can_dlc = 9;
    TEST_ASSERT_FALSE(take_frame(&b, &frame, &out));
    frame.can_dlc = 8;
    frame.can_id = 0x100U | CAN_EFF_FLAG;
    TEST_ASSERT_FALSE(take_frame(&b, &frame, &out));
    frame.can_id = 0x100U | CAN_RTR_FLAG;
    TEST_ASSERT_FALSE(take_frame(&b, &frame, &out));
    TEST_ASSERT_EQUAL(1, b.counts.received);
}

/* Unplugged: the socket is of no more use. A full queue costs the frame alone. */
static void test_what_a_refusal_means(void) {
    static const struct {
        int reason;
        bool lost;
    } sending[] = {{ENOBUFS, false}, {EAGAIN, false}, {ENODEV, true}, {ENXIO, true}},
      receiving[] = {{EAGAIN, false}, {EINTR, false}, {ENODEV, true}, {EBADF, true}};
    const terrapin_frame out = {.id = 0x180U};
    terrapin_frame in[BUS_AT_ONCE];
    for (size_t i = 0; i < 4U; i++) {
        bus b = {.name = "none", .descriptor = 5, .state = BUS_ACTIVE};
        refusal = sending[i].reason;
        socketcan_send(&b, &out, 1);
        TEST_ASSERT_EQUAL(sending[i].lost ? -1 : 5, b.descriptor);
        TEST_ASSERT_EQUAL(1, b.counts.unsent);
        TEST_ASSERT_EQUAL(0, b.counts.went_down);
        b.descriptor = 5;
        refusal = receiving[i].reason;
        TEST_ASSERT_EQUAL(0, socketcan_receive(&b, in));
        TEST_ASSERT_EQUAL(receiving[i].lost ? -1 : 5, b.descriptor);
    }
}

static struct can_frame on_the_bus(uint32_t id, uint8_t first) {
    return (struct can_frame){.can_id = id, .can_dlc = 2, .data = {first, 0x55}};
}

/* In their order, what is between them left out; each brings the kernel's count of what was lost before it. */
static void test_frames_are_taken_in_order(void) {
    bus b = {.name = "none", .descriptor = 5, .state = BUS_DOWN};
    terrapin_frame in[BUS_AT_ONCE];
    refusal = 0;
    waiting_count = 4;
    waiting_size = sizeof waiting[0];
    waiting[0] = on_the_bus(0x101U, 1);
    waiting[1] = on_the_bus(CAN_ERR_FLAG | CAN_ERR_ACK, 2);
    waiting[2] = on_the_bus(0x102U, 3);
    waiting[3] = on_the_bus(0x103U, 4);
    waiting_lost[0] = waiting_lost[1] = 2U;
    waiting_lost[2] = waiting_lost[3] = 7U;
    TEST_ASSERT_EQUAL(3, socketcan_receive(&b, in));
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_HEX(0x101 + i, in[i].id);
        TEST_ASSERT_EQUAL(2, in[i].length);
    }
    TEST_ASSERT_EQUAL(1, in[0].data[0]);
    TEST_ASSERT_EQUAL(3, in[1].data[0]);
    TEST_ASSERT_EQUAL(4, in[2].data[0]);
    TEST_ASSERT_EQUAL(3, b.counts.received);
    TEST_ASSERT_EQUAL(1, b.counts.no_acknowledge);
    TEST_ASSERT_EQUAL(7, b.counts.overflowed);
    TEST_ASSERT_EQUAL_MESSAGE(BUS_ACTIVE, b.state, "frames come: it is up again");
    waiting_size = sizeof waiting[0] - 1U; /* cut */
    TEST_ASSERT_EQUAL(0, socketcan_receive(&b, in));
    waiting_size = sizeof waiting[0];
    b.state = BUS_DOWN;
    waiting[0] = on_the_bus(CAN_ERR_FLAG | CAN_ERR_ACK, 2);
    waiting_count = 1;
    TEST_ASSERT_EQUAL(0, socketcan_receive(&b, in));
    TEST_ASSERT_EQUAL_MESSAGE(BUS_DOWN, b.state, "an error alone says nothing of it");
}

/* As many as the queue took, the rest counted. */
static void test_frames_are_sent_in_order(void) {
    const terrapin_frame out[TERRAPIN_MAX_FRAMES] = {{.id = 0x181U, .length = 8U, .data = {1, 2, 3, 4, 5, 6, 7, 8}},
                                                     {.id = 0x182U, .length = 1U, .data = {9}}};
    bus b = {.name = "none", .descriptor = 5, .state = BUS_DOWN};
    refusal = 0;
    takes = 2;
    socketcan_send(&b, out, 2U);
    TEST_ASSERT_EQUAL_HEX(0x181, taken[0].can_id);
    TEST_ASSERT_EQUAL(8, taken[0].can_dlc);
    TEST_ASSERT_EQUAL_MEMORY(out[0].data, taken[0].data, 8);
    TEST_ASSERT_EQUAL_HEX(0x182, taken[1].can_id);
    TEST_ASSERT_EQUAL(1, taken[1].can_dlc);
    TEST_ASSERT_EQUAL(9, taken[1].data[0]);
    TEST_ASSERT_EQUAL(2, b.counts.sent);
    TEST_ASSERT_EQUAL(BUS_ACTIVE, b.state);
    takes = 1;
    socketcan_send(&b, out, 2U);
    TEST_ASSERT_EQUAL(3, b.counts.sent);
    TEST_ASSERT_EQUAL(1, b.counts.unsent);
    takes = 0;
    socketcan_send(&b, out, 2U);
    TEST_ASSERT_EQUAL(3, b.counts.sent);
    TEST_ASSERT_EQUAL(3, b.counts.unsent);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_frames_are_taken_in_order);
    RUN_TEST(test_frames_are_sent_in_order);
    RUN_TEST(test_losses_add_up);
    RUN_TEST(test_a_new_socket_counts_from_zero);
    RUN_TEST(test_error_counters_are_no_error);
    RUN_TEST(test_a_socket_has_its_filters_errors_and_losses_before_it_is_bound);
    RUN_TEST(test_error_frames_one_by_one);
    RUN_TEST(test_frames_that_are_ours_to_read);
    RUN_TEST(test_what_a_refusal_means);
    RUN_TEST(test_an_interface_that_goes_down_counts_whoever_sees_it_first);
    return UNITY_END();
}
