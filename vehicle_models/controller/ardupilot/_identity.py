"""ArduCopter's version, its texts, and the file of packed parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..files._packed_parameters import packed_parameters
from ..files._served_files import FileContent
from ..links._enums import MAV_AUTOPILOT
from ..policies._choices import announcements, choices
from ..policies._identity import BootText, CalibrationProtocol, IdentityPolicy
from ..state._flight_state import FlightState
from ..state._parameter_store import ParameterStore
from ..state._texts import INFO
from ._modes import ALIGNED_S, ESTIMATOR_S, POSITION_S, RECEIVER_S, USES_GPS_S


def _boot_texts(flight: FlightState) -> Sequence[BootText]:
    aligned = ("tilt alignment complete", "MAG0 initial yaw alignment complete")
    texts = (
        (0.2, "Calibrating barometer"),
        (1.8, "Barometer 1 calibration complete"),
        (1.8, "Barometer 2 calibration complete"),
        (2.35, "ArduPilot Ready"),
        (2.35, "AHRS: DCM active"),
        (2.65, "RC7: SaveWaypoint LOW"),
        (ESTIMATOR_S, "EKF3 IMU0 initialised"),
        (ESTIMATOR_S, "EKF3 IMU1 initialised"),
        (ESTIMATOR_S, "AHRS: EKF3 active"),
        *((ALIGNED_S, f"EKF3 IMU{unit} {text}") for text in aligned for unit in (0, 1)),
        (RECEIVER_S, "GPS 1: probing for u-blox at 230400 baud"),
        (RECEIVER_S, "GPS 1: detected u-blox"),
        (POSITION_S, "EKF3 IMU0 origin set"),
        (POSITION_S, f"Field Elevation Set: {flight.origin.altitude_m:.0f}m"),
        (POSITION_S, "EKF3 IMU1 origin set"),
        (USES_GPS_S, "EKF3 IMU0 is using GPS"),
        (USES_GPS_S, "EKF3 IMU1 is using GPS"),
    )
    return tuple(BootText(at_s, INFO, text) for at_s, text in texts)


def _files(parameters: ParameterStore) -> Mapping[str, FileContent]:
    return {"@PARAM/param.pck": lambda query: packed_parameters(parameters, query)}


IDENTITY = IdentityPolicy(
    **choices(IdentityPolicy, "ardupilot"),
    name="ardupilot",
    autopilot=MAV_AUTOPILOT.ARDUPILOTMEGA,
    flight_custom_version=b"92b0cd78",
    uid2=b"3a5c0f7e91d24b68a",  # the real one has its machine's id here
    texts=announcements("ardupilot"),
    text_ending="",
    boot_texts=_boot_texts,
    climbed_clear_texts=tuple(
        (INFO, f"EKF3 IMU{unit} MAG0 in-flight yaw alignment complete") for unit in (0, 1)
    ),
    calibration=CalibrationProtocol.MESSAGES,
    files=_files,
)
