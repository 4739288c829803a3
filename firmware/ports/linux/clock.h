/* The clock of the step: a timerfd, and how late the step comes after it. */
#ifndef TERRAPIN_LINUX_CLOCK_H
#define TERRAPIN_LINUX_CLOCK_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#define CLOCK_RANGE_US 2000 /* of the distribution; later ones count as this */

typedef struct {
    int descriptor;
    uint64_t due_ns; /* when the next tick is due, CLOCK_MONOTONIC */
    uint64_t period_ns;
    uint32_t ticks;  /* taken */
    uint32_t missed; /* expirations that no step came for */
    uint64_t latest_ns;
    uint32_t late_us[CLOCK_RANGE_US + 1];
} tick_clock;

/* False (errno) when the system gives no timer. Begins with tick_clock_start. */
bool tick_clock_open(tick_clock *clock);

/* A tick each period_ns from now on. */
bool tick_clock_start(tick_clock *clock, uint64_t period_ns);

/* Takes a tick that is due: how many periods went by, 0 when none did. `measure`: count it and its lateness. */
uint32_t tick_clock_take(tick_clock *clock, bool measure);

/* One line: ticks, missed, lateness (median, 99 %, latest). */
void tick_clock_report(const tick_clock *clock, FILE *to);

#endif
