"""Namespaces and a root folder of an agent's own, made by the launcher of a landlocked agent; the standard library alone.

What an agent may not see is not there: a program that looks for an optional file finds none, as on a machine without it.
"""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

# From <linux/sched.h>.
CLONE_NEWNS, CLONE_NEWCGROUP, CLONE_NEWUTS, CLONE_NEWIPC = 0x20000, 0x2000000, 0x4000000, 0x8000000
CLONE_NEWUSER, CLONE_NEWPID = 0x10000000, 0x20000000
# From <linux/mount.h>.
MS_RDONLY, MS_NOSUID, MS_NODEV, MS_NOEXEC, MS_BIND, MS_REC, MS_PRIVATE = 1, 2, 4, 8, 4096, 16384, 1 << 18
MOUNT_ATTR_RDONLY, MOUNT_ATTR_NOSUID, MOUNT_ATTR_NODEV = 1, 2, 4
AT_FDCWD, AT_RECURSIVE, MNT_DETACH = -100, 0x8000, 2
# The numbers are the same on all processors; mount_setattr is as old as Landlock, Linux 5.12 and 5.13.
MOUNT_SETATTR = 442
PIVOT_ROOT = {"x86_64": 155, "aarch64": 41}
HOST_NAME = b"agent"
# Where the root is put together: a folder of every Linux system, which the mounts hide from this process alone.
NEW_ROOT = "/tmp"
# Each file of a tmpfs takes memory of the kernel that its size does not count; as many as the quota of the smallest
# files that the watch of a folder on a disk allows.
INODE_BYTES = 4096

libc = ctypes.CDLL(None, use_errno=True)


def enter_namespaces() -> None:
    """Namespaces of this process's own for all but the network and, for its children, for processes. Raises OSError."""
    uid, gid = os.getuid(), os.getgid()
    kinds = CLONE_NEWPID
    if uid != 0:
        kinds |= CLONE_NEWUSER
    _check("unshare", libc.unshare(kinds))
    if uid != 0:
        # The kernel asks for setgroups to be denied before an ordinary user maps a group.
        for name, text in (
            ("setgroups", "deny"),
            ("uid_map", f"{uid} {uid} 1"),
            ("gid_map", f"{gid} {gid} 1"),
        ):
            with open(f"/proc/self/{name}", "w", encoding="ascii") as file:
                file.write(text)


def enter_root(settings: Mapping[str, Any]) -> None:
    """Leave the root of the host for one of this process's own. For the first process of a namespace of processes.

    `settings` are those of `_landlock_launch`. Raises OSError.
    """
    _check("unshare", libc.unshare(CLONE_NEWNS | CLONE_NEWIPC | CLONE_NEWUTS | CLONE_NEWCGROUP))
    libc.sethostname(HOST_NAME, len(HOST_NAME))
    os.umask(0o022)
    size = settings["scratch_bytes"]
    root = _Root(f"size={size},nr_inodes={size // INODE_BYTES}")
    root.add_system(settings["system"])
    root.add_devices(settings["devices"])
    # After /tmp, because they may lie in there.
    for path in settings["mounted"]:
        root.add_readable(path)
    for name, text in settings["etc"].items():
        root.add_text(f"/etc/{name}", text)
    for path, inside in settings["files"].items():
        root.add_readable(path, inside)
    for path, inside in settings["shared"].items():
        root.add_file(path, inside)
    root.enter()


