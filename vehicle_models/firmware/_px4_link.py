"""PX4's simulator link: the bench listens on TCP, PX4 connects, and every sample is answered with motor outputs."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import NoReturn

from bench.errors import FirmwareFault

from ..controller.links._frames import FrameReader, message_id
from ._hil import (
    COMMAND_LONG,
    HIL_ACTUATOR_CONTROLS,
    ActuatorControls,
    actuator_controls,
    truth_interval_us,
)

PHYSICS_PORT = 4560
# Host seconds. PX4 starts in 0.3 s and answers in under a millisecond; a busy host gives a hundredth of that.
CONNECT_S, ANSWER_S = 60.0, 30.0
# Until its outputs run, PX4 leaves samples unanswered (eight of them, as observed): the bench goes on after this.
_UNANSWERED_S = 0.02
_MAX_UNANSWERED = 2000
_POLL_S = 0.1
_DYING_S = 1.0
_READ_BYTES = 65536

CheckAlive = Callable[[], None]
"""Raises FirmwareFault when the firmware's program has ended."""


def report_closed(text: str, check_alive: CheckAlive) -> NoReturn:
    """Raise FirmwareFault: with how the program ended, if it ends in a moment, else with `text`."""
    # The kernel closes the sockets of a dying process some moments before its end can be asked for.
    deadline_s = time.monotonic() + _DYING_S
    while time.monotonic() < deadline_s:
        check_alive()
        time.sleep(0.005)
    raise FirmwareFault(text)


class Px4Link:
    """One connection. `connect` first, then `exchange` for each sample; `close` at the end. `server` is an unbound socket,
    of the bench's network when absent.

    All raise FirmwareFault, which names PX4, when it ends, hangs or sends what is not MAVLink.
    """

    def __init__(
        self,
        port: int = PHYSICS_PORT,
        *,
        check_alive: CheckAlive,
        connect_s: float = CONNECT_S,
        answer_s: float = ANSWER_S,
        server: socket.socket | None = None,
    ) -> None:
        self._check_alive = check_alive
        self._connect_s, self._answer_s = connect_s, answer_s
        self._server = server or socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._server.bind(("127.0.0.1", port))
            self._server.listen(1)
        except OSError:
            self._server.close()
            raise
        self.port: int = self._server.getsockname()[1]
        self._connection: socket.socket | None = None
        self._reader = FrameReader()
        self._answered, self._answered_us = False, 0
        self.unanswered = 0
        self.truth_interval_us: int | None = None
        """How often PX4 wants HIL_STATE_QUATERNION; None until it has asked."""

    def connect(self) -> None:
        """Wait until PX4 has connected."""
        deadline_s = time.monotonic() + self._connect_s
        self._server.settimeout(_POLL_S)
        while self._connection is None:
            self._check_alive()
            try:
                self._connection, _ = self._server.accept()
            except TimeoutError:
                if time.monotonic() > deadline_s:
                    raise FirmwareFault(
                        f"PX4 did not connect to TCP port {self.port} within {self._connect_s:g} s"
                    ) from None
        # Nobody else may take the place of PX4, and a sample is one small write that must not wait.
        self._server.close()
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def exchange(self, time_us: int, frames: bytes) -> ActuatorControls | None:
        """Send the messages of one sample, HIL_SENSOR last, and return PX4's outputs for it.

        None as long as PX4 has never answered: its output driver starts some samples after its clock.
        """
        connection = self._connected()
        try:
            connection.sendall(frames)
        except OSError:
            self._report_closed()
        deadline_s = time.monotonic() + (self._answer_s if self._answered else _UNANSWERED_S)
        while True:
            controls = self._receive(connection, deadline_s, time_us)
            if controls is not None and controls.time_us == time_us:
                self._answered, self._answered_us = True, time_us
                return controls
            if controls is not None and controls.time_us > time_us:
                raise FirmwareFault(
                    f"PX4 answered a sample of {controls.time_us} us, but the last is of {time_us} us"
                )
            if controls is None and not self._answered and time.monotonic() >= deadline_s:
                self._pass_unanswered()
                return None

    def close(self) -> None:
        self._server.close()
        if self._connection is not None:
            self._connection.close()

    def _connected(self) -> socket.socket:
        if self._connection is None:
            raise AssertionError("connect() comes before exchange()")
        return self._connection

    def _report_closed(self) -> NoReturn:
        report_closed("PX4 closed the simulator link", self._check_alive)

    def _pass_unanswered(self) -> None:
        self._check_alive()
        self.unanswered += 1
        if self.unanswered > _MAX_UNANSWERED:
            raise FirmwareFault(
                f"PX4 answered none of {self.unanswered} samples; its actuator outputs do not run (does its airframe set "
                "PWM_MAIN_FUNC1 to 4?)"
            )

    def _receive(self, connection: socket.socket, deadline_s: float, time_us: int) -> ActuatorControls | None:
        """The last outputs that one read brings; None when it brings none or nothing comes in time."""
        remaining_s = deadline_s - time.monotonic()
        connection.settimeout(min(max(remaining_s, 1e-3), _POLL_S))
        try:
            data = connection.recv(_READ_BYTES)
        except TimeoutError:
            self._check_alive()
            if self._answered and remaining_s <= 0.0:
                raise FirmwareFault(
                    f"PX4 has not answered the sample of {time_us / 1e6:.3f} s for {self._answer_s:g} s; its last answer was "
                    f"for {self._answered_us / 1e6:.3f} s"
                ) from None
            return None
        except OSError:
            self._report_closed()
        if not data:
            self._report_closed()
        latest = None
        for frame in self._reader.feed(data):
            number = message_id(frame)
            if number == HIL_ACTUATOR_CONTROLS:
                latest = actuator_controls(frame)
            elif number == COMMAND_LONG and (interval_us := truth_interval_us(frame)) is not None:
                self.truth_interval_us = interval_us
        if self._reader.garbage_bytes:
            raise FirmwareFault("what connected to the simulator link does not speak MAVLink")
        return latest
