#define _GNU_SOURCE

#include "edges.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define EDGES_MOST 64 /* of one line at a time */

bool analog_open(analog_input *input, const char *path, unsigned int bits) {
    input->bits = bits;
    input->descriptor = (path == NULL) ? -1 : open(path, O_RDONLY | O_CLOEXEC);
    return (path == NULL) || (input->descriptor >= 0);
}

uint16_t analog_read(const analog_input *input) {
    char text[16];
    const ssize_t n = (input->descriptor < 0) ? 0 : pread(input->descriptor, text, sizeof text - 1U, 0);
    if (n <= 0) {
        return 0;
    }
    text[n] = '\0';
    char *end = NULL;
    errno = 0;
    const unsigned long code = strtoul(text, &end, 10);
    if ((end == text) || (errno != 0) || (text[0] == '-') || (code >= (1UL << input->bits))) {
        return 0;
    }
    return (uint16_t)((input->bits >= 12U) ? (code >> (input->bits - 12U)) : (code << (12U - input->bits)));
}

void analog_close(analog_input *input) {
    if (input->descriptor >= 0) {
        (void)close(input->descriptor);
        input->descriptor = -1;
    }
}

unsigned int quadrature_next(unsigned int phase, unsigned int next, int *step) {
    /* A leads B forward: 00 -> 01 -> 11 -> 10 (B A) */
    static const int steps[4][4] = {{0, 1, -1, 0}, {-1, 0, 0, 1}, {1, 0, 0, -1}, {0, -1, 1, 0}};
    *step = steps[phase & 3U][next & 3U];
    return next & 3U;
}

bool quadrature_open(quadrature *encoder, const gpio_name names[2], char *why, size_t size) {
    (void)memset(encoder, 0, sizeof *encoder);
    for (unsigned int i = 0; i < 2U; i++) {
        encoder->lines[i] = gpio_open(&names[i], GPIO_EDGES, why, size);
        if (encoder->lines[i] == NULL) {
            quadrature_close(encoder);
            return false;
        }
        encoder->phase |= (gpio_get(encoder->lines[i]) == 1) ? (1U << i) : 0U;
    }
    return true;
}

static void turn(quadrature *encoder, unsigned int line, bool active) {
    const unsigned int bit = 1U << line;
    const unsigned int next = active ? (encoder->phase | bit) : (encoder->phase & ~bit);
    int step = 0;
    if (next == encoder->phase) {
        encoder->skipped++; /* the edge between was lost */
    }
    encoder->phase = quadrature_next(encoder->phase, next, &step);
    encoder->count = (uint16_t)(encoder->count + (uint16_t)step);
}

void quadrature_update(quadrature *encoder) {
    gpio_edge edges[2][EDGES_MOST];
    int count[2] = {0, 0};
    int at[2] = {0, 0};
    if (encoder->lines[0] == NULL) {
        return;
    }
    for (int i = 0; i < 2; i++) {
        const int found = gpio_edges(encoder->lines[i], edges[i], EDGES_MOST);
        count[i] = (found > 0) ? found : 0;
    }
    while ((at[0] < count[0]) || (at[1] < count[1])) {
        const bool second =
            (at[0] == count[0]) || ((at[1] < count[1]) && (edges[1][at[1]].time_ns < edges[0][at[0]].time_ns));
        const unsigned int i = second ? 1U : 0U;
        turn(encoder, i, edges[i][at[i]].active);
        at[i]++;
    }
}

void quadrature_close(quadrature *encoder) {
    for (int i = 0; i < 2; i++) {
        gpio_close(encoder->lines[i]);
        encoder->lines[i] = NULL;
    }
}

static int open_attribute(const char *folder, const char *name, int mode) {
    char path[512];
    const int n = snprintf(path, sizeof path, "%s/%s", folder, name);
    if ((n < 0) || ((size_t)n >= sizeof path)) {
        errno = ENAMETOOLONG;
        return -1;
    }
    return open(path, mode | O_CLOEXEC);
}

static bool write_number(int descriptor, uint64_t value) {
    char text[24];
    const int n = snprintf(text, sizeof text, "%" PRIu64 "\n", value);
    return pwrite(descriptor, text, (size_t)n, 0) == n;
}

bool pwm_open(pwm_output *pwm, const char *folder) {
    char text[24] = "";
    (void)memset(pwm, 0, sizeof *pwm);
    pwm->descriptor = -1;
    if (folder == NULL) {
        return true;
    }
    const int period = open_attribute(folder, "period", O_RDONLY);
    const int enable = open_attribute(folder, "enable", O_WRONLY);
    pwm->descriptor = open_attribute(folder, "duty_cycle", O_WRONLY);
    bool good = (period >= 0) && (enable >= 0) && (pwm->descriptor >= 0);
    good = good && (read(period, text, sizeof text - 1U) > 0);
    pwm->period_ns = strtoull(text, NULL, 10);
    if (good && (pwm->period_ns == 0U)) {
        errno = EINVAL; /* its period is not set */
        good = false;
    }
    good = good && write_number(pwm->descriptor, 0) && write_number(enable, 1);
    const int reason = errno;
    if (period >= 0) {
        (void)close(period);
    }
    if (enable >= 0) {
        (void)close(enable);
    }
    errno = reason;
    return good;
}

bool pwm_set(pwm_output *pwm, int16_t duty_q15) {
    const uint64_t magnitude = (uint64_t)((duty_q15 < 0) ? -(int32_t)duty_q15 : (int32_t)duty_q15);
    const uint64_t duty = (pwm->period_ns * magnitude) >> 15U;
    if ((pwm->descriptor < 0) || (duty == pwm->duty_ns)) {
        return true;
    }
    const bool good = write_number(pwm->descriptor, duty);
    pwm->duty_ns = good ? duty : UINT64_MAX; /* unknown: the next call writes whatever it is */
    return good;
}

void pwm_close(pwm_output *pwm) {
    if (pwm->descriptor >= 0) {
        (void)write_number(pwm->descriptor, 0);
        (void)close(pwm->descriptor);
        pwm->descriptor = -1;
    }
}
