/* The controller as a process that speaks SLCAN on a pty or tty: its whole program, behind a main of its own (main.c)
 * or that of another port. */
#ifndef TERRAPIN_HOST_PROCESS_H
#define TERRAPIN_HOST_PROCESS_H

/* The command line as main gets it; the exit status. */
int terrapin_process(int argc, char **argv);

#endif
