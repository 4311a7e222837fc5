/* Joins Betaflight's SITL to a simulator in lockstep. It is preloaded (LD_PRELOAD) into the
 * unmodified firmware, and takes the place of its clock and of its UDP links.
 *
 * Time: the main thread's clock goes on by TICK with each look at it, and by what it sleeps, up to
 * the end of a step. There it waits for the next step of the simulator. So what the firmware does
 * depends on what it is told alone, and not on how busy the computer is.
 *
 * Links: of the firmware's UDP ports, none is opened. One inherited socket, whose number is in
 * AIRRACE_LOCKSTEP_FD, carries a Step to the firmware, and the Motors of the step before back. The
 * firmware has two threads that read them. Each handing over to a thread and back would wait for
 * its turn on a busy computer, some times a step. So these two are no threads here: what they are
 * to do is done on the main thread, on a stack of its own, while the main thread waits for it in
 * any case. Its serial ports (TCP) are on loopback alone, at free ports; the first one's number, four
 * bytes, is told on the socket. When the other end is closed, the process ends.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dlfcn.h>
#include <poll.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <ucontext.h>
#include <unistd.h>

enum { TICK = 1000, STEP = 1000000, SECOND = 1000000000 };           /* ns */
enum { PATIENCE = 100000000 };                                       /* ns */
enum { READERS = 2, STACK = 256 * 1024 };
enum { MOTORS_PORT = 9001, STATE_PORT = 9003, RC_PORT = 9004, FIRST_UART = 5761 };

typedef struct {
    double stamp, values[17];  /* see state_packet() in firmware_process.py */
} State;
typedef struct {
    double stamp;
    uint16_t channels[16];
} Rc;
typedef struct {
    State state;
    uint16_t channels[16];
} Step;
typedef struct {
    uint16_t count;
    float outputs[16];
} Motors;
typedef struct {
    int fd;
    const void *packet;
    size_t size;
    ucontext_t reader;  /* where it goes on when there is a packet */
} Link;

/* Held by the main thread while it runs, and by the thread of the serial ports while it does
 * anything but wait: the firmware itself does not keep these two apart. */
static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;
static __thread int has_turn;
static Link rc_link = {.fd = -1}, state_link = {.fd = -1};
static ucontext_t main_thread;
static char stacks[READERS][STACK];
static int readers;              /* that have begun */
static int channel = -1;
static __thread int is_main;     /* and no reader on its thread */
static int64_t now, step_end;  /* ns */
static Motors motors;

static void *watch(void *unused)
{
    struct pollfd other_end = {.fd = channel};
    while (!(other_end.revents & (POLLHUP | POLLERR))) poll(&other_end, 1, -1);
    _exit(0);
    return unused;
}

__attribute__((constructor)) static void begin(void)
{
    const char *number = getenv("AIRRACE_LOCKSTEP_FD");
    pthread_t thread;
    if (!number) _exit(2);
    channel = atoi(number);
    is_main = 1;
    step_end = STEP;
    pthread_mutex_lock(&turn);
    pthread_create(&thread, NULL, watch, NULL);
}

/* Lets a reader go on until it waits for its next packet. */
static void run(ucontext_t *reader)
{
    is_main = 0;
    swapcontext(&main_thread, reader);
    is_main = 1;
}

static void deliver(Link *link, const void *packet, size_t size)
{
    link->packet = packet;
    link->size = size;
    run(&link->reader);
}

/* What makes threads: of the firmware's, those after its links are their readers. */
int pthread_create(
    pthread_t *thread, const pthread_attr_t *attributes, void *(*routine)(void *), void *argument)
{
    int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *) =
        dlsym(RTLD_NEXT, "pthread_create");
    if (rc_link.fd < 0 || state_link.fd < 0 || readers == READERS)
        return real(thread, attributes, routine, argument);
    ucontext_t reader;
    getcontext(&reader);
    reader.uc_stack.ss_sp = stacks[readers];
    reader.uc_stack.ss_size = STACK;
    reader.uc_link = &main_thread;
    makecontext(&reader, (void (*)(void))routine, 0); /* it needs no argument */
    run(&reader);
    *thread = (pthread_t)stacks[readers++];
    return 0;
}

int pthread_join(pthread_t thread, void **result)
{
    int (*real)(pthread_t, void **) = dlsym(RTLD_NEXT, "pthread_join");
    for (int i = 0; i < readers; i++)
        if (thread == (pthread_t)stacks[i]) return 0;
    return real(thread, result);
}

