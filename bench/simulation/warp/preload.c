/* Preloaded into an agent: simulated time in place of the host's, for every clock that it reads and every call that waits
 * for a moment. docs/time.md describes the pace, `_pages.py` the bench's side of the two files shared with it.
 *
 * The bench alone sets the clock, so time never passes here by itself. A call that waits for a moment publishes a slot
 * (who, until when), then waits in the kernel without any limit. When the bench has set the clock to that moment it wakes
 * a thread of this library in each process concerned, the keeper, which ends the waits that are due. Nothing polls, but
 * for the few calls that the kernel offers no way to end from outside (`POLLED`).
 *
 * For 64-bit Linux with glibc 2.34 or newer. Without its two files the library does nothing. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/futex.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timeb.h>
#include <sys/timerfd.h>
#include <threads.h>
#include <time.h>
#include <unistd.h>

#if !defined(__LP64__) || !defined(__GLIBC__)
#error "the warp library is for 64-bit Linux with glibc"
#endif

#define NS_PER_S 1000000000LL
#define NEVER_NS (INT64_MAX / 4)  /* far beyond any session, and safe to add to */

/* ---- The two files. `_pages.py` has the same layout; change both, and the version with them. */

#define MAGIC 0x5041575241424552ULL /* "REBARWAP" */
#define VERSION 1
#define MAX_PROCESSES 256
#define MAX_SLOTS 4096

struct clock_page { /* written by the bench alone */
  uint64_t magic, version;
  _Atomic int64_t now_ns;         /* what CLOCK_MONOTONIC says */
  int64_t wall_offset_ns;         /* CLOCK_REALTIME less CLOCK_MONOTONIC */
  _Atomic int64_t released_ns;    /* the session is over: from this moment of the host's clock on, time passes by itself */
};

struct process { /* one process with this library; free while `pid` is 0 */
  _Atomic int32_t pid;
  _Atomic uint32_t wake;          /* the bench counts this up and wakes who waits for it: the keeper */
};

struct slot { /* one wait; free while `state` is FREE */
  _Atomic int64_t deadline_ns;
  _Atomic int32_t pid, tid;
  _Atomic uint32_t state;
  uint32_t kind;
};

struct waiters_page {
  uint64_t magic, version;
  _Atomic uint32_t slots_used;    /* slots above this were never used */
  _Atomic uint32_t overflowed;    /* a wait or a process found no place here: time must not go on */
  struct process processes[MAX_PROCESSES];
  struct slot slots[MAX_SLOTS];
};

enum state { FREE, CLAIMED, WAITING, FIRING, FIRED };
enum kind {
  BY_SIGNAL = 1,  /* a thread in ppoll, pselect or epoll_pwait */
  BY_FUTEX,       /* a thread on a futex */
  BY_BROADCAST,   /* a thread on a condition variable */
  POLLED,         /* looks at the clock itself, every POLL_NS of the host's time */
  TIMER           /* nobody waits: an armed timer */
};

static const struct clock_page *clock_page;
static struct waiters_page *waiters;
static struct process *_Atomic self_entry;
static int32_t self_pid;
/* What the keeper needs to end the wait in a slot; meaningful in this process alone. */
static struct { void *target; int private_flag; } handles[MAX_SLOTS];

static _Atomic int keeper_started;
/* Ends a wait in ppoll and the like. Any number that programs hardly use; glibc takes 32 and 33 for itself. */
#define WAKE_SIGNAL (SIGRTMAX - 5)
static __thread volatile sig_atomic_t woken_by_us __attribute__((tls_model("initial-exec")));

#define RETRY_NS 200000   /* until a wake-up is repeated that came before its thread was asleep; chosen */
#define GRAIN_NS 1000000  /* the bench stops at no finer moments, see `_pace.py` */
#define SPIN_LOOKS 1000   /* after so many looks at one moment a program only waits for the next; chosen */
#define POLL_NS 1000000   /* a third of it cost MAVSDK 1.01 CPU s in 45 simulated seconds, this 0.74: no other difference */

/* The next library's function of this name: glibc's. dlsym gives the newest version. */
#define REAL(name) ({ \
  static __typeof__(&name) real_; \
  real_ = real_ ? real_ : (__typeof__(&name))dlsym(RTLD_NEXT, #name); \
  real_; })

/* ---- Time */

static struct timespec to_timespec(int64_t ns) {
  if (ns < 0) ns = 0;
  return (struct timespec){ns / NS_PER_S, ns % NS_PER_S};
}

static int64_t to_ns(const struct timespec *t) {
  if (t->tv_sec < 0) return 0;
  return t->tv_sec >= NEVER_NS / NS_PER_S ? NEVER_NS : t->tv_sec * NS_PER_S + t->tv_nsec;
}

static int64_t timeval_ns(const struct timeval *t) {
  return to_ns(&(struct timespec){t->tv_sec, t->tv_usec * 1000});
}

static struct timeval to_timeval(int64_t ns) {
  struct timespec t = to_timespec(ns);
  return (struct timeval){t.tv_sec, t.tv_nsec / 1000};
}

static int is_valid(const struct timespec *t) { return t->tv_sec >= 0 && t->tv_nsec >= 0 && t->tv_nsec < NS_PER_S; }

static int64_t host_ns(void) {
  struct timespec t;
  REAL(clock_gettime)(CLOCK_MONOTONIC, &t);
  return t.tv_sec * NS_PER_S + t.tv_nsec;
}

static int64_t now_ns(void) {
  int64_t now = atomic_load(&clock_page->now_ns), released = atomic_load(&clock_page->released_ns);
  return released ? now + host_ns() - released : now;
}

static int64_t after(int64_t span_ns) { return span_ns >= NEVER_NS ? NEVER_NS : now_ns() + span_ns; }

static int is_wall(clockid_t clock) {
  return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI || clock == CLOCK_REALTIME_ALARM;
}

/* Clocks of CPU time stay the host's. */
static int is_simulated(clockid_t clock) {
  return is_wall(clock) || clock == CLOCK_MONOTONIC || clock == CLOCK_MONOTONIC_COARSE ||
         clock == CLOCK_MONOTONIC_RAW || clock == CLOCK_BOOTTIME || clock == CLOCK_BOOTTIME_ALARM;
}

static int64_t deadline_of(clockid_t clock, const struct timespec *moment) {
  int64_t ns = to_ns(moment);
  if (ns >= NEVER_NS) return NEVER_NS;
  if (is_wall(clock)) ns -= clock_page->wall_offset_ns;
  return ns > 0 ? ns : 1; /* 0 stands for no deadline */
}

