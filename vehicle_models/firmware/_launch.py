"""Starts an autopilot's program in a network of its own, bound to the life of the bench, with bounded files.

A program of its own and no preexec_fn, because the bench has threads. It hands the bench sockets of that network, waits
for the command, and becomes it. Standard library alone. Arguments: the bench's process id, the number of the socket to
the bench, the file bench/network_namespace.py, and a letter for each wanted socket (`s` stream, `d` datagram).
"""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import resource
import signal
import socket
import sys

_PR_SET_PDEATHSIG = 1
_FILE_BYTES = 1 << 30
NOT_STARTED = 127
MESSAGE_BYTES = 1 << 16
KINDS = {"s": socket.SOCK_STREAM, "d": socket.SOCK_DGRAM}


def main() -> None:
    parent, bench = int(sys.argv[1]), socket.socket(fileno=int(sys.argv[2]))
    fault = _enter_network(sys.argv[3])
    # Behind the new network: the kernel forgets it where a process gets a new user namespace.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    # A parent that died before the line above sends no signal any more.
    if os.getppid() != parent:
        sys.exit(1)
    sockets = [] if fault else [socket.socket(socket.AF_INET, KINDS[letter]) for letter in sys.argv[4]]
    socket.send_fds(bench, [json.dumps(fault).encode()], [made.fileno() for made in sockets])
    for made in sockets:
        made.close()
    request = json.loads(bench.recv(MESSAGE_BYTES) or "null")
    if request is None:
        sys.exit(1)
    if request["cores"]:
        os.sched_setaffinity(0, request["cores"])
    resource.setrlimit(resource.RLIMIT_FSIZE, (_FILE_BYTES, _FILE_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    command = request["command"]
    try:
        os.execv(command[0], command)
    except OSError as error:
        sys.stderr.write(f"{command[0]} cannot be started: {error.strerror}\n")
        sys.exit(NOT_STARTED)


def _enter_network(module: str) -> str:
    """Why there is no network of its own here; empty when this process has one."""
    spec = importlib.util.spec_from_file_location("network_namespace", module)
    assert spec
    assert spec.loader
    namespace = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(namespace)
    if not sys.platform.startswith("linux"):
        return "only Linux has network namespaces"
    try:
        namespace.unshare_network()
    except OSError as error:
        return f"{error.strerror or error}"
    return ""


if __name__ == "__main__":
    main()
