"""What the vehicle needs of one kind of real autopilot: the contract of the entry-point group rebar.firmware."""

from __future__ import annotations

import hashlib
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from bench.contracts import LinkSpec, VehiclePlan, load_plugin, plugins, remedy_for
from bench.documents import Document, validate_document
from bench.errors import Fault, SetupError
from bench.simspec import PluginAutopilot, RealAutopilot, SimSpec

from .._battery import BatteryModel
from ._body import Body
from ._mavlink_ports import MavlinkPort

FIRMWARE_FIELD = "vehicle.autopilot.firmware"


@dataclass(frozen=True, slots=True)
class Budgets:
    """Host seconds that an autopilot gets: to connect, and to answer a sample."""

    connect_s: float = 60.0
    answer_s: float = 30.0


@dataclass(frozen=True, slots=True)
class FirmwarePlan:
    """All that one autopilot needs to be started: `options` are of its kind's class, `folder` is its own, and empty."""

    simspec: SimSpec
    options: Document
    body: Body
    battery: BatteryModel
    links: Sequence[LinkSpec]
    folder: Path
    budgets: Budgets
    controller_hz: int
    boot_s: float
    """Simulated seconds on the ground before the session."""


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
    silent_s = 0.0
    """Simulated seconds without outputs for the rotors, which keep the last ones; 0 where they come."""

    @abstractmethod
    def fly_sample(self, *, new_fix: bool) -> None:
        """Make one step of the physics and get the autopilot's outputs for it. `new_fix`: the receiver has a new fix."""

    def settle(self) -> None:  # noqa: B027
        """Wait until the autopilot has done all that the last sample made it do, at paces that promise it."""

    def simulated_parameters(self, *, gps_off: bool, charge: float) -> dict[str, float]:
        """Parameters by which receiver and battery that it simulates are the bench's; `charge` is 0 to 1."""
        return {}

    def drop_command(self, charge: float) -> tuple[int, float, float] | None:
        """MAV_CMD and its first two parameters that tell it a charge which fell at once; None where none is needed."""
        return None

    # For one whose own clock goes on, and that waits for nobody:

    def wait_step(self) -> None:  # noqa: B027
        """Wait until the next step on the ground is due."""

    def stand_by(self, stand: Callable[[], None]) -> None:  # noqa: B027
        """The agent starts now, for seconds without a step. `stand` makes a step on the ground, in any one thread."""

    def end_stand_by(self) -> None:  # noqa: B027
        """Call `stand` no more: before each step of a session. Raises what went wrong meanwhile."""

    @abstractmethod
    def last_words(self) -> str:
        """What it wrote last, for an error."""

    @abstractmethod
    def counters(self) -> Mapping[str, int]:
        """What was unusual on the physics link, by name."""


class FirmwareKind(Protocol):
    """An object of the entry-point group rebar.firmware: what is needed to start one kind of autopilot."""

    name: str
    modes: str
    """The imitated autopilot that has the names of its modes: px4 or ardupilot."""
    options: type[Document]
    """The class of `options` in `vehicle.autopilot`. The bench's own kinds have theirs beside `kind`: RealAutopilot."""
    samples_hz: int
    boot_s: float
    estimate_hz: float | None
    """The rate that the bench asks of the autopilot's estimate; None where it comes unasked."""
    logs: Sequence[str]
    """Patterns of its logs, in its folder."""

    def identity(self, options: Document) -> str:
        """Which program or device it is, in words."""

    def faults(self, plan: VehiclePlan, options: Document) -> list[Fault]:
        """Why a vehicle with this autopilot, at this pace or with these failures, cannot be flown."""

    def open(self, plan: FirmwarePlan) -> AbstractContextManager[RunningFirmware]:
        """Start it and connect to it; leaving the block ends it."""


def kind_of(autopilot: RealAutopilot | PluginAutopilot) -> FirmwareKind:
    """The installed kind. Raises SetupError where there is none of this name."""
    if autopilot.kind not in plugins("rebar.firmware"):
        what = f"there is no firmware {autopilot.kind!r}"
        raise SetupError("vehicle.autopilot.kind", what, remedy_for("rebar.firmware", autopilot.kind))
    kind: FirmwareKind = load_plugin("rebar.firmware", autopilot.kind)
    return kind


def options_of(autopilot: RealAutopilot | PluginAutopilot, kind: FirmwareKind) -> Document:
    """The options as the kind's own document. Raises SetupError with every fault of them."""
    if isinstance(autopilot, RealAutopilot):
        return autopilot
    return validate_document(autopilot.options, kind.options, source="vehicle.autopilot.options")


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
