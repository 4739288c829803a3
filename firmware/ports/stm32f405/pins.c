#include "pins.h"

#include "wait.h"

static void field(reg32 *address, uint32_t at, uint32_t bits, uint32_t value) {
    const uint32_t mask = (BIT(bits) - 1U) << at;
    TERRAPIN_PUT(*address, (*address & ~mask) | (value << at));
}

void pin_setup(gpio_registers *port, const pin *p) {
    const uint32_t number = p->number;
    field(&port->PUPDR, 2U * number, 2U, p->pull);
    field(&port->OSPEEDR, 2U * number, 2U, (p->mode == (uint8_t)PIN_FUNCTION) ? 2U : 0U);
    field(&port->AFR[number / 8U], 4U * (number % 8U), 4U, p->function);
    field(&port->MODER, 2U * number, 2U, p->mode); /* last: the pin must not show another function on the way */
}

void pin_write(gpio_registers *port, const pin *p, bool high) {
    port->BSRR = BIT(p->number) << (high ? 0U : 16U);
}

bool pin_read(const gpio_registers *port, const pin *p) {
    return (port->IDR & BIT(p->number)) != 0U;
}
