/* A raw CAN socket: filters for our identifiers, error frames, a bounded queue whose losses the kernel counts. */
#define _GNU_SOURCE /* recvmmsg, sendmmsg */

#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "bus.h"

#define QUEUE_BYTES 65536 /* some 100 frames with what the kernel keeps about each */

/* Blocks of identifiers; what comes beside the messages is dropped later. Extended and remote frames do not fit, since
 * those flags must be 0. */
static bool set_filters(int s, const terrapin_node *node) {
    terrapin_filter blocks[TERRAPIN_BLOCK_RECEIVED];
    struct can_filter ours[TERRAPIN_BLOCK_RECEIVED];
    terrapin_node_filters(node, blocks);
    for (uint32_t i = 0; i < TERRAPIN_BLOCK_RECEIVED; i++) {
        ours[i].can_id = blocks[i].id;
        ours[i].can_mask = blocks[i].mask | CAN_EFF_FLAG | CAN_RTR_FLAG;
    }
    return setsockopt(s, SOL_CAN_RAW, CAN_RAW_FILTER, ours, sizeof ours) == 0;
}

static bool set_up(int s, const char *name, const terrapin_node *node) {
    const can_err_mask_t errors = CAN_ERR_MASK;
    const int queue = QUEUE_BYTES;
    const int yes = 1;
    struct ifreq interface;
    struct sockaddr_can address = {.can_family = AF_CAN};
    if (strlen(name) >= sizeof interface.ifr_name) {
        errno = ENODEV;
        return false;
    }
    (void)memset(&interface, 0, sizeof interface);
    (void)memcpy(interface.ifr_name, name, strlen(name));
    if (ioctl(s, SIOCGIFINDEX, &interface) != 0) {
        return false;
    }
    address.can_ifindex = interface.ifr_ifindex;
    if (ioctl(s, SIOCGIFFLAGS, &interface) != 0) {
        return false;
    }
    if (((unsigned int)interface.ifr_flags & (unsigned int)IFF_UP) == 0U) {
        errno = ENETDOWN;
        return false;
    }
    return set_filters(s, node) && (setsockopt(s, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) == 0) &&
           (setsockopt(s, SOL_SOCKET, SO_RCVBUF, &queue, sizeof queue) == 0) &&
           (setsockopt(s, SOL_SOCKET, SO_RXQ_OVFL, &yes, sizeof yes) == 0) &&
           (bind(s, (const struct sockaddr *)&address, sizeof address) == 0);
}

static bool socketcan_open(bus *b) {
    const int s = socket(PF_CAN, (int)SOCK_RAW | (int)SOCK_NONBLOCK | (int)SOCK_CLOEXEC, CAN_RAW);
    if (s < 0) {
        return false;
    }
    if (!set_up(s, b->name, &b->node)) {
        const int reason = errno;
        (void)close(s);
        errno = reason;
        return false;
    }
    b->descriptor = s;
    b->queue_lost = 0U; /* a new socket counts from zero */
    return true;
}

