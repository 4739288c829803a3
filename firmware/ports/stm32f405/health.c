#include "health.h"

health_verdict health_tick(health *h, bool good, bool bridge_on, bool trial) {
    health_verdict verdict = HEALTH_OPEN;
    h->elapsed_ms += (h->elapsed_ms < HEALTH_LIMIT_MS) ? 1U : 0U;
    if (!good) {
        h->good_ms = 0U;
    } else if (h->good_ms < HEALTH_GOOD_MS) {
        h->good_ms++;
    } else {
        /* long enough */
    }
    if (!h->decided && !bridge_on) {
        if ((h->good_ms >= HEALTH_GOOD_MS) && h->heard) {
            verdict = HEALTH_CONFIRM;
        } else if (trial && (h->elapsed_ms >= HEALTH_LIMIT_MS)) {
            verdict = HEALTH_FALL_BACK;
        } else {
            /* wait */
        }
    }
    h->decided = h->decided || (verdict != HEALTH_OPEN);
    return verdict;
}
