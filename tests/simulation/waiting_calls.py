"""Every call that waits for a moment, one after the other in one process: name, its answer, its span by the process's own
clocks. Run as `python waiting_calls.py SPAN_S`; nothing but the standard library."""

from __future__ import annotations

import ctypes
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

libc = ctypes.CDLL(None, use_errno=True)
SPAN_S = float(sys.argv[1])
MONOTONIC, REALTIME, ABSOLUTE = 1, 0, 1
SYS_FUTEX = {"x86_64": 202, "aarch64": 98}[os.uname().machine]


def timespec(seconds: float) -> Any:
    # Rounded up: by the process's own clock a call must never seem too short.
    ns = round(seconds * 1e9)
    return ctypes.create_string_buffer(struct.pack("ll", ns // 10**9, ns % 10**9))


def moment(clock: int) -> Any:
    ns = time.clock_gettime_ns(clock) + round(SPAN_S * 1e9)
    return ctypes.create_string_buffer(struct.pack("ll", ns // 10**9, ns % 10**9))


def itimerspec(first_s: float, interval_s: float = 0.0) -> Any:
    return ctypes.create_string_buffer(timespec(interval_s).raw[:16] + timespec(first_s).raw[:16])


def answer_of(answer: int) -> Any:
    """What a call of the C library answered, with the error where it tells one."""
    return [answer, ctypes.get_errno() if answer < 0 else 0]


def block() -> Any:
    """64 zero bytes, aligned as the largest of the C library's objects: a mutex, condition variable or semaphore."""
    return (ctypes.c_uint64 * 8)()


def pair() -> tuple[socket.socket, socket.socket]:
    return socket.socketpair()


def locked_elsewhere(lock: str) -> Any:
    """An object that another thread holds."""
    held, taken = block(), threading.Event()

    def hold() -> None:
        getattr(libc, lock)(held)
        taken.set()
        threading.Event().wait()

    threading.Thread(target=hold, daemon=True).start()
    taken.wait()
    return held


def call_futex(operation: int, limit: Any) -> Any:
    word = ctypes.c_uint32(7)
    return answer_of(libc.syscall(SYS_FUTEX, ctypes.byref(word), operation | 128, 7, limit, None, 0xFFFFFFFF))


def woken_futex() -> Any:
    """A thread waits on a futex without a limit until another wakes it, by a call that has nothing in the limit's place."""
    word = ctypes.c_uint32(7)
    answers: list[int] = []

    def wait() -> None:
        answers.append(libc.syscall(SYS_FUTEX, ctypes.byref(word), 128, 7, None, None, 0))

    waiter = threading.Thread(target=wait)
    waiter.start()
    time.sleep(SPAN_S)
    garbage = ctypes.c_void_p(1)
    while not (woken := libc.syscall(SYS_FUTEX, ctypes.byref(word), 129, 1, garbage, None, 0)):
        time.sleep(0)
    waiter.join()
    return [woken, answers]


def condition(call: str, *clock: int, when: int) -> Any:
    mutex, variable = block(), block()
    libc.pthread_mutex_lock(mutex)
    return getattr(libc, call)(variable, mutex, *clock, moment(when))


def condition_of_monotonic() -> Any:
    attributes, mutex, variable = block(), block(), block()
    libc.pthread_condattr_init(attributes)
    libc.pthread_condattr_setclock(attributes, MONOTONIC)
    libc.pthread_cond_init(variable, attributes)
    libc.pthread_mutex_lock(mutex)
    return libc.pthread_cond_timedwait(variable, mutex, moment(MONOTONIC))


def semaphore(call: str, *clock: int, when: int) -> Any:
    waited = block()
    libc.sem_init(waited, 0, 0)
    return answer_of(getattr(libc, call)(waited, *clock, moment(when)))


def poll_descriptor() -> Any:
    mine, _theirs = pair()
    watch = select.poll()
    watch.register(mine, select.POLLIN)
    return watch.poll(SPAN_S * 1000)


def call_ppoll() -> Any:
    return answer_of(libc.ppoll(None, 0, timespec(SPAN_S), None))


def call_select() -> Any:
    mine, _theirs = pair()
    return [len(part) for part in select.select([mine], [], [], SPAN_S)]


def call_pselect() -> Any:
    return answer_of(libc.pselect(0, None, None, None, timespec(SPAN_S), None))


def call_epoll(call: str) -> Any:
    mine, _theirs = pair()
    events = ctypes.create_string_buffer(64)
    with select.epoll() as watch:
        watch.register(mine, select.EPOLLIN)
        limit = timespec(SPAN_S) if call == "epoll_pwait2" else round(SPAN_S * 1000)
        rest = () if call == "epoll_wait" else (None,)
        return answer_of(getattr(libc, call)(watch.fileno(), events, 1, limit, *rest))


def receive(call: Callable[[socket.socket], Any]) -> Any:
    mine, _theirs = pair()
    limit = struct.pack("ll", int(SPAN_S), round(SPAN_S % 1 * 1e6))
    mine.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
    seconds, us = struct.unpack("ll", mine.getsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, 16))
    # The kernel keeps it in ticks of up to 10 ms.
    told = abs(seconds + us / 1e6 - SPAN_S) < 0.011
    try:
        call(mine)
    except BlockingIOError as error:
        return [told, error.errno]
    return None


def interrupted(arm: Callable[[], Any]) -> Any:
    """Whether a timer's signal comes, and ends a wait."""
    came = []
    signal.signal(signal.SIGALRM, lambda number, _frame: came.append(number))
    arm()
    while not came:
        signal.pause()
    return came


def interrupted_sleep() -> Any:
    """A sleep of three spans that a signal ends after one: C's function tells how much is left."""
    signal.signal(signal.SIGALRM, lambda *_: None)
    signal.setitimer(signal.ITIMER_REAL, SPAN_S)
    left = ctypes.create_string_buffer(16)
    answer = answer_of(libc.nanosleep(timespec(3 * SPAN_S), left))
    seconds, ns = struct.unpack("ll", left.raw)
    return [answer, round((seconds + ns / 1e9) / SPAN_S)]


def posix_timer(notify: int) -> Any:
    # struct sigevent: value, signal, kind of notice.
    event = ctypes.create_string_buffer(struct.pack("qii48x", 5, signal.SIGALRM, notify))
    timer = ctypes.c_void_p()
    libc.timer_create(MONOTONIC, event, ctypes.byref(timer))
    answers = interrupted(lambda: libc.timer_settime(timer, 0, itimerspec(SPAN_S), None))
    libc.timer_delete(timer)
    return answers


def timer_descriptor() -> Any:
    descriptor = libc.timerfd_create(MONOTONIC, 0)
    # A first expiration after half of the span, and two more at intervals of a quarter: read after the second.
    libc.timerfd_settime(descriptor, 0, itimerspec(SPAN_S / 2, SPAN_S / 4), None)
    counts: list[int] = []
    for _ in range(3):
        counts += struct.unpack("q", os.read(descriptor, 8))
    state = ctypes.create_string_buffer(32)
    libc.timerfd_gettime(descriptor, state)
    interval_s, interval_ns = struct.unpack("ll", state.raw[:16])
    os.close(descriptor)
    return [counts, round((interval_s + interval_ns / 1e9) / SPAN_S * 4)]


def timer_in_loop() -> Any:
    """As event loops wait: a descriptor of a timer in an epoll set, without a limit of its own."""
    descriptor = libc.timerfd_create(MONOTONIC, os.O_NONBLOCK)
    libc.timerfd_settime(
        descriptor, ABSOLUTE, ctypes.create_string_buffer(bytes(16) + moment(MONOTONIC).raw[:16]), None
    )
    with select.epoll() as watch:
        watch.register(descriptor, select.EPOLLIN)
        events = [event for _, event in watch.poll()]
    count = struct.unpack("q", os.read(descriptor, 8))[0]
    with suppress(BlockingIOError):
        os.read(descriptor, 8)
        count = -1
    os.close(descriptor)
    return [events, count]


def awaited_signal() -> Any:
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])
    return signal.sigtimedwait([signal.SIGUSR1], SPAN_S)


def asleep_behind_mask() -> Any:
    """A thread that takes no signals sleeps as long as any other."""
    previous = signal.pthread_sigmask(signal.SIG_SETMASK, signal.valid_signals())
    time.sleep(SPAN_S)
    signal.pthread_sigmask(signal.SIG_SETMASK, previous)
    return signal.pthread_sigmask(signal.SIG_BLOCK, []) == previous


def woken_early() -> Any:
    """What others wake before its moment is not late: a thread that waits three spans, woken after one."""
    event = threading.Event()
    threading.Timer(SPAN_S, event.set).start()
    return event.wait(3 * SPAN_S)


def join_thread() -> Any:
    thread = threading.Thread(target=threading.Event().wait, daemon=True)
    thread.start()
    thread.join(SPAN_S)
    return thread.is_alive()


def child_sleeps() -> Any:
    return subprocess.run(["sleep", str(SPAN_S)], check=False).returncode


def child_in_time() -> Any:
    with subprocess.Popen(["sleep", "1000000"]) as child:
        try:
            child.wait(SPAN_S)
        except subprocess.TimeoutExpired:
            child.kill()
    return child.returncode


def forked_sleeps() -> Any:
    child = os.fork()
    if not child:
        time.sleep(SPAN_S)
        os._exit(7)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def two_at_once() -> Any:
    """Two threads with different moments: in the order of these, whichever began first."""
    order: list[str] = []

    def note(name: str, span_s: float) -> None:
        time.sleep(span_s)
        order.append(name)

    threads = [threading.Thread(target=note, args=args) for args in (("late", SPAN_S), ("early", SPAN_S / 2))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return order


CALLS: dict[str, Callable[[], Any]] = {
    "clock_nanosleep": lambda: libc.clock_nanosleep(MONOTONIC, 0, timespec(SPAN_S), None),
    "clock_nanosleep until": lambda: libc.clock_nanosleep(MONOTONIC, ABSOLUTE, moment(MONOTONIC), None),
    "clock_nanosleep until a date": lambda: libc.clock_nanosleep(REALTIME, ABSOLUTE, moment(REALTIME), None),
    "nanosleep": lambda: answer_of(libc.nanosleep(timespec(SPAN_S), None)),
    "usleep": lambda: answer_of(libc.usleep(round(SPAN_S * 1e6))),
    "thrd_sleep": lambda: libc.thrd_sleep(timespec(SPAN_S), None),
    "nanosleep, interrupted": interrupted_sleep,
    "asleep behind a mask": asleep_behind_mask,
    "poll": poll_descriptor,
    "ppoll": call_ppoll,
    "select": call_select,
    "pselect": call_pselect,
    "epoll_wait": lambda: call_epoll("epoll_wait"),
    "epoll_pwait": lambda: call_epoll("epoll_pwait"),
    "epoll_pwait2": lambda: call_epoll("epoll_pwait2"),
    "pthread_cond_timedwait": lambda: condition("pthread_cond_timedwait", when=REALTIME),
    "pthread_cond_timedwait, monotonic": condition_of_monotonic,
    "pthread_cond_clockwait": lambda: condition("pthread_cond_clockwait", MONOTONIC, when=MONOTONIC),
    "sem_timedwait": lambda: semaphore("sem_timedwait", when=REALTIME),
    "sem_clockwait": lambda: semaphore("sem_clockwait", MONOTONIC, when=MONOTONIC),
    "pthread_mutex_timedlock": lambda: libc.pthread_mutex_timedlock(
        locked_elsewhere("pthread_mutex_lock"), moment(REALTIME)
    ),
    "pthread_mutex_clocklock": lambda: libc.pthread_mutex_clocklock(
        locked_elsewhere("pthread_mutex_lock"), MONOTONIC, moment(MONOTONIC)
    ),
    "pthread_rwlock_timedrdlock": lambda: libc.pthread_rwlock_timedrdlock(
        locked_elsewhere("pthread_rwlock_wrlock"), moment(REALTIME)
    ),
    "pthread_rwlock_clockwrlock": lambda: libc.pthread_rwlock_clockwrlock(
        locked_elsewhere("pthread_rwlock_rdlock"), MONOTONIC, moment(MONOTONIC)
    ),
    "futex": lambda: call_futex(0, timespec(SPAN_S)),
    "futex until": lambda: call_futex(9, moment(MONOTONIC)),
    "futex, woken": woken_futex,
    "sigtimedwait": awaited_signal,
    "recv with SO_RCVTIMEO": lambda: receive(lambda mine: mine.recv(1)),
    "recvmsg with SO_RCVTIMEO": lambda: receive(lambda mine: mine.recvmsg(1)),
    "read with SO_RCVTIMEO": lambda: receive(lambda mine: os.read(mine.fileno(), 1)),
    "setitimer": lambda: interrupted(lambda: signal.setitimer(signal.ITIMER_REAL, SPAN_S)),
    "timer_create": lambda: posix_timer(0),
    "timerfd": timer_descriptor,
    "timerfd in epoll": timer_in_loop,
    "a thread is joined": join_thread,
    "an event comes": woken_early,
    "two threads": two_at_once,
    "a child sleeps": child_sleeps,
    "a child is waited for": child_in_time,
    "a fork sleeps": forked_sleeps,
}
WHOLE_SECONDS: dict[str, Callable[[], Any]] = {
    "sleep": lambda: libc.sleep(1),
    "alarm": lambda: interrupted(lambda: signal.alarm(1)),
}


def main() -> None:
    calls = CALLS | (WHOLE_SECONDS if SPAN_S == 1.0 else {})
    for name, call in calls.items():
        before, wall_before = time.monotonic_ns(), time.time_ns()
        answer = call()
        spans = time.monotonic_ns() - before, time.time_ns() - wall_before
        print(json.dumps([name, answer, *spans]), flush=True)


if __name__ == "__main__":
    main()
