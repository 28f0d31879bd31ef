"""The process of an autopilot: started in a folder of its own, killed with all that it started."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from bench import network_namespace
from bench.errors import FirmwareFault

from . import _launch

CONSOLE_FILE = "console.log"
# Host seconds between SIGTERM and SIGKILL; both autopilots end at once.
_GRACE_S = 2.0
_TAIL_BYTES, _TAIL_LINES = 2000, 6


class FirmwareProgram:
    """One autopilot, which waits to be `run`. `folder` holds all that it writes, `console.log` what it prints.

    `network_fault` is why it shares the bench's network; empty where it has one of its own, in which `new_socket` makes
    the bench's sockets then.
    """

    def __init__(
        self, name: str, process: subprocess.Popen[bytes], folder: Path, launcher: socket.socket, sockets: str
    ) -> None:
        self.name, self.folder = name, folder
        self._process, self._launcher = process, launcher
        message, descriptors, _, _ = socket.recv_fds(launcher, _launch.MESSAGE_BYTES, len(sockets))
        if not message:
            process.wait()
            self.check_alive()
        self.network_fault: str = json.loads(message)
        made = [socket.socket(fileno=descriptor) for descriptor in descriptors]
        self._sockets = {
            kind: [candidate for candidate in made if candidate.type == kind]
            for kind in _launch.KINDS.values()
        }

    def new_socket(self, kind: socket.SocketKind) -> socket.socket:
        """An unbound IPv4 socket on the autopilot's network."""
        return socket.socket(socket.AF_INET, kind) if self.network_fault else self._sockets[kind].pop()

    def run(self, command: Sequence[str], cores: frozenset[int] = frozenset()) -> None:
        """Start the program itself, on these cores where there are some."""
        request = {"command": list(command), "cores": sorted(cores)}
        self._launcher.send(json.dumps(request).encode())

    @property
    def pid(self) -> int:
        return self._process.pid

    def check_alive(self) -> None:
        """Raise FirmwareFault when the program has ended, with its last words."""
        code = self._process.poll()
        if code is not None:
            cause = f"exit code {code}" if code >= 0 else signal.Signals(-code).name
            raise FirmwareFault(f"{self.name} ended with {cause}{self.last_words()}")

    def last_words(self) -> str:
        """The end of its console, for an error."""
        with suppress(OSError):
            console = (self.folder / CONSOLE_FILE).read_bytes()[-_TAIL_BYTES:]
            lines = console.decode(errors="replace").splitlines()
            if lines:
                return f"; its console ends with: {' | '.join(lines[-_TAIL_LINES:])}"
        return ""

    def close(self) -> None:
        """Close what nobody took."""
        for unused in (*self._sockets[socket.SOCK_STREAM], *self._sockets[socket.SOCK_DGRAM]):
            unused.close()


@contextmanager
def open_program(
    name: str, folder: Path, environment: Mapping[str, str], sockets: str
) -> Generator[FirmwareProgram]:
    """Prepare a program in `folder`, which is its HOME too, with sockets for the bench (a letter each, see `_launch`).

    Leaving the block kills its process group and whatever left it.
    """
    environment = {"LANG": "C.UTF-8", **environment, "HOME": str(folder)}
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    launch = [_launch.__file__, str(os.getpid()), str(theirs.fileno()), network_namespace.__file__, sockets]
    with ours:
        with theirs, (folder / CONSOLE_FILE).open("wb") as console:
            process = subprocess.Popen(
                [sys.executable, "-I", "-S", *launch],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        try:
            program = FirmwareProgram(name, process, folder, ours, sockets)
            try:
                yield program
            finally:
                program.close()
        finally:
            _end(process, folder)


def _end(process: subprocess.Popen[bytes], folder: Path) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGTERM)
    deadline_s = time.monotonic() + _GRACE_S
    while process.poll() is None and time.monotonic() < deadline_s:
        time.sleep(0.002)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    # PX4's start script and modules are one group; what made a session of its own is known by its HOME. Such a process is
    # somebody else's child, so its end cannot be waited for, only looked for.
    deadline_s = time.monotonic() + _GRACE_S
    while (pids := list(_processes_with_home(folder))) and time.monotonic() < deadline_s:
        for pid in pids:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.002)


def _processes_with_home(folder: Path) -> Iterator[int]:
    wanted = f"HOME={folder}".encode()
    for entry in os.scandir("/proc"):
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            with suppress(OSError):
                if wanted in Path(entry.path, "environ").read_bytes().split(b"\0"):
                    yield int(entry.name)
