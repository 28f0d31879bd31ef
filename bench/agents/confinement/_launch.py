"""The few lines that run between fork and the agent's own program; a script of the standard library alone.

Run as `python -I -S _launch.py PARENT FILE_BYTES FAILURE_FD COMMAND...`. The descriptor gets the reason when
the command cannot be started, so that the bench can tell this from a program that ends with the same code. A program of its own, not a `preexec_fn`,
because the bench's process has threads, and Python code between fork and exec in such a process may wait for
a lock that nobody holds any more.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys

# From <linux/prctl.h>; Python's standard library has no name for it.
PR_SET_PDEATHSIG = 1
# The code by which shells report a command that cannot be started.
NOT_FOUND = 127


def main() -> None:
    """Tie this process to its parent's life, bound what it can write, and become the agent."""
    parent, file_bytes, failure_fd = map(int, sys.argv[1:4])
    command = sys.argv[4:]
    # The agent must not inherit it: it closes with a successful start.
    os.set_inheritable(failure_fd, False)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    # A parent that died before the line above sends no signal any more.
    if os.getppid() != parent:
        sys.exit(1)
    resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        os.execvp(command[0], command)
    except OSError as error:
        reason = f"{command[0]} cannot be started: {error.strerror}"
        sys.stderr.write(f"{reason}\n")
        os.write(failure_fd, reason.encode())
        sys.exit(NOT_FOUND)


if __name__ == "__main__":
    main()
