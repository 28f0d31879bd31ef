"""ArduCopter's modes, the checks before arming, and the timeline of its start."""

from __future__ import annotations

from pathlib import Path

from ..links._enums import MAV_MODE_FLAG, MAV_STATE
from ..policies._choices import choices
from ..policies._modes import ModePolicy, numbers_by_mode, read_modes
from ..state._flight_state import Behaviour, FlightMode, FlightState
from ..state._parameter_store import ParameterStore
from ..state._service import CommandResult, Refusal, has_flag
from ..state._texts import CRITICAL, WARNING
from ._safety import battery_volts

# Simulated seconds after the start at which the SITL was seen to reach each state.
STANDBY_S, ESTIMATOR_S, ALIGNED_S, RECEIVER_S, POSITION_S = 2.9, 4.4, 5.8, 9.8, 20.0
AHRS_S, STABILIZE_READY_S, USES_GPS_S, GUIDED_READY_S = 22.5, 23.5, 41.5, 42.5
# A real one boots before the session, as long as the bench gives it (`ArduPilotKind.boot_s`).
_BOOTED_S = 50.0

_CUSTOM, _STABILIZE = MAV_MODE_FLAG.CUSTOM_MODE_ENABLED, MAV_MODE_FLAG.STABILIZE_ENABLED
_PLAIN = int(_CUSTOM | _STABILIZE | MAV_MODE_FLAG.MANUAL_INPUT_ENABLED)
# Of modes that steer position.
_STEERS = int(_PLAIN | MAV_MODE_FLAG.GUIDED_ENABLED)
_ARMED = int(MAV_MODE_FLAG.SAFETY_ARMED)

_TABLE = Path(__file__).with_name("modes.csv")
_MODES = read_modes(_TABLE)
_NAMED = {mode.name: mode for mode in _MODES}
# Modes that exist but cannot be entered here: the name, and the reason sent with the refusal.
_UNAVAILABLE = {
    14: ("FLIP", ""),
    15: ("AUTOTUNE", ""),
    22: ("FLOWHOLD", ""),
    23: ("FOLLOW", "Set FOLL_ENABLE = 1"),
    25: ("SYSTEMID", "No axis selected, SID_AXIS = 0"),
    27: ("AUTO RTL", "No return path or landing sequence found"),
    28: ("TURTLE", ""),
}

# Functions of a radio's switches (RCn_OPTION) that enter a mode, as ArduPilot's documentation numbers them.
_AUXILIARY_MODES: dict[float, int] = {
    switch: _NAMED[name].custom for name, switch in numbers_by_mode(_TABLE, "switch").items()
}


def steers_position(flight: FlightState) -> bool:
    return flight.mode.base == _STEERS


def ready(flight: FlightState) -> bool:
    """Whether SYS_STATUS shows that the vehicle could be armed in its present mode.

    The real one works this out once a second, so it shows it up to a second later than it arms.
    """
    return _stands_ready(flight) and not flight.calibration_failures


def _stands_ready(flight: FlightState) -> bool:
    """Whether nothing but a calibration keeps the vehicle from being armed."""
    placed = flight.time_s >= GUIDED_READY_S and flight.position_ok
    return (placed if steers_position(flight) else flight.time_s >= STABILIZE_READY_S) and not flight.crashed


def knows_position(flight: FlightState) -> bool:
    return flight.time_s >= POSITION_S


def _prearm_failures(flight: FlightState, p: ParameterStore) -> tuple[str, ...]:
    """The checks that keep the vehicle from being armed in its present mode, in the order of sending."""
    now_s = flight.time_s
    if now_s < STANDBY_S:
        return ("System not initialised",)
    if now_s < ALIGNED_S:
        ahrs = "not using configured AHRS type" if now_s < ESTIMATOR_S else "EKF3 still initialising"
        return ("Accels inconsistent", "EKF attitude is bad", f"AHRS: {ahrs}")
    low = battery_volts(flight, p) < p["BATT_LOW_VOLT"]
    failures = [*flight.calibration_failures]
    failures += ["Battery 1 low voltage failsafe", "Battery failsafe"] if low else []
    if now_s < RECEIVER_S:
        return (*failures, "AHRS: EK3 sources require GPS")
    if steers_position(flight) and (now_s < USES_GPS_S or not flight.position_ok):
        return (*failures, "Need Position Estimate")
    if now_s < STABILIZE_READY_S:
        return (*failures, "AHRS: waiting for home")
    return tuple(failures)


