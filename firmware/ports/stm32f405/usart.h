/* USART1: bytes in by interrupt into a bounded ring, bytes out from one. */
#ifndef TERRAPIN_USART_H
#define TERRAPIN_USART_H

#include "registers.h"
#include "ring.h"

#define USART_IN_SIZE  512U
#define USART_OUT_SIZE 1024U

typedef struct {
    usart_registers *registers;
    ring in;
    ring out;
    volatile uint32_t damaged; /* bytes with a framing or noise error, or lost in the receiver; wraps */
    uint8_t in_bytes[USART_IN_SIZE];
    uint8_t out_bytes[USART_OUT_SIZE];
} usart;

/* 8 data bits, no parity, one stop bit; apb_hz is the bus's clock. The pins and the interrupt's enabling are the
 * caller's. */
void usart_open(usart *u, usart_registers *registers, uint32_t apb_hz, uint32_t baud);

/* To be called from the interrupt. */
void usart_interrupt(usart *u);

/* The next received byte; false when there is none. */
bool usart_take(usart *u, uint8_t *byte);

/* Queue bytes, all or (false) none, and start sending. Not from an interrupt. */
bool usart_send(usart *u, const uint8_t *bytes, uint32_t length);

/* Wait until all is sent (a boot loader before it jumps), at most `tries` tries. */
bool usart_flush(usart *u, uint32_t tries);

#endif
