"""The air network at an interface of the host, for an agent on another computer."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from bench.documents import open_file
from bench.errors import SetupError
from bench.network_namespace import outside_socket
from bench.simspec import OutsideAir

from . import _service_relay
from ._interface import interface_address

_FIELD = "agent.outside_air"
# Zenoh keeps users as NAME:PASSWORD lines.
_TOKEN = re.compile(r"[!-9;-~]{16,256}")
_OTHERS_MAY_READ = 0o077
_MESSAGE_BYTES = 65536
_PATIENCE_S = 30.0


def read_token(air: OutsideAir) -> str:
    """The token in the file. Raises SetupError when it is missing, open to others, or too short to be a secret."""
    path = Path(air.token_file)
    field = f"{_FIELD}.token_file"
    make = f"write one: (umask 077; python3 -c 'import secrets; print(secrets.token_urlsafe(24))' > {path})"
    with open_file(path, field) as file:
        mode = os.fstat(file.fileno()).st_mode
        # A token that holds a replaced character, or goes on, is none.
        text = file.read(_MESSAGE_BYTES).decode("ascii", "replace").strip()
    if mode & _OTHERS_MAY_READ:
        raise SetupError(field, f"others on this host may read {path}", f"chmod 600 {path}")
    if not _TOKEN.fullmatch(text):
        what = f"{path} holds no token of 16 to 256 letters, digits and signs without colons and blanks"
        raise SetupError(field, what, make)
    return text


@contextmanager
def open_outside_air(air: OutsideAir, locator: str) -> Generator[str]:
    """Carry connections to the interface on to the session's router at `locator` (tcp/HOST:PORT), in a process of its own
    so that pictures take no time from the session. Yields the locator outside.

    Raises SetupError when the interface is missing or its port taken.
    """
    address = interface_address(air.interface, f"{_FIELD}.interface")
    host, _, port = locator.removeprefix("tcp/").rpartition(":")
    with outside_socket(socket.SOCK_STREAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address, air.port))
            listener.listen()
        except OSError as error:
            what = f"cannot listen on {address}:{air.port}: {error.strerror}"
            raise SetupError(f"{_FIELD}.port", what, "give another port") from None
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with ours:
            # The listener is of the host's network, the process of the session's: there it finds the router.
            with theirs:
                numbers = [theirs.fileno(), listener.fileno()]
                relay = subprocess.Popen(
                    [sys.executable, "-I", "-S", _service_relay.__file__, *map(str, numbers)],
                    pass_fds=numbers,
                    env={},
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,
                )
            listener.close()
            try:
                _check(ours, host, int(port))
                yield f"tcp/{address}:{air.port}"
            finally:
                with suppress(OSError):
                    ours.shutdown(socket.SHUT_WR)
                try:
                    relay.wait(_PATIENCE_S)
                except subprocess.TimeoutExpired:
                    relay.kill()
                    relay.wait()


def _check(control: socket.socket, host: str, port: int) -> None:
    control.settimeout(_service_relay.CHECK_BUDGET_S + _PATIENCE_S)
    faults = ["does not start"]
    with suppress(OSError):
        control.send(json.dumps([[host, port]]).encode())
        if message := control.recv(_MESSAGE_BYTES):
            faults = json.loads(message)
    if faults[0]:
        raise SetupError(_FIELD, f"the way to the air network {faults[0]}", "fly again")
