"""PX4's answers to commands, as section 3.3 of the observations has them, and how it takes setpoints and sticks."""

from __future__ import annotations

import math

from ..links._enums import MAV_CMD, MAV_FRAME
from ..policies._choices import choices
from ..policies._commands import CommandAnswer, CommandPolicy, roi_by_kind
from ..policies._setpoints import SetpointPolicy
from ..policies._tables import fixed_results
from ..state._flight_limits import FlightLimits
from ..state._flight_state import FlightState
from ..state._service import Command, CommandResult, Refusal
from ..state._texts import CRITICAL

# MAV_DO_REPOSITION_FLAGS
_CHANGE_MODE = 1


def _answer(flight: FlightState, command: Command) -> CommandAnswer | None:
    accepted, denied = (CommandResult.ACCEPTED,), CommandAnswer((CommandResult.DENIED,))
    match command.number:
        # The SITL answered the first gripper command with IN_PROGRESS, later ones at once.
        case MAV_CMD.DO_GRIPPER:
            return CommandAnswer(accepted, first_time=(CommandResult.IN_PROGRESS, CommandResult.ACCEPTED))
        case MAV_CMD.PREFLIGHT_CALIBRATION | MAV_CMD.PREFLIGHT_STORAGE if flight.armed:
            return CommandAnswer((CommandResult.TEMPORARILY_REJECTED,))
        case MAV_CMD.ACTUATOR_TEST if flight.armed:
            return denied
        case MAV_CMD.PREFLIGHT_REBOOT_SHUTDOWN if command.params[0] not in (0.0, 1.0):
            return denied
        case MAV_CMD.PREFLIGHT_REBOOT_SHUTDOWN if command.params[0] == 1.0 and flight.armed:
            return denied
        case MAV_CMD.MISSION_START:
            text = "Mission start denied! No valid mission"
            return CommandAnswer((CommandResult.DENIED,), ((CRITICAL, text),))
        case MAV_CMD.CONTROL_HIGH_LATENCY:
            text = "Control high latency failed! Telemetry unavailable"
            return CommandAnswer((CommandResult.FAILED,), ((CRITICAL, text),))
    return None


def _takeoff_altitude_m(flight: FlightState, command: Command, limits: FlightLimits) -> float | None:
    """Zero and NaN alike mean the default height."""
    altitude = command.params[6]
    return altitude if math.isfinite(altitude) and altitude != 0.0 else None


def _refuse_reposition(flight: FlightState, command: Command) -> Refusal | None:
    return None if command.flag(1, _CHANGE_MODE) else Refusal(CommandResult.UNSUPPORTED)


def _altitude_amsl_m(flight: FlightState, frame: int | None, altitude_m: float) -> float:
    # Above sea level in every frame: every observed release did so, and MAVSDK relies on it.
    return altitude_m


COMMANDS = CommandPolicy(
    **choices(CommandPolicy, "px4"),
    optional=frozenset({MAV_CMD.DO_CHANGE_ALTITUDE}),
    fixed_results=fixed_results("px4_result"),
    answer=_answer,
    refuse_takeoff=lambda flight, command: None,
    takeoff_altitude_m=_takeoff_altitude_m,
    refuse_reposition=_refuse_reposition,
    refuse_home=lambda flight, command: None,
    altitude_amsl_m=_altitude_amsl_m,
    roi_names_place=roi_by_kind,
)

SETPOINTS = SetpointPolicy(
    **choices(SetpointPolicy, "px4"),
    # In the body frame PX4 takes velocities and accelerations, and no positions.
    local_frames={MAV_FRAME.LOCAL_NED: "local", MAV_FRAME.BODY_NED: "body-velocity"},
    global_frames={
        MAV_FRAME.GLOBAL_INT: "amsl",
        MAV_FRAME.GLOBAL_RELATIVE_ALT_INT: "home",
        MAV_FRAME.GLOBAL_TERRAIN_ALT_INT: "ground",
    },
    echo_behaviours=None,
)