static int64_t timer_deadline(clockid_t clock, const struct timespec *value, int absolute) {
  return absolute ? deadline_of(clock, value) : after(to_ns(value));
}

/* ---- Starting */

static void fatal(const char *text) {
  ssize_t written = write(2, text, strlen(text));
  (void)written;
  abort();
}

static void on_wake_signal(int number) { (void)number; woken_by_us = 1; }

static void *map_file(const char *variable, int writable, size_t size) {
  const char *path = getenv(variable);
  if (!path) return NULL;
  int fd = open(path, (writable ? O_RDWR : O_RDONLY) | O_CLOEXEC);
  if (fd < 0) return NULL;
  void *page = mmap(NULL, size, writable ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED, fd, 0);
  REAL(close)(fd);
  const uint64_t *head = page;
  return page != MAP_FAILED && head[0] == MAGIC && head[1] == VERSION ? page : NULL;
}

/* Enter this process into the page. What stood there under its number was of an earlier program or process. */
static void enter(void) {
  self_pid = (int32_t)REAL(syscall)(SYS_getpid);
  for (uint32_t i = 0; i < atomic_load(&waiters->slots_used); i++)
    if (atomic_load(&waiters->slots[i].pid) == self_pid) {
      atomic_store(&waiters->slots[i].deadline_ns, 0);
      atomic_store(&waiters->slots[i].pid, 0);
      atomic_store(&waiters->slots[i].state, FREE);
    }
  struct process *entry = NULL;
  for (int i = 0; i < MAX_PROCESSES && !entry; i++)
    if (atomic_load(&waiters->processes[i].pid) == self_pid) entry = &waiters->processes[i];
  for (int i = 0; i < MAX_PROCESSES && !entry; i++) {
    int32_t nobody = 0;
    if (atomic_compare_exchange_strong(&waiters->processes[i].pid, &nobody, self_pid)) entry = &waiters->processes[i];
  }
  if (!entry) {
    atomic_store(&waiters->overflowed, 1);
    fatal("rebar warp: more processes at once than the session's page holds\n");
  }
  atomic_store(&self_entry, entry);
}

static void forget_timers(void);

static void after_fork_in_child(void) {
  atomic_store(&keeper_started, 0); /* threads stay with the parent */
  forget_timers();
  enter();
}

__attribute__((constructor)) static void start(void) {
  static _Atomic int started;
  if (atomic_exchange(&started, 1)) return;
  waiters = map_file("REBAR_WARP_WAITERS", 1, sizeof *waiters);
  const struct clock_page *page = map_file("REBAR_WARP_CLOCK", 0, sizeof *page);
  if (!waiters || !page) return;
  enter();
  /* SA_RESTART: a signal that comes late must not end another call of the program's. */
  struct sigaction action = {.sa_handler = on_wake_signal, .sa_flags = SA_RESTART | SA_ONSTACK};
  sigaction(WAKE_SIGNAL, &action, NULL);
  pthread_atfork(NULL, NULL, after_fork_in_child);
  clock_page = page; /* last: from here on the calls below are simulated */
}

static int active(void) {
  /* A constructor of another library may come before ours. */
  if (__builtin_expect(!clock_page, 0)) start();
  return clock_page != NULL;
}

/* ---- Slots and the keeper */

static long futex(void *word, int operation, uint32_t value, const struct timespec *limit, uint32_t bits) {
  return REAL(syscall)(SYS_futex, word, operation, value, limit, NULL, bits);
}

static void end_wait(int i) {
  struct slot *slot = &waiters->slots[i];
  switch (slot->kind) {
    case BY_SIGNAL: REAL(syscall)(SYS_tgkill, self_pid, atomic_load(&slot->tid), WAKE_SIGNAL); break;
    /* Wakes others on the same word too: a futex may always wake without a reason, and so may a condition variable. */
    case BY_FUTEX: futex(handles[i].target, FUTEX_WAKE | handles[i].private_flag, INT_MAX, NULL, 0); break;
    case BY_BROADCAST: pthread_cond_broadcast(handles[i].target); break;
  }
}

static void expire_timers(int64_t now);

/* End what is due in this process; whether some thread has still to take note. */
static int end_due_waits(int64_t now) {
  int unheard = 0;
  for (uint32_t i = 0; i < atomic_load(&waiters->slots_used); i++) {
    struct slot *slot = &waiters->slots[i];
    int64_t deadline = atomic_load(&slot->deadline_ns);
    if (!deadline || deadline > now || atomic_load(&slot->pid) != self_pid || slot->kind > BY_BROADCAST) continue;
    /* FIRED: it was woken before it slept. In FIRING its thread stays in `release`, so what it waits on exists. */
    uint32_t state = WAITING;
    if (!atomic_compare_exchange_strong(&slot->state, &state, FIRING))
      if (state != FIRED || !atomic_compare_exchange_strong(&slot->state, &state, FIRING)) continue;
    end_wait((int)i);
    atomic_store(&slot->state, FIRED);
    unheard = 1;
  }
  expire_timers(now);
  return unheard;
}

static int64_t next_deadline(void) {
  int64_t next = NEVER_NS;
  for (uint32_t i = 0; i < atomic_load(&waiters->slots_used); i++) {
    int64_t deadline = atomic_load(&waiters->slots[i].deadline_ns);
    if (deadline && deadline < next && atomic_load(&waiters->slots[i].pid) == self_pid) next = deadline;
  }
  return next;
}

static void *keep(void *unused) {
  prctl(PR_SET_NAME, "rebar-warp");
  for (;;) {
    struct process *entry = atomic_load(&self_entry);
    uint32_t ticket = atomic_load(&entry->wake);
    struct timespec limit = {0, RETRY_NS}, *pause = NULL;
    if (end_due_waits(now_ns())) {
      pause = &limit;
    } else if (atomic_load(&clock_page->released_ns)) {
      int64_t span = next_deadline() - now_ns();
      limit = to_timespec(span < RETRY_NS ? RETRY_NS : span > POLL_NS ? POLL_NS : span);
      pause = &limit;
    }
    /* Shared between processes, hence without FUTEX_PRIVATE_FLAG. */
    futex(&entry->wake, FUTEX_WAIT, ticket, pause, 0);
  }
  return unused;
}

static void start_keeper(void) {
  int no = 0;
  if (atomic_load(&keeper_started) || !atomic_compare_exchange_strong(&keeper_started, &no, 1)) return;
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED);
  pthread_attr_setstacksize(&attributes, 256 * 1024);
  /* No signal of the program's is for this thread. */
  sigset_t all, previous;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &previous);
  pthread_t thread;
  if (pthread_create(&thread, &attributes, keep, NULL)) fatal("rebar warp: no thread can be started for the clock\n");
  pthread_sigmask(SIG_SETMASK, &previous, NULL);
  pthread_attr_destroy(&attributes);
}

