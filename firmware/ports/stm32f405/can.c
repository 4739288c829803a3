#include "can.h"

#include <stdatomic.h>

#include "wait.h"

#define TRIES_INIT   20000U /* entering takes at most a frame's time: 0.3 ms at 500 kbit/s */
#define BOXES        3U
#define SEGMENT1_MAX 16U
#define SEGMENT2_MAX 8U

uint32_t can_timing(uint32_t apb_hz, uint32_t bit_rate) {
    for (uint32_t quanta = 18U; quanta >= 8U; quanta--) { /* the most quanta that divide: the finest sampling point */
        const uint32_t prescaler = apb_hz / (bit_rate * quanta);
        const uint32_t segment2 = (quanta < 10U) ? 1U : 2U; /* sampled at 80 to 89 % */
        const uint32_t segment1 = quanta - 1U - segment2;
        if ((prescaler >= 1U) && (prescaler <= 1024U) && ((prescaler * bit_rate * quanta) == apb_hz) &&
            (segment1 <= SEGMENT1_MAX) && (segment2 <= SEGMENT2_MAX)) {
            return (prescaler - 1U) | ((segment1 - 1U) << CAN_BTR_TS1) | ((segment2 - 1U) << CAN_BTR_TS2) |
                   ((segment2 - 1U) << CAN_BTR_SJW); /* may jump as far as that: clocks that differ more */
        }
    }
    return 0U;
}

/* Two 16-bit filters (identifier and mask) a bank, all into FIFO 0; data frames with 11-bit identifiers alone. */
static void set_filters(can_registers *registers, const terrapin_filter *filters, uint32_t count) {
    registers->FMR |= CAN_FMR_FINIT;
    uint32_t banks = 0U;
    for (uint32_t i = 0U; i < count; i += 2U) {
        const terrapin_filter *pair[2] = {&filters[i], &filters[((i + 1U) < count) ? (i + 1U) : i]};
        uint32_t words[2] = {0};
        for (uint32_t k = 0U; k < 2U; k++) {
            words[k] = ((uint32_t)pair[k]->id << 5U) | ((((uint32_t)pair[k]->mask << 5U) | BIT(4) | BIT(3)) << 16U);
        }
        registers->filter[i / 2U].R1 = words[0];
        registers->filter[i / 2U].R2 = words[1];
        banks |= BIT(i / 2U);
    }
    registers->FM1R = 0U;
    registers->FS1R = 0U;
    registers->FFA1R = 0U;
    registers->FA1R = banks;
    registers->FMR &= ~CAN_FMR_FINIT;
}

bool can_open(can *c, can_registers *registers, uint32_t timing, const terrapin_filter *filters,
              uint32_t filter_count) {
    *c = (can){.registers = registers, .phase = CAN_ABSENT};
    if ((timing == 0U) || (filter_count > CAN_FILTER_MAX)) {
        return false;
    }
    registers->MCR = CAN_MCR_INRQ;
    if (!wait_for(&registers->MSR, CAN_MSR_INAK, CAN_MSR_INAK, TRIES_INIT)) {
        return false;
    }
    registers->MCR = CAN_MCR_INRQ | CAN_MCR_ABOM; /* after bus-off back by itself; the lowest identifier first */
    registers->BTR = timing;
    set_filters(registers, filters, filter_count);
    registers->IER = CAN_IER_FMPIE0;
    registers->ESR |= CAN_ESR_LEC; /* 7: what comes next is told from what was */
    registers->MCR = CAN_MCR_ABOM;
    c->phase = CAN_STARTING;
    return true;
}

void can_receive_interrupt(can *c) {
    can_registers *registers = c->registers;
    const uint32_t fifo = registers->RF0R;
    if (((fifo & CAN_RF0R_FMP) == 0U) || ((fifo & CAN_RF0R_RFOM) != 0U)) {
        return; /* nothing, or the last one is not yet gone */
    }
    if ((fifo & CAN_RF0R_FOVR) != 0U) {
        c->in_lost++; /* at least one */
    }
    const uint32_t identifier = registers->rx[0].IR;
    const uint32_t head = c->in_head;
    if ((identifier & (CAN_IR_IDE | CAN_IR_RTR)) != 0U) {
        /* not ours, should the filters be off */
    } else if ((head - c->in_tail) >= CAN_IN_SIZE) {
        c->in_lost++;
    } else {
        terrapin_frame *frame = &c->in[head % CAN_IN_SIZE];
        const uint32_t low = registers->rx[0].DLR;
        const uint32_t high = registers->rx[0].DHR;
        const uint32_t length = registers->rx[0].DTR & 0xFU;
        frame->id = (uint16_t)(identifier >> CAN_IR_STID);
        frame->length = (uint8_t)((length > 8U) ? 8U : length);
        for (uint32_t i = 0U; i < 4U; i++) {
            frame->data[i] = (uint8_t)(low >> (8U * i));
            frame->data[i + 4U] = (uint8_t)(high >> (8U * i));
        }
        c->in_head = head + 1U;
    }
    registers->RF0R = CAN_RF0R_RFOM | CAN_RF0R_FOVR;
}

bool can_take(can *c, terrapin_frame *frame) {
    const uint32_t tail = c->in_tail;
    if (tail == c->in_head) {
        return false;
    }
    *frame = c->in[tail % CAN_IN_SIZE];
    atomic_signal_fence(memory_order_acq_rel); /* copied before the interrupt may write there again */
    c->in_tail = tail + 1U;
    return true;
}

static void insert(can *c, uint32_t at, const terrapin_frame *frame) {
    for (uint32_t i = c->out_count; i > at; i--) {
        c->out[i] = c->out[i - 1U];
    }
    c->out[at] = *frame;
    c->out_count++;
}

