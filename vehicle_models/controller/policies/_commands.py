"""Which commands an autopilot carries out, and how it answers them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..links._enums import MAV_CMD
from ..state._flight_limits import FlightLimits
from ..state._flight_state import FlightState
from ..state._service import Command, CommandResult, Refusal
from ..state._texts import StatusText


@dataclass(frozen=True, slots=True)
class CommandAnswer:
    """Results of a command that has no effect here: the first at once, the others a second apart; and texts.

    `first_time` are the results when the command comes for the first time, where that makes a difference.
    """

    results: tuple[CommandResult, ...]
    texts: tuple[StatusText, ...] = ()
    first_time: tuple[CommandResult, ...] = ()


_MAV_ROI_LOCATION = 3.0


def roi_by_kind(command: Command) -> bool:
    """PX4: a region of interest is a place where the command or its first parameter says so."""
    return command.number == MAV_CMD.DO_SET_ROI_LOCATION or command.params[0] == _MAV_ROI_LOCATION


def roi_by_coordinates(command: Command) -> bool:
    """ArduPilot: DO_SET_ROI is about a place wherever it gives coordinates."""
    return any(command.params[4:6]) if command.number == MAV_CMD.DO_SET_ROI else roi_by_kind(command)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandPolicy:
    """Commands of an autopilot. The functions change nothing; a refusal of None carries the command out."""

    optional: frozenset[int]
    """Commands carried out of those that not every autopilot has: CONDITION_YAW, DO_PAUSE_CONTINUE,
    DO_CHANGE_ALTITUDE, DO_MOUNT_CONFIGURE and DO_MOUNT_CONTROL (both or none).
    """

    fixed_results: Mapping[int, CommandResult | None]
    """Results of commands without effect; None: no answer. A command that is unknown here is UNSUPPORTED."""

    answer: Callable[[FlightState, Command], CommandAnswer | None]
    """Answer to a command without effect that depends on the state; None: as `fixed_results` has it."""

    accepts_mode_first: bool
    any_component: bool
    answers_ping: bool
    refuse_takeoff: Callable[[FlightState, Command], Refusal | None]
    takeoff_altitude_m: Callable[[FlightState, Command, FlightLimits], float | None]
    """AMSL altitude that NAV_TAKEOFF asks for; None for the default height."""
    raises_low_takeoffs: bool
    refuse_reposition: Callable[[FlightState, Command], Refusal | None]
    refuse_home: Callable[[FlightState, Command], Refusal | None]
    confirms_origin: bool
    origin_with_home: bool
    bad_home: CommandResult
    home_at_zero_is_here: bool
    home_has_heading: bool
    altitude_amsl_m: Callable[[FlightState, int | None, float], float]
    """AMSL altitude that the frame and the seventh parameter of a command mean."""
    result_without_speed: CommandResult
    bad_orbit_text: StatusText | None
    roi_names_place: Callable[[Command], bool]
    """Whether a DO_SET_ROI is about a place, and not the end of one."""
    gimbal_needs_control: bool
    commands_devices: bool
    motor_test_order: tuple[int, ...] = ()
    """Rotors in the order of DO_MOTOR_TEST; empty: there is no such command."""