static int claim(int64_t deadline_ns, enum kind kind, void *target, int private_flag) {
  for (int i = 0; i < MAX_SLOTS; i++) {
    struct slot *slot = &waiters->slots[i];
    uint32_t state = FREE;
    if (!atomic_compare_exchange_strong(&slot->state, &state, CLAIMED)) continue;
    handles[i].target = target;
    handles[i].private_flag = private_flag;
    slot->kind = kind;
    atomic_store(&slot->pid, self_pid);
    atomic_store(&slot->tid, (int32_t)REAL(syscall)(SYS_gettid));
    uint32_t used = atomic_load(&waiters->slots_used);
    while (used <= (uint32_t)i && !atomic_compare_exchange_weak(&waiters->slots_used, &used, (uint32_t)i + 1)) {}
    atomic_store(&slot->deadline_ns, deadline_ns);
    atomic_store(&slot->state, WAITING);
    start_keeper();
    return i;
  }
  atomic_store(&waiters->overflowed, 1);
  fatal("rebar warp: more waits at once than the session's page holds\n");
  return -1;
}

static void free_slot(struct slot *slot) {
  atomic_store(&slot->deadline_ns, 0);
  atomic_store(&slot->pid, 0);
  atomic_store(&slot->state, FREE);
}

/* The wait in a slot is over. `errno` stays. */
static void release(int i) {
  int error = errno;
  struct slot *slot = &waiters->slots[i];
  uint32_t state = WAITING;
  while (!atomic_compare_exchange_strong(&slot->state, &state, CLAIMED)) {
    if (state == FIRING) { sched_yield(); state = WAITING; }
  }
  /* A signal that was sent is pending by now: it is taken at the end of any system call, and disturbs no later one. */
  if (state == FIRED && slot->kind == BY_SIGNAL) REAL(syscall)(SYS_getppid);
  free_slot(slot);
  errno = error;
}

static int poll_until(struct pollfd *fds, nfds_t count, int64_t deadline, const sigset_t *mask);

/* A look at the clock, or at a descriptor where nothing had come. A program that looks again and again waits for time to
 * pass, which it cannot while anybody is at work: so it sleeps a little at every SPIN_LOOKS-th look. `errno` stays. */
static void look(void) {
  static __thread int64_t moment_ns __attribute__((tls_model("initial-exec")));
  static __thread uint32_t looks __attribute__((tls_model("initial-exec")));
  int64_t now = atomic_load_explicit(&clock_page->now_ns, memory_order_relaxed);
  if (now != moment_ns) {
    moment_ns = now;
    looks = 0;
  }
  if (++looks < SPIN_LOOKS) return;
  looks = 0;
  int error = errno;
  poll_until(NULL, 0, now + GRAIN_NS, NULL);
  errno = error;
}

/* The answer of a call that did not wait; one that found nothing is a look. */
static int looked(int answer) {
  if (!answer && clock_page) look();
  return answer;
}

/* ---- Reading clocks */

int clock_gettime(clockid_t clock, struct timespec *t) {
  if (!active() || !is_simulated(clock)) return REAL(clock_gettime)(clock, t);
  look();
  *t = to_timespec(now_ns() + (is_wall(clock) ? clock_page->wall_offset_ns : 0));
  return 0;
}

static int64_t wall_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_REALTIME, &t);
  return t.tv_sec * NS_PER_S + t.tv_nsec;
}

int gettimeofday(struct timeval *restrict t, void *restrict zone) {
  (void)zone;
  *t = to_timeval(wall_ns());
  return 0;
}

time_t time(time_t *out) {
  time_t seconds = wall_ns() / NS_PER_S;
  if (out) *out = seconds;
  return seconds;
}

int timespec_get(struct timespec *t, int base) {
  if (base != TIME_UTC) return 0;
  clock_gettime(CLOCK_REALTIME, t);
  return base;
}

int ftime(struct timeb *t) {
  int64_t ns = wall_ns();
  *t = (struct timeb){.time = ns / NS_PER_S, .millitm = ns % NS_PER_S / 1000000};
  return 0;
}

/* ---- Waiting for descriptors, and sleeping */

/* What the kernel is to block during a wait: the program's choice, but never our own signal. */
static sigset_t mask_of_wait(const sigset_t *mask) {
  sigset_t set;
  if (mask) set = *mask;
  else pthread_sigmask(SIG_BLOCK, NULL, &set);
  sigdelset(&set, WAKE_SIGNAL);
  return set;
}

#define MASK_BYTES (_NSIG / 8)

/* Run CALL, which waits without a limit, until it answers. After it the deadline may have come. A signal of the program's
 * ends it with EINTR, ours begins the loop anew. */
#define ANSWER_BEFORE(deadline, CALL) ({ \
  long answer_ = 0; int again_ = 1; \
  while (again_ && (deadline) > now_ns()) { \
    int slot_ = claim((deadline), BY_SIGNAL, NULL, 0); \
    woken_by_us = 0; \
    answer_ = (CALL); \
    release(slot_); \
    again_ = answer_ < 0 && errno == EINTR && woken_by_us; \
  } \
  again_ ? LONG_MIN : answer_; })

static int poll_until(struct pollfd *fds, nfds_t count, int64_t deadline, const sigset_t *mask) {
  sigset_t set = mask_of_wait(mask);
  long answer = ANSWER_BEFORE(deadline, REAL(syscall)(SYS_ppoll, fds, count, NULL, &set, MASK_BYTES));
  if (answer != LONG_MIN) return (int)answer;
  struct timespec none = {0, 0};
  return (int)REAL(syscall)(SYS_ppoll, fds, count, &none, mask, MASK_BYTES);
}

int ppoll(struct pollfd *fds, nfds_t count, const struct timespec *limit, const sigset_t *mask) {
  if (!active() || !limit || !is_valid(limit) || !to_ns(limit))
    return looked(REAL(ppoll)(fds, count, limit, mask));
  return poll_until(fds, count, after(to_ns(limit)), mask);
}

int poll(struct pollfd *fds, nfds_t count, int limit_ms) {
  if (!active() || limit_ms <= 0) return looked(REAL(poll)(fds, count, limit_ms));
  return poll_until(fds, count, after(limit_ms * 1000000LL), NULL);
}

