/* What outlives a reset (not a loss of power): why the firmware itself reset the chip, a word for the boot loader, and
 * whether STOP_ALL holds.
 * It stands in the last 32 bytes of RAM, which no image clears. */
#ifndef TERRAPIN_RETAINED_H
#define TERRAPIN_RETAINED_H

#include <stdbool.h>
#include <stdint.h>

#define RETAINED_MAGIC   0x7E57ACEDU
#define RETAINED_STOPPED 0x570BA110U

typedef enum {
    RETAINED_NOTHING = 0,
    RETAINED_PROCESSOR_FAULT = 1,
    RETAINED_STACK_OVERFLOW = 2,
    RETAINED_CRYSTAL_STOPPED = 3,
    RETAINED_UPDATE = 4 /* the controller asks the boot loader to stay */
} retained_reason;

typedef struct {
    uint32_t magic;   /* RETAINED_MAGIC, or nothing here is to be believed */
    uint32_t reason;  /* retained_reason */
    uint32_t address; /* of the instruction that failed, 0 when not known */
    uint32_t status;  /* the fault status register */
    uint32_t check;   /* all words exclusive-or'ed */
    uint32_t stopped; /* RETAINED_STOPPED: STOP_ALL holds; */
    uint32_t running; /* and what it is not, or it is not to be believed */
    uint32_t spare;
} retained_memory;

/* Note a reason, for the next start. */
void retained_note(retained_memory *memory, retained_reason reason, uint32_t address, uint32_t status);
/* What was noted, or RETAINED_NOTHING; forgotten afterwards. The boot loader takes RETAINED_UPDATE alone and leaves the
 * others: it looks with retained_look. */
retained_reason retained_look(const retained_memory *memory);
retained_reason retained_take(retained_memory *memory);

/* STOP_ALL holds, or no more. Neither of the above touches it. */
void retained_set_stopped(retained_memory *memory, bool stopped);
bool retained_stopped(const retained_memory *memory);

/* The memory itself. */
extern retained_memory retained;

#endif
