"""What an autopilot does about failures, breaches of the fence and an empty battery, by its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from ..state._flight_state import Behaviour, FlightState
from ..state._parameter_store import ParameterStore
from ..state._service import Refusal
from ..state._texts import StatusText

Seconds = float


@dataclass(frozen=True, slots=True)
class Reaction:
    """What is done about one cause: send `texts`; then Hold for `hold_s`; then send `action_texts` and enter
    `action`.

    An `action` of None changes no mode. `resumes` goes back to the previous mode when the cause is cleared;
    `shows` makes it a failsafe in the heartbeat; a landing begins its descent after `land_delay_s`. A text may
    hold {volts} and {used_mah} of the battery.
    """

    action: Behaviour | None = None
    hold_s: Seconds = 0.0
    texts: tuple[StatusText, ...] = ()
    action_texts: tuple[StatusText, ...] = ()
    resumes: bool = False
    shows: bool = True
    land_delay_s: Seconds = 0.0


@dataclass(frozen=True, slots=True)
class BatteryStep:
    """Charge below `fraction`, or volts below `volts` for `lasts_s`; `charge_state` is MAVLink's."""

    reaction: Reaction
    charge_state: int
    fraction: float = 0.0
    volts: float = 0.0
    lasts_s: Seconds = 0.0


@dataclass(frozen=True, slots=True)
class AidingTexts:
    """What an estimator reports of satellite navigation that is gone for `after_s`, and of its return."""

    after_s: Seconds
    lost: tuple[StatusText, ...]
    back: tuple[StatusText, ...]


@dataclass(frozen=True, slots=True)
class FailsafeSettings:
    """The reaction to each cause; None for no reaction.

    `strongest` lets no reaction replace a stronger one that is active. `latched` keeps a failsafe that has
    acted until the mode changes or the vehicle is disarmed, and ends it then; else it lasts as long as its
    cause, in whatever mode, armed or not.
    """

    hold_texts: tuple[StatusText, ...]  # with the Hold before an action
    disarms_on_ground: bool
    disarm_suffix: str  # put behind the texts of a reaction that disarms
    strongest: bool
    latched: bool
    station_timeout_s: Seconds
    station: Reaction | None
    station_back_texts: tuple[StatusText, ...] = ()
    station_lost_event: StatusText | None = None  # an event without a text, whatever the reaction
    setpoints: Reaction | None = None
    external_mode: Reaction | None = None  # to a companion's mode that cannot be flown any more
    sticks: Reaction | None = None
    battery: tuple[BatteryStep, ...] = ()
    position: Reaction | None = None  # in a mode that needs a position
    position_confirmed_s: Seconds = 0.0  # lost, or back, for so long until it counts
    position_lost_texts: tuple[StatusText, ...] = ()  # whatever the mode
    position_back_texts: tuple[StatusText, ...] = ()  # where the reaction has acted
    aiding: AidingTexts | None = None
    radio: Reaction | None = None
    radio_silent: bool = False  # the simulated radio has fallen silent
    radio_timeout_s: Seconds = math.inf
    radio_back_texts: tuple[StatusText, ...] = ()


class Breach(IntEnum):
    """Which limit was passed; values of FENCE_BREACH where there is one."""

    NONE = 0
    FLOOR = 1
    CEILING = 2
    CIRCLE = 3
    POLYGON = 4


@dataclass(frozen=True, slots=True)
class FenceLimits:
    """The fence as the parameters have it; distances from home, None for no limit."""

    radius_m: float | None
    ceiling_m: float | None
    polygons: bool
    enabled: bool  # where no parameter enables the fence by itself
    # Climbing ends this far below the ceiling; None: the fence slows nothing down
    ceiling_margin_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FencePolicy:
    """Fence and rally points of an autopilot."""

    limits: Callable[[ParameterStore], FenceLimits]
    reaction: Callable[[Breach, float, ParameterStore], Reaction]
    """What is done about a breach, this many metres outside."""
    recovery_text: StatusText | None
    recovery_s: float
    cleared_text: StatusText | None
    repeat_distance_m: float
    any_inclusion: bool
    enable_command: bool
    enable_parameter: str | None
    refuses_setpoints: bool
    outside: Refusal
    """Answer to a command to go outside."""
    rally_limit_m: Callable[[ParameterStore], float]
    """Rally points farther away than this do not count."""
    rally_includes_home: Callable[[ParameterStore], bool]
    uses_rally: Callable[[ParameterStore], bool]
    """Whether a return goes to rally points at all."""


@dataclass(frozen=True, slots=True)
class SimulatedDischarge:
    """A battery that empties by the clock: in `empties_s` of being armed, but never below `min_fraction`."""

    empties_s: Seconds
    min_fraction: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyPolicy:
    """Failsafes, fence and battery of an autopilot."""

    failsafes: Callable[[ParameterStore], FailsafeSettings]
    fence: FencePolicy
    is_ground_station: Callable[[int, ParameterStore], bool]
    """Whether heartbeats and sticks of this system are the ground station's."""
    dead_reckoning_s: Seconds
    """For so long without fixes the estimate of position is continued."""
    battery_volts: Callable[[FlightState, ParameterStore], float]
    """The voltage that the autopilot measures."""
    simulated_discharge: Callable[[ParameterStore], SimulatedDischarge | None] = lambda parameters: None
    """The battery of the autopilot's own simulation, when its parameters ask for one."""
    counts_charge: bool
    failure_parameter: str | None
