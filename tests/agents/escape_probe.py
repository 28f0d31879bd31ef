"""An agent that looks for ways out of its box. Standard library alone; prints two JSON objects, a line each.

PROBE in its environment is JSON with what the tests planted outside. Each key of the answer is a wall of the
table in docs/agents-confinement.md, each value lists the gaps found in it: an empty list is a wall that holds. It refuses
to run without PROBE, and undoes what it manages to do: a wall that does not hold must not cost the host.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import platform
import resource
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import Any

PLANTED: dict[str, Any] = json.loads(os.environ.pop("PROBE", "{}"))
if not PLANTED:
    sys.exit("this probe runs in the tests of confinement alone: PROBE is not set")
WORD = PLANTED["word"].encode()
HOME = os.environ["HOME"]
libc = ctypes.CDLL(None, use_errno=True)
# Numbers of x86-64 and aarch64.
ARM = platform.machine() == "aarch64"
IO_URING_SETUP, CLONE3 = 425, 435
BPF, PERF_EVENT_OPEN, USERFAULTFD = (280, 241, 282) if ARM else (321, 298, 323)
ADD_KEY, KEYCTL, PERSONALITY, PTRACE = (217, 219, 92, 117) if ARM else (248, 250, 135, 101)
CLONE_NEWUSER, CLONE_NEWNS, CLONE_NEWNET, CLONE_NEWPID = 0x10000000, 0x20000, 0x40000000, 0x20000000
SESSION_KEYRING, KEYCTL_SEARCH = -3, 10


def read(path: str) -> bytes:
    """The beginning of a file, empty where it cannot be read."""
    try:
        with open(path, "rb") as file:
            return file.read(1 << 20)
    except OSError:
        return b""


def process_ids() -> list[int]:
    """Processes other than this one and its parents in the box."""
    try:
        names = os.listdir("/proc")
    except OSError:
        return []
    return [int(name) for name in names if name.isdigit() and int(name) != os.getpid()]


def files() -> Iterator[str]:
    """The campaign's files, by their own path and by the roots of processes."""
    if WORD in read(PLANTED["file"]):
        yield PLANTED["file"]
    roots = [pid for pid in process_ids() if WORD in read(f"/proc/{pid}/root{PLANTED['file']}")]
    if roots:
        yield f"the roots of {len(roots)} processes"
    with suppress(OSError):
        yield from (f"{PLANTED['folder']}/{name}" for name in os.listdir(PLANTED["folder"]))


def writing() -> Iterator[str]:
    """Folders outside its own in which it can make a file."""
    own = {os.path.realpath(path) for path in PLANTED["writable"]}
    for folder in ("/", "/usr", "/etc", "/var/tmp", "/run", "/tmp", "/dev/shm", "/home", PLANTED["folder"]):
        if os.path.realpath(folder) in own:
            continue
        path = os.path.join(folder, f"probe-{os.getpid()}")
        with suppress(OSError):
            os.close(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_EXCL))
            os.unlink(path)
            yield folder
    for path in (PLANTED["file"], PLANTED["folder"], __file__, json.__file__, os.devnull):
        for change in (same_mode, same_times, attribute, same_owner, lease):
            with suppress(OSError):
                change(path)
                yield f"{change.__name__} of {path}"


def same_mode(path: str) -> None:
    os.chmod(path, os.stat(path).st_mode & 0o7777)


def same_times(path: str) -> None:
    os.utime(path, ns=(os.stat(path).st_atime_ns, os.stat(path).st_mtime_ns))


def attribute(path: str) -> None:
    os.setxattr(path, "user.probe", b"")
    os.removexattr(path, "user.probe")


def same_owner(path: str) -> None:
    os.chown(path, -1, os.getgid())


def lease(path: str) -> None:
    """Make whoever opens a file wait."""
    with open(path, "rb") as file:
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_WRLCK)


def processes() -> Iterator[str]:
    """What can be read of processes that are not in the box."""
    for pid in process_ids():
        for part in ("environ", "cmdline"):
            content = read(f"/proc/{pid}/{part}")
            if WORD in content or PLANTED["folder"].encode() in content:
                yield f"{part} of process {pid}"


def signals() -> Iterator[str]:
    """Whether it can signal the bench."""
    with suppress(OSError):
        os.kill(PLANTED["pid"], 0)
        yield f"process {PLANTED['pid']}"


