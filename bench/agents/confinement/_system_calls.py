"""The system calls that no agent has business with, as a seccomp filter.

A list of what is denied and not of what is allowed, as Docker's profile is in effect: agents are arbitrary
programs. The filter is written here because libseccomp's Python bindings are not on the package index, and
the programs of classic BPF that it needs are short (linux/filter.h, linux/seccomp.h).
"""

from __future__ import annotations

import errno
import platform
import struct
from typing import Any

# Numbers from asm/unistd_64.h and, for the others, asm-generic/unistd.h.
_NUMBERS: dict[str, dict[str, int]] = {
    "x86_64": {
        "shmget": 29, "msgget": 68, "semget": 64, "mq_open": 240,
        "clone": 56, "clone3": 435, "socket": 41, "socketpair": 53, "ioctl": 16, "fcntl": 72,
        "chmod": 90, "chown": 92, "fchmod": 91, "fchmodat": 268, "fchmodat2": 452, "fchown": 93, "fchownat": 260,
        "file_setattr": 469, "fremovexattr": 199, "fsetxattr": 190, "futimesat": 261, "lchown": 94,
        "lremovexattr": 198, "lsetxattr": 189, "removexattr": 197, "removexattrat": 466, "setxattr": 188,
        "setxattrat": 463, "utime": 132, "utimensat": 280, "utimes": 235,
        "acct": 163, "add_key": 248, "adjtimex": 159, "bpf": 321, "chroot": 161, "clock_adjtime": 305,
        "clock_settime": 227, "delete_module": 176, "finit_module": 313, "fsconfig": 431, "fsmount": 432,
        "fsopen": 430, "fspick": 433, "init_module": 175, "io_uring_enter": 426, "io_uring_register": 427,
        "io_uring_setup": 425, "ioperm": 173, "iopl": 172, "kcmp": 312, "kexec_file_load": 320,
        "kexec_load": 246, "keyctl": 250, "lookup_dcookie": 212, "mount": 165, "mount_setattr": 442,
        "move_mount": 429, "name_to_handle_at": 303, "open_by_handle_at": 304, "open_tree": 428,
        "perf_event_open": 298, "personality": 135, "pidfd_getfd": 438, "pivot_root": 155,
        "process_madvise": 440, "process_vm_readv": 310, "process_vm_writev": 311, "ptrace": 101,
        "quotactl": 179, "reboot": 169, "request_key": 249, "setdomainname": 171, "sethostname": 170,
        "setns": 308, "settimeofday": 164, "swapoff": 168, "swapon": 167, "syslog": 103, "umount2": 166,
        "unshare": 272, "userfaultfd": 323, "vhangup": 153,
    },
    "aarch64": {
        "shmget": 194, "msgget": 186, "semget": 190, "mq_open": 180,
        "clone": 220, "clone3": 435, "socket": 198, "socketpair": 199, "ioctl": 29, "fcntl": 25,
        "fchmod": 52, "fchmodat": 53, "fchmodat2": 452, "fchown": 55, "fchownat": 54, "file_setattr": 469,
        "fremovexattr": 16, "fsetxattr": 7, "lremovexattr": 15, "lsetxattr": 6, "removexattr": 14,
        "removexattrat": 466, "setxattr": 5, "setxattrat": 463, "utimensat": 88,
        "acct": 89, "add_key": 217, "adjtimex": 171, "bpf": 280, "chroot": 51, "clock_adjtime": 266,
        "clock_settime": 112, "delete_module": 106, "finit_module": 273, "fsconfig": 431, "fsmount": 432,
        "fsopen": 430, "fspick": 433, "init_module": 105, "io_uring_enter": 426, "io_uring_register": 427,
        "io_uring_setup": 425, "kcmp": 272, "kexec_file_load": 294, "kexec_load": 104, "keyctl": 219,
        "lookup_dcookie": 18, "mount": 40, "mount_setattr": 442, "move_mount": 429,
        "name_to_handle_at": 264, "open_by_handle_at": 265, "open_tree": 428, "perf_event_open": 241,
        "personality": 92, "pidfd_getfd": 438, "pivot_root": 41, "process_madvise": 440,
        "process_vm_readv": 270, "process_vm_writev": 271, "ptrace": 117, "quotactl": 60, "reboot": 142,
        "request_key": 218, "setdomainname": 162, "sethostname": 161, "setns": 268, "settimeofday": 170,
        "swapoff": 225, "swapon": 224, "syslog": 116, "umount2": 39, "unshare": 97, "userfaultfd": 282,
        "vhangup": 58,
    },
}  # fmt: skip
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
    if machine not in _NUMBERS:
        raise NotImplementedError(f"there is no system call filter for {machine} processors")
    numbers = _NUMBERS[machine]
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
    if machine not in _NUMBERS:
        raise NotImplementedError(f"there is no system call filter for {machine} processors")
    refused = [name for name in sorted(_NUMBERS[machine]) if name not in _NAMED_BELOW]
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
