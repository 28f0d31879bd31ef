"""Ports for tests that must name one before anybody listens."""

from __future__ import annotations

import contextlib
import os
import socket

import pytest


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Below those that the system gives out by itself, so that nobody has it a moment later."""
    first = 20_000 + os.getpid() * 7 % 10_000
    for port in range(first, first + 2000):
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, kind) as probe:
            if (
                kind is socket.SOCK_STREAM
            ):  # as a server does: connections that just ended do not stand in its way
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
            return port
    pytest.fail("no port is free")
