"""A network of a process's own: one loopback and nothing else, so that an agent in it reaches its session and nobody.

Standard library alone, and imported before anything else of ours: a process can leave its user namespace only while it
has one thread, and numpy starts threads when it is imported.
"""

from __future__ import annotations

import array
import ctypes
import fcntl
import os
import socket
import struct
import sys
from contextlib import suppress

# From <linux/sched.h>.
_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000
# From <linux/sockios.h> and <linux/if.h>: set the flags of an interface; up and running.
_SIOCSIFFLAGS, _IFF_UP_RUNNING = 0x8914, 0x1 | 0x40
# From <linux/prctl.h> and <linux/capability.h>.
_PR_SET_PDEATHSIG, _PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL, _SIGKILL = 1, 47, 4, 9
_KINDS = {b"d": socket.SOCK_DGRAM, b"s": socket.SOCK_STREAM}
_DESCRIPTOR_BYTES = array.array("i").itemsize

# The way to the helper process that stayed outside; None while this process is on the host's network itself.
_outside: socket.socket | None = None
_fault: str | None = "nothing has asked for one"


def enter_network_namespace() -> str | None:
    """Move this process into a network namespace of its own. Returns why that is not possible here; None if done.

    Without root a user namespace comes first, in which the process keeps its user id and can reach the files that it
    could reach before. A small helper process stays outside and makes sockets for `outside_socket`; it ends with this
    process. Costs some 5 ms.
    """
    global _outside, _fault
    if not sys.platform.startswith("linux"):
        _fault = "only Linux has network namespaces"
        return _fault
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    parent = os.getpid()
    helper = os.fork()
    if helper == 0:
        # Never back into the caller's code, whatever happens here.
        try:
            ours.close()
            _serve_sockets(theirs, parent)
        finally:
            os._exit(0)
    theirs.close()
    try:
        _unshare()
        _raise_loopback()
    except OSError as error:
        ours.close()
        os.waitpid(helper, 0)
        _fault = f"{error.strerror or error}"
        return _fault
    _outside, _fault = ours, None
    return None


def namespace_fault() -> str | None:
    """Why this process shares the host's network; None when it has one of its own."""
    return _fault


def outside_socket(kind: socket.SocketKind) -> socket.socket:
    """A new, unbound IPv4 socket on the host's network: for what the SimSpec lets look on from outside.

    Raises OSError when the helper process outside is gone.
    """
    if _outside is None:
        return socket.socket(socket.AF_INET, kind)
    _outside.send(next(code for code, known in _KINDS.items() if known is kind))
    _, ancillary, _, _ = _outside.recvmsg(1, socket.CMSG_SPACE(_DESCRIPTOR_BYTES))
    for level, type_, data in ancillary:
        if (level, type_) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
            return socket.socket(fileno=struct.unpack("i", data[:_DESCRIPTOR_BYTES])[0])
    raise OSError("the process that opens sockets on the host's network is gone")


def _serve_sockets(requests: socket.socket, parent: int) -> None:
    """Answer each request with a socket, until the other end is closed."""
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_PDEATHSIG, _SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        return
    # The parent may hold pipes whose end others wait for: this process keeps none of them open.
    with suppress(OSError):
        os.closerange(3, requests.fileno())
        os.closerange(requests.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
    while kind := requests.recv(1):
        with socket.socket(socket.AF_INET, _KINDS[kind]) as made:
            rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [made.fileno()]))]
            requests.sendmsg([b"!"], rights)


def _unshare() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    uid, gid = os.getuid(), os.getgid()
    flags = _CLONE_NEWNET if uid == 0 else _CLONE_NEWUSER | _CLONE_NEWNET
    if libc.unshare(flags):
        number = ctypes.get_errno()
        raise OSError(number, f"the system gives this user no network namespace ({os.strerror(number)})")
    if uid == 0:
        return
    # The kernel asks for setgroups to be denied before an ordinary user maps a group.
    for name, text in (("setgroups", "deny"), ("uid_map", f"{uid} {uid} 1"), ("gid_map", f"{gid} {gid} 1")):
        with open(f"/proc/self/{name}", "w") as file:
            file.write(text)


def _raise_loopback() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        fcntl.ioctl(probe, _SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", _IFF_UP_RUNNING))
    # Capabilities of the user namespace would let a child move interfaces; the permitted ones go with its exec.
    ctypes.CDLL(None).prctl(_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0)