/* What programs call that were compiled with _FORTIFY_SOURCE. */
int __poll_chk(struct pollfd *fds, nfds_t count, int limit_ms, size_t size);
int __poll_chk(struct pollfd *fds, nfds_t count, int limit_ms, size_t size) {
  if (size / sizeof *fds < count) fatal("rebar warp: poll with more descriptors than its array holds\n");
  return poll(fds, count, limit_ms);
}

int __ppoll_chk(struct pollfd *fds, nfds_t count, const struct timespec *limit, const sigset_t *mask, size_t size);
int __ppoll_chk(struct pollfd *fds, nfds_t count, const struct timespec *limit, const sigset_t *mask, size_t size) {
  if (size / sizeof *fds < count) fatal("rebar warp: ppoll with more descriptors than its array holds\n");
  return ppoll(fds, count, limit, mask);
}

static int select_until(int count, fd_set *r, fd_set *w, fd_set *x, int64_t deadline, const sigset_t *mask) {
  sigset_t set = mask_of_wait(mask);
  struct { const sigset_t *set; size_t bytes; } packed = {&set, MASK_BYTES};
  /* The kernel leaves the sets alone when a signal ends the call, so it can be repeated with them. */
  long answer = ANSWER_BEFORE(deadline, REAL(syscall)(SYS_pselect6, count, r, w, x, NULL, &packed));
  if (answer != LONG_MIN) return (int)answer;
  struct timespec none = {0, 0};
  packed.set = mask;
  return (int)REAL(syscall)(SYS_pselect6, count, r, w, x, &none, &packed);
}

int pselect(int count, fd_set *r, fd_set *w, fd_set *x, const struct timespec *limit, const sigset_t *mask) {
  if (!active() || !limit || !is_valid(limit) || !to_ns(limit))
    return looked(REAL(pselect)(count, r, w, x, limit, mask));
  return select_until(count, r, w, x, after(to_ns(limit)), mask);
}

int select(int count, fd_set *r, fd_set *w, fd_set *x, struct timeval *limit) {
  if (!active() || !limit || limit->tv_sec < 0 || !timeval_ns(limit))
    return looked(REAL(select)(count, r, w, x, limit));
  int64_t deadline = after(timeval_ns(limit));
  int answer = select_until(count, r, w, x, deadline, NULL);
  *limit = to_timeval(deadline - now_ns()); /* Linux leaves there what is left */
  return answer;
}

static int epoll_until(int fd, struct epoll_event *events, int count, int64_t deadline, const sigset_t *mask) {
  sigset_t set = mask_of_wait(mask);
  long answer = ANSWER_BEFORE(deadline, REAL(syscall)(SYS_epoll_pwait, fd, events, count, -1, &set, MASK_BYTES));
  if (answer != LONG_MIN) return (int)answer;
  return (int)REAL(syscall)(SYS_epoll_pwait, fd, events, count, 0, mask, MASK_BYTES);
}

int epoll_pwait(int fd, struct epoll_event *events, int count, int limit_ms, const sigset_t *mask) {
  if (!active() || limit_ms <= 0) return looked(REAL(epoll_pwait)(fd, events, count, limit_ms, mask));
  return epoll_until(fd, events, count, after(limit_ms * 1000000LL), mask);
}

int epoll_wait(int fd, struct epoll_event *events, int count, int limit_ms) {
  if (!active() || limit_ms <= 0) return looked(REAL(epoll_wait)(fd, events, count, limit_ms));
  return epoll_until(fd, events, count, after(limit_ms * 1000000LL), NULL);
}

int epoll_pwait2(int fd, struct epoll_event *events, int count, const struct timespec *limit, const sigset_t *mask);
int epoll_pwait2(int fd, struct epoll_event *events, int count, const struct timespec *limit, const sigset_t *mask) {
  if (active() && limit && is_valid(limit) && to_ns(limit))
    return epoll_until(fd, events, count, after(to_ns(limit)), mask);
  return (int)REAL(syscall)(SYS_epoll_pwait2, fd, events, count, limit, mask, MASK_BYTES);
}

/* 0, or EINTR with what is left. By ppoll, because a sleep ends with any signal and a futex with few. */
static int sleep_until(int64_t deadline, int64_t *left_ns) {
  if (deadline <= now_ns()) look();
  int answer = poll_until(NULL, 0, deadline, NULL);
  *left_ns = answer < 0 && deadline > now_ns() ? deadline - now_ns() : 0;
  return answer < 0 ? errno : 0;
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *span, struct timespec *left) {
  if (!active() || !is_simulated(clock)) return REAL(clock_nanosleep)(clock, flags, span, left);
  if (!is_valid(span)) return EINVAL;
  int absolute = flags & TIMER_ABSTIME, saved = errno;
  int64_t left_ns;
  int error = sleep_until(timer_deadline(clock, span, absolute), &left_ns);
  if (error == EINTR && left && !absolute) *left = to_timespec(left_ns);
  errno = saved; /* this call tells its error by its answer */
  return error;
}

int nanosleep(const struct timespec *span, struct timespec *left) {
  if (!active()) return REAL(nanosleep)(span, left);
  int error = clock_nanosleep(CLOCK_MONOTONIC, 0, span, left);
  if (error) errno = error;
  return error ? -1 : 0;
}

int usleep(useconds_t span_us) {
  struct timespec span = to_timespec(span_us * 1000LL);
  return nanosleep(&span, NULL);
}

unsigned sleep(unsigned span_s) {
  struct timespec span = {span_s, 0}, left = {0, 0};
  return nanosleep(&span, &left) ? (unsigned)(left.tv_sec + (left.tv_nsec > 0)) : 0;
}

int thrd_sleep(const struct timespec *span, struct timespec *left) {
  if (!nanosleep(span, left)) return 0;
  return errno == EINTR ? -1 : -2;
}

/* ---- Waiting for threads */

static void release_cancelled(void *slot) { release(*(int *)slot); }

int pthread_cond_clockwait(pthread_cond_t *c, pthread_mutex_t *m, clockid_t clock, const struct timespec *moment) {
  if (!active() || !is_simulated(clock)) return REAL(pthread_cond_clockwait)(c, m, clock, moment);
  if (!is_valid(moment)) return EINVAL;
  int64_t deadline = deadline_of(clock, moment);
  if (deadline <= now_ns()) { /* others still get the mutex for a moment, as POSIX says */
    pthread_mutex_unlock(m);
    pthread_mutex_lock(m);
    return ETIMEDOUT;
  }
  int slot = claim(deadline, BY_BROADCAST, c, 0), error;
  pthread_cleanup_push(release_cancelled, &slot);
  error = pthread_cond_wait(c, m);
  pthread_cleanup_pop(1);
  return error ? error : deadline <= now_ns() ? ETIMEDOUT : 0;
}

