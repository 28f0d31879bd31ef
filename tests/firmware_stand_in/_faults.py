"""Ways in which firmware fails."""

from __future__ import annotations

import os
import signal
import socket
import sys
import time

from ._pilot import State

DIES, HANGS, TALKS_NONSENSE, NEVER_CONNECTS, ENDS_AT_ONCE, IGNORES_SIGTERM, LEAVES_CHILD = range(1, 8)
FAULT_HEIGHT_M = 1.0
# Host seconds without anything from the bench: longer than its own patience in the tests.
PATIENCE_S = 60.0


class Faults:
    """Fails as STAND_IN_FAULT says, once the vehicle is high enough."""

    def __init__(self, kind: int) -> None:
        self.kind = kind
        if kind == ENDS_AT_ONCE:
            print("no airframe of this name", flush=True)
            sys.exit(7)
        if kind == NEVER_CONNECTS:
            time.sleep(PATIENCE_S)
        if kind == IGNORES_SIGTERM:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if kind == LEAVES_CHILD and os.fork() == 0:
            os.setsid()
            time.sleep(PATIENCE_S)
            os._exit(0)

    def act(self, state: State, say: socket.socket) -> None:
        if -state.position[2] < FAULT_HEIGHT_M:
            return
        if self.kind == DIES:
            print("out of memory in the mixer", flush=True)
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.kind == HANGS:
            time.sleep(PATIENCE_S)
        if self.kind == TALKS_NONSENSE:
            say.send(b"Segmentation fault? No: a web server.\r\n" * 4)
