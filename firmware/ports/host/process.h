/* The controller as a process that speaks SLCAN on a pty or tty: its whole program, behind a main of its own (main.c)
 * or that of another port. */
#ifndef TERRAPIN_HOST_PROCESS_H
#define TERRAPIN_HOST_PROCESS_H

#include "flash_file.h"
#include "parameters.h"

/* The command line as main gets it; the exit status. */
int terrapin_process(int argc, char **argv);

/* --flash: open the file, and the store in it. False, and one line on stderr, when that cannot be. */
bool terrapin_process_store(terrapin_flash_file *file, terrapin_store *store, const char *path);

#endif
