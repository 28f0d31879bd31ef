"""The warm interpreter: has libraries loaded, and forks the launcher of a landlocked agent for each session.

Run as `python _warm_launch.py LINK_FD PARENT MODULE...`, in an environment of which nothing is the agent's.
Each request on the socket LINK_FD brings four descriptors: the settings and the status of `_landlock_launch`, the agent's
output, and one to which this process writes the launcher's id and, at its end, its wait status and CPU seconds.

It never reads the settings: the launcher does, after the fork. So nothing of a session is ever in this process, and the next
session has none of the one before. Nor does it run anything of an agent: the modules are those that the bench has loaded
itself, and the agent's own are imported after the fork, inside the walls.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import os
import runpy
import select
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

# From <linux/prctl.h>.
PR_SET_PDEATHSIG, PR_SET_DUMPABLE = 1, 4
DESCRIPTORS = 4
# More than any limit on open files that a launcher inherits from this process.
MAX_DESCRIPTOR = 1 << 20


def main() -> None:
    """Serve until the bench closes the link; in a fork, be the agent."""
    link_fd, parent = map(int, sys.argv[1:3])
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    # A parent that died before the line above sends no signal any more.
    if os.getppid() != parent:
        return
    # Beside this script: the package around it would bring more of the bench along.
    landlock_launch = importlib.import_module("_landlock_launch")
    # The folder of this script: no agent has it.
    del sys.path[0]
    for name in sys.argv[3:]:
        load(name)
    # Else the first collection of each fork goes through all of it, and writes to every page, which is then copied.
    gc.freeze()
    descriptors = serve(link_fd)
    if descriptors is None:
        return
    settings_fd, status_fd = descriptors
    settings = landlock_launch.launch(settings_fd, status_fd, os.getppid(), become_interpreter)
    if settings is not None:
        run_program(settings["command"])


def load(name: str) -> None:
    """Import a module, with all names of a room of the bench, which loads them when they are first used."""
    module = importlib.import_module(name)
    if not name.startswith("bench."):
        return
    for exported in importlib.import_module("bench.lazy").declared_names(name):
        value = getattr(module, exported)
        # Models of documents build their validators when they are first used.
        if hasattr(value, "model_rebuild"):
            value.model_rebuild()


def serve(link_fd: int) -> tuple[int, int] | None:
    """Fork a launcher for each request, in which descriptors are returned; None once the link is closed."""
    # Not in a `with`: the fork leaves this function too.
    link = socket.socket(fileno=link_fd)
    poll = select.poll()
    poll.register(link_fd, select.POLLIN)
    launchers: dict[int, tuple[int, int]] = {}
    while True:
        for ready, _ in poll.poll():
            if ready != link_fd:
                poll.unregister(ready)
                report_end(ready, *launchers.pop(ready))
                continue
            request, descriptors, *_ = socket.recv_fds(link, 1, DESCRIPTORS)
            if not request:
                return None
            settings_fd, status_fd, output, report = descriptors
            pid = os.fork()
            if pid == 0:
                link.detach()
                begin_launcher(output, (settings_fd, status_fd))
                return settings_fd, status_fd
            for descriptor in (settings_fd, status_fd, output):
                os.close(descriptor)
            ending = os.pidfd_open(pid)
            launchers[ending] = pid, report
            poll.register(ending, select.POLLIN)
            with suppress(BrokenPipeError):
                os.write(report, f"{pid}\n".encode())


def report_end(ending: int, pid: int, report: int) -> None:
    """Reap a launcher, and tell the bench how it ended and what it used."""
    _, status, usage = os.wait4(pid, 0)
    with suppress(BrokenPipeError):
        os.write(report, f"{status} {usage.ru_utime + usage.ru_stime}\n".encode())
    os.close(report)
    os.close(ending)


def begin_launcher(output: int, kept: tuple[int, ...]) -> None:
    """A session and an output of its own, and no descriptor but the `kept` ones."""
    os.setsid()
    for standard in (1, 2):
        os.dup2(output, standard)
    begin = 3
    for descriptor in (*sorted(kept), MAX_DESCRIPTOR):
        os.closerange(begin, descriptor)
        begin = descriptor + 1


def become_interpreter(settings: dict[str, Any]) -> None:
    """Leave this process as a fresh interpreter would be: with the agent's environment, without a descriptor."""
    os.closerange(3, MAX_DESCRIPTOR)
    os.environ.clear()
    os.environ.update(settings["environment"])
    # A new user hides a process from itself until it starts a program.
    ctypes.CDLL(None).prctl(PR_SET_DUMPABLE, 1, 0, 0, 0)
    # Python seeds its own generator anew after a fork, NumPy does not.
    if numpy_random := sys.modules.get("numpy.random"):
        numpy_random.seed()


def run_program(command: list[str]) -> None:
    """Run `python -m MODULE ARGUMENT...` or `python SCRIPT ARGUMENT...` as the interpreter itself does."""
    if command[1] == "-m":
        sys.path.insert(0, os.getcwd())
        sys.argv = ["-m", *command[3:]]
        runpy.run_module(command[2], run_name="__main__", alter_sys=True)
    else:
        sys.path.insert(0, str(Path(command[1]).parent))
        sys.argv = command[1:]
        runpy.run_path(command[1], run_name="__main__")


if __name__ == "__main__":
    main()
