/* A quadrature encoder on TIM3 or TIM4: 16 bits that wrap, four counts a line. */
#ifndef TERRAPIN_ENCODER_H
#define TERRAPIN_ENCODER_H

#include "registers.h"

void encoder_open(tim_registers *timer, bool reversed);
uint16_t encoder_read(const tim_registers *timer);

#endif
