#include "watchdog.h"

#include "wait.h"

#define TRIES 20000U /* a new time takes five periods of 32 kHz: 0.3 ms */

bool watchdog_set(iwdg_registers *watchdog, watchdog_time time) {
    const uint32_t divider = (time == WATCHDOG_WORK) ? 0U : 6U; /* 4; 256 */
    const uint32_t reload = (time == WATCHDOG_WORK) ? 160U : 1000U;
    watchdog->KR = IWDG_KR_START;
    watchdog->KR = IWDG_KR_ACCESS;
    watchdog->PR = divider;
    watchdog->RLR = reload;
    const bool good = wait_for(&watchdog->SR, 3U, 0U, TRIES) && (watchdog->RLR == reload);
    watchdog->KR = IWDG_KR_RELOAD;
    return good;
}

void watchdog_feed(iwdg_registers *watchdog) {
    watchdog->KR = IWDG_KR_RELOAD;
}
