"""A network of a process's own: one loopback and nothing else, so that an agent in it reaches its session and nobody.

Standard library alone, and imported before anything else of ours: a process can leave its user namespace only while it
has one thread, and numpy starts threads when it is imported.
"""

from __future__ import annotations

import array
import ctypes
import fcntl
import json
import os
import signal
import socket
import struct
import sys
from collections.abc import Sequence
from contextlib import suppress

# From <linux/sched.h>.
_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000
# From <linux/sockios.h> and <linux/if.h>: set the flags of an interface; up and running.
_SIOCSIFFLAGS, _IFF_UP_RUNNING = 0x8914, 0x1 | 0x40
# From <linux/prctl.h> and <linux/capability.h>.
_PR_SET_PDEATHSIG, _PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL, _SIGKILL = 1, 47, 4, 9
_KINDS = {b"d": socket.SOCK_DGRAM, b"s": socket.SOCK_STREAM}
_DESCRIPTOR_BYTES = array.array("i").itemsize
# Of one request to the helper process: a command as JSON, and descriptors (the kernel takes 253 at most).
_REQUEST_BYTES, _REQUEST_DESCRIPTORS = 65536, 64
_DONE = b"!"
_GONE = "the process that opens sockets on the host's network is gone"

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
        unshare_network()
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
    raise OSError(_GONE)


def start_outside(command: Sequence[str], descriptors: Sequence[int]) -> int | None:
    """Start a program on the host's network, with an empty environment and copies of the descriptors, whose numbers are
    its last arguments.

    Returns its process id where this process has to wait for its end; None where the helper process does. Nothing ends
    it but itself, so it should end when a descriptor shows that this process is gone. Raises OSError.
    """
    if _outside is None:
        return _spawn(command, [os.dup(descriptor) for descriptor in descriptors])
    socket.send_fds(_outside, [json.dumps(list(command)).encode()], descriptors)
    answer = _outside.recv(_REQUEST_BYTES)
    if answer != _DONE:
        raise OSError(answer.decode() or _GONE)
    return None


def _serve_sockets(requests: socket.socket, parent: int) -> None:
    """Answer each request with a socket, or with the start of a program, until the other end is closed."""
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_PDEATHSIG, _SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        return
    # The parent may hold pipes whose end others wait for: this process keeps none of them open.
    with suppress(OSError):
        os.closerange(3, requests.fileno())
        os.closerange(requests.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
    # The kernel reaps the programs: nobody here asks how they ended.
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        request, descriptors, _, _ = socket.recv_fds(requests, _REQUEST_BYTES, _REQUEST_DESCRIPTORS)
        if not request:
            return
        if request in _KINDS:
            with socket.socket(socket.AF_INET, _KINDS[request]) as made:
                socket.send_fds(requests, [_DONE], [made.fileno()])
            continue
        try:
            _spawn(json.loads(request), descriptors)
            requests.send(_DONE)
        except OSError as error:
            requests.send(str(error).encode())


def _spawn(command: Sequence[str], descriptors: Sequence[int]) -> int:
    """Start a program with these descriptors, which are closed here."""
    try:
        for descriptor in descriptors:
            os.set_inheritable(descriptor, True)
        # In a group of its own, which the terminal's Ctrl-C does not reach: its end is the session's to decide.
        return os.posix_spawn(
            command[0], [*command, *map(str, descriptors)], {}, setpgroup=0, setsigdef=[signal.SIGCHLD]
        )
    finally:
        for descriptor in descriptors:
            os.close(descriptor)


def unshare_network() -> None:
    """Give this process a network with one loopback and nothing else, and no way back. Raises OSError."""
    _unshare()
    _raise_loopback()


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
        with open(f"/proc/self/{name}", "w", encoding="ascii") as file:
            file.write(text)


def _raise_loopback() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        fcntl.ioctl(probe, _SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", _IFF_UP_RUNNING))
    # Capabilities of the user namespace would let a child move interfaces; the permitted ones go with its exec.
    ctypes.CDLL(None).prctl(_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0)
