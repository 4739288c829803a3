/* Files of the machine that runs the emulator, through Arm semihosting (Arm's "Semihosting for AArch32 and AArch64").
 * A call stops the emulated processor until the host has done it, so that a run is a function of what was read.
 */
#ifndef TERRAPIN_SEMIHOSTING_H
#define TERRAPIN_SEMIHOSTING_H

#include <stddef.h>
#include <stdint.h>

/* Open a file for reading or for writing, both binary; a handle, or -1. */
int32_t semihosting_open(const char *path, int writing);

/* Read up to length bytes, at least one unless the file has ended; the number read, 0 at the end or on failure. */
size_t semihosting_read(int32_t handle, uint8_t *bytes, size_t length);

/* Write all bytes; 0 when done, -1 when not. */
int semihosting_write(int32_t handle, const uint8_t *bytes, size_t length);

/* The command line (-semihosting-config arg=...), at most size - 1 bytes and a zero; 0, or -1 when there is none. */
int semihosting_command_line(char *text, size_t size);

/* End the emulator with this exit status. */
_Noreturn void semihosting_exit(int status);

#endif
