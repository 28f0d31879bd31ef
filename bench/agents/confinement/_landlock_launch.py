"""The two processes between the bench and a landlocked agent; a script of the standard library alone.

Run as `python -I -S _landlock_launch.py SETTINGS_FD STATUS_FD PARENT`, with the JSON that `_landlock` writes in
SETTINGS_FD. The launcher stays outside: at the end it kills until nothing is left, and it watches the size of the agent's
folder where that is on a disk of the host. Its child, the keeper, is the parent of the agent: where the host gives them, in
namespaces and a root of their own (`_private_root`), as process 1. Orphans come to the keeper. They write lines to STATUS_FD:
`pid N` (of the keeper, for the host), then `failed REASON`, `exceeded LIMIT` or nothing, then `ended STATUS` (a wait status).
"""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import resource
import signal
import stat
import struct
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import closing, suppress
from types import FrameType, ModuleType
from typing import Any, NoReturn

# From <linux/prctl.h>, <linux/landlock.h> and <linux/capability.h>.
PR_SET_PDEATHSIG, PR_SET_SECCOMP, PR_CAPBSET_DROP = 1, 22, 24
PR_SET_CHILD_SUBREAPER, PR_SET_NO_NEW_PRIVS = 36, 38
SECCOMP_MODE_FILTER = 2
# The numbers are the same on all processors.
LANDLOCK_CREATE_RULESET, LANDLOCK_ADD_RULE, LANDLOCK_RESTRICT_SELF = 444, 445, 446
RULE_PATH_BENEATH, RULE_NET_PORT = 1, 2
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1, 2, 4, 8
TRUNCATE, IOCTL_DEVICE = 1 << 14, 1 << 15
OF_FILES = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEVICE
CONNECT_TCP = 2
SCOPE_ABSTRACT_SOCKETS, SCOPE_SIGNALS = 1, 2
# Rights to files that each version of Landlock knows, by count; later versions have the last.
FILE_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}
LATEST_FILE_RIGHTS = 16
TCP_FROM, SCOPES_FROM = 4, 6
LAST_CAPABILITY = 63
DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom")

# Between two looks at the agent's folder, which may take a tenth of a core; chosen.
WATCH_S, WATCH_SHARE = 0.1, 0.1
# What the smallest file takes: many empty ones fill a disk too.
LEAST_FILE_BYTES = 4096
# Of folders in folders: each takes a descriptor of the watch. More than any tree of packages has; chosen.
MAX_FOLDER_DEPTH = 128
# A folder that cannot be read now may be about to vanish; one that still cannot is hidden.
UNREADABLE_LOOKS = 3

# The code by which shells report a command that cannot be started.
NOT_STARTED = 127

libc = ctypes.CDLL(None, use_errno=True)


class Filter(ctypes.Structure):
    """struct sock_fprog."""

    _fields_ = (("length", ctypes.c_ushort), ("program", ctypes.c_void_p))


def main() -> None:
    """Start the agent as a program of its own, report, and stay until everything of it has ended."""
    settings_fd, status_fd, parent = map(int, sys.argv[1:4])
    with open(settings_fd, "rb") as file:
        settings: dict[str, Any] = json.loads(file.read())
    os.set_inheritable(status_fd, False)
    libc.prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0)
    # A parent that died before the line above sends no signal any more.
    if os.getppid() != parent:
        sys.exit(1)
    libc.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    root = private_root() if settings["namespaces"] else None
    if root is not None:
        try:
            root.enter_namespaces()
        except OSError as error:
            fail(settings, status_fd, error)
    keeper = os.fork()
    if keeper == 0:
        keep_agent(settings, status_fd, root)

    def stop(_number: int, _frame: FrameType | None) -> None:
        end_all(os.getpid())

    signal.signal(signal.SIGTERM, stop)
    release_output()
    os.write(status_fd, f"pid {keeper}\n".encode())
    # In a root of its own the folders of the agent are in memory, with a quota of the kernel's.
    if root is None:
        watch_folder(settings["home"], settings["scratch_bytes"], status_fd)
    while True:
        try:
            pid, _ = os.wait()
        except ChildProcessError:
            return
        if pid == keeper:
            end_all(os.getpid())


def keep_agent(settings: dict[str, Any], status_fd: int, root: ModuleType | None) -> NoReturn:
    """Start the agent and be the parent of its orphans until it has ended, and this process with it."""
    libc.prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    # Process 1 of a namespace has no handlers that it does not set, and none of Python's is wanted here.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        if root is None:
            libc.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        else:
            root.enter_root(settings)
    except OSError as error:
        fail(settings, status_fd, error)
    agent = os.fork()
    if agent == 0:
        become_agent(settings, status_fd)
    # It needs no right any more. Of what is outside of its Landlock domain the agent can read no memory.
    drop_rights(settings["user"])
    release_output()
    while True:
        pid, status = os.wait()
        if pid == agent:
            os.write(status_fd, f"ended {status}\n".encode())
            os._exit(0)


