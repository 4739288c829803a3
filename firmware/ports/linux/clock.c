#define _GNU_SOURCE

#include "clock.h"

#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define SECOND_NS 1000000000U

static uint64_t now_ns(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return ((uint64_t)now.tv_sec * SECOND_NS) + (uint64_t)now.tv_nsec;
}

static struct timespec as_time(uint64_t ns) {
    return (struct timespec){.tv_sec = (time_t)(ns / SECOND_NS), .tv_nsec = (long)(ns % SECOND_NS)};
}

bool tick_clock_open(tick_clock *clock) {
    clock->descriptor = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    return clock->descriptor >= 0;
}

bool tick_clock_start(tick_clock *clock, uint64_t period_ns) {
    clock->period_ns = period_ns;
    clock->due_ns = now_ns() + period_ns;
    const struct itimerspec times = {.it_interval = as_time(period_ns), .it_value = as_time(clock->due_ns)};
    return timerfd_settime(clock->descriptor, TFD_TIMER_ABSTIME, &times, NULL) == 0;
}

uint32_t tick_clock_take(tick_clock *clock, bool measure) {
    uint64_t expired = 0;
    if ((read(clock->descriptor, &expired, sizeof expired) != (ssize_t)sizeof expired) || (expired == 0U)) {
        return 0;
    }
    clock->due_ns += (expired - 1U) * clock->period_ns; /* the last one that went by */
    if (measure) {
        const uint64_t now = now_ns();
        const uint64_t late = (now > clock->due_ns) ? (now - clock->due_ns) : 0U;
        const uint64_t us = late / 1000U;
        clock->late_us[(us < CLOCK_RANGE_US) ? us : CLOCK_RANGE_US]++;
        clock->latest_ns = (late > clock->latest_ns) ? late : clock->latest_ns;
        clock->ticks++;
        clock->missed += (uint32_t)(expired - 1U);
    }
    clock->due_ns += clock->period_ns;
    return (uint32_t)expired;
}

static unsigned int quantile(const tick_clock *clock, uint64_t part, uint64_t of) {
    uint64_t seen = 0;
    unsigned int us = 0;
    while ((us < CLOCK_RANGE_US) && ((seen + clock->late_us[us]) * of < (uint64_t)clock->ticks * part)) {
        seen += clock->late_us[us];
        us++;
    }
    return us;
}

void tick_clock_report(const tick_clock *clock, FILE *to) {
    (void)fprintf(to,
                  "terrapin-controller: %lu ticks by the clock, %lu missed; late by %u us (median), %u us (99 %%), "
                  "%lu us (latest)\n",
                  (unsigned long)clock->ticks, (unsigned long)clock->missed, quantile(clock, 1, 2),
                  quantile(clock, 99, 100), (unsigned long)(clock->latest_ns / 1000U));
}
