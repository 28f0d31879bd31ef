"""The system calls that no agent has business with, as a seccomp filter.

A list of what is denied and not of what is allowed, as Docker's profile is in effect: agents are arbitrary
programs. The filter is written here because libseccomp's Python bindings are not on the package index, and
the programs of classic BPF that it needs are short (linux/filter.h, linux/seccomp.h).
"""

from __future__ import annotations

import errno
import json
import platform
import struct
from pathlib import Path
from typing import Any

_NUMBERS = Path(__file__).with_name("system_calls.json")
# AUDIT_ARCH_* of linux/audit.h.
_ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
_ENGINE_NAMES = {"x86_64": "SCMP_ARCH_X86_64", "aarch64": "SCMP_ARCH_AARCH64"}
_SHARED_MEMORY = ("shmget", "msgget", "semget", "mq_open")
# Of every file of the agent's user Landlock allows these: modes, owners, times, extended attributes.
_ATTRIBUTES = (
    *("chmod", "chown", "fchmod", "fchmodat", "fchmodat2", "fchown", "fchownat", "file_setattr"),
    *("fremovexattr", "fsetxattr", "futimesat", "lchown", "lremovexattr", "lsetxattr", "removexattr"),
    *("removexattrat", "setxattr", "setxattrat", "utime", "utimensat", "utimes"),
)
_NAMED_BELOW = frozenset(
    {"clone", "clone3", "socket", "socketpair", "ioctl", "fcntl", *_SHARED_MEMORY, *_ATTRIBUTES}
)
# AF_UNIX, AF_INET, AF_INET6, AF_NETLINK (getifaddrs asks by it). Not vsock, which reaches the hypervisor
# through any network namespace, and not packet, alg, xdp or bluetooth.
_SOCKET_FAMILIES = (1, 2, 10, 16)
# CLONE_NEWNS, NEWCGROUP, NEWUTS, NEWIPC, NEWUSER, NEWPID, NEWNET
_NEW_NAMESPACES = 0x20000 | 0x2000000 | 0x4000000 | 0x8000000 | 0x10000000 | 0x20000000 | 0x40000000
# What a terminal would take for typed; and, of a file that the agent may only read, its flags (FS_IOC_SETFLAGS,
# FS_IOC_FSSETXATTR) and that nobody writes it ever again (FS_IOC_ENABLE_VERITY).
_REFUSED_IOCTLS = (0x5412, 0x40086602, 0x401C5820, 0x40806685)
# F_SETLEASE and F_SETDELEG: whoever opens the file waits, up to /proc/sys/fs/lease-break-time (45 s).
_REFUSED_FCNTLS = (1024, 1040)

_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_ALLOW, _KILL_PROCESS, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
# Places in struct seccomp_data; arguments by their lower half, which is all that these calls use.
_NUMBER, _ARCHITECTURE, _ARGUMENT_0, _ARGUMENT_1 = 0, 4, 16, 24
# On x86-64 the numbers of the x32 calls start here: the same calls by other numbers.
_X32 = 0x40000000


