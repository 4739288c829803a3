/* The independent watchdog: resets the chip unless fed, on a clock of its own (32 kHz, 17 to 47). Once started it
 * cannot be stopped. */
#ifndef TERRAPIN_WATCHDOG_H
#define TERRAPIN_WATCHDOG_H

#include "registers.h"

/* Bites after this long: 20 ms (14 to 38) while the controller works, 8 s (5.6 to 15) around an erase of the flash. */
typedef enum { WATCHDOG_WORK = 0, WATCHDOG_ERASE = 1 } watchdog_time;

/* Start it, or set another time, and feed it. False when the watchdog does not answer. */
bool watchdog_set(iwdg_registers *watchdog, watchdog_time time);
void watchdog_feed(iwdg_registers *watchdog);

#endif
