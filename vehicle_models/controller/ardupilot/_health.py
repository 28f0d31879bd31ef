"""ArduCopter's health while it starts and after: checks before arming, bits of SYS_STATUS, estimator flags, boot texts."""

from __future__ import annotations

from .._flight import Flight
from .._personality import SensorBits
from ..parameters._store import ParameterStore
from ..telemetry._texts import INFO

# Simulated seconds at which the SITL was seen to get so far.
STANDBY_S, ESTIMATOR_S, ALIGNED_S, RECEIVER_S, PLACE_S = 2.9, 4.4, 5.8, 9.8, 20.0
AHRS_S, STABILIZE_READY_S, USES_GPS_S, GUIDED_READY_S = 22.5, 23.5, 41.5, 42.5
_STEERS = 89  # base_mode of modes that steer position

_AHRS, _LOGGING, _PREARM, _POSITION_CONTROL = 0x200000, 0x1000000, 0x10000000, 0x6000
_BEFORE_STANDBY = SensorBits(0x5331FC0F, 0x52019C0F, 0x45119C0B)
_BEFORE_RECEIVER = SensorBits(0x5371FC0F, 0x52419C0F, 0x47519C0F)
_BEFORE_AHRS = SensorBits(0x5371FC2F, 0x52419C2F, 0x47519C2F)

_UNINITIALISED, _NO_PLACE, _ALL = 1024, 167, 831  # EKF_STATUS_FLAGS; 167 holds a constant position


def steers(flight: Flight) -> bool:
    return flight.mode.base == _STEERS


def failing(flight: Flight, p: ParameterStore, volts: float) -> tuple[str, ...]:
    """The checks that keep the vehicle from being armed in its present mode, in the order in which they are said."""
    at = flight.time_s
    if at < STANDBY_S:
        return ("System not initialised",)
    if at < ALIGNED_S:
        behind = "AHRS: not using configured AHRS type" if at < ESTIMATOR_S else "AHRS: EKF3 still initialising"
        return ("Accels inconsistent", "EKF attitude is bad", behind)
    found = ["Battery 1 low voltage failsafe", "Battery failsafe"] if volts < p["BATT_LOW_VOLT"] else []
    if at < RECEIVER_S:
        return (*found, "AHRS: EK3 sources require GPS")
    if steers(flight) and (at < GUIDED_READY_S or not flight.position_ok):
        return (*found, "Need Position Estimate")
    if at < STABILIZE_READY_S:
        return (*found, "AHRS: waiting for home")
    return tuple(found)


def sensors(flight: Flight, ready: bool) -> SensorBits:
    """present, enabled and health as they went by while the SITL started."""
    at = flight.time_s
    if at < RECEIVER_S:
        return _BEFORE_STANDBY if at < STANDBY_S else _BEFORE_RECEIVER
    bits = _BEFORE_AHRS
    enabled, health = bits.enabled, bits.health
    if at >= AHRS_S:
        enabled, health = enabled | _AHRS, health | _AHRS
    if steers(flight):
        enabled |= _POSITION_CONTROL
    if flight.armed:
        enabled |= _LOGGING
    return SensorBits(bits.present, enabled, health | (_PREARM if ready else 0))


def estimator_flags(flight: Flight) -> int:
    if flight.time_s < ESTIMATOR_S:
        return _UNINITIALISED
    return _NO_PLACE if flight.time_s < USES_GPS_S or not flight.position_ok else _ALL


def boot_texts(field_m: float) -> tuple[tuple[float, int, str], ...]:
    """What is said while starting at a field `field_m` above the sea."""
    both = (
        (at, text) for at, text in ((ALIGNED_S, "tilt alignment complete"), (ALIGNED_S, "MAG0 initial yaw alignment complete"))
    )
    aligned = tuple((at, INFO, f"EKF3 IMU{unit} {text}") for at, text in both for unit in (0, 1))
    return (
        (0.2, INFO, "Calibrating barometer"),
        (1.8, INFO, "Barometer 1 calibration complete"),
        (1.8, INFO, "Barometer 2 calibration complete"),
        (2.35, INFO, "ArduPilot Ready"),
        (2.35, INFO, "AHRS: DCM active"),
        (2.65, INFO, "RC7: SaveWaypoint LOW"),
        (ESTIMATOR_S, INFO, "EKF3 IMU0 initialised"),
        (ESTIMATOR_S, INFO, "EKF3 IMU1 initialised"),
        (ESTIMATOR_S, INFO, "AHRS: EKF3 active"),
        *aligned,
        (RECEIVER_S, INFO, "GPS 1: probing for u-blox at 230400 baud"),
        (RECEIVER_S, INFO, "GPS 1: detected u-blox"),
        (PLACE_S, INFO, "EKF3 IMU0 origin set"),
        (PLACE_S, INFO, f"Field Elevation Set: {field_m:.0f}m"),
        (PLACE_S, INFO, "EKF3 IMU1 origin set"),
        (USES_GPS_S, INFO, "EKF3 IMU0 is using GPS"),
        (USES_GPS_S, INFO, "EKF3 IMU1 is using GPS"),
    )
