/* Words to systemd (sd_notify's protocol: datagrams to $NOTIFY_SOCKET). Nothing happens when it did not start us. */
#ifndef TERRAPIN_LINUX_SYSTEMD_H
#define TERRAPIN_LINUX_SYSTEMD_H

/* "READY=1", "WATCHDOG=1", "STOPPING=1". */
void systemd_tell(const char *state);

/* SCHED_FIFO with `priority` (0: not) and all memory locked; what is not allowed is said on stderr and done without. */
void real_time(int priority);

#endif
