"""PX4's modes (`modes.csv`): custom_mode = sub << 24 | main << 16.

A mode that cannot be armed shows system_status 0 on the ground.
"""

from __future__ import annotations

from pathlib import Path

from ..links._enums import MAV_MODE_FLAG, MAV_STATE
from ..policies._choices import choices
from ..policies._modes import ModePolicy, numbers_by_mode, read_modes
from ..state._flight_state import Behaviour, FlightMode, FlightState
from ..state._parameter_store import ParameterStore
from ..state._service import CommandResult, Refusal, has_flag
from ..state._texts import CRITICAL

# "Resolve system health failures first" until then.
READY_S = 4.2
# Home is set; a client that waits for it is not refused the arming.
POSITION_S = READY_S

_ARMED = int(MAV_MODE_FLAG.SAFETY_ARMED)

MODES_TABLE = Path(__file__).with_name("modes.csv")
NAV_STATES = numbers_by_mode(MODES_TABLE, "nav_state")
# AUTO_LAND needs a position too: without one PX4 descends, which it shows as the same mode.
_MODES = read_modes(MODES_TABLE)
_NAMED = {mode.name: mode for mode in _MODES}


def ready(flight: FlightState) -> bool:
    """Whether the vehicle could be armed in its present mode."""
    return flight.time_s >= READY_S and _armable(flight) and not flight.crashed


def knows_position(flight: FlightState) -> bool:
    return flight.time_s >= POSITION_S


def is_placed(flight: FlightState) -> bool:
    """Whether there is a position that counts."""
    return flight.position_ok and knows_position(flight)


def _armable(flight: FlightState) -> bool:
    behaviour = flight.mode.behaviour
    if flight.companion_objects:
        return False
    if behaviour is Behaviour.EXTERNAL:
        external = flight.external_modes.get(flight.mode.name)
        return external is not None and external.armable
    if behaviour is Behaviour.MISSION:
        return flight.mission_ready and flight.position_ok
    piloted = behaviour is Behaviour.PILOT and flight.sticks is not None
    return piloted or (flight.mode.armable and flight.position_ok)


def _heartbeat(flight: FlightState, has_setpoints: bool) -> tuple[int, int]:
    base = flight.mode.base
    lacks_setpoints = flight.mode.behaviour is Behaviour.OFFBOARD and not has_setpoints
    # The SITL showed a bare custom mode for OFFBOARD until setpoints arrived, and not after a landing out of it.
    if lacks_setpoints and not flight.armed and not flight.had_setpoints:
        base = int(MAV_MODE_FLAG.CUSTOM_MODE_ENABLED)
    if flight.mode.behaviour is Behaviour.TERMINATE:
        return base | (_ARMED if flight.armed else 0), MAV_STATE.FLIGHT_TERMINATION
    if flight.armed:
        return base | _ARMED, MAV_STATE.CRITICAL if flight.failsafe else MAV_STATE.ACTIVE
    return base, MAV_STATE.STANDBY if ready(flight) and not lacks_setpoints else MAV_STATE.UNINIT


def _refuse_arm_value(value: float) -> Refusal | None:
    if value in (0.0, 1.0) or 0.5 <= value < 1.5:
        return None
    return Refusal(None, ((CRITICAL, f"Unsupported ARM_DISARM param: {value:.3f}"),))


def _refuse_arming(
    flight: FlightState, parameters: ParameterStore, forced: bool, has_setpoints: bool
) -> Refusal | None:
    if forced and flight.time_s >= READY_S and not flight.crashed:
        return None
    lacks_setpoints = flight.mode.behaviour is Behaviour.OFFBOARD and not has_setpoints
    if ready(flight) and not lacks_setpoints and flight.battery_fraction > parameters["BAT_CRIT_THR"]:
        return None
    text = "Arming denied: Resolve system health failures first"
    return Refusal(CommandResult.TEMPORARILY_REJECTED, ((CRITICAL, text),))


def _refuse_disarming(flight: FlightState, forced: bool) -> Refusal | None:
    if forced or not flight.flying:
        return None
    return Refusal(CommandResult.TEMPORARILY_REJECTED, ((CRITICAL, "Disarming denied: not landed"),))


def _refuse_mode(
    flight: FlightState, wanted: FlightMode | None, number: int, has_setpoints: bool
) -> Refusal | None:
    if wanted is None or wanted.behaviour is Behaviour.TERMINATE:
        return Refusal(CommandResult.TEMPORARILY_REJECTED, ((CRITICAL, "Unsupported auto mode"),))
    if not flight.armed or (wanted.behaviour is Behaviour.MISSION and flight.mission_ready):
        return None
    unavailable = wanted.behaviour in (Behaviour.MISSION, Behaviour.CIRCLE)
    unavailable |= wanted.behaviour is Behaviour.EXTERNAL and not flight.runs(wanted)
    unavailable |= wanted.behaviour is Behaviour.PILOT and flight.sticks is None
    if unavailable or (wanted.behaviour is Behaviour.OFFBOARD and not has_setpoints):
        return _not_available(wanted)
    return None


def _not_available(wanted: FlightMode) -> Refusal:
    text = f"Switching to {wanted.label} is currently not available"
    return Refusal(CommandResult.TEMPORARILY_REJECTED, ((CRITICAL, text),))


def _number_of_command(params: tuple[float, ...]) -> int | None:
    """Bit 0 of the first parameter announces main and sub mode; else its other bits ask for a mode (source)."""
    base, main, sub = params[:3]
    if not has_flag(base, MAV_MODE_FLAG.CUSTOM_MODE_ENABLED):
        if has_flag(base, MAV_MODE_FLAG.AUTO_ENABLED):
            return _NAMED["AUTO_MISSION"].custom
        if not has_flag(base, MAV_MODE_FLAG.MANUAL_INPUT_ENABLED):
            return None
        if has_flag(base, MAV_MODE_FLAG.GUIDED_ENABLED):
            return _NAMED["POSCTL"].custom
        return _NAMED["STABILIZED" if has_flag(base, MAV_MODE_FLAG.STABILIZE_ENABLED) else "MANUAL"].custom
    if not (0 <= main < 256 and 0 <= sub < 256):
        return None
    return int(sub) << 24 | int(main) << 16


MODES = ModePolicy(
    **choices(ModePolicy, "px4"),
    modes=_MODES,
    initial=_NAMED["AUTO_LOITER"],
    hold=_NAMED["AUTO_LOITER"],
    land=_NAMED["AUTO_LAND"],
    return_home=_NAMED["AUTO_RTL"],
    offboard=_NAMED["OFFBOARD"],
    reposition=_NAMED["AUTO_LOITER"],
    mission=_NAMED["AUTO_MISSION"],
    takeoff=_NAMED["AUTO_TAKEOFF"],
    orbit=_NAMED["POSCTL_ORBIT"],
    pilot=(_NAMED["POSCTL"], _NAMED["ALTCTL"]),
    after_landing=_NAMED["AUTO_LOITER"],
    standard_modes=numbers_by_mode(MODES_TABLE, "standard_mode"),
    heartbeat=_heartbeat,
    refuse_mode=_refuse_mode,
    refuse_without_position=_not_available,
    number_of_command=_number_of_command,
    knows_position=knows_position,
    refuse_arming=_refuse_arming,
    refuse_disarming=_refuse_disarming,
    refuse_arm_value=_refuse_arm_value,
)