def _heartbeat(flight: FlightState, has_setpoints: bool) -> tuple[int, int]:
    base = flight.mode.base | (_ARMED if flight.armed or flight.tests_motors else 0)
    # A return steers position as soon as it is flown; disarmed in RTL the SITL showed the plain bits.
    if flight.armed and flight.mode.behaviour is Behaviour.RETURN:
        base |= MAV_MODE_FLAG.GUIDED_ENABLED
    # A landing without a position steers nothing but the height, and a mission that has landed nothing at all.
    blind = flight.mode.behaviour is Behaviour.LAND and not flight.position_ok
    if blind or (flight.mode.behaviour is Behaviour.MISSION and flight.disarmed_by_landing):
        base &= ~MAV_MODE_FLAG.GUIDED_ENABLED
    # While it starts, the SITL shows a mode that steers position, whatever the mode is.
    if flight.time_s < STANDBY_S:
        return _STEERS, MAV_STATE.BOOT
    if flight.failsafe:
        return base, MAV_STATE.CRITICAL
    return base, MAV_STATE.ACTIVE if flight.armed and flight.flying else MAV_STATE.STANDBY


def _refuse_arm_value(value: float) -> Refusal | None:
    return None if value in (0.0, 1.0) else Refusal(CommandResult.UNSUPPORTED)


def _refuse_arming(
    flight: FlightState, parameters: ParameterStore, forced: bool, has_setpoints: bool
) -> Refusal | None:
    if flight.mode.behaviour is Behaviour.MISSION and not flight.mission_ready:
        return Refusal(CommandResult.FAILED, ((CRITICAL, "Arm: Mode requires mission"),))
    if not flight.mode.armable:
        return Refusal(CommandResult.FAILED, ((CRITICAL, f"Arm: {flight.mode.name} mode not armable"),))
    failures = _prearm_failures(flight, parameters)
    if not flight.crashed and (not failures or (forced and _stands_ready(flight))):
        return None
    return Refusal(CommandResult.FAILED, tuple((CRITICAL, f"Arm: {text}") for text in failures))


def _refuse_disarming(flight: FlightState, forced: bool) -> Refusal | None:
    return None if forced or not flight.flying else Refusal(CommandResult.FAILED)


def _refuse_mode(
    flight: FlightState, wanted: FlightMode | None, number: int, has_setpoints: bool
) -> Refusal | None:
    if wanted is None:
        unavailable = _UNAVAILABLE.get(number)
        if unavailable is None:
            return Refusal(CommandResult.FAILED, ((WARNING, f"No such mode {number}"),))
        name, reason = unavailable
        reasons = ((WARNING, reason),) if reason else ()
        failed = (WARNING, f"Mode change to {name} failed: init failed")
        return Refusal(CommandResult.FAILED, (*reasons, failed))
    if wanted.behaviour is Behaviour.MISSION and flight.armed and not flight.mission_ready:
        return Refusal(CommandResult.FAILED, ((WARNING, "Mode change to AUTO failed: init failed"),))
    return None


def _requires_position(wanted: FlightMode) -> Refusal:
    text = f"Mode change to {wanted.name} failed: requires position"
    return Refusal(CommandResult.FAILED, ((WARNING, text),))


def _number_of_command(params: tuple[float, ...]) -> int | None:
    custom = has_flag(params[0], MAV_MODE_FLAG.CUSTOM_MODE_ENABLED)
    return int(params[1]) if custom and 0 <= params[1] < 2**24 else None


MODES = ModePolicy(
    **choices(ModePolicy, "ardupilot"),
    modes=_MODES,
    initial=_NAMED["STABILIZE"],
    hold=_NAMED["BRAKE"],
    land=_NAMED["LAND"],
    return_home=_NAMED["RTL"],
    offboard=_NAMED["GUIDED"],
    reposition=_NAMED["GUIDED"],
    mission=_NAMED["AUTO"],
    loiter=_NAMED["LOITER"],
    heartbeat=_heartbeat,
    refuse_mode=_refuse_mode,
    refuse_without_position=_requires_position,
    number_of_command=_number_of_command,
    auxiliary_modes=_AUXILIARY_MODES,
    knows_position=knows_position,
    refuse_arming=_refuse_arming,
    refuse_disarming=_refuse_disarming,
    refuse_arm_value=_refuse_arm_value,
    prearm_failures=_prearm_failures,
    booted_s=_BOOTED_S,
)