def private_root() -> ModuleType:
    """The module beside this script; the search path of an isolated interpreter does not have its folder."""
    path = os.path.join(os.path.dirname(__file__), "_private_root.py")
    spec = importlib.util.spec_from_file_location("_private_root", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def release_output() -> None:
    """Let go of the agent's output: its end shows to the bench only when nobody holds it any more."""
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (1, 2):
        os.dup2(null, descriptor)
    os.close(null)


def fail(settings: dict[str, Any], status_fd: int, error: OSError) -> NoReturn:
    """Say why the agent cannot be started, and end."""
    reason = f"{settings['command'][0]}: {error.strerror or error}"
    os.write(2, f"{reason}\n".encode())
    os.write(status_fd, f"failed {reason}\n".encode())
    os._exit(NOT_STARTED)


def become_agent(settings: dict[str, Any], status_fd: int) -> NoReturn:
    """Give up rights, in the order in which each step still has those that it needs, and become the agent."""
    try:
        os.setsid()
        libc.prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        # What is ignored stays ignored in the program.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        ruleset = make_ruleset(settings)
        for kind, value in settings["limits"]:
            hard = resource.getrlimit(kind)[1]
            value = value if hard == resource.RLIM_INFINITY else min(value, hard)
            resource.setrlimit(kind, (value, value))
        drop_rights(settings["user"])
        check("landlock_restrict_self", libc.syscall(LANDLOCK_RESTRICT_SELF, ruleset, 0))
        os.close(ruleset)
        os.chdir(settings["home"])
        program = bytes.fromhex(settings["filter"])
        buffer = ctypes.create_string_buffer(program, len(program))
        sock_filter = Filter(len(program) // 8, ctypes.addressof(buffer))
        done = libc.prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, ctypes.byref(sock_filter), 0, 0)
        check("seccomp", done)
        os.execvpe(settings["command"][0], settings["command"], settings["environment"])
    except OSError as error:
        fail(settings, status_fd, error)


def make_ruleset(settings: dict[str, Any]) -> int:
    """A descriptor of the rules: reading, executing, writing by folder, and TCP connections by port."""
    version = check("landlock", libc.syscall(LANDLOCK_CREATE_RULESET, None, 0, 1))
    rights = (1 << FILE_RIGHTS.get(version, LATEST_FILE_RIGHTS)) - 1
    attributes = struct.pack(
        "=QQQ",
        rights,
        CONNECT_TCP if version >= TCP_FROM and settings["tcp_ports"] is not None else 0,
        SCOPE_ABSTRACT_SOCKETS | SCOPE_SIGNALS if version >= SCOPES_FROM else 0,
    )
    size = 8 if version < TCP_FROM else 16 if version < SCOPES_FROM else 24
    ruleset = check("landlock", libc.syscall(LANDLOCK_CREATE_RULESET, attributes[:size], size, 0))
    readable = EXECUTE | READ_FILE | READ_DIR
    writable = [*settings["writable"], *DEVICES, *settings["devices"]]
    rules = [(path, readable) for path in settings["read"]]
    rules += [(path, READ_DIR) for path in settings["listed"]]
    rules += [(path, rights) for path in writable]
    for path, allowed in rules:
        with suppress(FileNotFoundError):
            descriptor = os.open(path, os.O_PATH)
            allowed &= rights if os.path.isdir(path) else rights & OF_FILES
            rule = struct.pack("=Qi", allowed, descriptor)
            check("rule", libc.syscall(LANDLOCK_ADD_RULE, ruleset, RULE_PATH_BENEATH, rule, 0))
            os.close(descriptor)
    for port in settings["tcp_ports"] or () if version >= TCP_FROM else ():
        rule = struct.pack("=QQ", CONNECT_TCP, port)
        check("rule", libc.syscall(LANDLOCK_ADD_RULE, ruleset, RULE_NET_PORT, rule, 0))
    return ruleset


def drop_rights(user: int | None) -> None:
    """No capability, none to be had from any program, and another user where one is given."""
    for capability in range(LAST_CAPABILITY + 1):
        # Fails for numbers that the kernel does not know, and without the right, where there is none to lose.
        libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
    if user is not None:
        os.setgroups([])
        os.setresgid(user, user, user)
        os.setresuid(user, user, user)
    # struct __user_cap_header_struct of version 3, and two of __user_cap_data_struct: none.
    header, none = struct.pack("=Ii", 0x20080522, 0), bytes(24)
    check("capset", libc.capset(header, none))
    check("no_new_privs", libc.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))


def check(what: str, result: int) -> int:
    """The result of a call of the C library; raises OSError if it failed."""
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
    return result


