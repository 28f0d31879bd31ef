"""Every field of every streamed message against the truth that it is made from: sign, unit, frame and scale.

A field without an entry stays the same during the flight, but for those that other tests look at. An entry whose truth
hardly changes during the flight fails.
"""

from __future__ import annotations

import math
import operator
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import pymap3d
import pytest
from scipy.spatial.transform import Rotation
from vehicle_client import Client, Make, mavlink, simspec

HOME_EAST_M, HOME_NORTH_M, HEADING_DEG, GROUND_M = 40.0, -30.0, 30.0, 488.0
G_MPS2 = 9.80665
# Gauss, north, east, down: the field over Zurich, which every magnetometer shows.
FIELD_NED = (0.2146, 0.0133, 0.4329)
# Ten minutes before a full hour, so that what counts from the hour is told from what counts from the start.
START, START_S, ODID_EPOCH_S = "2026-06-01T12:50:00+02:00", 1_780_311_000, 1_546_300_800


@dataclass(frozen=True)
class Near:
    """A truth that a field holds to `tolerance` (None: rounded once).

    It returns after a full `turn`; of a rotation as a quaternion both signs are the same.
    """

    value: Any
    tolerance: float | None = None
    turn: float | None = None
    is_rotation: bool = False


class Fixed(Near):
    """A truth that stays the same during the flight."""


class Truth:
    """What plant, battery and client know at the end of a step; other names are those of the plant's motion."""

    def __init__(
        self, vehicle: Any, setpoint: Mapping[str, float], turned_radps: tuple[float, float]
    ) -> None:
        plant, self.battery = vehicle._plant, vehicle._battery
        self.vehicle, self.motion, self.setpoint = vehicle, plant.motion, setpoint
        self.turned_radps = turned_radps  # gimbal: pitch, pan
        self.is_px4 = vehicle._autopilot is vehicle.autopilots["px4"]
        self.time_s: float = vehicle.time.s
        # Since the autopilot has started: ArduPilot 50 s before the session.
        self.clock_s = self.time_s + (0.0 if self.is_px4 else 50.0)
        self.north_m: float = plant.motion.north_m - HOME_NORTH_M
        self.east_m: float = plant.motion.east_m - HOME_EAST_M
        self.attitude = Rotation.from_euler("ZYX", (self.yaw_rad, self.pitch_rad, self.roll_rad))
        self.force: list[float] = list(plant.specific_force_mps2())
        self.speed_mps = math.hypot(self.vn_mps, self.ve_mps)
        self.volts: float = self.battery.terminals()[0]
        self.amperes: float = self.battery.power_w / self.volts
        self.rotors: list[float] = list(plant.rotor_commands())

    def __getattr__(self, name: str) -> float:
        return float(getattr(self.motion, name))