def tcp() -> Iterator[str]:
    """A server of the host that is none of its endpoints."""
    with suppress(OSError), socket.create_connection(("127.0.0.1", PLANTED["tcp"]), 2.0):
        yield "a server on 127.0.0.1"


def udp() -> Iterator[str]:
    """A socket of the host that answers."""
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.settimeout(2.0)
        probe.connect(("127.0.0.1", PLANTED["udp"]))
        probe.send(b"?")
        if probe.recv(9):
            yield "a socket on 127.0.0.1"


def abstract_sockets() -> Iterator[str]:
    """A Unix socket without a file."""
    with suppress(OSError), socket.socket(socket.AF_UNIX) as probe:
        probe.connect("\0" + PLANTED["abstract"])
        yield "a server"


def shared_memory() -> Iterator[str]:
    """POSIX and System V shared memory of others."""
    if WORD in read(PLANTED["shm"]):
        yield "POSIX"
    if libc.shmget(PLANTED["sysv"], 0, 0) >= 0:
        yield "System V"


def kernel() -> Iterator[str]:
    """System calls that agents have no business with, and kinds of sockets."""
    buffer = ctypes.create_string_buffer(256)
    calls: dict[str, tuple[Any, ...]] = {
        "bpf": (BPF, 5, buffer, 120),
        "io_uring": (IO_URING_SETUP, 1, ctypes.create_string_buffer(120)),
        "keyring": (KEYCTL, KEYCTL_SEARCH, ctypes.c_int(SESSION_KEYRING), b"user", WORD, 0),
        "new key": (ADD_KEY, b"user", b"probe", b"x", 1, ctypes.c_int(SESSION_KEYRING)),
        "perf": (PERF_EVENT_OPEN, buffer, 0, -1, -1, 0),
        "personality": (PERSONALITY, 0x0040000),
        "userfaultfd": (USERFAULTFD, 1),
    }
    yield from (name for name, call in calls.items() if libc.syscall(*call) >= 0)
    for name, flag in (
        ("user", CLONE_NEWUSER),
        ("mount", CLONE_NEWNS),
        ("network", CLONE_NEWNET),
        ("process", CLONE_NEWPID),
    ):
        if in_child(partial(unshare, flag)):
            yield f"{name} namespace"
    if in_child(trace_child):
        yield "ptrace"
    for name, family, kind in (("vsock", 40, 1), ("packet", 17, 3), ("alg", 38, 5), ("xdp", 44, 3)):
        with suppress(OSError), socket.socket(family, kind):
            yield f"{name} socket"


def unshare(flag: int) -> bool:
    """Whether this process can enter a namespace of its own."""
    return bool(libc.unshare(flag) == 0)


def trace_child() -> bool:
    """Whether a child can be traced, as a debugger does."""
    pid = os.fork()
    if pid == 0:
        time.sleep(5)
        os._exit(0)
    traced = libc.syscall(PTRACE, 16, pid, 0, 0) == 0
    os.kill(pid, signal.SIGKILL)
    return bool(traced)


def rights() -> Iterator[str]:
    """Capabilities, and programs that would give some."""
    for line in read("/proc/self/status").decode().splitlines():
        if line.startswith(("CapEff", "CapPrm")) and int(line.split()[1], 16):
            yield line
    # PR_GET_NO_NEW_PRIVS, and PR_CAPBSET_READ of CAP_SYS_ADMIN
    if libc.prctl(39, 0, 0, 0, 0) == 0:
        yield "programs with setuid bits"


def settings() -> Iterator[str]:
    """A file that changes the kernel."""
    with suppress(OSError), open("/proc/sys/kernel/core_pattern", "r+b"):
        yield "/proc/sys"


def host_name() -> Iterator[str]:
    """The name of the machine."""
    if socket.gethostname() == PLANTED["host"]:
        yield "the name of the host"


def descriptors() -> Iterator[str]:
    """Files of the bench that are still open here."""
    for number in range(3, 64):
        with suppress(OSError):
            os.fstat(number)
            yield f"descriptor {number}"


def disk() -> Iterator[str]:
    """More files in its own folder than its quota, 256 KiB at a time."""
    quota_mb = PLANTED["scratch_mb"]
    written = 0
    names: list[str] = []
    block = bytes(1 << 18)
    try:
        while written <= 4 * quota_mb:
            names.append(os.path.join(HOME, f"probe-{len(names)}"))
            with open(names[-1], "wb") as file:
                file.write(block)
            written = len(names) // 4
        # Where a watch holds the quota, this is where it ends.
        time.sleep(PLANTED["watch_s"])
        yield f"{written} MB, {quota_mb} allowed"
    except OSError:
        pass
    for name in names:
        with suppress(OSError):
            os.unlink(name)