static void take_step(void)
{
    static Step step;
    static Rc rc;
    if (send(channel, &motors, sizeof motors, MSG_NOSIGNAL) < 0) _exit(0);
    pthread_mutex_unlock(&turn);
    if (recv(channel, &step, sizeof step, 0) != sizeof step) _exit(0);
    pthread_mutex_lock(&turn);
    memcpy(rc.channels, step.channels, sizeof rc.channels);
    if (rc.channels[0]) deliver(&rc_link, &rc, sizeof rc); /* the firmware's start undoes it */
    /* A stamp that is a second later each time keeps the firmware from estimating how fast the
     * simulator is, by which it would scale its clock. */
    step.state.stamp = (double)(step_end / STEP);
    __atomic_fetch_add(&step_end, STEP, __ATOMIC_SEQ_CST);
    deliver(&state_link, &step.state, sizeof step.state);
}

static void advance(int64_t duration)
{
    now += duration;
    while (now >= step_end && readers == READERS) take_step();
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    if (clock != CLOCK_MONOTONIC) return (int)syscall(SYS_clock_gettime, clock, time);
    int64_t t = is_main ? now : __atomic_load_n(&step_end, __ATOMIC_SEQ_CST) - STEP;
    time->tv_sec = t / SECOND;
    time->tv_nsec = t % SECOND;
    if (is_main) advance(TICK);
    return 0;
}

int nanosleep(const struct timespec *duration, struct timespec *left)
{
    if (!is_main) return (int)syscall(SYS_nanosleep, duration, left);
    advance(duration->tv_sec * (int64_t)SECOND + duration->tv_nsec);
    return 0;
}

int bind(int fd, const struct sockaddr *address, socklen_t length)
{
    int (*real_bind)(int, const struct sockaddr *, socklen_t) = dlsym(RTLD_NEXT, "bind");
    /* The port is at the same place in both families. */
    int port = ntohs(((const struct sockaddr_in *)address)->sin_port);
    if (port == RC_PORT || port == STATE_PORT) {
        (port == RC_PORT ? &rc_link : &state_link)->fd = fd;
        return 0;
    }
    struct sockaddr_in v4 = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct sockaddr_in6 v6 = {.sin6_family = AF_INET6, .sin6_addr = IN6ADDR_LOOPBACK_INIT};
    struct sockaddr *local = (struct sockaddr *)&v4;
    if (address->sa_family == AF_INET6) local = (struct sockaddr *)&v6;
    int result = real_bind(fd, local, length);
    if (result == 0 && port == FIRST_UART) {
        struct sockaddr_in6 bound;
        socklen_t size = sizeof bound;
        getsockname(fd, (struct sockaddr *)&bound, &size);
        uint32_t free_port = ntohs(bound.sin6_port);
        send(channel, &free_port, sizeof free_port, MSG_NOSIGNAL);
    }
    return result;
}

static Link *link_of(int fd)
{
    return fd == rc_link.fd ? &rc_link : fd == state_link.fd ? &state_link : NULL;
}

static struct timespec time_limit(void)
{
    struct timespec limit;
    clock_gettime(CLOCK_REALTIME, &limit);
    limit.tv_nsec += PATIENCE;
    limit.tv_sec += limit.tv_nsec / SECOND;
    limit.tv_nsec %= SECOND;
    return limit;
}

static int select_serial_ports(
    int n, fd_set *reads, fd_set *writes, fd_set *errors, struct timeval *timeout)
{
    int (*real)(int, fd_set *, fd_set *, fd_set *, struct timeval *) = dlsym(RTLD_NEXT, "select");
    if (has_turn) pthread_mutex_unlock(&turn);
    int ready = real(n, reads, writes, errors, timeout);
    struct timespec limit = time_limit(); /* for a main thread that waits for this one */
    has_turn = pthread_mutex_timedlock(&turn, &limit) == 0;
    return ready;
}

int select(int n, fd_set *reads, fd_set *writes, fd_set *errors, struct timeval *timeout)
{
    Link *link = n > 0 && !writes ? link_of(n - 1) : NULL;
    if (!link) return select_serial_ports(n, reads, writes, errors, timeout);
    swapcontext(&link->reader, &main_thread);
    return 1;
}

ssize_t recvfrom(
    int fd, void *data, size_t size, int flags, struct sockaddr *source, socklen_t *length)
{
    Link *link = link_of(fd);
    if (!link) return syscall(SYS_recvfrom, fd, data, size, flags, source, length);
    if (size > link->size) size = link->size;
    memcpy(data, link->packet, size);
    return (ssize_t)size;
}

ssize_t sendto(
    int fd, const void *data, size_t size, int flags, const struct sockaddr *to, socklen_t length)
{
    int port = to ? ntohs(((const struct sockaddr_in *)to)->sin_port) : 0;
    if (port == MOTORS_PORT && size == sizeof motors) memcpy(&motors, data, size);
    (void)fd, (void)flags, (void)length;
    return (ssize_t)size;
}
