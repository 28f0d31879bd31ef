"""An autopilot's parameters, their protocol, and the flight limits that they give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ..state._flight_limits import FlightLimits
from ..state._parameter_store import Parameter, ParameterStore


@dataclass(frozen=True, slots=True)
class ParameterPush:
    """Sent unasked at `first_s` and every `every_s` after; `counts_seconds` sets it to the running time."""

    name: str
    first_s: float
    every_s: float | None = None
    counts_seconds: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterPolicy:
    """Definitions and protocol of an autopilot's parameters."""

    definitions: tuple[Parameter, ...]
    system_id: str
    limits: Callable[[ParameterStore], FlightLimits]
    """The numbers to fly by; called again whenever a parameter has changed."""
    bytewise: bool
    hash_first: bool
    unknown: Literal["error", "silence"]
    index_in_replies: bool
    any_case: bool
    changes_twice: bool
    checks_type: bool
    listed_per_step: int

    simulation: tuple[str, ...]
    """Beginnings of the names that set up the simulation, which only the bench may set in a session."""
    write_denied: str | None
    pushes: tuple[ParameterPush, ...] = ()

    def is_simulation(self, name: str) -> bool:
        """Whether a parameter sets up the simulation and not the flight controller."""
        return name.startswith(self.simulation)
