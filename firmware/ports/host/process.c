/* terrapin-controller: the controller as a process that speaks SLCAN, like a board on USB.
 *
 *     terrapin-controller --pty [LINK]    make a pseudo-terminal, print its path, serve whoever opens it
 *     terrapin-controller DEVICE          serve a tty (its speed is left as stty set it)
 *     --flash FILE before either          keep parameters and node number in FILE (made when absent); without it a
 * reset forgets them
 *     --node N before either              have this node number, whatever FILE says (0)
 *     --link-key FILE before either       take commands and changes only from who has this key, too (link/seal.h)
 *
 * It has no sensors of its own and no bridge: it steps in test mode only, once a SENSORS_FAST. On a pseudo-terminal it
 * outlives its peers; it ends, with the outputs off, on SIGTERM, SIGINT or SIGHUP (status 0), when a tty's peer goes
 * away, or a pseudo-terminal's and nobody reads what is printed any more (status 0), or when the device fails (status
 * 1). What one read brought is answered by one write; both buffers are bounded.
 */
#define _GNU_SOURCE /* ppoll, posix_openpt, ptsname_r, cfmakeraw */

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "flash_file.h"
#include "link_key_file.h"
#include "parameters.h"
#include "process.h"
#include "service.h"
#include "terrapin_interface.h"

#define IN_SIZE 512
/* The shortest line with the longest answer decides: "F\r" gives 4 bytes, "t1008...\r" (22) two frames and "\r" (45),
 * "t0822....\r" (10) and "t085100\r" (8) one frame and "\r" (23). A line that an earlier read began adds one more
 * answer. */
#define OUT_SIZE (4 * IN_SIZE)
_Static_assert(OUT_SIZE >= (3 * IN_SIZE) + (TERRAPIN_MAX_FRAMES * TERRAPIN_SLCAN_TEXT_MAX) + TERRAPIN_SLCAN_REPLY_MAX,
               "answers to one read must fit");

typedef struct {
    int fd;
    terrapin_service service;
    terrapin_flash_file flash;
    bool flash_open;
    bool stop_kept; /* as it stands in there */
    terrapin_store store;
    terrapin_identity identity;
    uint8_t out[OUT_SIZE];
    size_t out_length;
} controller;

static volatile sig_atomic_t stop_signal;

static void on_signal(int number) {
    stop_signal = number;
}

/* Signals are open only while ppoll waits, so that none slips in between the check and the wait. */
static int catch_signals(sigset_t *while_waiting) {
    static const int numbers[] = {SIGTERM, SIGINT, SIGHUP};
    struct sigaction action = {.sa_handler = on_signal};
    sigset_t blocked;
    (void)sigemptyset(&blocked);
    (void)sigprocmask(SIG_SETMASK, NULL, while_waiting);
    for (size_t i = 0; i < (sizeof numbers / sizeof numbers[0]); i++) {
        if (sigaction(numbers[i], &action, NULL) != 0) {
            return -1;
        }
        (void)sigaddset(&blocked, numbers[i]);
        (void)sigdelset(while_waiting, numbers[i]);
    }
    (void)signal(SIGPIPE, SIG_IGN);
    return sigprocmask(SIG_BLOCK, &blocked, NULL);
}

static void fail(const char *what, const char *name) {
    (void)fprintf(stderr, "terrapin-controller: %s %s: %s\n", what, name, strerror(errno));
}

static int make_raw(int fd) {
    struct termios settings;
    if (tcgetattr(fd, &settings) != 0) {
        return -1;
    }
    cfmakeraw(&settings);
    settings.c_cflag |= CLOCAL | CREAD;
    return tcsetattr(fd, TCSANOW, &settings);
}

