"""Every field of every streamed message against the truth that it is made from: sign, unit, frame and scale.

A message or field without an entry fails, and so does an entry whose truth hardly changes during the flight.
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
TIME = ("time_boot_ms", "time_usec", "timestamp")


@dataclass(frozen=True)
class NoTruth:
    """Why there is nothing to compare a field with."""

    reason: str


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


CONSTANT = NoTruth("a constant of the simulated vehicle or of the protocol")
MODES = NoTruth("modes and flags: test_vehicle_modes, test_vehicle_health, test_vehicle_failsafes")
NOT_MODELLED = NoTruth("the vehicle has no such part or estimate, and says so by a constant")
PLANS = NoTruth("counts of plans, orbits and calibrations: the tests of those services")
NO_HEADING = NoTruth("ArduPilot keeps no heading at home")
LINK = NoTruth("counts of the link: test_vehicle_links")


@dataclass(frozen=True)
class Truth:
    """What plant, battery and client know at the end of a step."""

    vehicle: Any
    setpoint: Mapping[str, float]
    turned_radps: tuple[float, float]  # gimbal: pitch, pan

    def __getattr__(self, name: str) -> float:
        return float(getattr(self.vehicle._plant.motion, name))

    @property
    def time_s(self) -> float:
        return float(self.vehicle.time.s)

    @property
    def clock_s(self) -> float:
        """Since the autopilot has started: ArduPilot 50 s before the session."""
        return self.time_s + (0.0 if is_px4(self) else 50.0)

    @property
    def north_m(self) -> float:
        return float(self.vehicle._plant.motion.north_m) - HOME_NORTH_M

    @property
    def east_m(self) -> float:
        return float(self.vehicle._plant.motion.east_m) - HOME_EAST_M

    @property
    def attitude(self) -> Rotation:
        return Rotation.from_euler("ZYX", (self.yaw_rad, self.pitch_rad, self.roll_rad))

    @property
    def force(self) -> list[float]:
        return list(self.vehicle._plant.specific_force_mps2())

    @property
    def speed_mps(self) -> float:
        return math.hypot(self.vn_mps, self.ve_mps)

    @property
    def battery(self) -> Any:
        return self.vehicle._battery

    @property
    def amperes(self) -> float:
        return float(self.battery.power_w) / self.volts

    @property
    def volts(self) -> float:
        return float(self.battery.terminals()[0])

    @property
    def rotors(self) -> list[float]:
        return list(self.vehicle._plant.rotor_commands())


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
    motion = all_of("vx vy vz afx afy afz", Fixed(0.0))
    return motion | {"yaw": Near(t.setpoint["yaw"]), "yaw_rate": Fixed(0.0), "type_mask": MODES}


def course_rad(t: Truth) -> float:
    return math.atan2(t.ve_mps, t.vn_mps)


def is_px4(t: Truth) -> bool:
    return bool(t.vehicle._autopilot is t.vehicle.autopilots["px4"])


def battery_volts(t: Truth) -> float:
    """PX4 shows the vehicle's own battery, ArduPilot its parameter for a full one, which falls alike."""
    return t.volts if is_px4(t) else 12.6 * t.volts / 16.6


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
        **all_of("aspd_error xtrack_error", NOT_MODELLED),
    }


def scaled_inertial(t: Truth) -> dict[str, Any]:
    return inertial(t, 1000.0 / G_MPS2, 1000.0, 1000.0) | {"temperature": CONSTANT}


def pressure(t: Truth) -> dict[str, Any]:
    more = all_of("temperature temperature_press_diff press_diff", CONSTANT)
    return {"press_abs": Near(pressure_hpa(t), 0.02)} | more


