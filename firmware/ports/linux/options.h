/* The command line of the Linux controller. */
#ifndef TERRAPIN_LINUX_OPTIONS_H
#define TERRAPIN_LINUX_OPTIONS_H

#include <stdbool.h>

#include "gpio.h"

typedef struct {
    bool given;
    gpio_name name;
    const char *text;
} line_option;

typedef struct {
    const char *can;     /* SocketCAN interface, or NULL */
    const char *adapter; /* SLCAN adapter's device, or NULL */
    unsigned int bitrate;
    line_option estop, enable, led, direction;
    line_option motor[2], ground[2];            /* encoders' A and B */
    const char *current, *supply, *temperature; /* files of the converter's raw codes, or NULL */
    unsigned int adc_bits;
    const char *pwm;      /* folder of a sysfs PWM channel, or NULL */
    const char *flash;    /* file that keeps the parameters and the node number, or NULL */
    const char *link_key; /* file of the key that commands are sealed with, or NULL */
    int node;             /* number on the bus; -1: as the file says */
    unsigned int debounce_ms;
    int priority; /* of SCHED_FIFO; 0: leave it */
    bool off;     /* only put the outputs off */
} controller_options;

typedef enum { OPTIONS_RUN, OPTIONS_DONE, OPTIONS_WRONG } options_result;

/* Read the command line. OPTIONS_WRONG: said why on stderr in one line. OPTIONS_DONE: --help or --version was answered.
 */
options_result options_read(int argc, char **argv, controller_options *options);

#endif
