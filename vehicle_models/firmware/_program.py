"""The process of an autopilot: started in a folder of its own, killed with all that it started."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from bench.errors import FirmwareFault

from . import _launch

CONSOLE_FILE = "console.log"
# Host seconds between SIGTERM and SIGKILL; both autopilots end at once.
_GRACE_S = 2.0
_TAIL_BYTES, _TAIL_LINES = 2000, 6


class FirmwareProgram:
    """One running autopilot. `folder` holds all that it writes, `console.log` what it prints."""

    def __init__(self, name: str, process: subprocess.Popen[bytes], folder: Path) -> None:
        self.name, self.folder = name, folder
        self._process = process

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
            lines = (
                (self.folder / CONSOLE_FILE).read_bytes()[-_TAIL_BYTES:].decode(errors="replace").splitlines()
            )
            if lines:
                return f"; its console ends with: {' | '.join(lines[-_TAIL_LINES:])}"
        return ""


@contextmanager
def open_program(
    name: str,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    cores: frozenset[int] = frozenset(),
) -> Generator[FirmwareProgram]:
    """Start a command in `folder`, which is its HOME too; leaving the block kills its process group and whatever left it."""
    environment = {"LANG": "C.UTF-8", **environment, "HOME": str(folder)}
    launch = [_launch.__file__, str(os.getpid()), ",".join(map(str, sorted(cores))) or "-"]
    with (folder / CONSOLE_FILE).open("wb") as console:
        process = subprocess.Popen(
            [sys.executable, "-I", "-S", *launch, *command],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=console,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        yield FirmwareProgram(name, process, folder)
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
    # PX4's start script and modules are one group; what made a session of its own is known by its HOME.
    for pid in _processes_with_home(folder):
        with suppress(ProcessLookupError, PermissionError):
            os.kill(pid, signal.SIGKILL)


def _processes_with_home(folder: Path) -> Iterator[int]:
    wanted = f"HOME={folder}".encode()
    for entry in os.scandir("/proc"):
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            with suppress(OSError):
                if wanted in Path(entry.path, "environ").read_bytes().split(b"\0"):
                    yield int(entry.name)