def watch_folder(folder: str, quota_bytes: int, status_fd: int) -> None:
    """Look at the agent's folder again and again, and end everything below this process once it is over a limit."""
    unreadable = 0

    def look(_number: int, _frame: FrameType | None) -> None:
        nonlocal unreadable
        began_s = time.monotonic()
        limit = b""
        try:
            if used_bytes(folder, os.getpid(), quota_bytes) > quota_bytes:
                limit = b"scratch"
            unreadable = 0
        except TooDeep:
            limit = b"folders"
        except OSError:
            unreadable += 1
            if unreadable >= UNREADABLE_LOOKS:
                limit = b"scratch"
        if limit:
            os.write(status_fd, b"exceeded %s\n" % limit)
            end_all(os.getpid())
            return
        pause_s = max(WATCH_S, (time.monotonic() - began_s) / WATCH_SHARE)
        signal.setitimer(signal.ITIMER_REAL, pause_s)

    # A timer of this process: what the agent does cannot keep it from looking.
    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, WATCH_S)


class TooDeep(Exception):
    """There are more than MAX_FOLDER_DEPTH folders in one another."""


def used_bytes(folder: str, root: int, enough: int) -> int:
    """What a folder takes of its disk, with deleted files that processes below `root` hold open.

    Stops counting past `enough`. Raises as `statuses_in` does.
    """
    seen: set[int] = set()
    total = 0
    with closing(statuses_in(folder)) as statuses:
        for status in statuses:
            total += file_bytes(status, seen)
            if total > enough:
                return total
    device = os.stat(folder).st_dev
    for status in open_files(root):
        if status.st_nlink == 0 and status.st_dev == device and stat.S_ISREG(status.st_mode):
            total += file_bytes(status, seen)
    return total


def statuses_in(folder: str) -> Generator[os.stat_result]:
    """Everything in a folder and the folders in it. Follows no link, wherever one appears meanwhile.

    Raises OSError for a folder that cannot be read, and TooDeep.
    """
    # Descriptors from the top down, and for each the names of the folders in it that are still to be entered.
    held: list[int] = []
    names = [[folder]]
    try:
        while names:
            if not names[-1]:
                names.pop()
                if held:
                    os.close(held.pop())
                continue
            if len(held) > MAX_FOLDER_DEPTH:
                raise TooDeep
            parent = held[-1] if held else None
            try:
                held.append(
                    os.open(names[-1].pop(), os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=parent)
                )
            except (FileNotFoundError, NotADirectoryError):
                if parent is None:
                    raise
                continue
            names.append([])
            with os.scandir(held[-1]) as entries:
                for entry in entries:
                    with suppress(FileNotFoundError):
                        status = entry.stat(follow_symlinks=False)
                        if stat.S_ISDIR(status.st_mode):
                            names[-1].append(entry.name)
                        yield status
    finally:
        for descriptor in held:
            os.close(descriptor)


def file_bytes(status: os.stat_result, seen: set[int]) -> int:
    """What a file takes of its disk; nothing for one that was counted already under another name."""
    if status.st_ino in seen:
        return 0
    seen.add(status.st_ino)
    # POSIX leaves the unit of st_blocks open; on Linux it is 512 bytes.
    return max(LEAST_FILE_BYTES, status.st_blocks * 512)


def open_files(root: int) -> Iterator[os.stat_result]:
    """Files that processes below `root` hold open, as far as they show."""
    waiting = children_of(root)
    while waiting:
        pid = waiting.pop()
        waiting += children_of(pid)
        # Another process may end, or close the file, at any moment; a process may hide its files from its own user.
        with suppress(OSError):
            for name in os.listdir(f"/proc/{pid}/fd"):
                with suppress(OSError):
                    yield os.stat(f"/proc/{pid}/fd/{name}")


def children_of(pid: int) -> list[int]:
    """The children of a process, by the kernel's list for each thread: a tenth of the cost of a look through /proc."""
    children: list[int] = []
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            with suppress(OSError), open(f"/proc/{pid}/task/{task}/children", encoding="ascii") as file:
                children += map(int, file.read().split())
    return children


def end_all(root: int) -> None:
    """Kill everything below `root`, again and again: what is killed last may have started more."""
    while pids := descendants(root):
        for pid in pids:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.001)


def descendants(root: int) -> list[int]:
    """Living processes below `root`."""
    children: dict[int, list[int]] = {}
    for entry in os.scandir("/proc"):
        with suppress(OSError, ValueError):
            pid = int(entry.name)
            with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:
                fields = file.read().rpartition(")")[2].split()
            if fields[0] not in "ZX":
                children.setdefault(int(fields[1]), []).append(pid)
    below, waiting = [], [root]
    while waiting:
        pids = children.get(waiting.pop(), [])
        below += pids
        waiting += pids
    return below


if __name__ == "__main__":
    main()
