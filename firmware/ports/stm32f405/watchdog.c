#include "watchdog.h"

#include "wait.h"

#define UPDATING 3U     /* divider or reload value on the way */
#define TRIES    20000U /* 1 ms at 168 MHz, 10 ms at 16 MHz: shorter than the shortest time */
#define ROUNDS   200U

/* True when this time is in force. Registers that are being updated are not to be read. */
static bool in_force(const iwdg_registers *registers, uint32_t divider, uint32_t reload) {
    return ((registers->SR & UPDATING) == 0U) && (registers->PR == divider) && (registers->RLR == reload);
}

static bool give(iwdg_registers *registers, watchdog_time time) {
    const uint32_t divider = (time == WATCHDOG_WORK) ? 0U : 6U; /* 4; 256 */
    const uint32_t reload = (time == WATCHDOG_WORK) ? 160U : 1000U;
    const bool already = in_force(registers, divider, reload);
    if (!already && ((registers->SR & UPDATING) == 0U)) {
        registers->KR = IWDG_KR_ACCESS;
        TERRAPIN_PUT(registers->PR, divider);
        TERRAPIN_PUT(registers->RLR, reload);
    }
    registers->KR = IWDG_KR_RELOAD;
    return already;
}

bool watchdog_set(watchdog *w, iwdg_registers *registers, watchdog_time time) {
    w->registers = registers;
    w->wanted = time;
    registers->KR = IWDG_KR_START;
    bool good = give(registers, time);
    for (uint32_t i = 0U; !good && (time == WATCHDOG_ERASE) && (i < ROUNDS); i++) {
        (void)wait_for(&registers->SR, UPDATING, 0U, TRIES);
        good = give(registers, time);
    }
    return good || (time == WATCHDOG_WORK);
}

void watchdog_feed(const watchdog *w) {
    (void)give(w->registers, w->wanted);
}