int pthread_cond_timedwait(pthread_cond_t *c, pthread_mutex_t *m, const struct timespec *moment) {
  if (!active()) return REAL(pthread_cond_timedwait)(c, m, moment);
  /* pthread_condattr_setclock leaves its choice in this bit since glibc 2.25 (nptl/pthread_cond_common.c). */
  return pthread_cond_clockwait(c, m, c->__data.__wrefs & 2 ? CLOCK_MONOTONIC : CLOCK_REALTIME, moment);
}

int cnd_timedwait(cnd_t *c, mtx_t *m, const struct timespec *moment) {
  int error = pthread_cond_timedwait((pthread_cond_t *)c, (pthread_mutex_t *)m, moment);
  return !error ? thrd_success : error == ETIMEDOUT ? thrd_timedout : thrd_error;
}

/* glibc's semaphore of 64 bits (nptl/sem_waitcommon.c): the value in the low word, the number of waiters in the high one,
 * and after it 0 for one process alone or FUTEX_PRIVATE_FLAG for several. So it is since glibc 2.21. */
struct glibc_semaphore { _Atomic uint64_t data; int shared; };

static int semaphore_until(sem_t *semaphore, int64_t deadline) {
  struct glibc_semaphore *inner = (struct glibc_semaphore *)semaphore;
  int private_flag = FUTEX_PRIVATE_FLAG ^ inner->shared;
  while (sem_trywait(semaphore)) {
    if (errno != EAGAIN) return -1;
    if (deadline <= now_ns()) {
      errno = ETIMEDOUT;
      return -1;
    }
    atomic_fetch_add(&inner->data, 1ULL << 32);
    int slot = claim(deadline, BY_FUTEX, &inner->data, private_flag);
    long answer = futex(&inner->data, FUTEX_WAIT | private_flag, 0, NULL, 0);
    release(slot);
    atomic_fetch_sub(&inner->data, 1ULL << 32);
    if (answer && errno == EINTR) return -1;
  }
  return 0;
}

int sem_clockwait(sem_t *semaphore, clockid_t clock, const struct timespec *moment) {
  if (!active() || !is_simulated(clock)) return REAL(sem_clockwait)(semaphore, clock, moment);
  if (!is_valid(moment)) {
    errno = EINVAL;
    return -1;
  }
  return semaphore_until(semaphore, deadline_of(clock, moment));
}

int sem_timedwait(sem_t *semaphore, const struct timespec *moment) {
  if (!active()) return REAL(sem_timedwait)(semaphore, moment);
  return sem_clockwait(semaphore, CLOCK_REALTIME, moment);
}

/* Run CALL with `limit`, a moment of the host's clock soon to come, until it answers something else than that it was late
 * or the deadline has come. For calls that nothing ends from outside. */
#define POLL_UNTIL(deadline, LATE, CALL) ({ \
  int slot_ = claim((deadline), POLLED, NULL, 0); \
  int answer_; \
  for (;;) { \
    int due_ = (deadline) <= now_ns(); \
    struct timespec limit __attribute__((unused)) = to_timespec(host_ns() + (due_ ? 0 : POLL_NS)); \
    answer_ = (CALL); \
    if (!(LATE) || due_) break; \
  } \
  release(slot_); \
  answer_; })

#define TIMED_LOCK(name, without_clock, object, plain) \
  int name(object *o, clockid_t clock, const struct timespec *moment) { \
    if (!active() || !is_simulated(clock)) return REAL(name)(o, clock, moment); \
    if (!is_valid(moment)) return EINVAL; \
    int first = plain(o); \
    if (first != EBUSY) return first; \
    int64_t deadline = deadline_of(clock, moment); \
    return POLL_UNTIL(deadline, answer_ == ETIMEDOUT, REAL(name)(o, CLOCK_MONOTONIC, &limit)); \
  } \
  int without_clock(object *o, const struct timespec *moment) { \
    return active() ? name(o, CLOCK_REALTIME, moment) : REAL(without_clock)(o, moment); \
  }

TIMED_LOCK(pthread_mutex_clocklock, pthread_mutex_timedlock, pthread_mutex_t, pthread_mutex_trylock)
TIMED_LOCK(pthread_rwlock_clockrdlock, pthread_rwlock_timedrdlock, pthread_rwlock_t, pthread_rwlock_tryrdlock)
TIMED_LOCK(pthread_rwlock_clockwrlock, pthread_rwlock_timedwrlock, pthread_rwlock_t, pthread_rwlock_trywrlock)

int mtx_timedlock(mtx_t *restrict m, const struct timespec *restrict moment) {
  int error = pthread_mutex_timedlock((pthread_mutex_t *)m, moment);
  return !error ? thrd_success : error == ETIMEDOUT ? thrd_timedout : thrd_error;
}

int pthread_clockjoin_np(pthread_t thread, void **result, clockid_t clock, const struct timespec *moment) {
  if (!active() || !moment || !is_simulated(clock)) return REAL(pthread_clockjoin_np)(thread, result, clock, moment);
  int64_t deadline = deadline_of(clock, moment);
  return POLL_UNTIL(deadline, answer_ == ETIMEDOUT, REAL(pthread_clockjoin_np)(thread, result, CLOCK_MONOTONIC, &limit));
}

int pthread_timedjoin_np(pthread_t thread, void **result, const struct timespec *moment) {
  return active() ? pthread_clockjoin_np(thread, result, CLOCK_REALTIME, moment)
                  : REAL(pthread_timedjoin_np)(thread, result, moment);
}

int sigtimedwait(const sigset_t *set, siginfo_t *info, const struct timespec *span) {
  if (!active() || !span || !is_valid(span) || !to_ns(span)) return REAL(sigtimedwait)(set, info, span);
  int64_t deadline = after(to_ns(span));
  struct timespec slice = {0, POLL_NS};
  /* This call takes a span, not a moment. */
  return POLL_UNTIL(deadline, answer_ < 0 && errno == EAGAIN, REAL(sigtimedwait)(set, info, &slice));
}

/* ---- System calls that programs make by number: Rust's standard library and absl wait on futexes so */

