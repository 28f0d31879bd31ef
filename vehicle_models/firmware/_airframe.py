"""What an autopilot is told of the aircraft, so that nobody tunes it by hand."""

from __future__ import annotations

from collections.abc import Mapping

from ..x500 import HOVER_THRUST, ROTOR_ARM_M, ROTOR_TORQUE_M

# Signs along x (forward) and y (right) and of the torque, of motors 1 to 4: front right and rear left turn against the
# clock and push the nose right.
_QUAD_X = ((1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1))
PX4_CHARGE = "SIM_BAT_MIN_PCT"
# Four cells of 3.7 V, as the imitation has them.
BATTERY_NOMINAL_V = 14.8
# Two digits, as in the flights of docs/real-autopilots.md; both autopilots learn the rest in the air.
_HOVER = round(HOVER_THRUST, 2)


def px4_parameters(*, log: bool, charge: float) -> dict[str, float]:
    """PX4's parameters of the X500. Its motors follow the command with the square: THR_MDL_FAC 1.

    Once armed, its simulated battery falls within a second to the charge (0 to 1) that it may not fall below.
    """
    # With -i N PX4 takes the system id N + 1: clients expect 1.
    battery = {"SIM_BAT_DRAIN": 1, PX4_CHARGE: charge_percent(charge)}
    return px4_geometry() | battery | {"MAV_SYS_ID": 1, "SDLOG_BACKEND": 1 if log else 0}


def px4_geometry() -> dict[str, float]:
    """Those that every PX4 needs, whatever it runs on: where the motors are, and what they do."""
    geometry: dict[str, float] = {}
    for number, (x, y, torque) in enumerate(_QUAD_X):
        geometry |= {
            f"CA_ROTOR{number}_PX": x * ROTOR_ARM_M,
            f"CA_ROTOR{number}_PY": y * ROTOR_ARM_M,
            f"CA_ROTOR{number}_KM": torque * ROTOR_TORQUE_M,
        }
    return geometry | {"THR_MDL_FAC": 1, "MPC_THR_HOVER": _HOVER}


def ardupilot_parameters(*, log: bool, samples_hz: int, capacity_wh: float) -> dict[str, float]:
    """ArduCopter's parameters of the X500: quad X (class 1, type 1), thrust with the square of the command.

    Beside them those that upstream's SITL sets for every frame (Tools/autotest/default_params/copter.parm), so that
    agents meet the modes, channels, fence and battery monitor of the SITL. Gains and motors are the frame's.
    """
    channels = {
        f"RC{number}_{end}": value
        for number in range(1, 9)
        for end, value in (("MIN", 1000), ("MAX", 2000), ("TRIM", 1500))
    }
    return channels | {
        "BATT_MONITOR": 4,
        "BATT_CAPACITY": round(capacity_wh / BATTERY_NOMINAL_V * 1000.0),
        "FENCE_RADIUS": 150,
        **{f"FLTMODE{number}": mode for number, mode in enumerate((7, 9, 6, 3, 5, 0), start=1)},
        "FS_THR_ENABLE": 1,
        "RC7_OPTION": 7,
        "FRAME_CLASS": 1,
        "FRAME_TYPE": 1,
        "MOT_THST_EXPO": 1,
        "MOT_THST_HOVER": _HOVER,
        "LOG_BACKEND_TYPE": 1 if log else 0,
        "SIM_RATE_HZ": samples_hz,
        # The SITL alone aborts where something is computed with NaN, so that one message of an agent would end the session.
        "SIM_FLOAT_EXCEPT": 0,
    }


def charge_percent(charge: float) -> int:
    """A charge (0 to 1) in whole percent, as autopilots tell it."""
    return round(100.0 * charge)


def parameter_text(value: float) -> str:
    """A value as both start scripts take it: whole numbers without a point, as integers need."""
    return str(int(value)) if float(value).is_integer() else repr(value)


def merged(*parts: Mapping[str, float]) -> dict[str, str]:
    """Names in order with the text of their last value."""
    return {name: parameter_text(value) for part in parts for name, value in part.items()}
