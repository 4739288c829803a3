/* terrapin-controller on Linux: see options.c for its command line, docs/linux.md for its use. */
#define _GNU_SOURCE

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "controller.h"
#include "process.h"
#include "systemd.h"

#define SIGNAL_STACK 65536 /* bytes: above what any processor's registers need (sysconf(_SC_MINSIGSTKSZ)) */

static controller the_controller;
static controller_options options;

static void on_fatal(int number) {
    controller_emergency(&the_controller);
    (void)raise(number); /* SA_RESETHAND: now with its ordinary end */
}

/* On a stack of its own: the end of the ordinary one is such a signal, too. */
static void catch_fatal(void) {
    static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGSYS, SIGXCPU};
    static uint8_t memory[SIGNAL_STACK];
    const stack_t stack = {.ss_sp = memory, .ss_size = sizeof memory};
    const struct sigaction action = {.sa_handler = on_fatal,
                                     .sa_flags = (int)SA_RESETHAND | (int)SA_NODEFER | (int)SA_ONSTACK};
    (void)sigaltstack(&stack, NULL);
    for (size_t i = 0; i < (sizeof numbers / sizeof numbers[0]); i++) {
        (void)sigaction(numbers[i], &action, NULL);
    }
}

/* --off: request the outputs inactive and let them go; what systemd runs after the controller, however it ended. */
static int outputs_off(void) {
    int status = 0;
    char why[160];
    if (options.enable.given) {
        gpio_line *line = gpio_open(&options.enable.name, GPIO_OUTPUT, why, sizeof why);
        if (line == NULL) {
            (void)fprintf(stderr, "terrapin-controller: line %s: %s\n", options.enable.text, why);
            status = 1;
        }
        gpio_close(line);
    }
    pwm_output pwm;
    if (!pwm_open(&pwm, options.pwm)) {
        (void)fprintf(stderr, "terrapin-controller: cannot open PWM channel %s\n", options.pwm);
        status = 1;
    }
    pwm_close(&pwm);
    return status;
}

/* [--flash FILE] [--node N] [--link-key FILE] --pty [LINK] | DEVICE: the controller itself is the SLCAN device. */
static bool speaks_slcan(int argc, char **argv) {
    int first = 1;
    while (((first + 2) < argc) && terrapin_process_option(argv[first])) {
        first += 2;
    }
    return (first < argc) && ((strcmp(argv[first], "--pty") == 0) || (argv[first][0] != '-'));
}

int main(int argc, char **argv) {
    if (speaks_slcan(argc, argv)) {
        return terrapin_process(argc, argv);
    }
    switch (options_read(argc, argv, &options)) {
    case OPTIONS_DONE:
        return 0;
    case OPTIONS_WRONG:
        return 2;
    case OPTIONS_RUN:
    default:
        break;
    }
    if (options.off) {
        return outputs_off();
    }
    int status = 1;
    catch_fatal();
    if (controller_open(&the_controller, &options)) {
        real_time(options.priority);
        status = controller_run(&the_controller);
    }
    controller_close(&the_controller);
    return status;
}