static long futex_until(uint32_t *word, int private_flag, uint32_t expected, int64_t deadline, uint32_t bits) {
  if (deadline <= now_ns()) {
    errno = atomic_load((_Atomic uint32_t *)word) == expected ? ETIMEDOUT : EAGAIN;
    return -1;
  }
  int slot = claim(deadline, BY_FUTEX, word, private_flag);
  long answer = futex(word, FUTEX_WAIT_BITSET | private_flag, expected, NULL, bits);
  release(slot);
  /* Who wakes a waiter has changed the word first; an unchanged one was our keeper's doing. */
  if (!answer && deadline <= now_ns() && atomic_load((_Atomic uint32_t *)word) == expected) {
    errno = ETIMEDOUT;
    return -1;
  }
  return answer;
}

long syscall(long number, ...) {
  va_list arguments;
  va_start(arguments, number);
  long a = va_arg(arguments, long), b = va_arg(arguments, long), c = va_arg(arguments, long);
  long d = va_arg(arguments, long), e = va_arg(arguments, long), f = va_arg(arguments, long);
  va_end(arguments);
  if (active()) switch (number) {
    case SYS_futex: {
      int operation = (int)b & FUTEX_CMD_MASK, private_flag = (int)b & FUTEX_PRIVATE_FLAG;
      /* Other operations take fewer arguments: what stands in the place of the limit is then no address. */
      if (operation != FUTEX_WAIT && operation != FUTEX_WAIT_BITSET) break;
      const struct timespec *limit = (const struct timespec *)d;
      if (!limit || !is_valid(limit)) break;
      if (operation == FUTEX_WAIT)
        return futex_until((uint32_t *)a, private_flag, (uint32_t)c, after(to_ns(limit)), FUTEX_BITSET_MATCH_ANY);
      clockid_t clock = b & FUTEX_CLOCK_REALTIME ? CLOCK_REALTIME : CLOCK_MONOTONIC;
      return futex_until((uint32_t *)a, private_flag, (uint32_t)c, deadline_of(clock, limit), (uint32_t)f);
    }
    case SYS_clock_gettime: return clock_gettime((clockid_t)a, (struct timespec *)b);
    case SYS_gettimeofday: return gettimeofday((struct timeval *)a, NULL);
    case SYS_nanosleep: return nanosleep((struct timespec *)a, (struct timespec *)b);
    case SYS_clock_nanosleep: {
      int error = clock_nanosleep((clockid_t)a, (int)b, (struct timespec *)c, (struct timespec *)d);
      if (error) errno = error;
      return error ? -1 : 0;
    }
    case SYS_ppoll: return ppoll((struct pollfd *)a, (nfds_t)b, (struct timespec *)c, (sigset_t *)d);
    case SYS_epoll_pwait: return epoll_pwait((int)a, (struct epoll_event *)b, (int)c, (int)d, (sigset_t *)e);
    case SYS_epoll_pwait2:
      return epoll_pwait2((int)a, (struct epoll_event *)b, (int)c, (struct timespec *)d, (sigset_t *)e);
#ifdef SYS_poll
    case SYS_time: return time((time_t *)a);
    case SYS_poll: return poll((struct pollfd *)a, (nfds_t)b, (int)c);
    case SYS_epoll_wait: return epoll_wait((int)a, (struct epoll_event *)b, (int)c, (int)d);
    case SYS_select: return select((int)a, (fd_set *)b, (fd_set *)c, (fd_set *)d, (struct timeval *)e);
#endif
  }
  return REAL(syscall)(number, a, b, c, d, e, f);
}

/* ---- Timers: timerfd, timer_create, setitimer, alarm */

#define MAX_TIMERS 256
enum effect { NO_TIMER, SIGNALS_PROCESS, SIGNALS_THREAD, RUNS_FUNCTION, NO_EFFECT, WRITES_FILE };

struct timer {
  enum effect effect; /* NO_TIMER: free */
  clockid_t clock;
  int fd, slot; /* slot: -1 while it is not armed */
  int overruns;
  int64_t deadline_ns, interval_ns;
  struct sigevent event;
};

static struct timer timers[MAX_TIMERS];
static struct timer interval_timer = {.effect = SIGNALS_PROCESS, .slot = -1};
static pthread_mutex_t timers_lock = PTHREAD_MUTEX_INITIALIZER;
/* Of which descriptor there is a timer, so that `close` asks an array. */
#define MAX_DESCRIPTOR 65536
static _Atomic uint8_t is_timer_descriptor[MAX_DESCRIPTOR];

/* Signals stay away meanwhile: a handler may set a timer too. */
static sigset_t lock_timers(void) {
  sigset_t all, previous;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &previous);
  pthread_mutex_lock(&timers_lock);
  return previous;
}

static void unlock_timers(sigset_t previous) {
  pthread_mutex_unlock(&timers_lock);
  pthread_sigmask(SIG_SETMASK, &previous, NULL);
}

static void forget_timers(void) {
  pthread_mutex_init(&timers_lock, NULL);
  memset(timers, 0, sizeof timers); /* the child of a fork inherits no timers */
  interval_timer.slot = -1;
  interval_timer.deadline_ns = 0;
}

static void disarm(struct timer *timer) {
  if (timer->slot >= 0) release(timer->slot);
  timer->slot = -1;
  timer->deadline_ns = 0;
}

static void arm(struct timer *timer, int64_t deadline, int64_t interval) {
  disarm(timer);
  timer->deadline_ns = deadline;
  timer->interval_ns = interval;
  timer->overruns = 0;
  timer->slot = claim(deadline, TIMER, NULL, 0);
}

static void *run_function(void *argument) {
  struct sigevent event = *(struct sigevent *)argument;
  free(argument);
  event.sigev_notify_function(event.sigev_value);
  return NULL;
}

static void take_effect(struct timer *timer, uint64_t count) {
  siginfo_t info = {.si_signo = timer->event.sigev_signo, .si_code = SI_TIMER};
  info.si_value = timer->event.sigev_value;
  switch (timer->effect) {
    case WRITES_FILE: {
      ssize_t written = write(timer->fd, &count, sizeof count);
      (void)written;
      break;
    }
    case SIGNALS_PROCESS:
      if (timer == &interval_timer) REAL(syscall)(SYS_kill, self_pid, SIGALRM);
      else REAL(syscall)(SYS_rt_sigqueueinfo, self_pid, info.si_signo, &info);
      break;
    case SIGNALS_THREAD:
      REAL(syscall)(SYS_rt_tgsigqueueinfo, self_pid, timer->event._sigev_un._tid, info.si_signo, &info);
      break;
    case RUNS_FUNCTION: {
      struct sigevent *copy = malloc(sizeof *copy);
      pthread_t thread;
      if (!copy) fatal("rebar warp: no memory for a timer\n");
      *copy = timer->event;
      if (pthread_create(&thread, copy->sigev_notify_attributes, run_function, copy)) free(copy);
      else if (!copy->sigev_notify_attributes) pthread_detach(thread);
      break;
    }
    case NO_TIMER:
    case NO_EFFECT: break;
  }
}

