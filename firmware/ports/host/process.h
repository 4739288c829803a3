/* The controller as a process that speaks SLCAN on a pty or tty: its whole program, behind a main of its own (main.c)
 * or that of another port. */
#ifndef TERRAPIN_HOST_PROCESS_H
#define TERRAPIN_HOST_PROCESS_H

#include "dispatch.h"
#include "flash_file.h"
#include "node.h"
#include "parameters.h"

/* The command line as main gets it; the exit status. */
int terrapin_process(int argc, char **argv);

/* An option that a value follows. */
bool terrapin_process_option(const char *word);

/* --node: a number of a node; -1, and one line on stderr, when it is none. */
int terrapin_process_node(const char *text);

/* Who this process is: its own unique number, and the node number `node`, or, with -1, the one in the file (NULL: 0).
 */
void terrapin_process_identity(terrapin_identity *identity, int node, terrapin_flash_file *file);

/* --flash: open the file, and the store in it. False, and one line on stderr, when that cannot be. */
bool terrapin_process_store(terrapin_flash_file *file, terrapin_store *store, const char *path);

/* STOP_ALL held when the file was used last: it is latched again, and true. After each tick, and with what that said:
 * whether it holds goes into the file as it changes. */
bool terrapin_process_take_stop(const terrapin_flash_file *file, terrapin_state *state);
void terrapin_process_keep_stop(terrapin_flash_file *file, const terrapin_state *state, bool *kept);

#endif
