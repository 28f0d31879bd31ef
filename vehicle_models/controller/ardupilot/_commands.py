"""ArduCopter's answers to commands, as section 5 of the observations has them, and how it takes setpoints and sticks."""

from __future__ import annotations

import math

from ..links._enums import MAV_CMD, MAV_FRAME
from ..policies._choices import choices
from ..policies._commands import CommandAnswer, CommandPolicy, roi_by_coordinates
from ..policies._setpoints import SetpointPolicy
from ..policies._tables import fixed_results
from ..state._flight_limits import FlightLimits
from ..state._flight_state import Behaviour, FlightState, LandedState
from ..state._service import Command, CommandResult, Refusal
from ..state._texts import INFO, NOTICE, WARNING
from ._modes import knows_position

_RELATIVE_FRAMES = (MAV_FRAME.GLOBAL_RELATIVE_ALT, MAV_FRAME.GLOBAL_RELATIVE_ALT_INT)
_REPOSITION_FRAMES = (MAV_FRAME.GLOBAL, MAV_FRAME.GLOBAL_INT, *_RELATIVE_FRAMES)
# MAV_DO_REPOSITION_FLAGS
_CHANGE_MODE = 1
_REBOOT, _REBOOT_TO_BOOTLOADER = 1.0, 3.0
BANNER = ("ArduCopter V4.6.3 (92b0cd78)", "0" * 32, "Frame: QUAD/PLUS")

_ACCEPTED, _FAILED = CommandAnswer((CommandResult.ACCEPTED,)), CommandAnswer((CommandResult.FAILED,))
_DENIED, _UNSUPPORTED = CommandAnswer((CommandResult.DENIED,)), CommandAnswer((CommandResult.UNSUPPORTED,))


def _answer(flight: FlightState, command: Command) -> CommandAnswer | None:
    first = command.params[0]
    accepted, failed = _ACCEPTED, _FAILED
    match command.number:
        case MAV_CMD.DO_FENCE_ENABLE:
            return accepted if first in (0.0, 1.0, 2.0) else failed
        case MAV_CMD.DO_SET_SERVO:
            return _set_servo(first)
        case MAV_CMD.DO_LAND_START:
            texts = ((WARNING, "Mode change to AUTO RTL failed: No landing sequence found"),) * 2
            return CommandAnswer((CommandResult.FAILED,), texts)
        case MAV_CMD.SET_EKF_SOURCE_SET:
            # Sets 1 to 3 exist (source); they change nothing, since there is one source of position here.
            return accepted if first in (1.0, 2.0, 3.0) else _DENIED
        case MAV_CMD.PREFLIGHT_REBOOT_SHUTDOWN:
            known = accepted if first in (_REBOOT, _REBOOT_TO_BOOTLOADER) else _UNSUPPORTED
            return failed if flight.armed or flight.tests_motors else known
        case MAV_CMD.CONTROL_HIGH_LATENCY:
            text = f"Control high latency {'en' if first else 'dis'}abled"
            return CommandAnswer((CommandResult.ACCEPTED,), ((NOTICE, text),))
        case MAV_CMD.DO_SEND_BANNER:
            return CommandAnswer((CommandResult.ACCEPTED,), tuple((INFO, text) for text in BANNER))
    return None


def _set_servo(channel: float) -> CommandAnswer:
    if channel in (1.0, 2.0, 3.0, 4.0):
        text = f"ServoRelayEvent: Channel {channel:.0f} is already in use"
        return CommandAnswer((CommandResult.FAILED,), ((WARNING, text),))
    return _ACCEPTED if 5.0 <= channel <= 16.0 else _FAILED


def _refuse_takeoff(flight: FlightState, command: Command) -> Refusal | None:
    altitude = command.params[6]
    if command.frame not in (None, *_RELATIVE_FRAMES):
        return Refusal(CommandResult.DENIED)
    on_ground = flight.landed is LandedState.ON_GROUND
    possible = flight.mode.behaviour is Behaviour.OFFBOARD and flight.armed and on_ground
    return None if possible and math.isfinite(altitude) and altitude > 0.0 else Refusal(CommandResult.FAILED)


def _takeoff_altitude_m(flight: FlightState, command: Command, limits: FlightLimits) -> float | None:
    return _altitude_amsl_m(flight, MAV_FRAME.GLOBAL_RELATIVE_ALT, command.params[6])


def _refuse_reposition(flight: FlightState, command: Command) -> Refusal | None:
    if command.frame is None:
        return Refusal(CommandResult.UNSUPPORTED)
    if command.frame not in _REPOSITION_FRAMES:
        return Refusal(CommandResult.DENIED, ((INFO, f"Unknown mavlink coordinate frame {command.frame}"),))
    latitude, longitude, altitude = command.params[4:7]
    if flight.mode.behaviour is not Behaviour.OFFBOARD and not command.flag(1, _CHANGE_MODE):
        return Refusal(CommandResult.DENIED)
    finite = math.isfinite(latitude) and math.isfinite(longitude) and math.isfinite(altitude)
    return None if finite and (latitude or longitude) else Refusal(CommandResult.DENIED)


def _refuse_home(flight: FlightState, command: Command) -> Refusal | None:
    return None if knows_position(flight) else Refusal(CommandResult.FAILED)


def _altitude_amsl_m(flight: FlightState, frame: int | None, altitude_m: float) -> float:
    home = flight.home or flight.origin
    return altitude_m + home.altitude_m if frame in _RELATIVE_FRAMES else altitude_m


COMMANDS = CommandPolicy(
    **choices(CommandPolicy, "ardupilot"),
    optional=frozenset(
        {
            MAV_CMD.CONDITION_YAW,
            MAV_CMD.DO_PAUSE_CONTINUE,
            MAV_CMD.DO_MOUNT_CONFIGURE,
            MAV_CMD.DO_MOUNT_CONTROL,
        }
    ),
    fixed_results=fixed_results("ardupilot_result"),
    answer=_answer,
    refuse_takeoff=_refuse_takeoff,
    takeoff_altitude_m=_takeoff_altitude_m,
    refuse_reposition=_refuse_reposition,
    refuse_home=_refuse_home,
    altitude_amsl_m=_altitude_amsl_m,
    roi_names_place=roi_by_coordinates,
    motor_test_order=(0, 3, 1, 2),  # clockwise from the front right
)

SETPOINTS = SetpointPolicy(
    **choices(SetpointPolicy, "ardupilot"),
    local_frames={
        MAV_FRAME.LOCAL_NED: "local",
        MAV_FRAME.LOCAL_OFFSET_NED: "offset",
        # ArduPilot treats both body frames as offsets from the vehicle, turned by its heading.
        MAV_FRAME.BODY_NED: "body",
        MAV_FRAME.BODY_OFFSET_NED: "body",
    },
    global_frames={
        MAV_FRAME.GLOBAL: "amsl",
        MAV_FRAME.GLOBAL_RELATIVE_ALT: "home",
        MAV_FRAME.GLOBAL_INT: "amsl",
        MAV_FRAME.GLOBAL_RELATIVE_ALT_INT: "home",
        MAV_FRAME.GLOBAL_TERRAIN_ALT: "ground",
        MAV_FRAME.GLOBAL_TERRAIN_ALT_INT: "ground",
    },
    echo_behaviours=(Behaviour.OFFBOARD,),
)
