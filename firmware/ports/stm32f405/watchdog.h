/* The independent watchdog: resets the chip unless fed, on a clock of its own (32 kHz, 17 to 47). Once started it
 * cannot be stopped.
 *
 * It takes a new time only when the last one is in force, which is up to six periods of its divided clock later: 1.4 ms
 * while the controller works, 48 ms (90 at its slowest) around an erase. What is written before that is ignored.
 */
#ifndef TERRAPIN_WATCHDOG_H
#define TERRAPIN_WATCHDOG_H

#include "registers.h"

/* Bites after this long: 20 ms (14 to 38) while the controller works, 8 s (5.6 to 15) around an erase of the flash. */
typedef enum { WATCHDOG_WORK = 0, WATCHDOG_ERASE = 1 } watchdog_time;

typedef struct {
    iwdg_registers *registers;
    watchdog_time wanted;
} watchdog;

/* Start it, or have another time, and feed it. WATCHDOG_ERASE is waited for, so that an erase may follow; WATCHDOG_WORK
 * comes with one of the next feeds. False when the time for an erase did not come: the watchdog does not answer. */
bool watchdog_set(watchdog *w, iwdg_registers *registers, watchdog_time time);
/* Feed it; gives it the time that is wanted as soon as it takes one. */
void watchdog_feed(const watchdog *w);

#endif
