/* Words to systemd, and the priority that the Linux controller asks for: the kernel's calls are stand-ins. */
#define _GNU_SOURCE

#include <errno.h>
#include <sched.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "unity.h"

static FILE *said;
static int fake_socket(int domain, int type, int protocol);
static ssize_t fake_sendto(int s, const void *bytes, size_t size, int flags, const struct sockaddr *to,
                           socklen_t length);
static int fake_close(int s);
static int fake_scheduler(pid_t who, int policy, const struct sched_param *parameters);
static int fake_lock(int flags);
#undef stderr
#define stderr             said
#define socket             fake_socket
#define sendto             fake_sendto
#define close              fake_close
#define sched_setscheduler fake_scheduler
#define mlockall           fake_lock
#include "../../firmware/ports/linux/systemd.c"
#undef socket
#undef sendto
#undef close

static int given, sockets, sends, closes;
static struct sockaddr_un address_sent;
static socklen_t length_sent;
static char state_sent[32];
static int priority_asked, locks;
static bool priority_refused, lock_refused;
static char *told_text;
static size_t told_size;

static int fake_socket(int domain, int type, int protocol) {
    TEST_ASSERT_EQUAL(AF_UNIX, domain);
    TEST_ASSERT_EQUAL_HEX((int)SOCK_DGRAM | (int)SOCK_CLOEXEC, type);
    TEST_ASSERT_EQUAL(0, protocol);
    sockets++;
    return given;
}
static ssize_t fake_sendto(int s, const void *bytes, size_t size, int flags, const struct sockaddr *to,
                           socklen_t length) {
    TEST_ASSERT_EQUAL(given, s);
    TEST_ASSERT_EQUAL_HEX_MESSAGE(MSG_DONTWAIT | MSG_NOSIGNAL, flags, "the loop waits for nobody");
    TEST_ASSERT_LESS_THAN(sizeof state_sent, size);
    TEST_ASSERT_LESS_OR_EQUAL(sizeof address_sent, length);
    (void)memcpy(state_sent, bytes, size);
    state_sent[size] = '\0';
    (void)memset(&address_sent, 0, sizeof address_sent);
    (void)memcpy(&address_sent, to, length);
    length_sent = length;
    sends++;
    return (ssize_t)size;
}
static int fake_close(int s) {
    TEST_ASSERT_EQUAL(given, s);
    closes++;
    return 0;
}
static int fake_scheduler(pid_t who, int policy, const struct sched_param *parameters) {
    TEST_ASSERT_EQUAL(0, who);
    TEST_ASSERT_EQUAL(SCHED_FIFO, policy);
    priority_asked = parameters->sched_priority;
    errno = EPERM;
    return priority_refused ? -1 : 0;
}
static int fake_lock(int flags) {
    TEST_ASSERT_EQUAL_HEX(MCL_CURRENT | MCL_FUTURE, flags);
    locks++;
    errno = ENOMEM;
    return lock_refused ? -1 : 0;
}

void setUp(void) {
    said = open_memstream(&told_text, &told_size);
    TEST_ASSERT_NOT_NULL(said);
    given = 0;
    sockets = sends = closes = 0;
    priority_asked = locks = 0;
    priority_refused = lock_refused = false;
    (void)unsetenv("NOTIFY_SOCKET");
}
void tearDown(void) {
    (void)fclose(said);
    free(told_text);
}

static void tell(const char *path, const char *state) {
    TEST_ASSERT_EQUAL(0, setenv("NOTIFY_SOCKET", path, 1));
    systemd_tell(state);
}

static void test_a_word_goes_to_the_socket_that_systemd_named(void) {
    const char *path = "/run/systemd/notify";
    tell(path, "READY=1");
    TEST_ASSERT_EQUAL_STRING("READY=1", state_sent);
    TEST_ASSERT_EQUAL(AF_UNIX, address_sent.sun_family);
    TEST_ASSERT_EQUAL_STRING(path, address_sent.sun_path);
    TEST_ASSERT_EQUAL(offsetof(struct sockaddr_un, sun_path) + strlen(path), length_sent);
    TEST_ASSERT_EQUAL(1, closes);
}

/* unix(7): the name begins with a zero, and has no end but the address's length. */
static void test_an_abstract_name_begins_with_a_zero(void) {
    tell("@terrapin", "WATCHDOG=1");
    TEST_ASSERT_EQUAL_STRING("WATCHDOG=1", state_sent);
    TEST_ASSERT_EQUAL_MEMORY("\0terrapin", address_sent.sun_path, 9);
    TEST_ASSERT_EQUAL(offsetof(struct sockaddr_un, sun_path) + 9U, length_sent);
}

static void test_without_systemd_nothing_is_asked(void) {
    char path[200];
    systemd_tell("READY=1");
    tell("", "READY=1");
    (void)memset(path, 'x', sizeof path);
    path[sizeof address_sent.sun_path] = '\0';
    tell(path, "READY=1"); /* would not fit */
    TEST_ASSERT_EQUAL(0, sockets);
    path[sizeof address_sent.sun_path - 1U] = '\0';
    tell(path, "READY=1"); /* the longest that does */
    TEST_ASSERT_EQUAL(1, sends);
    TEST_ASSERT_EQUAL_STRING(path, address_sent.sun_path);
    given = -1;
    tell("/run/x", "READY=1");
    TEST_ASSERT_EQUAL(2, sockets);
    TEST_ASSERT_EQUAL(1, sends);
    TEST_ASSERT_EQUAL(1, closes);
}

static void test_a_priority_is_asked_for_and_memory_locked(void) {
    real_time(0);
    TEST_ASSERT_EQUAL(0, priority_asked + locks);
    real_time(1);
    TEST_ASSERT_EQUAL(1, priority_asked);
    TEST_ASSERT_EQUAL(1, locks);
    (void)fflush(said);
    TEST_ASSERT_EQUAL_STRING("", told_text);
}

/* The controller runs all the same, and says what it does without. */
static void test_what_is_refused_is_told(void) {
    priority_refused = true;
    real_time(50);
    (void)fflush(said);
    TEST_ASSERT_EQUAL_STRING("terrapin-controller: ordinary scheduling, SCHED_FIFO refused: Operation not permitted\n",
                             told_text);
    TEST_ASSERT_EQUAL(1, locks);
    tearDown();
    setUp();
    lock_refused = true;
    real_time(50);
    (void)fflush(said);
    TEST_ASSERT_EQUAL_STRING("terrapin-controller: memory not locked: Cannot allocate memory\n", told_text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_word_goes_to_the_socket_that_systemd_named);
    RUN_TEST(test_an_abstract_name_begins_with_a_zero);
    RUN_TEST(test_without_systemd_nothing_is_asked);
    RUN_TEST(test_a_priority_is_asked_for_and_memory_locked);
    RUN_TEST(test_what_is_refused_is_told);
    return UNITY_END();
}
