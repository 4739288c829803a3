#include "bus.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

const char *bus_state_name(bus_state state) {
    static const char *const names[] = {"error active", "error warning", "error passive", "bus-off", "down"};
    return names[state];
}

void bus_enter(bus *b, bus_state state) {
    if (state != b->state) {
        (void)fprintf(stderr, "terrapin-controller: %s: %s\n", b->name, bus_state_name(state));
        b->state = state;
    }
}

bool bus_open(bus *b) {
    b->descriptor = -1;
    b->state = BUS_ACTIVE;
    if (!b->kind->open(b)) {
        (void)fprintf(stderr, "terrapin-controller: cannot open %s: %s\n", b->name, strerror(errno));
        return false;
    }
    return true;
}

bool bus_reopen(bus *b) {
    if ((b->descriptor < 0) && b->kind->open(b)) {
        bus_enter(b, BUS_ACTIVE);
    }
    return b->descriptor >= 0;
}

void bus_lost(bus *b, int reason) {
    b->counts.went_down++;
    (void)fprintf(stderr, "terrapin-controller: %s went away: %s\n", b->name, strerror(reason));
    b->state = BUS_DOWN;
    (void)close(b->descriptor);
    b->descriptor = -1;
}

int bus_receive(bus *b, terrapin_frame frames[BUS_AT_ONCE]) {
    const int count = (b->descriptor < 0) ? 0 : b->kind->receive(b, frames);
    int ours = 0;
    for (int i = 0; i < count; i++) { /* an adapter brings all that is on the bus */
        if (terrapin_node_receive(&b->node, &frames[i])) {
            frames[ours] = frames[i];
            ours++;
        }
    }
    return ours;
}

void bus_send(bus *b, const terrapin_frame *frames, uint8_t count) {
    if (count == 0U) {
        return;
    }
    if (b->descriptor < 0) {
        b->counts.unsent += count;
    } else {
        terrapin_frame sent[TERRAPIN_MAX_FRAMES];
        for (uint8_t i = 0; i < count; i++) {
            sent[i] = frames[i];
            terrapin_node_send(&b->node, &sent[i]);
        }
        b->kind->send(b, sent, count);
    }
}

void bus_close(bus *b) {
    if (b->descriptor >= 0) {
        const char *words = b->kind->last_words;
        if (words != NULL) {
            (void)!write(b->descriptor, words, strlen(words));
        }
        (void)close(b->descriptor);
        b->descriptor = -1;
    }
}

void bus_report(const bus *b, FILE *to) {
    const bus_counts *c = &b->counts;
    (void)fprintf(to,
                  "terrapin-controller: %s %s: %lu frames received, %lu lost to a full queue, %lu sent, %lu not sent; "
                  "errors: %lu warning, %lu passive, %lu bus-off, %lu restarted, %lu no acknowledge, %lu other; "
                  "down %lu times",
                  b->name, bus_state_name(b->state), (unsigned long)c->received, (unsigned long)c->overflowed,
                  (unsigned long)c->sent, (unsigned long)c->unsent, (unsigned long)c->error_warning,
                  (unsigned long)c->error_passive, (unsigned long)c->bus_off, (unsigned long)c->restarted,
                  (unsigned long)c->no_acknowledge, (unsigned long)c->other_error, (unsigned long)c->went_down);
    if (b->kind->lines) {
        (void)fprintf(to, "; adapter: %lu lines refused, %lu malformed", (unsigned long)c->refused,
                      (unsigned long)b->parser.malformed);
    }
    (void)fputc('\n', to);
}