class _Root:
    """The new root while it is put together at NEW_ROOT; paths are those of the host and of the root."""

    def __init__(self, quota: str) -> None:
        self._quota = quota
        # Nothing of what follows shows outside, whatever the host shares.
        _mount(None, "/", None, MS_REC | MS_PRIVATE)
        # Sources may lie in the folder that the new root is about to cover.
        self._covered = os.open(NEW_ROOT, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        _mount("root", NEW_ROOT, "tmpfs", MS_NOSUID | MS_NODEV, f"mode=755,{quota}")

    def add_system(self, folders: Iterable[str]) -> None:
        """Programs and libraries, and the links to them at the root of today's distributions."""
        for folder in folders:
            if os.path.islink(folder):
                os.symlink(os.readlink(folder), NEW_ROOT + folder)
            elif os.path.isdir(folder):
                self.add_readable(folder)

    def add_devices(self, devices: Iterable[str]) -> None:
        """/proc of the new processes, harmless devices, and folders in memory that share one quota each."""
        self._tmpfs("/dev", "mode=755,size=64k")
        names = ("null", "zero", "full", "random", "urandom")
        for path in (*(f"/dev/{name}" for name in names), *devices):
            if place := self.add_file(path):
                # Devices are written all the same; what cannot be changed are the modes and owners of the host's.
                _set_attributes(place, MOUNT_ATTR_RDONLY, recursive=True)
        for name, target in (
            ("fd", "self/fd"),
            ("stdin", "self/fd/0"),
            ("stdout", "self/fd/1"),
            ("stderr", "self/fd/2"),
        ):
            os.symlink(f"/proc/{target}", f"{NEW_ROOT}/dev/{name}")
        os.makedirs(f"{NEW_ROOT}/dev/pts")
        _mount(
            "devpts",
            f"{NEW_ROOT}/dev/pts",
            "devpts",
            MS_NOSUID | MS_NOEXEC,
            "newinstance,ptmxmode=0666,mode=620",
        )
        os.symlink("pts/ptmx", f"{NEW_ROOT}/dev/ptmx")
        self._tmpfs("/dev/shm", f"mode=1777,{self._quota}")
        _set_attributes(f"{NEW_ROOT}/dev", MOUNT_ATTR_RDONLY, recursive=False)
        self._tmpfs("/tmp", f"mode=1777,{self._quota}")
        self._tmpfs("/scratch", f"mode=1777,{self._quota}")
        os.makedirs(f"{NEW_ROOT}/proc")
        _mount("proc", f"{NEW_ROOT}/proc", "proc", MS_NOSUID | MS_NODEV | MS_NOEXEC)
        # The kernel lets its root user write /proc/sys without any capability.
        _set_attributes(f"{NEW_ROOT}/proc", MOUNT_ATTR_RDONLY, recursive=True)

    def add_readable(self, path: str, inside: str | None = None) -> None:
        """A file or a folder, with all that is mounted in it, that nobody can change."""
        if place := self.add_file(path, inside):
            _set_attributes(place, MOUNT_ATTR_RDONLY | MOUNT_ATTR_NOSUID | MOUNT_ATTR_NODEV, recursive=True)

    def add_file(self, path: str, inside: str | None = None) -> str | None:
        """A file or a folder, as the host lets this process use it; its place. None where the host has none."""
        return self._bind(self._source(path), inside or path)

    def add_text(self, path: str, text: str) -> None:
        """A file with this content, also where its folder is one of the host's."""
        content = f"{NEW_ROOT}/{os.path.basename(path)}"
        with open(content, "w", encoding="utf-8") as file:
            file.write(text)
        # A folder of the host's that lacks the file cannot be given one.
        with suppress(OSError):
            self._bind(content, path)
        os.unlink(content)

    def enter(self) -> None:
        """Make it the root of this process, read-only, and let go of the host's."""
        _set_attributes(NEW_ROOT, MOUNT_ATTR_RDONLY, recursive=False)
        os.chdir(NEW_ROOT)
        # Onto itself: the old root then lies over the new one, and goes (pivot_root(2), notes).
        _check("pivot_root", libc.syscall(PIVOT_ROOT[os.uname().machine], b".", b"."))
        _check("umount", libc.umount2(b".", MNT_DETACH))
        os.chdir("/")
        os.close(self._covered)

    def _bind(self, source: str, path: str) -> str | None:
        if not os.path.exists(source):
            return None
        place = NEW_ROOT + path
        if not os.path.exists(place):
            os.makedirs(place if os.path.isdir(source) else os.path.dirname(place), exist_ok=True)
        if not os.path.exists(place):
            os.close(os.open(place, os.O_CREAT | os.O_CLOEXEC, 0o644))
        _mount(source, place, None, MS_BIND | MS_REC)
        return place

    def _source(self, path: str) -> str:
        """The host's file, also where the new root hides its folder."""
        if path == NEW_ROOT or path.startswith(f"{NEW_ROOT}/"):
            return f"/proc/self/fd/{self._covered}{path.removeprefix(NEW_ROOT)}"
        return path

    def _tmpfs(self, path: str, options: str) -> None:
        os.makedirs(NEW_ROOT + path, exist_ok=True)
        _mount("tmpfs", NEW_ROOT + path, "tmpfs", MS_NOSUID | MS_NODEV, options)


def _mount(source: str | None, target: str, kind: str | None, flags: int, options: str | None = None) -> None:
    words = [None if word is None else os.fsencode(word) for word in (source, target, kind)]
    result = libc.mount(*words, ctypes.c_ulong(flags), None if options is None else options.encode())
    _check(f"mount {target.removeprefix(NEW_ROOT) or '/'}", result)


def _set_attributes(path: str, attributes: int, *, recursive: bool) -> None:
    # struct mount_attr: set, clear, propagation, userns_fd. Adding alone: what the host has locked stays.
    wanted = struct.pack("=QQQQ", attributes, 0, 0, 0)
    flags = AT_RECURSIVE if recursive else 0
    result = libc.syscall(MOUNT_SETATTR, AT_FDCWD, os.fsencode(path), flags, wanted, len(wanted))
    _check(f"mount_setattr {path.removeprefix(NEW_ROOT)}", result)


def _check(what: str, result: int) -> None:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