static void drop(can *c, uint32_t at) {
    c->out_count--;
    for (uint32_t i = at; i < c->out_count; i++) {
        c->out[i] = c->out[i + 1U];
    }
}

bool can_send(can *c, const terrapin_frame *frame, can_policy policy) {
    if ((c->phase == CAN_ABSENT) || (c->phase == CAN_CLOSED)) {
        return false;
    }
    uint32_t at = 0U;
    while ((at < c->out_count) && (c->out[at].id <= frame->id)) {
        if ((policy == CAN_REPLACE) && (c->out[at].id == frame->id)) {
            c->out[at] = *frame;
            return true;
        }
        at++;
    }
    bool all = true;
    if (c->out_count == CAN_OUT_SIZE) {
        c->out_lost++;
        all = false;
        if (at == CAN_OUT_SIZE) {
            return false; /* the newest of the lowest priority is this one */
        }
        c->out_count--;
    }
    insert(c, at, frame);
    return all;
}

/* Mailboxes whose frame has left, or was taken back. */
static void collect(can *c) {
    const uint32_t status = c->registers->TSR;
    for (uint32_t i = 0U; i < BOXES; i++) {
        const uint32_t shift = i * CAN_TSR_STRIDE;
        if (!c->box[i].used || ((status & (CAN_TSR_TME0 << i)) == 0U)) {
            continue;
        }
        const bool sent = (status & (CAN_TSR_TXOK0 << shift)) != 0U;
        if (sent) {
            c->state.no_acknowledge = false;
        }
        c->box[i].used = false;
        c->registers->TSR = CAN_TSR_RQCP0 << shift; /* clears its results with it */
        if (!sent && c->box[i].aborting) {
            uint32_t at = 0U; /* older than all others of its identifier */
            while ((at < c->out_count) && (c->out[at].id < c->box[i].frame.id)) {
                at++;
            }
            if (c->out_count < CAN_OUT_SIZE) {
                insert(c, at, &c->box[i].frame);
            } else {
                c->out_lost++;
            }
        } else if (!sent) {
            c->out_lost++; /* only when the chip gave up by itself: bus-off */
        } else {
            /* done */
        }
    }
}

static bool in_a_box(const can *c, uint16_t id) {
    bool found = false;
    for (uint32_t i = 0U; i < BOXES; i++) {
        found = found || (c->box[i].used && (c->box[i].frame.id == id));
    }
    return found;
}

/* A free mailbox, or BOXES. */
static uint32_t free_box(const can *c) {
    uint32_t i = 0U;
    while ((i < BOXES) && c->box[i].used) {
        i++;
    }
    return i;
}

static void fill(can *c, uint32_t index, const terrapin_frame *frame) {
    can_mailbox_registers *box = &c->registers->tx[index];
    uint32_t words[2] = {0};
    for (uint32_t i = 0U; i < 8U; i++) {
        words[i / 4U] |= (uint32_t)frame->data[i] << (8U * (i % 4U));
    }
    c->box[index].frame = *frame;
    c->box[index].used = true;
    c->box[index].aborting = false;
    box->DTR = frame->length;
    box->DLR = words[0];
    box->DHR = words[1];
    box->IR = ((uint32_t)frame->id << CAN_IR_STID) | CAN_IR_TXRQ;
}

/* All mailboxes are taken: take back the last of them when the frame that waits comes before it. One at a time. */
static void make_room(can *c, uint16_t id) {
    uint32_t last = 0U;
    for (uint32_t i = 0U; i < BOXES; i++) {
        if (c->box[i].aborting) {
            return;
        }
        last = (c->box[i].frame.id > c->box[last].frame.id) ? i : last;
    }
    if (c->box[last].frame.id > id) {
        c->box[last].aborting = true;
        c->registers->TSR = CAN_TSR_ABRQ0 << (last * CAN_TSR_STRIDE);
    }
}

static void move_out(can *c) {
    uint32_t at = 0U;
    while (at < c->out_count) {
        const uint16_t id = c->out[at].id;
        const uint32_t box = free_box(c);
        if (in_a_box(c, id)) {
            at++; /* one of an identifier at a time */
        } else if (box < BOXES) {
            const terrapin_frame frame = c->out[at];
            drop(c, at);
            fill(c, box, &frame);
        } else {
            make_room(c, id);
            return;
        }
    }
}

static void watch(can *c) {
    const uint32_t errors = c->registers->ESR;
    const bool off = (errors & CAN_ESR_BOFF) != 0U;
    if (off && !c->state.bus_off) {
        c->state.bus_off_count++;
    }
    c->state.bus_off = off;
    c->state.passive = (errors & CAN_ESR_EPVF) != 0U;
    c->state.transmit_errors = (uint8_t)(errors >> CAN_ESR_TEC);
    c->state.receive_errors = (uint8_t)(errors >> CAN_ESR_REC);
    /* Alone on the bus the error counter climbs to 128 by missing acknowledges and stays there (RM0090, 32.7.6). */
    if (((errors & CAN_ESR_LEC) == CAN_ESR_LEC_AK) && c->state.passive) {
        c->state.no_acknowledge = true;
    }
}

bool can_idle(const can *c) {
    bool idle = c->out_count == 0U;
    for (uint32_t i = 0U; i < BOXES; i++) {
        idle = idle && !c->box[i].used;
    }
    return idle || (c->phase != CAN_RUNNING);
}

void can_poll(can *c) {
    if (c->phase == CAN_STARTING) {
        c->starting++;
        if ((c->registers->MSR & CAN_MSR_INAK) == 0U) {
            c->phase = CAN_RUNNING;
        }
    }
    if (c->phase == CAN_RUNNING) {
        watch(c);
        collect(c);
        move_out(c);
    }
}
