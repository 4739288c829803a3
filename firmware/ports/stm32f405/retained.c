#include "retained.h"

#if defined(__arm__)
__attribute__((section(".retained")))
#endif
retained_memory retained;

static uint32_t check_of(const retained_memory *memory) {
    return memory->magic ^ memory->reason ^ memory->address ^ memory->status;
}

void retained_note(retained_memory *memory, retained_reason reason, uint32_t address, uint32_t status) {
    memory->magic = RETAINED_MAGIC;
    memory->reason = (uint32_t)reason;
    memory->address = address;
    memory->status = status;
    memory->check = check_of(memory);
}

retained_reason retained_look(const retained_memory *memory) {
    const bool good = (memory->magic == RETAINED_MAGIC) && (memory->check == check_of(memory)) &&
                      (memory->reason <= (uint32_t)RETAINED_UPDATE);
    return good ? (retained_reason)memory->reason : RETAINED_NOTHING;
}

retained_reason retained_take(retained_memory *memory) {
    const retained_reason reason = retained_look(memory);
    memory->magic = 0U;
    return reason;
}

void retained_set_stopped(retained_memory *memory, bool stopped) {
    memory->stopped = stopped ? RETAINED_STOPPED : 0U;
    memory->running = ~memory->stopped;
}

bool retained_stopped(const retained_memory *memory) {
    return (memory->stopped == RETAINED_STOPPED) && (memory->running == ~RETAINED_STOPPED);
}
