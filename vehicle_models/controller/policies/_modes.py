"""Which modes an autopilot has, when they may be entered, and when the vehicle may be armed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..._read_table import read_table
from ..links._enums import MAV_MODE_FLAG
from ..state._flight_state import Behaviour, FlightMode, FlightState, StickControl
from ..state._parameter_store import ParameterStore
from ..state._service import CommandResult, Refusal
from ..state._texts import WARNING, StatusText


@dataclass(frozen=True, slots=True, kw_only=True)
class ModePolicy:
    """Modes and arming. The functions change nothing; `has_setpoints`: setpoints arrive in time."""

    modes: tuple[FlightMode, ...]
    initial: FlightMode
    hold: FlightMode
    land: FlightMode
    return_home: FlightMode
    offboard: FlightMode
    reposition: FlightMode
    """The mode in which DO_REPOSITION flies."""
    mission: FlightMode
    takeoff: FlightMode | None = None
    """None: taking off is part of the offboard mode."""
    loiter: FlightMode | None = None
    """The mode of NAV_LOITER_UNLIM; None: there is no such command."""
    orbit: FlightMode | None = None
    """The mode of DO_ORBIT; None: there is no such command."""
    pilot: tuple[FlightMode, FlightMode] | None = None
    """The modes in which a pilot takes over by moving the sticks: with a position, and without one."""
    after_landing: FlightMode | None = None
    """Entered when the vehicle has been disarmed."""
    standard_modes: Mapping[str, int] = field(default_factory=dict)
    """MAV_STANDARD_MODE by name of the mode; empty: the autopilot does not list its modes."""
    acknowledges_set_mode: bool
    heartbeat_on_change: bool
    heartbeat: Callable[[FlightState, bool], tuple[int, int]]
    """base_mode and system_status, given the flight and `has_setpoints`."""
    refuse_mode: Callable[[FlightState, FlightMode | None, int, bool], Refusal | None]
    """Why a mode may not be entered: flight, mode (None for an unknown number), number, `has_setpoints`."""

    refuse_without_position: Callable[[FlightMode], Refusal]
    """The refusal of a mode that needs a position while there is none, for an armed vehicle."""
    number_of_command: Callable[[tuple[float, ...]], int | None]
    """The custom mode that the parameters of DO_SET_MODE ask for; None where they ask for none."""
    result_without_mode: CommandResult
    auxiliary_modes: Mapping[float, int] = field(default_factory=dict)
    """Custom modes by function of DO_AUX_FUNCTION; empty: there is no such command."""
    no_auxiliary_text: StatusText = (WARNING, "Invalid channel option ({})")
    knows_position: Callable[[FlightState], bool]
    """Whether navigation has found the position, so that home can be set."""
    refuse_arming: Callable[[FlightState, ParameterStore, bool, bool], Refusal | None]
    """Why the vehicle may not be armed: flight, parameters, whether it is forced, `has_setpoints`."""
    refuse_disarming: Callable[[FlightState, bool], Refusal | None]
    """Why the vehicle may not be disarmed: flight, whether it is forced."""
    refuse_arm_value: Callable[[float], Refusal | None]
    """Why the first parameter of COMPONENT_ARM_DISARM makes no sense."""
    prearm_failures: Callable[[FlightState, ParameterStore], tuple[str, ...]] = lambda flight, parameters: ()
    """Failing checks that the autopilot reports without being asked; none for one that does not report."""
    checks_when_armed: CommandResult
    manual_landing_disarms: bool
    spools_up_armed: bool
    booted_s: float = 0.0
    """For so long the autopilot has run when the session begins; after a restart it begins anew."""

    @property
    def termination(self) -> FlightMode | None:
        """The mode that stops the rotors for good, where there is one."""
        return next((mode for mode in self.modes if mode.behaviour is Behaviour.TERMINATE), None)

    def numbered(self, custom: int) -> FlightMode | None:
        """The mode with this custom number, if there is one."""
        return next((mode for mode in self.modes if mode.custom == custom), None)


def read_modes(table: Path) -> tuple[FlightMode, ...]:
    """The modes of a CSV table: name, custom number, flags of HEARTBEAT.base_mode without ARMED, and the other fields of a
    FlightMode; further columns are the autopilot's own.
    """
    return tuple(
        FlightMode(
            row["name"],
            int(row["custom"], 0),
            sum(MAV_MODE_FLAG[flag] for flag in row["base"].split()),
            Behaviour[row["behaviour"]],
            row["armable"] == "yes",
            row["label"],
            StickControl[row["stick"]] if row["stick"] else None,
            row["needs_position"] == "yes",
        )
        for row in read_table(table)
    )


def numbers_by_mode(table: Path, column: str) -> dict[str, int]:
    """A column of such a table, of the modes that have a number there."""
    return {row["name"]: int(row[column]) for row in read_table(table) if row[column]}
