"""Which parameters an autopilot has, how its parameter protocol behaves, and the flight limits that they
give.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ..state._flight_limits import FlightLimits
from ..state._parameter_store import Parameter, ParameterStore


@dataclass(frozen=True, slots=True)
class ParameterPush:
    """A parameter that is sent unasked at `first_s` and every `every_s` after that; `counts_seconds` sets it
    to the running time.
    """

    name: str
    first_s: float
    every_s: float | None = None
    counts_seconds: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterPolicy:
    """Definitions and protocol of an autopilot's parameters."""

    definitions: tuple[Parameter, ...]
    system_id: str
    """The parameter that holds the MAVLink system id, read at the start."""
    limits: Callable[[ParameterStore], FlightLimits]
    """The numbers to fly by; called again whenever a parameter has changed."""
    bytewise: bool
    """Whether PARAM_VALUE carries an integer's bits in its float field
    (MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE).
    """

    hash_first: bool
    """Whether a list begins with _HASH_CHECK."""
    unknown: Literal["error", "silence"]
    """Whether an unknown name is answered by PARAM_ERROR."""
    index_in_replies: bool
    """False: a parameter that is read by name comes with index 65535."""
    any_case: bool
    """Whether names are found in any case; the reply repeats the spelling of the request."""
    changes_twice: bool
    """Whether a changed value is sent once more to every channel."""
    checks_type: bool
    listed_per_step: int
    """How many values of a list leave in one step: the list takes as long as the real autopilot's."""

    simulation: tuple[str, ...]
    """Beginnings of the names that set up the simulation, which only the bench may set in a session."""
    write_denied: str | None
    """The text with which a protected parameter is refused, with `{name}`; None: PARAM_ERROR."""
    pushes: tuple[ParameterPush, ...] = ()

    def is_simulation(self, name: str) -> bool:
        """Whether a parameter sets up the simulation and not the flight controller."""
        return name.startswith(self.simulation)
