/* The H-bridge: TIM1's channels 1 and 2 with their complements, dead time between them, and a break input by which the
 * gate driver switches it off without any software.
 */
#ifndef TERRAPIN_BRIDGE_H
#define TERRAPIN_BRIDGE_H

#include "registers.h"

typedef struct {
    tim_registers *timer;
    uint16_t period; /* compare value of full duty */
    bool broken;     /* the break input has struck since the bridge was last off by request */
} bridge;

/* Set up, outputs off. Centre-aligned at pwm_hz; dead_time_ns is rounded up to the timer's steps. */
void bridge_open(bridge *b, tim_registers *timer, uint32_t timer_hz, uint32_t pwm_hz, uint16_t dead_time_ns);

/* Duty -32767 to 32767 of the supply when `on`, all transistors off otherwise. After a break it stays off until it was
 * asked for `on` false and the input is quiet again. */
void bridge_drive(bridge *b, int16_t duty_q15, bool on);

/* All transistors off, by one write: for faults. */
void bridge_off(tim_registers *timer);

/* Register code of a dead time (RM0090, 17.4.18), rounded up; the longest there is when it is longer. */
uint32_t bridge_dead_time(uint32_t timer_hz, uint16_t dead_time_ns);

#endif
