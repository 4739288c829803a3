/* The link key of a controller that is a process: the file that `terrapin keys link` makes. On a chip it stands beside
 * the boot loader (ports/stm32f405/link_key.h). */
#ifndef TERRAPIN_HOST_LINK_KEY_FILE_H
#define TERRAPIN_HOST_LINK_KEY_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "dispatch.h"

/* The key and its generation in the file. False, and one line on stderr, when there is none. */
bool terrapin_process_link_key(const char *path, uint32_t key[TERRAPIN_CHASKEY_WORDS], uint32_t *generation);

/* --link-key: seal the link with the key in the file, under a number of this start that was never before. The same
 * process seals one link. False, and one line on stderr, when that cannot be. */
bool terrapin_process_seal(terrapin_link *link, const char *path);

/* Now, for terrapin_seal_at: the time goes on while the machine sleeps. */
uint32_t terrapin_process_ms(void);

#endif
