/* Whether an image may stay: what decides between its confirmation and the return of the old one.
 *
 * It is confirmed when it has been good for HEALTH_GOOD_MS on end, one good frame was heard, and the bridge is off. On
 * trial, when that has not come within HEALTH_LIMIT_MS, it is given up as soon as the bridge is off. Decided once.
 */
#ifndef TERRAPIN_HEALTH_H
#define TERRAPIN_HEALTH_H

#include <stdbool.h>
#include <stdint.h>

#define HEALTH_GOOD_MS  5000U
#define HEALTH_LIMIT_MS 60000U

typedef struct {
    uint32_t good_ms;    /* on end */
    uint32_t elapsed_ms; /* stops at HEALTH_LIMIT_MS */
    bool heard;          /* a good frame, some time: set by the caller */
    bool decided;
} health;

typedef enum { HEALTH_OPEN = 0, HEALTH_CONFIRM = 1, HEALTH_FALL_BACK = 2 } health_verdict;

/* A millisecond more. `good`: self test passed, no latched fault, sensors alive, somebody listens, no tick missed. */
health_verdict health_tick(health *h, bool good, bool bridge_on, bool trial);

#endif