def geodetic(north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude in 1e-7 degree of a place beside home, by the rigorous conversion."""
    origin = simspec().world.origin
    place = pymap3d.enu2geodetic(
        east_m + HOME_EAST_M, north_m + HOME_NORTH_M, 0.0, origin.latitude_deg, origin.longitude_deg, 0.0
    )
    return place[0] * 1e7, place[1] * 1e7


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Near:
    """w, x, y, z."""
    x, y, z, w = Rotation.from_euler("ZYX", (yaw_rad, pitch_rad, roll_rad)).as_quat()
    return Near([w, x, y, z], 1e-5, is_rotation=True)


def named(prefix: Iterable[str], values: Iterable[Any], tolerance: float | None = None) -> dict[str, Any]:
    return {name: Near(value, tolerance) for name, value in zip(prefix, values, strict=True)}


def all_of(names: str, entry: Any) -> dict[str, Any]:
    return dict.fromkeys(names.split(), entry)


def place(t: Truth, latitude: str = "lat", longitude: str = "lon") -> dict[str, Any]:
    return named((latitude, longitude), geodetic(t.north_m, t.east_m), 1.5)


def home(*names: str) -> dict[str, Any]:
    # Set when the vehicle was armed, where the wind had pushed it.
    return {name: Fixed(value, 25.0) for name, value in zip(names, geodetic(0.0, 0.0), strict=True)}


def angles(t: Truth) -> dict[str, Any]:
    return named(("roll", "pitch"), (t.roll_rad, t.pitch_rad)) | {"yaw": Near(t.yaw_rad, 1e-5, math.tau)}


def rates(t: Truth) -> dict[str, Any]:
    return named(("rollspeed", "pitchspeed", "yawspeed"), (t.p_radps, t.q_radps, t.r_radps))


def local(t: Truth) -> dict[str, Any]:
    motion = (t.north_m, t.east_m, -t.up_m, t.vn_mps, t.ve_mps, t.vd_mps)
    return named(("x", "y", "z", "vx", "vy", "vz"), motion)


def inertial(t: Truth, force: float, rate: float, field: float) -> dict[str, Any]:
    """Axes of an inertial unit, each in so many units of m/s2, rad/s and gauss."""
    values = [
        *(axis * force for axis in t.force),
        *(axis * rate for axis in (t.p_radps, t.q_radps, t.r_radps)),
        *(axis * field for axis in t.attitude.inv().apply(FIELD_NED)),
    ]
    return named([axis + kind for kind in ("acc", "gyro", "mag") for axis in "xyz"], values)


def pressure_hpa(t: Truth) -> float:
    """The standard atmosphere, by temperature and lapse rate."""
    return float(1013.25 * (1.0 - 0.0065 * (GROUND_M + t.up_m) / 288.15) ** 5.2559)


def wanted(t: Truth) -> dict[str, Any]:
    return all_of("vx vy vz afx afy afz yaw_rate", Fixed(0.0)) | {"yaw": Near(t.setpoint["yaw"])}


def course_rad(t: Truth) -> float:
    return math.atan2(t.ve_mps, t.vn_mps)


def battery_volts(t: Truth) -> float:
    """PX4 shows the vehicle's own battery, ArduPilot its parameter for a full one, which falls alike."""
    return t.volts if t.is_px4 else 12.6 * t.volts / 16.6


def gimbal_quaternion(t: Truth) -> Near:
    state = t.vehicle.truth()
    return quaternion(0.0, -state.camera_tilt_rad, state.camera_pan_rad)


def position_target(t: Truth) -> dict[str, Any]:
    return {"coordinate_frame": Fixed(1)} | {axis: Near(t.setpoint[axis]) for axis in "xyz"} | wanted(t)


def global_target(t: Truth) -> dict[str, Any]:
    x, y, z = (t.setpoint[axis] for axis in "xyz")
    goal = named(("lat_int", "lon_int"), geodetic(x, y), 1.5)
    return goal | {"alt": Near(GROUND_M - z, 1e-4), "coordinate_frame": Fixed(0)} | wanted(t)


def navigation(t: Truth) -> dict[str, Any]:
    """As MAVLink defines it: desired attitude; target less position, its bearing and distance."""
    roll, pitch, yaw, _ = (math.degrees(value) for value in t.vehicle._plant.commanded_attitude())
    north, east = t.setpoint["x"] - t.north_m, t.setpoint["y"] - t.east_m
    return {
        "nav_roll": Near(roll, 1e-4),
        "nav_pitch": Near(pitch, 1e-4),
        "nav_bearing": Near(yaw, 0.51, 360.0),
        "target_bearing": Near(math.degrees(math.atan2(east, north)), 0.51, 360.0),
        "wp_dist": Near(math.hypot(north, east)),
        "alt_error": Near(-t.setpoint["z"] - t.up_m, 1e-4),
    }


def scaled_inertial(t: Truth) -> dict[str, Any]:
    return inertial(t, 1000.0 / G_MPS2, 1000.0, 1000.0)


def pressure(t: Truth) -> dict[str, Any]:
    return {"press_abs": Near(pressure_hpa(t), 0.02)}


AT_HOME = Fixed(quaternion(0.0, 0.0, math.radians(HEADING_DEG)).value, 0.01, is_rotation=True)
# Fields named in `entries` count from the controller's start, unless a message has an entry of its own for them.
FIELDS: dict[str, Callable[[Truth], dict[str, Any]]] = {
    "AHRS2": lambda t: angles(t) | place(t, "lat", "lng") | {"altitude": Near(GROUND_M + t.up_m, 1e-4)},
    "ALTITUDE": lambda t: (
        named(("altitude_monotonic", "altitude_amsl"), (GROUND_M + t.up_m,) * 2, 1e-4)
        | named(("altitude_local", "altitude_relative", "bottom_clearance"), (t.up_m,) * 3)
    ),
    "ATTITUDE": lambda t: angles(t) | rates(t),
    "ATTITUDE_QUATERNION": lambda t: {"q": quaternion(t.roll_rad, t.pitch_rad, t.yaw_rad), **rates(t)},
    "ATTITUDE_TARGET": lambda t: {
        "q": quaternion(*t.vehicle._plant.commanded_attitude()[:3]),
        "thrust": Near(t.vehicle._plant.commanded_attitude()[3]),
        **all_of("body_roll_rate body_pitch_rate body_yaw_rate", Fixed(0.0)),
    },
    "BATTERY_STATUS": lambda t: {
        "current_consumed": Near(t.battery.used_wh / 14.8 * 1000.0),
        "voltages": Near([battery_volts(t) * 1000.0, *[65535] * 9]),
        "current_battery": Near(t.amperes * 100.0),
        "battery_remaining": Near(t.battery.fraction * 100.0),
    },
    "DISTANCE_SENSOR": lambda t: {"current_distance": Near(min(max(t.up_m * 100.0, 10.0), 4000.0))},
    # Made up as by PX4's simulator link.
    "ESC_INFO": lambda t: {"temperature": Near([2000.0 + 4000.0 * rotor for rotor in t.rotors], 1.0)},
    "ESC_STATUS": lambda t: {
        "rpm": Near([rotor * 6000.0 for rotor in t.rotors], 1.0),
        "voltage": Near([battery_volts(t)] * 4, 1e-3),
        "current": Near([1.0 + 15.0 * rotor for rotor in t.rotors], 1e-3),
    },
    "ESC_TELEMETRY_1_TO_4": lambda t: {
        "voltage": Near([battery_volts(t) * 100.0] * 4),
        "current": Near([t.amperes * 100.0 / 4.0] * 4),
        "totalcurrent": Near([t.battery.used_wh / 14.8 * 250.0] * 4),
        "rpm": Near([rotor * 8000.0 for rotor in t.rotors]),
        "count": Near([t.clock_s * 50.0] * 4, 1.0),
    },
    "GIMBAL_DEVICE_ATTITUDE_STATUS": lambda t: {
        "q": gimbal_quaternion(t),
        "angular_velocity_x": Fixed(0.0),
        "angular_velocity_y": Near(t.turned_radps[0], 1e-4),
        "angular_velocity_z": Near(t.turned_radps[1], 1e-4),
        "delta_yaw": Near(t.yaw_rad, 1e-5, math.tau),
        "delta_yaw_velocity": Near(t.r_radps),
    },
    "GLOBAL_POSITION_INT": lambda t: {
        **place(t),
        "alt": Near((GROUND_M + t.up_m) * 1000.0),
        "relative_alt": Near(t.up_m * 1000.0),
        **named(("vx", "vy", "vz"), (t.vn_mps * 100.0, t.ve_mps * 100.0, t.vd_mps * 100.0)),
        "hdg": Near(math.degrees(t.yaw_rad) * 100.0, None, 36000.0),
    },
    "GPS_GLOBAL_ORIGIN": lambda t: home("latitude", "longitude") | {"altitude": Fixed(GROUND_M * 1000.0)},
    "GPS_RAW_INT": lambda t: {
        # Of the last fix, up to an eighth of a second ago, at up to 6 m/s.
        **named(("lat", "lon"), geodetic(t.north_m, t.east_m), 120.0),
        **named(("alt", "alt_ellipsoid"), ((GROUND_M + t.up_m) * 1000.0,) * 2, 600.0),
        "time_usec": Near(t.clock_s * 1e6, 130_000.0),
        "vel": Near(t.speed_mps * 100.0),
        "cog": Near(math.degrees(course_rad(t)) * 100.0, None, 36000.0) if t.speed_mps > 0.1 else Fixed(0),
    },
    "HIGHRES_IMU": lambda t: {
        **inertial(t, 1.0, 1.0, 1.0),
        "abs_pressure": Near(pressure_hpa(t), 0.02),
        "pressure_alt": Near(GROUND_M + t.up_m, 1e-4),
    },
    "HIL_STATE_QUATERNION": lambda t: {
        "attitude_quaternion": quaternion(t.roll_rad, t.pitch_rad, t.yaw_rad),
        **rates(t),
        **place(t),
        "alt": Near((GROUND_M + t.up_m) * 1000.0),
        **named(("vx", "vy", "vz"), (t.vn_mps * 100.0, t.ve_mps * 100.0, t.vd_mps * 100.0)),
        **named(("ind_airspeed", "true_airspeed"), (t.airspeed_mps * 100.0,) * 2),
        **named(("xacc", "yacc", "zacc"), [axis / G_MPS2 * 1000.0 for axis in t.force]),
    },
    "HOME_POSITION": lambda t: {
        **home("latitude", "longitude"),
        "altitude": Fixed(GROUND_M * 1000.0),
        **all_of("x y z", Fixed(0.0, 0.2)),
        # ArduPilot keeps no heading at home.
        **({"q": AT_HOME} if t.is_px4 else {}),
    },
    "LOCAL_POSITION_NED": local,
    "NAV_CONTROLLER_OUTPUT": navigation,
    "ODOMETRY": lambda t: {
        **local(t),
        "q": quaternion(t.roll_rad, t.pitch_rad, t.yaw_rad),
        **rates(t),
        # PX4 gives the velocities in the local frame, and names it as the child.
        **all_of("frame_id child_frame_id", Fixed(1)),
    },
    "OPEN_DRONE_ID_LOCATION": lambda t: {
        **place(t, "latitude", "longitude"),
        **named(("altitude_barometric", "altitude_geodetic"), (GROUND_M + t.up_m,) * 2, 1e-4),
        "height": Near(t.up_m),
        "timestamp": Near((3000.0 + t.time_s) % 3600.0, 1e-3),
        "direction": Near(math.degrees(course_rad(t)) * 100.0, None, 36000.0),
        "speed_horizontal": Near(t.speed_mps * 100.0),
        "speed_vertical": Near(-t.vd_mps * 100.0),
    },
    "OPEN_DRONE_ID_SYSTEM": lambda t: {
        **home("operator_latitude", "operator_longitude"),
        "operator_altitude_geo": Fixed(GROUND_M),
        "timestamp": Near(START_S - ODID_EPOCH_S + t.time_s, 1.0),
    },
    "POSITION_TARGET_GLOBAL_INT": global_target,
    "POSITION_TARGET_LOCAL_NED": position_target,
    "RAW_IMU": scaled_inertial,
    "SCALED_IMU": scaled_inertial,
    "SCALED_IMU2": scaled_inertial,
    "SCALED_IMU3": scaled_inertial,
    "SCALED_PRESSURE": pressure,
    "SCALED_PRESSURE2": pressure,
    "SERVO_OUTPUT_RAW": lambda t: {
        **named(
            [f"servo{number}_raw" for number in range(1, 5)], [1000.0 + 1000.0 * rotor for rotor in t.rotors]
        )
    },
    "SIMSTATE": lambda t: (
        {name: entry for name, entry in inertial(t, 1.0, 1.0, 1.0).items() if "mag" not in name}
        | angles(t)
        | place(t, "lat", "lng")
    ),
    "SYSTEM_TIME": lambda t: {"time_unix_usec": Near((START_S + t.time_s) * 1e6, 2.0)},
    "SYS_STATUS": lambda t: {
        "voltage_battery": Near(battery_volts(t) * 1000.0),
        "current_battery": Near(t.amperes * 100.0),
        "battery_remaining": Near(t.battery.fraction * 100.0),
    },
    "TERRAIN_REPORT": place,
    "TIMESYNC": lambda t: {"ts1": Near(t.clock_s * 1e9, 1.0)},
    "VFR_HUD": lambda t: {
        # Without a sensor PX4 shows none, and ArduPilot the ground speed.
        "airspeed": Fixed(0.0) if t.is_px4 else Near(t.speed_mps),
        "groundspeed": Near(t.speed_mps),
        "alt": Near(GROUND_M + t.up_m, 1e-4),
        "climb": Near(-t.vd_mps),
        "heading": Near(math.degrees(t.yaw_rad), None, 360.0),
        "throttle": Near(sum(t.rotors) * 25.0),
    },
}
LEGS = ((7.0, 25.0, -15.0, -17.0, 1.2), (9.0, -14.0, 20.0, -9.0, -2.4), (4.0, -2.0, 5.0, -12.0, 2.8))


def take_off(client: Client, autopilot: str) -> None:
    if autopilot == "px4":
        client.airborne(10.0)
        client.offboard(0.0, 0.0, -10.0)
        return
    client.guided()


def legs(client: Client) -> Iterable[tuple[Any, Truth]]:
    """Every streamed message of a flight through wind, with climbs and turns, and the truth when it was sent."""
    for seconds, x, y, z, yaw in LEGS:
        client.command(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, -30.0 - 10.0 * yaw, 40.0 * yaw)
        for _ in range(round(seconds * 50)):
            before: Any = client.vehicle.truth()
            client.setpoint(x, y, z, yaw=yaw)
            messages = client.fly(0.02)
            after: Any = client.vehicle.truth()
            pan_rad = math.remainder(after.camera_pan_rad - before.camera_pan_rad, math.tau)
            turned_radps = ((before.camera_tilt_rad - after.camera_tilt_rad) * 50.0, pan_rad * 50.0)
            truth = Truth(client.vehicle, {"x": x, "y": y, "z": z, "yaw": yaw}, turned_radps)
            yield from ((message, truth) for message in messages)


def entries(name: str, truth: Truth) -> dict[str, Any]:
    times = {
        "time_boot_ms": truth.clock_s * 1e3,
        "time_usec": truth.clock_s * 1e6,
        "timestamp": truth.clock_s * 1e3,
    }
    return {field: Near(value, 1.0) for field, value in times.items()} | (
        FIELDS[name](truth) if name in FIELDS else {}
    )


def flat(value: Any) -> list[float]:
    return list(value) if isinstance(value, list | tuple) else [value]


def deviation(entry: Near, value: Any, whole: bool) -> tuple[float, float]:
    """How far a field is from its truth, and how far it may be: half a unit of a whole number, the digits of a float."""
    truths = flat(entry.value)
    errors = [held - truth for held, truth in zip(flat(value), truths, strict=True)]
    if entry.is_rotation and sum(map(operator.mul, value, truths)) < 0.0:
        errors = [held + truth for held, truth in zip(value, truths, strict=True)]
    if entry.turn:
        errors = [math.remainder(error, entry.turn) for error in errors]
    digits = 0.51 if whole else 1e-6 * max(1.0, *map(abs, truths))
    return max(map(abs, errors)), digits if entry.tolerance is None else entry.tolerance


def parts_of(message: Any) -> dict[str, tuple[Any, bool]]:
    """Value of every field, and whether it is a whole number; the four numbers of a quaternion together."""
    parts = {
        name: (getattr(message, name), "int" in kind)
        for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True)
    }
    if "q1" in parts:
        parts["q"] = ([parts.pop(f"q{number}")[0] for number in range(1, 5)], False)
    return parts


