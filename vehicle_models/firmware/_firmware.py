"""What the vehicle needs of one kind of real autopilot."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from bench.contracts import LinkSpec
from bench.errors import Fault
from bench.simspec import Failure, RealAutopilot, SimSpec

from ._body import Body
from ._mavlink_ports import MavlinkPort
from ._program import FirmwareProgram

FIRMWARE_FIELD = "vehicle.autopilot.firmware"


@dataclass(frozen=True, slots=True)
class Budgets:
    """Host seconds that an autopilot gets: to connect, and to answer a sample."""

    connect_s: float = 60.0
    answer_s: float = 30.0


@dataclass(frozen=True, slots=True)
class FirmwarePlan:
    """All that one autopilot needs to be started: `folder` is its own, and empty."""

    simspec: SimSpec
    autopilot: RealAutopilot
    body: Body
    links: Sequence[LinkSpec]
    folder: Path
    budgets: Budgets


class RunningFirmware(Protocol):
    """A started autopilot on its links."""

    program: FirmwareProgram
    cores: frozenset[int]
    """The cores that it is kept on; empty where it is not."""
    estimate_port: MavlinkPort
    """The connection on which the autopilot tells its estimate."""
    ports: Mapping[str, MavlinkPort]
    """The connection of each of the vehicle's links, by the name of the link; some may share one."""
    connections: Sequence[MavlinkPort]
    """Every connection: the autopilot may wait for one that nobody reads."""
    armed: bool | None
    """Whether it is armed by what the physics link says; None where only its heartbeat does."""

    def fly_sample(self, *, new_fix: bool) -> None:
        """Make one step of the physics and get the autopilot's outputs for it. `new_fix`: the receiver has a new fix."""

    def counters(self) -> Mapping[str, int]:
        """What was unusual on the physics link, by name."""


class FirmwareKind(Protocol):
    """PX4 or ArduPilot: what is needed to start it."""

    name: str
    samples_hz: int
    boot_s: float
    estimate_hz: float | None
    """The rate that the bench asks of the autopilot's estimate; None where it comes unasked."""
    logs: Sequence[str]
    """Patterns of its logs, in its folder."""

    def program(self, firmware: Path) -> Path:
        """The executable."""

    def faults(self, firmware: Path, failures: Sequence[Failure]) -> list[Fault]:
        """Why this firmware or these failures cannot be flown."""

    def open(self, plan: FirmwarePlan) -> AbstractContextManager[RunningFirmware]:
        """Start it and connect to it; leaving the block ends it."""


def program_faults(program: Path, other_files: Sequence[Path]) -> list[Fault]:
    """Faults of files that are missing, or of a program that cannot be executed."""
    missing = [path for path in (program, *other_files) if not path.exists()]
    if missing:
        return [
            Fault(
                FIRMWARE_FIELD, f"{missing[0]} does not exist", "docs/real-autopilots.md says what is needed"
            )
        ]
    if not program.is_file() or not os.access(program, os.X_OK):
        return [Fault(FIRMWARE_FIELD, f"{program} is not an executable file", f"chmod +x {program}")]
    return []
