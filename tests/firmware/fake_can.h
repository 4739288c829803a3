/* A bxCAN made of memory: mailboxes that take part in a bus's arbitration, and a receive FIFO of one frame. */
#ifndef FAKE_CAN_H
#define FAKE_CAN_H

#include <string.h>

#include "can.h"

typedef struct {
    can_registers r;
    bool pending[3];
    bool sent[3]; /* the last one that the mailbox held, until it holds another */
} fake_can;

static void fake_open(fake_can *f) {
    memset(f, 0, sizeof *f);
    f->r.MSR = CAN_MSR_INAK;
    f->r.TSR = CAN_TSR_TME0 * 7U;
}

/* Take in what the driver has written since. Mailboxes are read from their request bits; of the status register the
 * last write counts, which is where an abort stands. */
static inline void fake_settle(fake_can *f) {
    const uint32_t written = f->r.TSR;
    for (uint32_t i = 0; i < 3U; i++) {
        if (((f->r.tx[i].IR & CAN_IR_TXRQ) != 0U) && !f->pending[i]) {
            f->pending[i] = true;
            f->sent[i] = false;
        }
        if (f->pending[i] && ((written & (CAN_TSR_ABRQ0 << (8U * i))) != 0U)) {
            f->pending[i] = false;
            f->r.tx[i].IR &= ~CAN_IR_TXRQ;
        }
    }
    f->r.TSR = 0U;
    for (uint32_t i = 0; i < 3U; i++) {
        f->r.TSR |= f->pending[i] ? 0U : (CAN_TSR_TME0 << i);
        f->r.TSR |= f->sent[i] ? ((CAN_TSR_RQCP0 | CAN_TSR_TXOK0) << (8U * i)) : 0U;
    }
}

/* The mailbox that takes part in arbitration, or -1. */
static inline int fake_first(const fake_can *f) {
    int first = -1;
    for (int i = 0; i < 3; i++) {
        if (f->pending[i] && ((first < 0) || ((f->r.tx[i].IR >> CAN_IR_STID) < (f->r.tx[first].IR >> CAN_IR_STID)))) {
            first = i;
        }
    }
    return first;
}

/* That mailbox's frame has won the bus and was acknowledged; its identifier. */
static inline uint16_t fake_sent(fake_can *f, int box) {
    f->pending[box] = false;
    f->sent[box] = true;
    f->r.tx[box].IR &= ~CAN_IR_TXRQ;
    f->r.TSR |= (CAN_TSR_TME0 << box) | ((CAN_TSR_RQCP0 | CAN_TSR_TXOK0) << (8 * box));
    return (uint16_t)(f->r.tx[box].IR >> CAN_IR_STID);
}

/* A frame from the bus, through the receive interrupt. */
static inline void fake_receive(fake_can *f, can *driver, const terrapin_frame *frame) {
    f->r.rx[0].IR = (uint32_t)frame->id << CAN_IR_STID;
    f->r.rx[0].DTR = frame->length;
    f->r.rx[0].DLR = (uint32_t)frame->data[0] | ((uint32_t)frame->data[1] << 8U) | ((uint32_t)frame->data[2] << 16U) |
                     ((uint32_t)frame->data[3] << 24U);
    f->r.rx[0].DHR = (uint32_t)frame->data[4] | ((uint32_t)frame->data[5] << 8U) | ((uint32_t)frame->data[6] << 16U) |
                     ((uint32_t)frame->data[7] << 24U);
    f->r.RF0R = 1U;
    can_receive_interrupt(driver);
}

#endif
