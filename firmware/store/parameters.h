/* The parameters that survive a reset: two flash pages, each a row of whole sets, the newest of which counts.
 *
 *     static terrapin_store store;
 *     static const terrapin_flash_area pages[2] = {{0x4000, 16384}, {0x8000, 16384}};   of the F405; of any size
 *     terrapin_store_open(&store, &flash, pages);       once after reset: reads, never writes
 *     terrapin_parameter_set_all(state, store.value);   the values found, or the defaults
 *     terrapin_store_save(&store, state);               begins to keep the values that stand now
 *     each tick:  terrapin_store_work(&store, bridge_is_off);
 *
 * A port does not call these but terrapin_link_use_store and terrapin_link_store_work (link/dispatch.h), which do.
 *
 * A set is a head (magic, layout, number of entries, sequence number), an entry of hash and value for each parameter,
 * and a CRC-32 over all of it; its size is a multiple of 16. Sets are appended; when a page is full, the other one is
 * erased and takes the next set, so that the newest whole set is never touched. Power may fail in any write or erase:
 * the next start finds the whole old or the whole new set. 16 kB hold 23 sets of 82 parameters: an erase each 23 saves.
 *
 * A set names the robot that the firmware was built for, and its board. Another robot's or board's gives the defaults,
 * and the origin says so; the next save takes its place.
 *
 * The hash is of name, unit and scale, so a value outlives a change of order; an entry that this firmware does not know
 * (or knows in another unit) is dropped, a value out of range is replaced by the default, and both are counted. A set
 * of another layout is not read.
 *
 * Cost: terrapin_store_work erases one page, or writes 16 bytes (F405: at most 0.4 ms), or reads one set back. The
 * erase stalls an F405 for 0.25 to 0.5 s (DS8626), so it waits until the bridge is off. RAM: sizeof(terrapin_store).
 */
#ifndef TERRAPIN_STORE_PARAMETERS_H
#define TERRAPIN_STORE_PARAMETERS_H

#include "flash.h"
#include "terrapin_interface.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TERRAPIN_STORE_LAYOUT 1U
#define TERRAPIN_STORE_UNIT   16U /* sets begin at multiples of this, and are written in pieces of it */

/* What the save under way does next. */
typedef enum {
    TERRAPIN_STORE_IDLE = 0,
    TERRAPIN_STORE_ERASE = 1,
    TERRAPIN_STORE_WRITE = 2,
    TERRAPIN_STORE_VERIFY = 3
} terrapin_store_phase;

typedef struct terrapin_store {
    const terrapin_flash *flash; /* outlives the store */
    terrapin_flash_area page[2];
    uint32_t next[2];  /* offset in the page of the first byte that no set has used */
    uint32_t newest;   /* offset in flash of the newest whole set; known when origin is `stored` */
    uint32_t sequence; /* its number; 0 when there is none */
    uint8_t active;    /* its page */
    uint8_t origin;    /* store_origin of controller.toml: blank, stored, damaged */
    bool foreign;      /* the newest set is another robot's or board's: the values are the defaults */
    bool remains;      /* beside whole sets there is something else: a save or an erase that was cut */
    bool failed;       /* the last save did not succeed; what was stored before stands */
    uint16_t dropped;  /* entries that this firmware does not know */
    uint16_t replaced; /* values out of range, replaced by the default */
    uint16_t missing;  /* parameters that the set does not name: at their default */
    terrapin_store_phase phase;
    uint8_t target;                          /* page of the save under way */
    uint32_t written;                        /* bytes of it */
    uint32_t crc;                            /* of these */
    int32_t value[TERRAPIN_PARAMETER_COUNT]; /* as stored, or about to be; in range */
} terrapin_store;

/* Find the newest whole set. False when the pages cannot hold a set or overlap: every save will fail then. */
TERRAPIN_API bool terrapin_store_open(terrapin_store *store, const terrapin_flash *flash,
                                      const terrapin_flash_area pages[2]);

/* Begin to save the values of the state as they are now. False, and nothing is written, while a save is under way or
 * when the pages were refused. */
TERRAPIN_API bool terrapin_store_save(terrapin_store *store, const terrapin_state *state);

/* One bounded piece of the save under way; true while more is to be done. An erase waits until may_erase. */
TERRAPIN_API bool terrapin_store_work(terrapin_store *store, bool may_erase);

/* True when the state's values are not those of the newest stored set (or of the defaults, when there is none). */
TERRAPIN_API bool terrapin_store_differs(const terrapin_store *store, const terrapin_state *state);

#ifdef __cplusplus
}
#endif
#endif