def process_count() -> Iterator[str]:
    """More processes than allowed."""
    allowed = PLANTED["processes"]
    children: list[int] = []
    with suppress(OSError):
        while len(children) <= allowed:
            pid = os.fork()
            if pid == 0:
                signal.pause()
                os._exit(0)
            children.append(pid)
        yield f"{len(children)}, {allowed} allowed"
    for pid in children:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


def memory() -> Iterator[str]:
    """More memory in one process than allowed."""
    if in_child(lambda: len(bytes(PLANTED["memory_mb"] << 20)) > 0):
        yield f"{PLANTED['memory_mb']} MB"


def memory_of_all() -> Iterator[str]:
    """More memory in three processes than allowed in all, though not in each: all three hold half of it."""
    held, holding = os.pipe()
    children = []
    for _ in range(3):
        pid = os.fork()
        if pid == 0:
            with suppress(MemoryError):
                block = b"\1" * (PLANTED["memory_mb"] << 19)
                os.write(holding, b".")
                signal.pause()
                del block
            os._exit(1)
        children.append(pid)
    os.close(holding)
    os.set_blocking(held, False)
    count, ended = 0, 0
    while count < 3 and not ended:
        with suppress(BlockingIOError):
            count += len(os.read(held, 3))
        ended = os.waitpid(-1, os.WNOHANG)[0]
        children = [pid for pid in children if pid != ended]
        time.sleep(0.005)
    for pid in children:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    if count == 3:
        yield f"{3 * PLANTED['memory_mb'] // 2} MB, {PLANTED['memory_mb']} allowed"
    held_mb = held_by_sockets() >> 20
    if held_mb > PLANTED["memory_mb"]:
        yield f"{held_mb} MB in sockets, {PLANTED['memory_mb']} allowed"


def held_by_sockets() -> int:
    """How many bytes of datagrams wait in sockets of this process's own, which is no memory of any process."""
    datagram, full, held = bytes(60_000), 12, 0
    receivers = []
    with suppress(OSError):
        for _ in range(900):
            receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            receivers.append(receiver)
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 24)
            receiver.bind(("127.0.0.1", 0))
            receiver.setblocking(False)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.setblocking(False)
                for _ in range(full):
                    sender.sendto(datagram, receiver.getsockname())
    for receiver in receivers:
        with suppress(OSError):
            while True:
                held += len(receiver.recv(len(datagram)))
        receiver.close()
    return held


def in_child(attempt: Callable[[], bool]) -> bool:
    """Whether an attempt succeeds, made in a child so that it changes nothing here."""
    pid = os.fork()
    if pid == 0:
        code = 1
        with suppress(BaseException):
            code = 0 if attempt() else 1
        os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0


def leave_daemon() -> None:
    """Leave a process behind that left the session, ignores SIGTERM and holds no output."""
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            # PR_SET_NAME, by which the test finds it
            libc.prctl(15, WORD[:15], 0, 0, 0)
            for number in range(3):
                with suppress(OSError):
                    os.close(number)
            os.environ.clear()
            time.sleep(600)
        os._exit(0)


PROBES: dict[str, Callable[[], Iterator[str]]] = {
    # First: others leave some open.
    "DESCRIPTORS": descriptors,
    "FILES": files,
    "WRITING": writing,
    "PROCESSES": processes,
    "SIGNALS": signals,
    "TCP": tcp,
    "UDP": udp,
    "ABSTRACT_SOCKETS": abstract_sockets,
    "SHARED_MEMORY": shared_memory,
    "KERNEL": kernel,
    "RIGHTS": rights,
    "SETTINGS": settings,
    "HOST_NAME": host_name,
    "PROCESS_COUNT": process_count,
    "MEMORY": memory,
    "MEMORY_OF_ALL": memory_of_all,
}

if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    gaps = {name: list(probe()) for name, probe in PROBES.items()}
    leave_daemon()
    print(json.dumps(gaps), flush=True)
    # Last, and by itself: a quota may be held by ending whoever passes it.
    print(json.dumps({"DISK": list(disk())}), flush=True)
    time.sleep(600)
