"""Whether a tree of processes is at rest, judged on real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from bench.process_threads import ProcessThreads, unseen_reason

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(bool(unseen_reason()), reason=unseen_reason() or "threads are seen"),
]

LOOKS = 2000
"""By their states alone, read one after the other, all of two threads looked asleep in 0 to 128 of so many looks, all of
eight in 95 to 988 (six runs each, on two cores).
"""
BUDGET_S = 60.0

# Threads with one turn: each waits for it, and hands it on. The turn is always with one that runs or is about to.
HAND_OVER = """
import os, select, sys, threading
count = int(sys.argv[1])
polls = sys.argv[2] == "polled"
pipes = [os.pipe() for _ in range(count)]
def wait(number):
    if polls:
        select.select([pipes[number][0]], [], [])
    return True
def hand_on(number):
    while wait(number) and os.read(pipes[number][0], 1) == b"t":
        os.write(pipes[(number + 1) % count][1], b"t")
    os.write(pipes[(number + 1) % count][1], b"x")
threads = [threading.Thread(target=hand_on, args=(number,)) for number in range(count)]
for thread in threads:
    thread.start()
os.write(pipes[0][1], b"t")
print(flush=True)
sys.stdin.readline()
os.write(pipes[0][1], b"x")
for thread in threads:
    thread.join()
print(flush=True)
sys.stdin.readline()
"""

# A child that leaves its parent, which ends, and stays in the group. It works until it is told to wait.
ORPHAN = """
import os, sys, time
if os.fork() == 0:
    if os.fork() == 0:
        while not os.path.exists(sys.argv[1]):
            pass
        time.sleep(1000)
    os._exit(0)
os.wait()
print(flush=True)
time.sleep(1000)
"""


# It calls itself what is no UTF-8, and works until it is told to wait.
NAMED = """
import os, sys, time
with open("/proc/self/comm", "wb") as file:
    file.write(b"\\xff\\xfe")
print(flush=True)
while not os.path.exists(sys.argv[1]):
    pass
time.sleep(1000)
"""

# It starts a child as vfork(2) does, and waits for it in state D, as for the disk, until the child ends.
UNINTERRUPTIBLE = """
import ctypes, os, platform, signal, time
clone = {"x86_64": 56, "aarch64": 220}[platform.machine()]
CLONE_VFORK = 0x4000
if ctypes.CDLL(None).syscall(clone, CLONE_VFORK | signal.SIGCHLD, 0, 0, 0, 0) == 0:
    print(flush=True)
    os.read(0, 1)
    os._exit(0)
time.sleep(1000)
"""


@contextmanager
def started(code: str, *arguments: str) -> Generator[subprocess.Popen[bytes]]:
    """The program, in a group of its own, once it has said that it runs."""
    command = [sys.executable, "-IS", "-c", code, *arguments]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as process:
        assert process.stdout
        process.stdout.readline()
        try:
            yield process
        finally:
            os.killpg(process.pid, signal.SIGKILL)


def rests_in_time(threads: ProcessThreads) -> bool:
    deadline_s = time.monotonic() + BUDGET_S
    while not (rests := threads.at_rest()) and time.monotonic() < deadline_s:
        time.sleep(0)
    return rests


@pytest.mark.parametrize("wait", ["read", "polled"])
@pytest.mark.parametrize("count", [2, 8])
def test_threads_that_hand_on_one_turn_are_never_at_rest(count: int, wait: str) -> None:
    """Most of them sleep at any moment, and all can be seen asleep by one who looks at one after the other."""
    with started(HAND_OVER, str(count), wait) as process, closing(watched(process)) as threads:
        assert not any(threads.at_rest() for _ in range(LOOKS))
        assert process.stdin
        assert process.stdout
        process.stdin.write(b"\n")
        process.stdin.flush()
        process.stdout.readline()
        assert rests_in_time(threads)


def test_a_thread_that_waits_for_the_disk_is_at_work() -> None:
    """All of its processes are off the run queues, but one of them goes on without being asked."""
    with started(UNINTERRUPTIBLE) as process, closing(watched(process)) as threads:
        assert Path(f"/proc/{process.pid}/stat").read_text().split()[2] == "D"
        assert not any(threads.at_rest() for _ in range(LOOKS))
        assert process.stdin
        process.stdin.write(b"x")
        process.stdin.flush()
        assert rests_in_time(threads)


def test_an_orphan_belongs_to_the_group_alone(tmp_path: Path) -> None:
    """Two watches on one program, whose orphan is at work until it is told to wait."""
    with (
        started(ORPHAN, str(tmp_path / "waits")) as process,
        closing(watched(process)) as tree,
        closing(watched(process)) as group,
    ):
        group.with_group = True
        assert rests_in_time(tree)
        assert not any(group.at_rest() for _ in range(LOOKS // 10))
        (tmp_path / "waits").touch()
        assert rests_in_time(group)
        assert len(group.processes) == len(tree.processes) + 1


def test_a_process_is_watched_whatever_it_calls_itself(tmp_path: Path) -> None:
    with started(NAMED, str(tmp_path / "waits")) as process, closing(watched(process)) as threads:
        assert not any(threads.at_rest() for _ in range(LOOKS // 10))
        (tmp_path / "waits").touch()
        assert rests_in_time(threads)
        assert len(threads.processes) == 1


def watched(process: subprocess.Popen[bytes]) -> ProcessThreads:
    return ProcessThreads(process.pid, root_is_box=False, with_bench=False)