@dataclass
class Seen:
    """What a field held during a flight."""

    false: list[Any] = field(default_factory=list)  # beside the truth
    truths: list[float] = field(default_factory=list)
    tolerance: float = 0.0
    held: set[str] = field(default_factory=set)
    is_compared: bool = False

    def take(self, entry: Near | None, value: Any, whole: bool) -> None:
        self.held.add(repr(value))
        if entry is None:
            return
        self.is_compared = True
        error, tolerance = deviation(entry, value, whole)
        if error > tolerance:
            self.false.append((value, entry))
        if not isinstance(entry, Fixed):
            self.truths.append(flat(entry.value)[0])
            self.tolerance = max(self.tolerance, tolerance)

    @property
    def is_shown(self) -> bool:
        """Whether the truth moves so much that a wrong sign, unit or frame cannot hide in the tolerance."""
        return not self.truths or max(self.truths) - min(self.truths) > 10.0 * self.tolerance


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_every_streamed_field_is_the_truth_it_is_made_from(make: Make, autopilot: str) -> None:
    parts = {
        "home": {"east_m": HOME_EAST_M, "north_m": HOME_NORTH_M, "heading_deg": HEADING_DEG},
        "camera": {"mavlink": True, "gimbal": True},
        "battery": {"capacity_wh": 12.0},
        "ground_truth": True,
    }
    weather = {"wind": {"speed_mps": 5.0, "from_deg": 240.0, "turbulence_mps": 2.0}, "start_utc": START}
    client = make(simspec(autopilot, vehicle=parts, environment=weather), system=255)
    supported = client.vehicle._controller._streams._supported  # type: ignore[attr-defined]
    streamed = {mavlink.mavlink_map[number].msgname for number in supported}
    take_off(client, autopilot)
    assert client.command(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, 255, 190, -1, -1) == [0]
    for number in supported:
        assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 200_000) == [0]
    seen: dict[str, dict[str, Seen]] = defaultdict(lambda: defaultdict(Seen))
    for message, truth in legs(client):
        name = message.get_type()
        # The camera is a component of its own.
        is_streamed = name in streamed and message.get_srcComponent() == 1
        expected = entries(name, truth) if is_streamed else {}
        for part, (value, is_whole) in parts_of(message).items() if is_streamed else ():
            seen[name][part].take(expected.get(part), value, is_whole)
    # Orbits, calibrations and fences have tests of their own.
    assert streamed - seen.keys() <= {"ORBIT_EXECUTION_STATUS", "MAG_CAL_PROGRESS", "FENCE_STATUS"}
    fields = {
        f"{name}.{place}": history for name, places in seen.items() for place, history in places.items()
    }
    changing = {place for place, one in fields.items() if len(one.held) > 1 and not one.is_compared}
    # Counts of the link: test_vehicle_links.
    assert changing <= {"PING.seq", "LINK_NODE_STATUS.messages_sent", "LINK_NODE_STATUS.messages_received"}
    assert {place: history.false[:2] for place, history in fields.items() if history.false} == {}
    assert [place for place, history in fields.items() if not history.is_shown] == []
