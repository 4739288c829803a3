#include "usart.h"

#include "wait.h"

void usart_open(usart *u, usart_registers *registers, uint32_t apb_hz, uint32_t baud) {
    u->registers = registers;
    u->damaged = 0U;
    ring_init(&u->in, u->in_bytes, USART_IN_SIZE);
    ring_init(&u->out, u->out_bytes, USART_OUT_SIZE);
    registers->CR1 = 0U;
    registers->CR2 = 0U;
    registers->CR3 = 0U;
    registers->BRR = (apb_hz + (baud / 2U)) / baud; /* with 16 samples a bit, mantissa and fraction are one number */
    registers->CR1 = USART_CR1_UE | USART_CR1_RE | USART_CR1_TE | USART_CR1_RXNEIE;
}

static void receive(usart *u) {
    const uint32_t status = u->registers->SR; /* reading SR, then DR, clears the errors */
    if ((status & (USART_SR_RXNE | USART_SR_ORE)) == 0U) {
        return;
    }
    const uint8_t byte = (uint8_t)u->registers->DR;
    if ((status & (USART_SR_ORE | USART_SR_FE | USART_SR_NF)) != 0U) {
        u->damaged++;
    }
    if ((status & USART_SR_RXNE) != 0U) {
        (void)ring_put(&u->in, byte);
    }
}

/* As many bytes as the transmitter takes at once; its interrupt asks for the rest. */
static void transmit(usart *u) {
    uint8_t byte = 0;
    uint32_t room = USART_OUT_SIZE; /* an emulated transmitter is always empty */
    while ((room > 0U) && ((u->registers->SR & USART_SR_TXE) != 0U)) {
        if (!ring_take(&u->out, &byte)) {
            u->registers->CR1 &= ~USART_CR1_TXEIE;
            return;
        }
        u->registers->DR = byte;
        room--;
    }
}

void usart_interrupt(usart *u) {
    receive(u);
    if ((u->registers->CR1 & USART_CR1_TXEIE) != 0U) {
        transmit(u);
    }
}

bool usart_take(usart *u, uint8_t *byte) {
    return ring_take(&u->in, byte);
}

bool usart_send(usart *u, const uint8_t *bytes, uint32_t length) {
    u->registers->CR1 &= ~USART_CR1_TXEIE; /* the interrupt must not take while this does */
    const bool taken = ring_put_all(&u->out, bytes, length);
    transmit(u);
    if (ring_used(&u->out) > 0U) {
        u->registers->CR1 |= USART_CR1_TXEIE;
    }
    return taken;
}

bool usart_flush(usart *u, uint32_t tries) {
    uint32_t left = tries;
    while ((ring_used(&u->out) > 0U) && (left > 0U)) {
        (void)usart_send(u, NULL, 0U);
        left--;
    }
    return (left > 0U) && wait_for(&u->registers->SR, USART_SR_TC, USART_SR_TC, tries);
}
