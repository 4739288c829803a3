/* What the Linux controller reads and drives by itself: converter files, quadrature encoders, a PWM channel. */
#ifndef TERRAPIN_LINUX_EDGES_H
#define TERRAPIN_LINUX_EDGES_H

#include <stdbool.h>
#include <stdint.h>

#include "gpio.h"

/* A file whose text is the converter's last code; the driver converts at each read from the start. */
typedef struct {
    int descriptor; /* -1: none, reads as 0, which is the code of a broken sensor */
    unsigned int bits;
} analog_input;

bool analog_open(analog_input *input, const char *path, unsigned int bits);
uint16_t analog_read(const analog_input *input); /* 12 bits; 0 when it cannot be read */
void analog_close(analog_input *input);

/* Two lines in quadrature, four counts a period. */
typedef struct {
    gpio_line *lines[2]; /* NULL: none */
    unsigned int phase;  /* bit 0: A, bit 1: B */
    uint16_t count;      /* wraps */
    uint32_t skipped;    /* both lines changed between two edges: a count was lost */
} quadrature;

bool quadrature_open(quadrature *encoder, const gpio_name names[2], char *why, size_t size);
void quadrature_update(quadrature *encoder); /* take the edges that wait, in the order of their times */
void quadrature_close(quadrature *encoder);

/* Phase after an edge; +1, -1 or (both lines differ) 0 counts in *step. */
unsigned int quadrature_next(unsigned int phase, unsigned int next, int *step);

/* A channel of sysfs. Duty is a part of its period, which is read when it is opened. */
typedef struct {
    int descriptor; /* of duty_cycle; -1: none */
    uint64_t period_ns;
    uint64_t duty_ns; /* written last */
} pwm_output;

bool pwm_open(pwm_output *pwm, const char *folder); /* duty 0, channel on */
bool pwm_set(pwm_output *pwm, int16_t duty_q15);    /* its magnitude */
void pwm_close(pwm_output *pwm);                    /* duty 0 */

#endif