# Fields named in TIME count from the controller's start, unless a message has an entry of its own for them.
FIELDS: dict[str, Callable[[Truth], dict[str, Any]]] = {
    "AHRS": lambda t: all_of(
        "omegaIx omegaIy omegaIz accel_weight renorm_val error_rp error_yaw", NOT_MODELLED
    ),
    "AHRS2": lambda t: angles(t) | place(t, "lat", "lng") | {"altitude": Near(GROUND_M + t.up_m, 1e-4)},
    "ALTITUDE": lambda t: (
        named(("altitude_monotonic", "altitude_amsl"), (GROUND_M + t.up_m,) * 2, 1e-4)
        | named(("altitude_local", "altitude_relative", "bottom_clearance"), (t.up_m,) * 3)
        | {"altitude_terrain": NOT_MODELLED}
    ),
    "ATTITUDE": lambda t: angles(t) | rates(t),
    "ATTITUDE_QUATERNION": lambda t: {
        "q": quaternion(t.roll_rad, t.pitch_rad, t.yaw_rad),
        **rates(t),
        "repr_offset_q": NOT_MODELLED,
    },
    "ATTITUDE_TARGET": lambda t: {
        "q": quaternion(*t.vehicle._plant.commanded_attitude()[:3]),
        "thrust": Near(t.vehicle._plant.commanded_attitude()[3]),
        **all_of("body_roll_rate body_pitch_rate body_yaw_rate", Fixed(0.0)),
        "type_mask": CONSTANT,
    },
    "BATTERY_STATUS": lambda t: {
        "current_consumed": Near(t.battery.used_wh / 14.8 * 1000.0),
        "voltages": Near([battery_volts(t) * 1000.0, *[65535] * 9]),
        "current_battery": Near(t.amperes * 100.0),
        "battery_remaining": Near(t.battery.fraction * 100.0),
        **all_of("energy_consumed temperature time_remaining voltages_ext", NOT_MODELLED),
        **all_of("id battery_function type mode", CONSTANT),
        **all_of("charge_state fault_bitmask", MODES),
    },
    "CURRENT_EVENT_SEQUENCE": lambda t: all_of("sequence flags", NoTruth("test_vehicle_events")),
    "CURRENT_MODE": lambda t: all_of("custom_mode intended_custom_mode standard_mode", MODES),
    "DISTANCE_SENSOR": lambda t: {
        "current_distance": Near(min(max(t.up_m * 100.0, 10.0), 4000.0)),
        **all_of("min_distance max_distance type id orientation covariance", CONSTANT),
        **all_of("horizontal_fov vertical_fov quaternion signal_quality", NOT_MODELLED),
    },
    "EKF_STATUS_REPORT": lambda t: {
        **all_of("velocity_variance pos_horiz_variance pos_vert_variance compass_variance", NOT_MODELLED),
        **all_of("terrain_alt_variance airspeed_variance", NOT_MODELLED),
        "flags": MODES,
    },
    # Made up as by PX4's simulator link.
    "ESC_INFO": lambda t: {
        "temperature": Near([2000.0 + 4000.0 * rotor for rotor in t.rotors], 1.0),
        **all_of("counter failure_flags error_count count connection_type index info", CONSTANT),
    },
    "ESC_STATUS": lambda t: {
        "rpm": Near([rotor * 6000.0 for rotor in t.rotors], 1.0),
        "voltage": Near([battery_volts(t)] * 4, 1e-3),
        "current": Near([1.0 + 15.0 * rotor for rotor in t.rotors], 1e-3),
        "index": CONSTANT,
    },
    "ESC_TELEMETRY_1_TO_4": lambda t: {
        "voltage": Near([battery_volts(t) * 100.0] * 4),
        "current": Near([t.amperes * 100.0 / 4.0] * 4),
        "totalcurrent": Near([t.battery.used_wh / 14.8 * 250.0] * 4),
        "rpm": Near([rotor * 8000.0 for rotor in t.rotors]),
        "count": Near([t.clock_s * 50.0] * 4, 1.0),
        "temperature": NOT_MODELLED,
    },
    "ESTIMATOR_STATUS": lambda t: {
        **all_of("vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio hagl_ratio tas_ratio", NOT_MODELLED),
        **all_of("pos_horiz_accuracy pos_vert_accuracy", CONSTANT),
        "flags": MODES,
    },
    "EXTENDED_SYS_STATE": lambda t: all_of("vtol_state landed_state", MODES),
    "GIMBAL_DEVICE_ATTITUDE_STATUS": lambda t: {
        "q": gimbal_quaternion(t),
        "angular_velocity_x": Fixed(0.0),
        "angular_velocity_y": Near(t.turned_radps[0], 1e-4),
        "angular_velocity_z": Near(t.turned_radps[1], 1e-4),
        "delta_yaw": Near(t.yaw_rad, 1e-5, math.tau),
        "delta_yaw_velocity": Near(t.r_radps),
        **all_of("failure_flags flags target_system target_component gimbal_device_id", CONSTANT),
    },
    "GIMBAL_MANAGER_STATUS": lambda t: all_of(
        "flags gimbal_device_id primary_control_sysid primary_control_compid secondary_control_sysid "
        "secondary_control_compid",
        NoTruth("who controls the gimbal: test_vehicle_payload"),
    ),
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
        **all_of("eph epv h_acc v_acc vel_acc fix_type satellites_visible", CONSTANT),
        **all_of("hdg_acc yaw", NOT_MODELLED),
    },
    "HEARTBEAT": lambda t: {
        **all_of("custom_mode system_status base_mode", MODES),
        **all_of("type autopilot mavlink_version", CONSTANT),
    },
    "HIGHRES_IMU": lambda t: {
        **inertial(t, 1.0, 1.0, 1.0),
        "abs_pressure": Near(pressure_hpa(t), 0.02),
        "pressure_alt": Near(GROUND_M + t.up_m, 1e-4),
        **all_of("diff_pressure temperature fields_updated id", CONSTANT),
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
        "q": Fixed(quaternion(0.0, 0.0, math.radians(HEADING_DEG)).value, 0.01, is_rotation=True)
        if is_px4(t)
        else NO_HEADING,
        **all_of("approach_x approach_y approach_z", NOT_MODELLED),
    },
    "LINK_NODE_STATUS": lambda t: {
        **all_of(
            "tx_rate rx_rate messages_lost rx_parse_err tx_overflows rx_overflows tx_buf rx_buf", NOT_MODELLED
        ),
        **all_of("messages_sent messages_received", LINK),
    },
    "LOCAL_POSITION_NED": local,
    "MAG_CAL_PROGRESS": lambda t: {},
    "MEMINFO": lambda t: all_of("brkval freemem freemem32", CONSTANT),
    "MISSION_CURRENT": lambda t: all_of(
        "seq total mission_state mission_mode mission_id fence_id rally_points_id", PLANS
    ),
    "NAV_CONTROLLER_OUTPUT": navigation,
    "ODOMETRY": lambda t: {
        **local(t),
        "q": quaternion(t.roll_rad, t.pitch_rad, t.yaw_rad),
        **rates(t),
        # PX4 gives the velocities in the local frame, and names it as the child.
        **all_of("frame_id child_frame_id", Fixed(1)),
        **all_of("reset_counter estimator_type quality", CONSTANT),
        **all_of("pose_covariance velocity_covariance", NOT_MODELLED),
    },
    "OPEN_DRONE_ID_LOCATION": lambda t: {
        **place(t, "latitude", "longitude"),
        **named(("altitude_barometric", "altitude_geodetic"), (GROUND_M + t.up_m,) * 2, 1e-4),
        "height": Near(t.up_m),
        "timestamp": Near((3000.0 + t.time_s) % 3600.0, 1e-3),
        "direction": Near(math.degrees(course_rad(t)) * 100.0, None, 36000.0),
        "speed_horizontal": Near(t.speed_mps * 100.0),
        "speed_vertical": Near(-t.vd_mps * 100.0),
        "status": MODES,
        **all_of("target_system target_component id_or_mac height_reference horizontal_accuracy", CONSTANT),
        **all_of("vertical_accuracy barometer_accuracy speed_accuracy timestamp_accuracy", CONSTANT),
    },
    "OPEN_DRONE_ID_SYSTEM": lambda t: {
        **home("operator_latitude", "operator_longitude"),
        "operator_altitude_geo": Fixed(GROUND_M),
        "timestamp": Near(START_S - ODID_EPOCH_S + t.time_s, 1.0),
        **all_of("area_ceiling area_floor area_count area_radius operator_location_type", CONSTANT),
        **all_of(
            "target_system target_component id_or_mac classification_type category_eu class_eu", CONSTANT
        ),
    },
    "ORBIT_EXECUTION_STATUS": lambda t: {},
    "PING": lambda t: all_of("seq target_system target_component", LINK),
    "POSITION_TARGET_GLOBAL_INT": global_target,
    "POSITION_TARGET_LOCAL_NED": position_target,
    "POWER_STATUS": lambda t: all_of("Vcc Vservo flags", CONSTANT),
    "RAW_IMU": lambda t: scaled_inertial(t) | {"id": CONSTANT},
    "RC_CHANNELS": lambda t: all_of(
        " ".join(f"chan{number}_raw" for number in range(1, 19)) + " chancount rssi",
        NoTruth("no pilot steers in this flight: test_vehicle_modes, test_vehicle_shaping"),
    ),
    "SCALED_IMU": scaled_inertial,
    "SCALED_IMU2": scaled_inertial,
    "SCALED_IMU3": scaled_inertial,
    "SCALED_PRESSURE": pressure,
    "SCALED_PRESSURE2": pressure,
    "SERVO_OUTPUT_RAW": lambda t: {
        **named(
            [f"servo{number}_raw" for number in range(1, 5)], [1000.0 + 1000.0 * rotor for rotor in t.rotors]
        ),
        **all_of(" ".join(f"servo{number}_raw" for number in range(5, 17)) + " port", NOT_MODELLED),
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
        **all_of(
            " ".join(f"onboard_control_sensors_{name}" for name in ("present", "enabled", "health")), MODES
        ),
        **all_of("load drop_rate_comm errors_comm", NOT_MODELLED),
        **all_of(" ".join(f"errors_count{number}" for number in range(1, 5)), NOT_MODELLED),
        **all_of(
            " ".join(f"onboard_control_sensors_{name}_extended" for name in ("present", "enabled", "health")),
            NOT_MODELLED,
        ),
    },
    "TERRAIN_REPORT": lambda t: {
        **place(t),
        **all_of("terrain_height current_height spacing pending loaded", NOT_MODELLED),
    },
    "TERRAIN_REQUEST": lambda t: all_of(
        "mask lat lon grid_spacing", NoTruth("the corner of a grid: test_vehicle_protocols")
    ),
    "TIMESYNC": lambda t: {
        "ts1": Near(t.clock_s * 1e9, 1.0),
        **all_of("tc1 target_system target_component", CONSTANT),
    },
    "TIME_ESTIMATE_TO_TARGET": lambda t: all_of(
        "safe_return land mission_next_item mission_end commanded_action", NOT_MODELLED
    ),
    "VFR_HUD": lambda t: {
        # Without a sensor PX4 shows none, and ArduPilot the ground speed.
        "airspeed": Fixed(0.0) if is_px4(t) else Near(t.speed_mps),
        "groundspeed": Near(t.speed_mps),
        "alt": Near(GROUND_M + t.up_m, 1e-4),
        "climb": Near(-t.vd_mps),
        "heading": Near(math.degrees(t.yaw_rad), None, 360.0),
        "throttle": Near(sum(t.rotors) * 25.0),
    },
    "VIBRATION": lambda t: all_of(
        "vibration_x vibration_y vibration_z clipping_0 clipping_1 clipping_2", NOT_MODELLED
    ),
    "WIND": lambda t: all_of("direction speed speed_z", NOT_MODELLED),
}
# Never sent in this flight: orbits and calibrations have tests of their own.
ABSENT = {"ORBIT_EXECUTION_STATUS", "MAG_CAL_PROGRESS", "FENCE_STATUS"}
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
    return {field: Near(value, 1.0) for field, value in times.items()} | FIELDS[name](truth)


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

    def take(self, entry: Any, value: Any, whole: bool) -> None:
        self.held.add(repr(value))
        if isinstance(entry, NoTruth):
            return
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
    assert streamed <= FIELDS.keys() | ABSENT
    take_off(client, autopilot)
    assert client.command(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, 255, 190, -1, -1) == [0]
    for number in supported:
        assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 100_000) == [0]
    seen: dict[str, dict[str, Seen]] = defaultdict(lambda: defaultdict(Seen))
    for message, truth in legs(client):
        name = message.get_type()
        # The camera is a component of its own.
        is_streamed = name in streamed and message.get_srcComponent() == 1
        expected = entries(name, truth) if is_streamed else {}
        for part, (value, is_whole) in parts_of(message).items() if expected else ():
            assert part in expected, f"{name}.{part} has neither a truth nor a reason why there is none"
            seen[name][part].take(expected[part], value, is_whole)
            if expected[part] in (CONSTANT, NOT_MODELLED):
                assert len(seen[name][part].held) == 1, f"{name}.{part} is no constant"
    assert streamed - seen.keys() <= ABSENT
    fields = {
        f"{name}.{place}": history for name, places in seen.items() for place, history in places.items()
    }
    assert {place: history.false[:2] for place, history in fields.items() if history.false} == {}
    assert [place for place, history in fields.items() if not history.is_shown] == []
