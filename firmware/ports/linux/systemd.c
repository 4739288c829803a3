#define _GNU_SOURCE

#include "systemd.h"

#include <errno.h>
#include <sched.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

void systemd_tell(const char *state) {
    const char *path = getenv("NOTIFY_SOCKET");
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if ((path == NULL) || (path[0] == '\0') || (strlen(path) >= sizeof address.sun_path)) {
        return;
    }
    (void)memcpy(address.sun_path, path, strlen(path));
    if (path[0] == '@') { /* an abstract name */
        address.sun_path[0] = '\0';
    }
    const int s = socket(AF_UNIX, (int)SOCK_DGRAM | (int)SOCK_CLOEXEC, 0);
    if (s >= 0) {
        const socklen_t length = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + strlen(path));
        (void)sendto(s, state, strlen(state), MSG_DONTWAIT | MSG_NOSIGNAL, (const struct sockaddr *)&address, length);
        (void)close(s);
    }
}

void real_time(int priority) {
    const struct sched_param parameters = {.sched_priority = priority};
    if ((priority > 0) && (sched_setscheduler(0, SCHED_FIFO, &parameters) != 0)) {
        (void)fprintf(stderr, "terrapin-controller: ordinary scheduling, SCHED_FIFO refused: %s\n", strerror(errno));
    }
    if ((priority > 0) && (mlockall(MCL_CURRENT | MCL_FUTURE) != 0)) {
        (void)fprintf(stderr, "terrapin-controller: memory not locked: %s\n", strerror(errno));
    }
}