def filter_program(*, shares_ipc: bool, shares_files: bool = False, machine: str = "") -> bytes:
    """The filter for this machine (`platform.machine()`), as an array of struct sock_filter.

    With `shares_ipc`, System V and POSIX queues and shared memory are denied too: for rungs without an IPC
    namespace. With `shares_files`, the attributes of files cannot be changed: for an agent that is the bench's user in the
    bench's root. Raises NotImplementedError for a machine whose calls are not listed.
    """
    machine = machine or platform.machine()
    numbers = _numbers(machine)
    program = [
        (_LOAD, 0, 0, _ARCHITECTURE),
        (_EQUAL, 1, 0, _ARCHITECTURES[machine]),
        (_RETURN, 0, 0, _KILL_PROCESS),
        (_LOAD, 0, 0, _NUMBER),
    ]
    if machine == "x86_64":
        program += [(_AT_LEAST, 0, 1, _X32), _refuse(errno.ENOSYS)]
    denied = [name for name in sorted(numbers) if name not in _NAMED_BELOW]
    denied += _SHARED_MEMORY if shares_ipc else ()
    denied += (name for name in _ATTRIBUTES if shares_files and name in numbers)
    for name in denied:
        program += [(_EQUAL, 0, 1, numbers[name]), _refuse(errno.EPERM)]
    # The flags of clone3 lie in memory, where a filter cannot look; libraries then fall back to clone.
    program += [(_EQUAL, 0, 1, numbers["clone3"]), _refuse(errno.ENOSYS)]
    program += [
        (_EQUAL, 0, 4, numbers["clone"]),
        (_LOAD, 0, 0, _ARGUMENT_0),
        (_ANY_BIT, 0, 1, _NEW_NAMESPACES),
        _refuse(errno.EPERM),
        (_RETURN, 0, 0, _ALLOW),
    ]
    for name in ("socket", "socketpair"):
        count = len(_SOCKET_FAMILIES)
        program += [(_EQUAL, 0, count + 3, numbers[name]), (_LOAD, 0, 0, _ARGUMENT_0)]
        program += [(_EQUAL, count - index, 0, family) for index, family in enumerate(_SOCKET_FAMILIES)]
        program += [_refuse(errno.EAFNOSUPPORT), (_RETURN, 0, 0, _ALLOW)]
    for name, refused in (("ioctl", _REFUSED_IOCTLS), ("fcntl", _REFUSED_FCNTLS)):
        count = len(refused)
        program += [(_EQUAL, 0, count + 3, numbers[name]), (_LOAD, 0, 0, _ARGUMENT_1)]
        program += [(_EQUAL, count - index, 0, value) for index, value in enumerate(refused)]
        program += [(_RETURN, 0, 0, _ALLOW), _refuse(errno.EPERM)]
    program.append((_RETURN, 0, 0, _ALLOW))
    return b"".join(struct.pack("=HBBI", *instruction) for instruction in program)


def engine_profile(machine: str = "") -> dict[str, Any]:
    """The same filter in the form that container engines take, with an IPC namespace of the container's own.

    JSON as in the OCI runtime specification, `linux.seccomp`. A rule there compares an argument once, so what the
    filter above allows by name is here refused by its complement. Raises as `filter_program` does.
    """
    machine = machine or platform.machine()
    refused = [name for name in sorted(_numbers(machine)) if name not in _NAMED_BELOW]
    rules = [_rule(refused, errno.EPERM), _rule(["clone3"], errno.ENOSYS)]
    bits = [1 << bit for bit in range(32) if _NEW_NAMESPACES >> bit & 1]
    rules += [_rule(["clone"], errno.EPERM, 0, "SCMP_CMP_MASKED_EQ", bit, bit) for bit in bits]
    sockets = ["socket", "socketpair"]
    last = max(_SOCKET_FAMILIES)
    others = [family for family in range(last) if family not in _SOCKET_FAMILIES]
    rules += [_rule(sockets, errno.EAFNOSUPPORT, 0, "SCMP_CMP_EQ", family) for family in others]
    rules.append(_rule(sockets, errno.EAFNOSUPPORT, 0, "SCMP_CMP_GT", last))
    for call, numbers in (("ioctl", _REFUSED_IOCTLS), ("fcntl", _REFUSED_FCNTLS)):
        # The kernel looks at the lower half of this argument alone.
        rules += [
            _rule([call], errno.EPERM, 1, "SCMP_CMP_MASKED_EQ", 0xFFFFFFFF, number) for number in numbers
        ]
    return {"defaultAction": "SCMP_ACT_ALLOW", "architectures": [_ENGINE_NAMES[machine]], "syscalls": rules}


def _numbers(machine: str) -> dict[str, int]:
    """By name, from asm/unistd_64.h and, for the other machine, asm-generic/unistd.h."""
    numbers: dict[str, dict[str, int]] = json.loads(_NUMBERS.read_text("ascii"))
    if machine not in numbers:
        raise NotImplementedError(f"there is no system call filter for {machine} processors")
    return numbers[machine]


def _rule(
    names: list[str], number: int, argument: int = 0, operator: str = "", value: int = 0, compared: int = 0
) -> dict[str, Any]:
    """A refusal with an error number; `compared` is what a masked argument is compared with."""
    test = {"index": argument, "op": operator, "value": value, "valueTwo": compared}
    return {
        "names": names,
        "action": "SCMP_ACT_ERRNO",
        "errnoRet": number,
        "args": [test] if operator else [],
    }


def _refuse(number: int) -> tuple[int, int, int, int]:
    return (_RETURN, 0, 0, _ERRNO | number)