static void expire(struct timer *timer, int64_t now) {
  if (timer->slot < 0 || timer->deadline_ns > now) return;
  uint64_t count = 1;
  if (timer->interval_ns > 0) {
    count += (uint64_t)((now - timer->deadline_ns) / timer->interval_ns);
    timer->deadline_ns += (int64_t)count * timer->interval_ns;
    timer->overruns = (int)count - 1;
  }
  /* First the effect, then the deadline: as long as it is due, time stands still. */
  take_effect(timer, count);
  if (timer->interval_ns > 0) atomic_store(&waiters->slots[timer->slot].deadline_ns, timer->deadline_ns);
  else disarm(timer);
}

static void expire_timers(int64_t now) {
  pthread_mutex_lock(&timers_lock); /* by the keeper alone, in which all signals are blocked */
  expire(&interval_timer, now);
  for (int i = 0; i < MAX_TIMERS; i++)
    if (timers[i].effect != NO_TIMER) expire(&timers[i], now);
  pthread_mutex_unlock(&timers_lock);
}

static struct itimerspec state_of(const struct timer *timer) {
  int64_t left = timer->slot >= 0 ? timer->deadline_ns - now_ns() : 0;
  /* An armed timer never says 0, which would mean that it is not armed. */
  return (struct itimerspec){to_timespec(timer->interval_ns), to_timespec(timer->slot >= 0 && left <= 0 ? 1 : left)};
}

static void set_timer(struct timer *timer, int absolute, const struct itimerspec *new, struct itimerspec *old) {
  if (old) *old = state_of(timer);
  if (to_ns(&new->it_value)) {
    arm(timer, timer_deadline(timer->clock, &new->it_value, absolute), to_ns(&new->it_interval));
  } else {
    disarm(timer);
  }
}

static struct timer *new_timer(enum effect effect, clockid_t clock) {
  for (int i = 0; i < MAX_TIMERS; i++)
    if (timers[i].effect == NO_TIMER) {
      timers[i] = (struct timer){.effect = effect, .clock = clock, .fd = -1, .slot = -1};
      return &timers[i];
    }
  fatal("rebar warp: more timers than the library keeps\n");
  return NULL;
}

static struct timer *timer_of_descriptor(int fd) {
  if (fd < 0 || fd >= MAX_DESCRIPTOR || !atomic_load(&is_timer_descriptor[fd])) return NULL;
  for (int i = 0; i < MAX_TIMERS; i++)
    if (timers[i].effect == WRITES_FILE && timers[i].fd == fd) return &timers[i];
  return NULL;
}

/* An eventfd in place of a timerfd: a kernel's timer would expire by the host's time. */
int timerfd_create(int clock, int flags) {
  if (!active() || !is_simulated(clock)) return REAL(timerfd_create)(clock, flags);
  int fd = eventfd(0, (flags & TFD_NONBLOCK ? EFD_NONBLOCK : 0) | (flags & TFD_CLOEXEC ? EFD_CLOEXEC : 0));
  if (fd < 0) return fd;
  if (fd >= MAX_DESCRIPTOR) fatal("rebar warp: a timer's descriptor is too high\n");
  sigset_t previous = lock_timers();
  new_timer(WRITES_FILE, clock)->fd = fd;
  atomic_store(&is_timer_descriptor[fd], 1);
  unlock_timers(previous);
  return fd;
}

int timerfd_settime(int fd, int flags, const struct itimerspec *new, struct itimerspec *old) {
  struct timer *timer = active() ? timer_of_descriptor(fd) : NULL;
  if (!timer) return REAL(timerfd_settime)(fd, flags, new, old);
  if (!is_valid(&new->it_value) || !is_valid(&new->it_interval)) {
    errno = EINVAL;
    return -1;
  }
  sigset_t previous = lock_timers();
  /* Setting a timer forgets expirations that nobody has read. */
  struct pollfd unread = {fd, POLLIN, 0};
  uint64_t count;
  if (REAL(poll)(&unread, 1, 0) > 0 && REAL(read)(fd, &count, sizeof count) < 0) errno = 0;
  set_timer(timer, flags & TFD_TIMER_ABSTIME, new, old);
  unlock_timers(previous);
  return 0;
}

int timerfd_gettime(int fd, struct itimerspec *state) {
  struct timer *timer = active() ? timer_of_descriptor(fd) : NULL;
  if (!timer) return REAL(timerfd_gettime)(fd, state);
  sigset_t previous = lock_timers();
  *state = state_of(timer);
  unlock_timers(previous);
  return 0;
}

static _Atomic int64_t receive_limit_ns[MAX_DESCRIPTOR];

int close(int fd) {
  /* The child of a vfork closes descriptors in its parent's memory: the parent's timers stay. */
  if (clock_page && fd >= 0 && fd < MAX_DESCRIPTOR && (is_timer_descriptor[fd] || receive_limit_ns[fd]) &&
      REAL(syscall)(SYS_getpid) == self_pid) {
    sigset_t previous = lock_timers();
    struct timer *timer = timer_of_descriptor(fd);
    if (timer) {
      disarm(timer);
      timer->effect = NO_TIMER;
    }
    atomic_store(&is_timer_descriptor[fd], 0);
    atomic_store(&receive_limit_ns[fd], 0);
    unlock_timers(previous);
  }
  return REAL(close)(fd);
}

static struct timer *timer_of_id(timer_t id) {
  uintptr_t address = (uintptr_t)id, first = (uintptr_t)timers;
  return address >= first && address < first + sizeof timers ? (struct timer *)id : NULL;
}

int timer_create(clockid_t clock, struct sigevent *restrict event, timer_t *restrict id) {
  if (!active() || !is_simulated(clock)) return REAL(timer_create)(clock, event, id);
  int notify = event ? event->sigev_notify : SIGEV_SIGNAL;
  enum effect effect = notify == SIGEV_THREAD      ? RUNS_FUNCTION
                       : notify == SIGEV_THREAD_ID ? SIGNALS_THREAD
                       : notify == SIGEV_NONE      ? NO_EFFECT
                                                   : SIGNALS_PROCESS;
  sigset_t previous = lock_timers();
  struct timer *timer = new_timer(effect, clock);
  timer->event = event ? *event : (struct sigevent){.sigev_signo = SIGALRM, .sigev_value.sival_ptr = timer};
  *id = timer;
  unlock_timers(previous);
  return 0;
}

