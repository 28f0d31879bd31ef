"""What a vehicle promises: physics that moves, and links that speak MAVLink."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, runtime_checkable

from bench.clock import SimTime
from bench.values import value_class

if TYPE_CHECKING:
    from bench.simspec import SimSpec

Vector = tuple[float, float, float]


@value_class(frozen=True, slots=True)
class VehicleState:
    """Motion at one moment, in the world's map frame (ENU, origin at SimSpec.world.origin on the ground).

    Attitude is that of the body (FRD) against north-east-down, as autopilots state it; rates are body FRD.
    """

    time: SimTime
    position_enu_m: Vector
    velocity_enu_mps: Vector
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    rates_body_radps: Vector = (0.0, 0.0, 0.0)
    # Where a gimbal holds the camera: clockwise from the nose, and below the horizon. None without a gimbal.
    camera_pan_rad: float | None = None
    camera_tilt_rad: float | None = None


def body_axes_enu(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[Vector, Vector, Vector]:
    """Forward, right and down axes of a body with the attitude of a VehicleState, in ENU."""
    sr, cr = math.sin(roll_rad), math.cos(roll_rad)
    sp, cp = math.sin(pitch_rad), math.cos(pitch_rad)
    sy, cy = math.sin(yaw_rad), math.cos(yaw_rad)
    # The usual yaw-pitch-roll matrix, north and east swapped, down turned up.
    return (
        (cp * sy, cp * cy, sp),
        (sr * sp * sy + cr * cy, sr * sp * cy - cr * sy, -sr * cp),
        (cr * sp * sy - sr * cy, cr * sp * cy + sr * sy, -cr * cp),
    )


@value_class(frozen=True, slots=True)
class VehicleCondition:
    """What of the vehicle is not motion."""

    armed: bool
    landed: bool
    crashed: bool
    mode: str
    battery_fraction: float
    failsafe: str = ""
    failures: tuple[str, ...] = ()  # what is broken just now


OpenSocket = Callable[[socket.SocketKind], socket.socket]
"""Makes an unbound IPv4 socket."""


def socket_here(kind: socket.SocketKind) -> socket.socket:
    """A socket on the network that this process is in."""
    return socket.socket(socket.AF_INET, kind)


@dataclass(frozen=True, slots=True)
class LinkSpec:
    """One MAVLink link that the flight controller opens, on loopback unless `host` says otherwise.

    `udp_out` sends from a port of its own to host:port (as PX4 does to 14540); `udp_in` listens there;
    `tcp_in` listens and serves one or more clients (as ArduPilot does on 5760). Port 0 lets the system choose
    for the listening kinds. `serial` is a pseudo terminal, and `path` the name that its other end gets
    (`auto`: the system's), or a serial device that exists; with a `baud` it must be one. `streams` names the autopilot's default stream set
    of the link (`onboard`, `gcs`, `none`). With a `signing_key` (64 hexadecimal digits, the same on all of a
    vehicle's links) messages are signed, and unsigned ones are not heard where `signing` is `require`. What comes
    over a link that is not `heard` is discarded. `open_socket` makes the unbound IPv4 sockets of the link: those of
    a link that leads out of the session come from another network than the process is in.
    """

    name: str
    kind: Literal["udp_out", "udp_in", "tcp_in", "serial"]
    host: str = "127.0.0.1"
    port: int = 0
    streams: str = "onboard"
    path: str = "auto"
    baud: int = 0
    signing_key: str = ""
    signing: Literal["accept", "require"] = "require"
    heard: bool = True
    open_socket: OpenSocket = socket_here


@dataclass(frozen=True, slots=True)
class VehiclePlan:
    """All that a vehicle needs to be built: the SimSpec it flies in and the links it opens.

    `artefacts` is where a real autopilot's console and logs are left; None: they are discarded. With `companion_topics` a
    vehicle that `HasCompanionTopics` publishes them.
    """

    simspec: SimSpec
    links: tuple[LinkSpec, ...]
    controller_hz: int = 50
    artefacts: Path | None = None
    companion_topics: bool = False


MavlinkTap = Callable[[str, str, bytes], None]
"""Called with link name, direction (`to_agent` or `from_agent`) and whole MAVLink frames, during `step`."""


class Vehicle(Protocol):
    """One simulated aircraft with its flight controller, at the simulated moment `time`.

    The order of a step is fixed: take what lies in the inboxes, control, physics, send. Nothing is read from
    a socket outside `receive`, so a session that calls `receive` until the counts match knows exactly what
    the step will see.
    """

    @property
    def time(self) -> SimTime:
        """The moment that truth and estimate speak of."""

    @property
    def step_s(self) -> float:
        """Simulated seconds of one step: 1 / controller_hz, a whole number of physics steps."""

    def endpoints(self) -> Mapping[str, str]:
        """Each link's connection string for pymavlink: `udpin:127.0.0.1:14540`, `tcp:127.0.0.1:5760`."""

    # Counts since the start: a session compares them with those in an Ack, and none can be lost.
    def receive(self) -> Mapping[str, int]:
        """Move what waits in the sockets to the inboxes, without blocking; messages so far, by link."""

    def sent(self) -> Mapping[str, int]:
        """Whole MAVLink messages sent so far, by link."""

    def step(self) -> None:
        """Advance by `step_s`. Raises VehicleFault when the state is no longer finite."""

    def truth(self) -> VehicleState:
        """Where the vehicle really is."""

    def estimate(self) -> VehicleState:
        """Where its own navigation believes it to be; what its MAVLink says."""

    def condition(self) -> VehicleCondition:
        """Armed, landed, crashed, mode, battery, failsafe."""

    def counters(self) -> Mapping[str, int]:
        """What was dropped or malformed, by name, for the session's result."""


@runtime_checkable
class CarriesCamera(Protocol):
    """What a vehicle promises beside `Vehicle` when its camera is on its MAVLink links."""

    def record_exposure(self, frame: int, time: SimTime) -> None:
        """The scene has made frame number `frame` of the vehicle's camera at `time`."""


@runtime_checkable
class BootsFirmware(Protocol):
    """What a vehicle promises beside `Vehicle` when a real autopilot flies it."""

    def boot(self) -> str:
        """Start the autopilot's program and let it run until it can fly, before the first step; the simulated moment
        stays as it is. Returns name, version, digest and pace for the recording. Raises FirmwareFault.
        """


CompanionSample = tuple[str, Mapping[str, Any]]
"""A topic of the autopilot (`/fmu/out/vehicle_status`, `/ap/status`), and the fields of its message by name; those that a
release has beside them are zero. Where the vehicle publishes, those of a message in it are a mapping too. Or a service
(`/ap/arm_motors`), and the fields of a request or of an answer.
"""


@runtime_checkable
class HasCompanionTopics(Protocol):
    """What a vehicle promises beside `Vehicle` when a companion may see the topics of its autopilot."""

    def take_samples(self, samples: Sequence[CompanionSample]) -> None:
        """Hand over what the companion has published and asked, in order; the next step acts on it."""

    def published_samples(self) -> list[CompanionSample]:
        """What was published since the last call, in order; with one answer for each request, a service's in its order."""


class OpenVehicle(Protocol):
    """The entry point of group `rebar.vehicles`: builds a vehicle; leaving the block closes its sockets."""

    def __call__(
        self, plan: VehiclePlan, tap: MavlinkTap | None = None
    ) -> AbstractContextManager[Vehicle]: ...
