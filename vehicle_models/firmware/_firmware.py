"""What the vehicle needs of one kind of real autopilot."""

from __future__ import annotations

import hashlib
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from bench.contracts import LinkSpec
from bench.errors import Fault
from bench.simspec import BoardAutopilot, RealAutopilot, SimSpec, VehicleSpec

from .._battery import BatteryModel
from ._body import Body
from ._mavlink_ports import MavlinkPort
from ._pace import LineClock

FIRMWARE_FIELD = "vehicle.autopilot.firmware"


@dataclass(frozen=True, slots=True)
class Budgets:
    """Host seconds that an autopilot gets: to connect, and to answer a sample. `clock` measures those of a board."""

    connect_s: float = 60.0
    answer_s: float = 30.0
    clock: LineClock = field(default_factory=LineClock)


@dataclass(frozen=True, slots=True)
class FirmwarePlan:
    """All that one autopilot needs to be started: `folder` is its own, and empty."""

    simspec: SimSpec
    autopilot: RealAutopilot | BoardAutopilot
    body: Body
    battery: BatteryModel
    links: Sequence[LinkSpec]
    folder: Path
    budgets: Budgets
    controller_hz: int


class RunningFirmware(ABC):
    """A started autopilot on its links."""

    cores: frozenset[int] = frozenset()
    """The cores that it is kept on; empty where it is not."""
    estimate_port: MavlinkPort
    """The connection on which the autopilot tells its estimate."""
    ports: Mapping[str, MavlinkPort]
    """The connection of each of the vehicle's links, by the name of the link; some may share one."""
    connections: Sequence[MavlinkPort]
    """Every connection: the autopilot may wait for one that nobody reads."""
    armed: bool | None
    """Whether it is armed by what the physics link says; None where only its heartbeat does."""
    keeps_real_time = False
    """Whether its own clock goes on: it waits for nobody."""
    silent_s = 0.0
    """Simulated seconds without outputs for the rotors, which keep the last ones; 0 where they come."""

    @abstractmethod
    def fly_sample(self, *, new_fix: bool) -> None:
        """Make one step of the physics and get the autopilot's outputs for it. `new_fix`: the receiver has a new fix."""

    def settle(self) -> None:  # noqa: B027  (a board's threads cannot be seen)
        """Wait until the autopilot has done all that the last sample made it do, at paces that promise it."""

    def simulated_parameters(self, *, gps_off: bool, charge: float) -> dict[str, float]:
        """Parameters by which receiver and battery that it simulates are the bench's; `charge` is 0 to 1."""
        return {}

    def drop_command(self, charge: float) -> tuple[int, float, float] | None:
        """MAV_CMD and its first two parameters that tell it a charge which fell at once; None where none is needed."""
        return None

    def wait_step(self) -> None:  # noqa: B027
        """Wait until the next step is due, where `keeps_real_time`."""

    @abstractmethod
    def last_words(self) -> str:
        """What it wrote last, for an error."""

    @abstractmethod
    def counters(self) -> Mapping[str, int]:
        """What was unusual on the physics link, by name."""


class FirmwareKind(Protocol):
    """PX4, ArduPilot, or a board: what is needed to start it."""

    name: str
    samples_hz: int
    boot_s: float
    estimate_hz: float | None
    """The rate that the bench asks of the autopilot's estimate; None where it comes unasked."""
    logs: Sequence[str]
    """Patterns of its logs, in its folder."""

    def identity(self, autopilot: RealAutopilot | BoardAutopilot) -> str:
        """Which program or board it is, in words."""

    def faults(self, vehicle: VehicleSpec) -> list[Fault]:
        """Why a vehicle with this autopilot, or these failures, cannot be flown."""

    def open(self, plan: FirmwarePlan) -> AbstractContextManager[RunningFirmware]:
        """Start it and connect to it; leaving the block ends it."""


def program_identity(program: Path, pace: str) -> str:
    """An executable by its name and digest, and the pace at which it flies."""
    digest = hashlib.sha256(program.read_bytes()).hexdigest()
    return f"{program.name} sha256:{digest}, pace {pace}"


def program_faults(program: Path, other_files: Sequence[Path]) -> list[Fault]:
    """Faults of files that are missing, or of a program that cannot be executed."""
    missing = [path for path in (program, *other_files) if not path.exists()]
    if missing:
        remedy = "docs/real-autopilots.md says what is needed"
        return [Fault(FIRMWARE_FIELD, f"{missing[0]} does not exist", remedy)]
    if not program.is_file() or not os.access(program, os.X_OK):
        return [Fault(FIRMWARE_FIELD, f"{program} is not an executable file", f"chmod +x {program}")]
    return []
