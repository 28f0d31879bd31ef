"""ArduPilot's JSON physics: a packet of servo pulses over UDP, one answer with the state, one step of the physics."""

from __future__ import annotations

import math
import socket
import struct
import time

from bench.contracts import Vector
from bench.errors import FirmwareFault
from bench.geodesy import wrapped

from ._px4_link import ANSWER_S, CONNECT_S, CheckAlive, set_timeout

PHYSICS_PORT = 9002
# `<HHI` is magic, wanted rate (Hz), frame count; then 16 pulses (us), or 32 where SERVO_32_ENABLE is 1.
_LAYOUTS = {18458: struct.Struct("<HHI16H"), 29569: struct.Struct("<HHI32H")}
_MAGIC = struct.Struct("<H")
_POLL_S = 0.1
_READ_BYTES = 4096
# A line feed before and after. ArduPilot looks for `"key":` as text, so there is no blank behind the colon, and no key
# contains one that is looked for later.
_ANSWER = (
    '\n{"timestamp":%.9f,"imu":{"gyro":[%.9g,%.9g,%.9g],"accel_body":[%.9g,%.9g,%.9g]},"position":[%.9g,%.9g,%.9g],'
    '"quaternion":[%.9g,%.9g,%.9g,%.9g],"velocity":[%.9g,%.9g,%.9g],"battery":{"voltage":%.6g,"current":%.6g}}\n'
)
# Metres in 1e-7 degrees on ArduPilot's spherical Earth of 6378100 m (Location.h, LOCATION_SCALING_FACTOR).
_METRES_PER_E7 = 0.011131884502145034


def encoded_state(
    time_s: float,
    rates_radps: Vector,
    specific_force_mps2: Vector,
    position_ned_m: Vector,
    attitude: tuple[float, float, float, float],
    velocity_ned_mps: Vector,
    battery: tuple[float, float],
) -> bytes:
    """The answer that ArduPilot makes its sensors from. Position and velocity are north, east, down; the battery is volts and
    amperes; the rest is body FRD.
    """
    values = (*specific_force_mps2, *position_ned_m, *attitude, *velocity_ned_mps, *battery)
    return (_ANSWER % (time_s, *rates_radps, *values)).encode()


class ArduPilotLink:
    """The physics' end: `receive` the pulses of the next step, make it, `answer`. `unbound` is a socket, of the bench's
    network when absent.

    Both raise FirmwareFault, which names ArduPilot, when it ends, hangs or sends something else.
    """

    def __init__(
        self,
        port: int = PHYSICS_PORT,
        *,
        check_alive: CheckAlive,
        connect_s: float = CONNECT_S,
        answer_s: float = ANSWER_S,
        unbound: socket.socket | None = None,
    ) -> None:
        self._check_alive = check_alive
        self._connect_s, self._answer_s = connect_s, answer_s
        self._socket = unbound or socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError:
            self._socket.close()
            raise
        # The kernel's timeout costs nothing; that of Python is a further call for each of the socket's.
        self._socket.settimeout(None)
        set_timeout(self._socket, socket.SO_RCVTIMEO, _POLL_S)
        self.port: int = self._socket.getsockname()[1]
        self._peer: tuple[str, int] | None = None
        self._count: int | None = None
        self.repeated = 0
        """Packets that came again, because an answer took more than a second of the host's."""
        self.strangers = 0
        """Datagrams from somebody else than who sent the first packet; they are passed over."""
        self.restarts = 0
        """How often the count of frames began anew: ArduPilot restarts on MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN."""

    def receive(self) -> tuple[int, ...]:
        """Pulse widths (us) of the next step.

        A packet that comes again gets no further answer: on loopback none is lost, and ArduPilot takes two as those of two
        packets. From then on it is a step ahead of the physics, and no flight repeats (observed).
        """
        patience_s = self._answer_s if self._peer else self._connect_s
        deadline_s = 0.0
        while True:
            try:
                data, peer = self._socket.recvfrom(_READ_BYTES)
            except BlockingIOError:
                self._check_alive()
                now_s = time.monotonic()
                deadline_s = deadline_s or now_s - _POLL_S + patience_s
                if now_s > deadline_s:
                    silent = f"has sent no packet after frame {self._count} for {patience_s:g} s"
                    if self._peer is None:
                        silent = f"sent nothing to UDP port {self.port} within {patience_s:g} s"
                    raise FirmwareFault(f"ArduPilot {silent}") from None
                continue
            except OSError:  # an ICMP answer to what was sent to a program that has ended
                self._check_alive()
                continue
            if self._peer is not None and peer != self._peer:
                # An agent in the same network must not be able to end the session by a datagram.
                self.strangers += 1
                continue
            pulses = self._take(data, peer)
            if pulses is not None:
                return pulses

    def answer(self, state: bytes) -> None:
        """Answer the packet that `receive` returned last."""
        assert self._peer
        self._socket.sendto(state, self._peer)

    def close(self) -> None:
        self._socket.close()

    def _take(self, data: bytes, peer: tuple[str, int]) -> tuple[int, ...] | None:
        layout = _LAYOUTS.get(_MAGIC.unpack_from(data)[0]) if len(data) >= _MAGIC.size else None
        if layout is None or len(data) != layout.size:
            raise FirmwareFault(
                f"UDP port {self.port} got {len(data)} bytes that are no packet of ArduPilot's JSON physics"
            )
        values = layout.unpack(data)
        count = values[2]
        self._peer = peer
        if count == self._count:
            self.repeated += 1
            return None
        if self._count is not None and count != self._count + 1:
            if count > self._count:
                raise FirmwareFault(f"ArduPilot's frame {count} came after frame {self._count}")
            self.restarts += 1
        self._count = count
        return values[3:]


class ArduPilotMetres:
    """North and east of home in ArduPilot's metres, so that the degrees that it makes of them are the true ones.

    Its Earth is a sphere; the bench's is WGS84, on which a degree of latitude is up to 0.6 % shorter.
    """

    def __init__(self, latitude_e7: int, longitude_e7: int) -> None:
        self._latitude_e7, self._longitude_e7 = latitude_e7, longitude_e7

    def north_east_m(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """As Location::offset takes them."""
        north_e7 = latitude_deg * 1e7 - self._latitude_e7
        east_e7 = wrapped(longitude_deg * 1e7 - self._longitude_e7, 1.8e9)
        middle_rad = math.radians((self._latitude_e7 + 0.5 * north_e7) * 1e-7)
        return north_e7 * _METRES_PER_E7, east_e7 * _METRES_PER_E7 * math.cos(middle_rad)


def rotor_share(pulse_us: int) -> float:
    """Rotor speed as a share of the greatest: 1000 us is still, 2000 us full."""
    share = (pulse_us - 1000) / 1000.0
    return 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