static void controller_error(bus *b, uint8_t problem) {
    if ((problem & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0U) {
        b->counts.error_passive++;
        bus_enter(b, BUS_PASSIVE);
    } else if ((problem & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0U) {
        b->counts.error_warning++;
        bus_enter(b, BUS_WARNING);
    } else if ((problem & CAN_ERR_CRTL_ACTIVE) != 0U) {
        bus_enter(b, BUS_ACTIVE);
    } else if ((problem & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0U) {
        b->counts.overflowed++;
    } else {
        b->counts.other_error++;
    }
}

/* Classes of linux/can/error.h; a frame may have several. Since Linux 6.0 a driver marks with COUNTERS a frame that
 * carries the chip's error counters as well: that is no error of its own (older headers lack its name). */
static void take_error(bus *b, const struct can_frame *frame) {
    enum { COUNTERS = 0x200 };
    const uint32_t kind = frame->can_id & CAN_ERR_MASK & ~(uint32_t)COUNTERS;
    if ((kind & CAN_ERR_CRTL) != 0U) {
        controller_error(b, frame->data[1]);
    }
    if ((kind & CAN_ERR_ACK) != 0U) { /* nobody else is on the bus, or nobody with this bit rate */
        b->counts.no_acknowledge++;
    }
    if ((kind & CAN_ERR_RESTARTED) != 0U) {
        b->counts.restarted++;
        bus_enter(b, BUS_ACTIVE);
    }
    if ((kind & CAN_ERR_BUSOFF) != 0U) {
        b->counts.bus_off++;
        bus_enter(b, BUS_OFF);
    }
    if ((kind & ~(uint32_t)(CAN_ERR_CRTL | CAN_ERR_ACK | CAN_ERR_RESTARTED | CAN_ERR_BUSOFF)) != 0U) {
        b->counts.other_error++;
    }
}

/* The kernel's count of frames that this socket's queue had no place for; it comes with the next frame that had one. */
static void note_overflow(bus *b, struct msghdr *header) {
    for (struct cmsghdr *c = CMSG_FIRSTHDR(header); c != NULL; c = CMSG_NXTHDR(header, c)) {
        if ((c->cmsg_level == SOL_SOCKET) && (c->cmsg_type == SO_RXQ_OVFL)) {
            uint32_t lost = 0;
            (void)memcpy(&lost, CMSG_DATA(c), sizeof lost);
            b->counts.overflowed += lost - b->queue_lost;
            b->queue_lost = lost;
        }
    }
}

/* The kernel tells it once, to whichever call comes first, then again to each that sends. The socket stays bound, and
 * works when the interface is up again. */
static void went_down(bus *b) {
    if (b->state != BUS_DOWN) {
        b->counts.went_down++;
        bus_enter(b, BUS_DOWN);
    }
}

static bool take_frame(bus *b, const struct can_frame *in, terrapin_frame *out) {
    bool taken = false;
    if ((in->can_id & CAN_ERR_FLAG) != 0U) {
        take_error(b, in);
    } else if ((in->can_id <= CAN_SFF_MASK) && (in->can_dlc <= CAN_MAX_DLEN)) {
        out->id = (uint16_t)in->can_id;
        out->length = in->can_dlc;
        (void)memcpy(out->data, in->data, sizeof out->data);
        b->counts.received++;
        taken = true;
    } else {
        /* excluded by the filters */
    }
    return taken;
}

static int socketcan_receive(bus *b, terrapin_frame frames[BUS_AT_ONCE]) {
    struct can_frame in[BUS_AT_ONCE];
    struct iovec places[BUS_AT_ONCE];
    struct mmsghdr messages[BUS_AT_ONCE];
    _Alignas(struct cmsghdr) char notes[BUS_AT_ONCE][CMSG_SPACE(sizeof(uint32_t))];
    (void)memset(messages, 0, sizeof messages);
    for (int i = 0; i < BUS_AT_ONCE; i++) {
        places[i] = (struct iovec){.iov_base = &in[i], .iov_len = sizeof in[i]};
        messages[i].msg_hdr = (struct msghdr){
            .msg_iov = &places[i], .msg_iovlen = 1, .msg_control = notes[i], .msg_controllen = sizeof notes[i]};
    }
    const int count = recvmmsg(b->descriptor, messages, BUS_AT_ONCE, MSG_DONTWAIT, NULL);
    if (count < 0) {
        if (errno == ENETDOWN) {
            went_down(b);
        } else if ((errno != EAGAIN) && (errno != EINTR)) {
            bus_lost(b, errno);
        } else {
            /* nothing there */
        }
        return 0;
    }
    int taken = 0;
    for (int i = 0; i < count; i++) {
        note_overflow(b, &messages[i].msg_hdr);
        if (messages[i].msg_len == sizeof in[i]) {
            taken += take_frame(b, &in[i], &frames[taken]) ? 1 : 0;
        }
    }
    if ((taken > 0) && (b->state == BUS_DOWN)) {
        bus_enter(b, BUS_ACTIVE);
    }
    return taken;
}

static void socketcan_send(bus *b, const terrapin_frame *frames, uint8_t count) {
    struct can_frame out[TERRAPIN_MAX_FRAMES];
    struct iovec places[TERRAPIN_MAX_FRAMES];
    struct mmsghdr messages[TERRAPIN_MAX_FRAMES];
    (void)memset(messages, 0, sizeof messages);
    (void)memset(out, 0, sizeof out);
    for (int i = 0; i < count; i++) {
        out[i].can_id = frames[i].id;
        out[i].can_dlc = frames[i].length;
        (void)memcpy(out[i].data, frames[i].data, sizeof out[i].data);
        places[i] = (struct iovec){.iov_base = &out[i], .iov_len = sizeof out[i]};
        messages[i].msg_hdr = (struct msghdr){.msg_iov = &places[i], .msg_iovlen = 1};
    }
    const int sent = sendmmsg(b->descriptor, messages, count, MSG_DONTWAIT);
    const int reason = errno;
    const uint32_t done = (sent > 0) ? (uint32_t)sent : 0U;
    b->counts.sent += done;
    b->counts.unsent += count - done;
    if (sent >= 0) {
        if (b->state == BUS_DOWN) {
            bus_enter(b, BUS_ACTIVE);
        }
    } else if (reason == ENETDOWN) {
        went_down(b);
    } else if ((reason == ENODEV) || (reason == ENXIO)) {
        bus_lost(b, reason);
    } else {
        /* ENOBUFS, EAGAIN: the queue is full, because nobody acknowledges or others keep the bus busy */
    }
}

const bus_kind bus_socketcan = {
    .open = socketcan_open,
    .receive = socketcan_receive,
    .send = socketcan_send,
};
