/* What a pin does. A board is a table of these, made of its file (terrapin_board.h). */
#ifndef TERRAPIN_PINS_H
#define TERRAPIN_PINS_H

#include "registers.h"

typedef enum { PIN_INPUT = 0, PIN_OUTPUT = 1, PIN_FUNCTION = 2, PIN_ANALOG = 3 } pin_mode;
typedef enum { PIN_FLOATING = 0, PIN_UP = 1, PIN_DOWN = 2 } pin_pull;

typedef struct {
    uint8_t port; /* 0 is A */
    uint8_t number;
    uint8_t mode;     /* pin_mode */
    uint8_t pull;     /* pin_pull */
    uint8_t function; /* alternate function, DS8626 table 9; 0 unless PIN_FUNCTION */
} pin;

void pin_setup(gpio_registers *port, const pin *p);
void pin_write(gpio_registers *port, const pin *p, bool high);
bool pin_read(const gpio_registers *port, const pin *p);

#endif