int timer_settime(timer_t id, int flags, const struct itimerspec *restrict new, struct itimerspec *restrict old) {
  struct timer *timer = active() ? timer_of_id(id) : NULL;
  if (!timer) return REAL(timer_settime)(id, flags, new, old);
  if (!is_valid(&new->it_value) || !is_valid(&new->it_interval)) {
    errno = EINVAL;
    return -1;
  }
  sigset_t previous = lock_timers();
  set_timer(timer, flags & TIMER_ABSTIME, new, old);
  unlock_timers(previous);
  return 0;
}

int timer_gettime(timer_t id, struct itimerspec *state) {
  struct timer *timer = active() ? timer_of_id(id) : NULL;
  if (!timer) return REAL(timer_gettime)(id, state);
  sigset_t previous = lock_timers();
  *state = state_of(timer);
  unlock_timers(previous);
  return 0;
}

int timer_getoverrun(timer_t id) {
  struct timer *timer = active() ? timer_of_id(id) : NULL;
  return timer ? timer->overruns : REAL(timer_getoverrun)(id);
}

int timer_delete(timer_t id) {
  struct timer *timer = active() ? timer_of_id(id) : NULL;
  if (!timer) return REAL(timer_delete)(id);
  sigset_t previous = lock_timers();
  disarm(timer);
  timer->effect = NO_TIMER;
  unlock_timers(previous);
  return 0;
}

int setitimer(__itimer_which_t which, const struct itimerval *restrict new, struct itimerval *restrict old) {
  if (!active() || which != ITIMER_REAL) return REAL(setitimer)(which, new, old);
  struct itimerspec state, wanted = {{0, 0}, {0, 0}};
  if (new) wanted = (struct itimerspec){to_timespec(timeval_ns(&new->it_interval)), to_timespec(timeval_ns(&new->it_value))};
  sigset_t previous = lock_timers();
  set_timer(&interval_timer, 0, &wanted, &state);
  unlock_timers(previous);
  if (old) *old = (struct itimerval){to_timeval(to_ns(&state.it_interval)), to_timeval(to_ns(&state.it_value))};
  return 0;
}

int getitimer(__itimer_which_t which, struct itimerval *state) {
  if (!active() || which != ITIMER_REAL) return REAL(getitimer)(which, state);
  sigset_t previous = lock_timers();
  struct itimerspec present = state_of(&interval_timer);
  unlock_timers(previous);
  *state = (struct itimerval){to_timeval(to_ns(&present.it_interval)), to_timeval(to_ns(&present.it_value))};
  return 0;
}

unsigned alarm(unsigned span_s) {
  if (!active()) return REAL(alarm)(span_s);
  struct itimerval wanted = {{0, 0}, {span_s, 0}}, old;
  setitimer(ITIMER_REAL, &wanted, &old);
  /* Whole seconds, and never 0 for an alarm that was still to come. */
  return (unsigned)(old.it_value.tv_sec + (old.it_value.tv_usec > 0));
}

useconds_t ualarm(useconds_t span_us, useconds_t interval_us) {
  if (!active()) return REAL(ualarm)(span_us, interval_us);
  struct itimerval wanted = {to_timeval(interval_us * 1000LL), to_timeval(span_us * 1000LL)}, old;
  setitimer(ITIMER_REAL, &wanted, &old);
  return (useconds_t)(timeval_ns(&old.it_value) / 1000);
}

/* ---- SO_RCVTIMEO: kept here, for the kernel would count the host's time */

int setsockopt(int fd, int level, int option, const void *value, socklen_t size) {
  int is_ours = active() && level == SOL_SOCKET && option == SO_RCVTIMEO && fd >= 0 && fd < MAX_DESCRIPTOR &&
                size >= sizeof(struct timeval);
  if (!is_ours) return REAL(setsockopt)(fd, level, option, value, size);
  struct timeval none = {0, 0};
  int answer = REAL(setsockopt)(fd, level, option, &none, sizeof none);
  if (!answer) atomic_store(&receive_limit_ns[fd], timeval_ns(value));
  return answer;
}

int getsockopt(int fd, int level, int option, void *restrict value, socklen_t *restrict size) {
  int is_ours = active() && level == SOL_SOCKET && option == SO_RCVTIMEO && fd >= 0 && fd < MAX_DESCRIPTOR &&
                receive_limit_ns[fd] && *size >= sizeof(struct timeval);
  if (!is_ours) return REAL(getsockopt)(fd, level, option, value, size);
  *(struct timeval *)value = to_timeval(receive_limit_ns[fd]);
  *size = sizeof(struct timeval);
  return 0;
}

/* 0 when the call may go on, else -1 with its error. */
static int await_input(int fd, int flags) {
  int64_t limit = clock_page && fd >= 0 && fd < MAX_DESCRIPTOR ? atomic_load(&receive_limit_ns[fd]) : 0;
  if (!limit || flags & MSG_DONTWAIT || fcntl(fd, F_GETFL) & O_NONBLOCK) return 0;
  struct pollfd input = {fd, POLLIN, 0};
  int answer = poll_until(&input, 1, after(limit), NULL);
  if (!answer) errno = EAGAIN;
  return answer > 0 ? 0 : -1;
}

/* A receiving call that found nothing on a descriptor that does not wait is a look too. */
static ssize_t received(ssize_t answer) {
  if (answer < 0 && errno == EAGAIN && clock_page) look();
  return answer;
}

ssize_t read(int fd, void *buffer, size_t size) {
  return await_input(fd, 0) ? -1 : received(REAL(read)(fd, buffer, size));
}

ssize_t recv(int fd, void *buffer, size_t size, int flags) {
  return await_input(fd, flags) ? -1 : received(REAL(recv)(fd, buffer, size, flags));
}

ssize_t recvfrom(int fd, void *restrict buffer, size_t size, int flags, struct sockaddr *restrict from,
                 socklen_t *restrict length) {
  return await_input(fd, flags) ? -1 : received(REAL(recvfrom)(fd, buffer, size, flags, from, length));
}

ssize_t recvmsg(int fd, struct msghdr *message, int flags) {
  return await_input(fd, flags) ? -1 : received(REAL(recvmsg)(fd, message, flags));
}

int accept(int fd, struct sockaddr *restrict address, socklen_t *restrict length) {
  return await_input(fd, 0) ? -1 : REAL(accept)(fd, address, length);
}

int accept4(int fd, struct sockaddr *restrict address, socklen_t *restrict length, int flags) {
  return await_input(fd, 0) ? -1 : REAL(accept4)(fd, address, length, flags);
}
