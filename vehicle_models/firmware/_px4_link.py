"""PX4's simulator link: the bench listens on TCP, PX4 connects, and answers samples with motor outputs."""

from __future__ import annotations

import os
import socket
import struct
import time
from collections.abc import Callable
from typing import NoReturn

from bench.errors import FirmwareFault

from ..controller.links._frames import FrameReader, message_id
from ._hil import COMMAND_LONG, HIL_ACTUATOR_CONTROLS, ActuatorControls, actuator_controls, truth_interval_us

PHYSICS_PORT = 4560
# Host seconds. PX4 starts in 0.3 s and answers in under a millisecond; a busy host gives a hundredth of that.
CONNECT_S, ANSWER_S = 60.0, 30.0
# Until its outputs run, PX4 leaves samples unanswered (eight of them, as observed): the bench goes on after this. Later on it
# looks then whether PX4 still works on an answer, which takes it less than a hundredth of this.
_UNANSWERED_S = 0.02
_MAX_UNANSWERED = 2000
_TIMEVAL = struct.Struct("ll")
_POLL_S = 0.1
_DYING_S = 1.0
_READ_BYTES = 65536

CheckAlive = Callable[[], None]
"""Raises FirmwareFault when the firmware's program has ended."""
IsAsleep = Callable[[], bool]
"""Whether no thread of the firmware is at work, or about to be."""


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
        self._is_asleep: IsAsleep | None = None
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
        self._answered = False
        self.unanswered = 0
        self.silent = 0
        """Samples since PX4's last answer; 0 as long as it has never answered."""
        self.truth_interval_us: int | None = None
        """How often PX4 wants HIL_STATE_QUATERNION; None until it has asked."""

    def connect(self, is_asleep: IsAsleep | None = None) -> None:
        """Wait until PX4 has connected. Without `is_asleep`, it is thought asleep when no answer has come for 20 ms."""
        self._is_asleep = is_asleep
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
        # The kernel's timeouts cost nothing; those of Python are a further call for each of the socket's.
        self._connection.settimeout(None)
        set_timeout(self._connection, socket.SO_SNDTIMEO, self._answer_s)
        set_timeout(self._connection, socket.SO_RCVTIMEO, _UNANSWERED_S)

    def exchange(self, time_us: int, frames: bytes) -> ActuatorControls | None:
        """Send the messages of one sample, HIL_SENSOR last, and return PX4's outputs for it.

        None where there are none: its output driver starts some samples after its clock, and no controller runs in
        OFFBOARD on the ground without setpoints, or after a flight termination (observed). It sleeps then.
        """
        connection = self._connected()
        self._send(connection, frames)
        slept, deadline_s = False, 0.0
        while True:
            # Whoever is silent already is not waited for, where it can be seen whether it works.
            data = self._read(connection, wait=not (slept or (self.silent and self._is_asleep)))
            if data:
                controls = self._controls(data)
                if controls is None or controls.time_us < time_us:
                    continue
                if controls.time_us > time_us:
                    raise FirmwareFault(
                        f"PX4 answered a sample of {controls.time_us} us, but the last is of {time_us} us"
                    )
                self._answered, self.silent = True, 0
                return controls
            self._check_alive()
            # It slept before the last look at the socket, which found nothing: no answer is on its way.
            if slept or not self._answered:
                self._pass_unanswered()
                return None
            slept = self._is_asleep is None or self._is_asleep()
            now_s = time.monotonic()
            deadline_s = deadline_s or now_s + self._answer_s
            if now_s > deadline_s and not slept:
                raise FirmwareFault(
                    f"PX4 has worked on the sample of {time_us / 1e6:.3f} s for {self._answer_s:g} s without an answer"
                )
            if not slept:
                os.sched_yield()

    def close(self) -> None:
        self._server.close()
        if self._connection is not None:
            self._connection.close()

    def _connected(self) -> socket.socket:
        if self._connection is None:
            raise AssertionError("connect() comes before exchange()")
        return self._connection

    def _send(self, connection: socket.socket, frames: bytes) -> None:
        try:
            connection.sendall(frames)
        except BlockingIOError:
            raise FirmwareFault(f"PX4 has read no sample for {self._answer_s:g} s") from None
        except OSError:
            self._report_closed()

    def _report_closed(self) -> NoReturn:
        report_closed("PX4 closed the simulator link", self._check_alive)

    def _pass_unanswered(self) -> None:
        self.unanswered += 1
        self.silent += self._answered
        if self.unanswered > _MAX_UNANSWERED and not self._answered:
            raise FirmwareFault(
                f"PX4 answered none of {self.unanswered} samples; its actuator outputs do not run (does its airframe set "
                "PWM_MAIN_FUNC1 to 4?)"
            )

    def _read(self, connection: socket.socket, *, wait: bool) -> bytes:
        """What PX4 has sent; empty where nothing comes in time."""
        try:
            data = connection.recv(_READ_BYTES, 0 if wait else socket.MSG_DONTWAIT)
        except BlockingIOError:
            return b""
        except OSError:
            self._report_closed()
        if not data:
            self._report_closed()
        return data

    def _controls(self, data: bytes) -> ActuatorControls | None:
        """The last outputs in what PX4 has sent."""
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


def set_timeout(connection: socket.socket, option: int, seconds: float) -> None:
    """Let the kernel end the calls of a socket that blocks: SO_RCVTIMEO or SO_SNDTIMEO. They raise BlockingIOError then."""
    connection.setsockopt(socket.SOL_SOCKET, option, _TIMEVAL.pack(int(seconds), round(seconds % 1.0 * 1e6)))