/* A raw pty; its slave's path is printed and, when link is not NULL, linked there. The master, or -1 (said why). */
static int open_pty(const char *link) {
    char path[128];
    const int master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if ((master < 0) || (grantpt(master) != 0) || (unlockpt(master) != 0) ||
        (ptsname_r(master, path, sizeof path) != 0) || (make_raw(master) != 0)) {
        fail("cannot make", "a pseudo-terminal");
        return -1;
    }
    if (link != NULL) {
        /* A link that an earlier run left behind is replaced; anything else under this name is the user's. */
        struct stat old;
        if ((lstat(link, &old) == 0) && S_ISLNK(old.st_mode)) {
            (void)unlink(link);
        }
        if (symlink(path, link) != 0) {
            fail("cannot link", link);
            return -1;
        }
    }
    if ((printf("%s\n", (link != NULL) ? link : path) < 0) || (fflush(stdout) != 0)) {
        fail("cannot print", path);
        return -1;
    }
    return master;
}

static int open_tty(const char *device) {
    const int fd = open(device, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if ((fd < 0) || (make_raw(fd) != 0)) {
        fail("cannot open", device);
        return -1;
    }
    return fd;
}

static void queue(controller *c, const uint8_t *bytes, size_t length) {
    if (length > (OUT_SIZE - c->out_length)) {
        (void)fprintf(stderr, "terrapin-controller: answer buffer overflow\n"); /* excluded by OUT_SIZE */
        abort();
    }
    memcpy(&c->out[c->out_length], bytes, length);
    c->out_length += length;
}

static void take_bytes(controller *c, const uint8_t *bytes, size_t length) {
    uint8_t answer[TERRAPIN_SERVICE_ANSWER_MAX];
    if (c->service.link.seal.key != NULL) { /* the clock is a call of the system */
        terrapin_seal_at(&c->service.link.seal, terrapin_process_ms());
    }
    for (size_t i = 0; i < length; i++) {
        queue(c, answer, terrapin_service_take(&c->service, bytes[i], answer));
    }
}

/* Wait until the device is ready for events. 1: ready, 0: the peer is gone or a signal came, -1: failed. */
static int wait_for(const controller *c, short events, const sigset_t *while_waiting) {
    struct pollfd device = {.fd = c->fd, .events = events};
    for (;;) {
        if (stop_signal != 0) {
            return 0;
        }
        if (ppoll(&device, 1, NULL, while_waiting) < 0) {
            if (errno != EINTR) {
                return -1;
            }
        } else if ((device.revents & events) != 0) {
            return 1;
        } else if ((device.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0) {
            return 0;
        }
    }
}

/* Answers of one read go out in one write, as far as the terminal takes them. Same results as wait_for. */
static int flush(controller *c, const sigset_t *while_waiting) {
    size_t done = 0;
    while (done < c->out_length) {
        const ssize_t n = write(c->fd, &c->out[done], c->out_length - done);
        if (n >= 0) {
            done += (size_t)n;
        } else if (errno == EIO) {
            return 0;
        } else if ((errno != EAGAIN) && (errno != EINTR)) {
            return -1;
        }
        if (done < c->out_length) {
            const int ready = wait_for(c, POLLOUT, while_waiting);
            if (ready != 1) {
                return ready;
            }
        }
    }
    c->out_length = 0;
    return 1;
}

/* Whatever the reason for leaving, nothing drives the bridge any more. */
static void outputs_off(controller *c) {
    c->service.outputs.enable = false;
    c->service.outputs.duty_q15 = 0;
}

/* Whether nobody reads any more what is printed: whoever started this process over a pipe has ended. */
static bool abandoned(void) {
    struct pollfd out = {.fd = STDOUT_FILENO};
    return (poll(&out, 1, 0) > 0) && ((out.revents & (POLLHUP | POLLERR)) != 0);
}

/* A pseudo-terminal outlives its peers. Wait for the next one (1), a signal, or an end without anybody (0). */
static int next_peer(controller *c, const sigset_t *while_waiting) {
    const struct timespec pause = {.tv_nsec = 20000000L}; /* nothing tells that somebody opens the other side */
    outputs_off(c);
    c->out_length = 0;
    terrapin_slcan_init(&c->service.parser); /* half a line of the last peer is no begin of a line of the next */
    while ((stop_signal == 0) && !abandoned()) {
        struct pollfd device = {.fd = c->fd, .events = POLLIN};
        if ((poll(&device, 1, 0) >= 0) && ((device.revents & POLLHUP) == 0)) {
            return 1;
        }
        (void)ppoll(NULL, 0, &pause, while_waiting);
    }
    return 0;
}

/* Until the peer goes away or a signal comes (0) or the device fails (-1). */
static int serve_peer(controller *c, const sigset_t *while_waiting) {
    uint8_t in[IN_SIZE];
    int going = wait_for(c, POLLIN, while_waiting);
    while (going == 1) {
        const ssize_t n = read(c->fd, in, sizeof in);
        if (n > 0) {
            take_bytes(c, in, (size_t)n);
            if (c->flash_open) {
                terrapin_process_keep_stop(&c->flash, c->service.state, &c->stop_kept);
            }
            going = flush(c, while_waiting);
        } else if ((n == 0) || (errno == EIO)) {
            going = 0;
        } else if ((errno != EAGAIN) && (errno != EINTR)) {
            going = -1;
        }
        if (going == 1) {
            going = wait_for(c, POLLIN, while_waiting);
        }
    }
    return going;
}

static int serve(controller *c, bool pty, const sigset_t *while_waiting) {
    int result = serve_peer(c, while_waiting);
    while ((result == 0) && pty && (stop_signal == 0) && (next_peer(c, while_waiting) == 1)) {
        result = serve_peer(c, while_waiting);
    }
    return result;
}

static int usage(int status) {
    (void)fprintf(
        (status == 0) ? stdout : stderr,
        "usage: terrapin-controller [OPTION]... --pty [LINK]   serve a new pseudo-terminal until stopped; its path is "
        "printed\n"
        "       terrapin-controller [OPTION]... DEVICE         serve a serial port (set its speed with stty)\n"
        "       --flash FILE   keep parameters, node number and a STOP_ALL in FILE over a reset\n"
        "       --node N       node number on its bus, 0 to 7, whatever FILE says (0)\n"
        "       --link-key FILE  take commands and changes only from who has this key, too\n"
        "The controller speaks SLCAN. Example: terrapin-controller --pty /tmp/terrapin\n");
    return status;
}

int terrapin_process_node(const char *text) {
    char *end = NULL;
    const long node = strtol(text, &end, 10);
    if ((end == text) || (*end != '\0') || (node < 0) || (node >= (long)TERRAPIN_NODES)) {
        (void)fprintf(stderr, "terrapin-controller: --node: found '%.20s', expected a number from 0 to %u\n", text,
                      TERRAPIN_NODES - 1U);
        return -1;
    }
    return (int)node;
}

/* Told from all other processes that may be on the bus at the same time, wherever they run; never 0. */
static uint32_t unique_number(void) {
    uint32_t number = 0U;
    if (getrandom(&number, sizeof number, GRND_NONBLOCK) != (ssize_t)sizeof number) {
        number = (uint32_t)getpid();
    }
    return number | 1U;
}

void terrapin_process_keep_stop(terrapin_flash_file *file, const terrapin_state *state, bool *kept) {
    const bool stopped = (terrapin_latched(state) & TERRAPIN_LINK_STOPPED) != 0U;
    if (stopped != *kept) {
        *kept = stopped;
        terrapin_flash_file_set_stopped(file, stopped);
    }
}

bool terrapin_process_take_stop(const terrapin_flash_file *file, terrapin_state *state) {
    const bool stopped = terrapin_flash_file_stopped(file);
    terrapin_latch(state, stopped ? TERRAPIN_LINK_STOPPED : 0U);
    return stopped;
}

void terrapin_process_identity(terrapin_identity *identity, int node, terrapin_flash_file *file) {
    uint8_t number = (node >= 0) ? (uint8_t)node : 0U;
    if ((node < 0) && (file != NULL)) {
        number = terrapin_flash_file_node(file);
    }
    terrapin_identity_init(identity, unique_number(), number);
    if (file != NULL) {
        identity->store = terrapin_flash_file_set_node;
        identity->context = file;
        identity->stored = terrapin_flash_file_node(file);
    }
}

bool terrapin_process_store(terrapin_flash_file *file, terrapin_store *store, const char *path) {
    const int error = terrapin_flash_file_open(file, path);
    if (error != 0) {
        (void)fprintf(stderr, "terrapin-controller: cannot use %s: %s\n", path,
                      (error == EINVAL)        ? "not a file of flash (49152 bytes)"
                      : (error == EWOULDBLOCK) ? "another controller uses it"
                                               : strerror(error));
        return false;
    }
    (void)terrapin_store_open(store, &file->flash, file->pages); /* the pages are large enough */
    return true;
}

/* The stored parameters, when a file was named. */
static bool use_flash(controller *c, const char *path) {
    if (path != NULL) {
        if (!terrapin_process_store(&c->flash, &c->store, path)) {
            return false;
        }
        terrapin_service_use_store(&c->service, &c->store);
        c->flash_open = true;
        c->stop_kept = terrapin_process_take_stop(&c->flash, c->service.state);
    }
    return true;
}

bool terrapin_process_option(const char *word) {
    return (strcmp(word, "--flash") == 0) || (strcmp(word, "--node") == 0) || (strcmp(word, "--link-key") == 0);
}

int terrapin_process(int argc, char **argv) {
    static controller c;
    sigset_t while_waiting;
    const char *flash = NULL;
    const char *link_key = NULL;
    int node = -1;
    while ((argc >= 3) && terrapin_process_option(argv[1])) {
        if (argv[1][2] == 'f') {
            flash = argv[2];
        } else if (argv[1][2] == 'l') {
            link_key = argv[2];
        } else {
            node = terrapin_process_node(argv[2]);
            if (node < 0) {
                return 2;
            }
        }
        argc -= 2;
        argv += 2;
    }
    const bool pty = (argc >= 2) && (strcmp(argv[1], "--pty") == 0);
    if ((argc == 2) && (strcmp(argv[1], "--help") == 0)) {
        return usage(0);
    }
    if ((argc < 2) || (argc > (pty ? 3 : 2)) || (!pty && (argv[1][0] == '-'))) {
        return usage(2);
    }
    const char *link = (pty && (argc == 3)) ? argv[2] : NULL;
    if (catch_signals(&while_waiting) != 0) {
        fail("cannot catch", "signals");
        return 1;
    }
    terrapin_state *state = calloc(1, terrapin_state_size());
    if (state != NULL) {
        terrapin_service_init(&c.service, state);
    }
    c.fd = -1;
    if ((state != NULL) && use_flash(&c, flash) &&
        ((link_key == NULL) || terrapin_process_seal(&c.service.link, link_key))) {
        terrapin_process_identity(&c.identity, node, (flash != NULL) ? &c.flash : NULL);
        terrapin_service_use_identity(&c.service, &c.identity);
        c.fd = pty ? open_pty(link) : open_tty(argv[1]);
    }
    if (c.fd < 0) {
        free(state);
        return 1;
    }

    const int result = serve(&c, pty, &while_waiting);
    if (result != 0) {
        fail("lost", pty ? "the pseudo-terminal" : argv[1]);
    }
    outputs_off(&c);
    (void)fprintf(stderr,
                  "terrapin-controller: %s after %lu ticks, outputs off; dropped: %lu bad CRC, %lu repeated, "
                  "%lu malformed frames, %lu malformed lines\n",
                  (stop_signal != 0) ? "stopped by a signal" : "peer gone", (unsigned long)c.service.ticks,
                  (unsigned long)c.service.link.bad_crc, (unsigned long)c.service.link.repeated,
                  (unsigned long)c.service.link.malformed, (unsigned long)c.service.parser.malformed);
    if (link != NULL) {
        (void)unlink(link);
    }
    (void)close(c.fd);
    if (flash != NULL) {
        terrapin_flash_file_close(&c.flash);
    }
    free(state);
    return (result == 0) ? 0 : 1;
}
