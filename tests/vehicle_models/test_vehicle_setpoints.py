"""Offboard and guided setpoints: every frame and mask, attitude and rates, and nonsense."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation
from vehicle_client import NAN, Client, Make, of

from vehicle_models.controller.services._setpoints import _NAN3 as MASKED
from vehicle_models.controller.services._setpoints import _Setpoint

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
POSITION, VELOCITY, ACCELERATION = 0xDF8, 0xDC7, 0xC3F  # masks that leave one group (and no yaw)
YAW, YAWRATE = 0x400, 0x800
DEG = math.radians(1.0)


def local(client: Client, mask: int, frame: int = 1, **at: float) -> None:
    """SET_POSITION_TARGET_LOCAL_NED by field names; what is not named is 0."""
    fields = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    values = [at.get(name, 0.0) for name in fields]
    client.send(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *values))


def earth(
    client: Client, mask: int, frame: int, north: float, east: float, altitude: float, **at: float
) -> None:
    latitude, longitude = client.vehicle_goal(east, north)
    values = [at.get(name, 0.0) for name in ("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")]
    message = mavlink.MAVLink_set_position_target_global_int_message
    client.send(message(0, 1, 1, frame, mask, latitude, longitude, altitude, *values))


def attitude(
    client: Client, mask: int, roll: float, pitch: float, yaw: float, thrust: float, *rates: float
) -> None:
    """SET_ATTITUDE_TARGET; degrees."""
    q = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_quat(scalar_first=True)
    message = mavlink.MAVLink_set_attitude_target_message
    client.send(message(0, 1, 1, mask, q, *(rates or (0.0, 0.0, 0.0)), thrust))


def stream(client: Client, seconds: float, say: Callable[[], None]) -> list[Any]:
    """Ten setpoints a second; the first enters OFFBOARD where that is needed."""
    if client.vehicle.condition().mode not in ("OFFBOARD", "GUIDED"):
        say()
        client.fly(0.1)
        say()
        assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == [ACCEPTED, ACCEPTED]
    return client.fly(seconds, say)


def test_px4_mixes_axes(px4: Client) -> None:
    """Height by position and way by velocity; NaN stands for a masked axis."""
    stream(px4, 6.0, lambda: local(px4, 0xDC3, z=-15.0, vx=2.0, vy=-1.0))
    truth = px4.vehicle.truth()
    assert truth.velocity_enu_mps == pytest.approx((-1.0, 2.0, 0.0), abs=0.15)
    assert truth.position_enu_m[2] == pytest.approx(15.0, abs=0.3)
    unmasked: Any = dict.fromkeys(("x", "y", "vz", "afx", "afy", "afz"), NAN)
    stream(px4, 6.0, lambda: local(px4, 0xC00, z=-12.0, vx=1.0, vy=0.0, **unmasked))
    truth = px4.vehicle.truth()
    assert truth.velocity_enu_mps == pytest.approx((0.0, 1.0, 0.0), abs=0.15)
    assert truth.position_enu_m[2] == pytest.approx(12.0, abs=0.3)
    assert px4.vehicle.counters()["setpoints_ignored"] == 0


def test_px4_accelerates(px4: Client) -> None:
    """An acceleration of 1 m/s2 for three seconds makes 3 m/s; beside a velocity it is feed-forward."""
    stream(px4, 3.0, lambda: local(px4, ACCELERATION, afx=1.0))
    assert px4.vehicle.truth().velocity_enu_mps[1] == pytest.approx(3.0, abs=0.4)
    stream(px4, 3.0, lambda: local(px4, VELOCITY & ~0x1C0, vy=1.0))
    assert px4.vehicle.truth().velocity_enu_mps == pytest.approx((1.0, 0.0, 0.0), abs=0.2)


def test_px4_follows_a_trajectory_given_with_derivatives(px4: Client) -> None:
    """A circle of 10 m at 3 m/s: nowhere farther than 0.5 m from it, and from its clock."""
    begun, rate = px4.vehicle.time.s, 0.3

    def say() -> None:
        angle = rate * (px4.vehicle.time.s - begun)
        cos, sin = math.cos(angle), math.sin(angle)
        motion: Any = {"vx": -3 * sin, "vy": 3 * cos, "afx": -0.9 * cos, "afy": -0.9 * sin}
        local(px4, 0xC00, x=10 * cos - 10, y=10 * sin, z=-10.0, **motion)

    stream(px4, 8.0, say)
    for _ in range(50):
        px4.fly(0.2, say)
        angle = rate * (px4.vehicle.time.s - begun)
        east, north, _ = px4.vehicle.truth().position_enu_m
        assert math.hypot(north - 10 * math.cos(angle) + 10, east - 10 * math.sin(angle)) < 0.5


def test_px4_body_frame_means_velocity(px4: Client) -> None:
    """Frame 8 turns velocities with the vehicle; a position in it is no setpoint at all."""
    stream(px4, 4.0, lambda: local(px4, POSITION & ~YAW, z=-10.0, yaw=math.pi / 2))
    stream(px4, 5.0, lambda: local(px4, VELOCITY, frame=8, vx=2.0))
    east, north, _ = px4.vehicle.truth().velocity_enu_mps
    assert (east, north) == pytest.approx((2.0, 0.0), abs=0.2)
    local(px4, POSITION, frame=8, x=5.0)
    px4.fly(0.1)
    assert "SET_POSITION_TARGET_LOCAL_NED invalid" in "".join(px4.texts())


def test_px4_global_frames(px4: Client) -> None:
    """5 above sea level, 6 above home, 11 above the ground; the frames without _INT are refused by a text."""
    for frame, altitude, north in ((5, 500.0, 5.0), (6, 14.0, -5.0), (11, 9.0, 0.0)):
        stream(px4, 7.0, lambda: earth(px4, POSITION, frame, north, 3.0, altitude))  # noqa: B023
        height = altitude - 488.0 if frame == 5 else altitude
        assert px4.vehicle.truth().position_enu_m == pytest.approx((3.0, north, height), abs=0.3)
    for frame in (0, 3, 10, 1):
        earth(px4, POSITION, frame, 0, 0, 500.0)
        px4.fly(0.1)
        assert f"SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {frame}" in "".join(px4.texts())


def test_px4_force_bit(px4: Client) -> None:
    """The force bit alone changes nothing; with an acceleration it is complained of."""
    stream(px4, 2.0, lambda: local(px4, POSITION | 0x200, z=-10.0))
    assert not any("force" in text for text in px4.texts())
    local(px4, ACCELERATION | 0x200, afx=1.0)
    px4.fly(0.1)
    assert "SET_POSITION_TARGET_LOCAL_NED force not supported" in "".join(px4.texts())


def test_px4_attitude_flies(px4: Client) -> None:
    """Level at 0.8 climbs, -20 degrees of pitch flies forward; the target is streamed; Hold works again."""
    px4.ask_for("ATTITUDE_TARGET")
    stream(px4, 2.0, lambda: attitude(px4, 7, 0, 0, 0, 0.8))
    assert px4.vehicle.truth().position_enu_m[2] > 13.0
    stream(px4, 3.0, lambda: attitude(px4, 7, 0, -20, 0, 0.62))
    assert px4.vehicle.truth().pitch_rad == pytest.approx(-20 * DEG, abs=2 * DEG)
    assert px4.vehicle.truth().velocity_enu_mps[1] > 5.0
    echo = px4.last("ATTITUDE_TARGET")
    _, pitch, _ = Rotation.from_quat(echo.q, scalar_first=True).as_euler("ZYX")
    assert (pitch, echo.thrust) == pytest.approx((-20 * DEG, 0.62), abs=0.01)
    assert px4.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == [ACCEPTED, ACCEPTED]
    px4.fly(6.0)
    assert math.dist(px4.vehicle.truth().velocity_enu_mps, (0, 0, 0)) < 0.1


def test_px4_body_rates(px4: Client) -> None:
    """Half a radian a second of yaw for two seconds, and roll while it is commanded."""
    stream(px4, 2.0, lambda: attitude(px4, 128, 0, 0, 0, 0.6, 0.0, 0.0, 0.5))
    assert px4.vehicle.truth().yaw_rad == pytest.approx(1.0, abs=0.15)
    px4.fly(0.3, lambda: attitude(px4, 128, 0, 0, 0, 0.6, 0.6, 0.0, 0.0))
    assert px4.vehicle.truth().rates_body_radps[0] == pytest.approx(0.6, abs=0.1)


def test_px4_takes_off_and_lands_by_thrust(make: Make) -> None:
    """Thrust lifts it, no thrust near the ground ends in disarming."""
    client = make()
    client.fly(5.0)
    stream(client, 0.2, lambda: attitude(client, 7, 0, 0, 0, 0.0))
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [ACCEPTED]
    client.fly(1.0, lambda: attitude(client, 7, 0, 0, 0, 0.3))
    assert client.vehicle.condition().landed
    client.fly(1.5, lambda: attitude(client, 7, 0, 0, 0, 0.7))
    assert client.vehicle.truth().position_enu_m[2] > 0.5
    while client.vehicle.truth().position_enu_m[2] > 0.01:
        sinks = client.vehicle.truth().velocity_enu_mps[2] + 0.5
        client.fly(0.1, lambda: attitude(client, 7, 0, 0, 0, 0.592 - 0.2 * sinks))  # noqa: B023
    client.fly(4.0, lambda: attitude(client, 7, 0, 0, 0, 0.0))
    condition = client.vehicle.condition()
    assert (condition.armed, condition.crashed) == (False, False)


def test_px4_attitude_stream_counts_and_its_end_is_noticed(px4: Client) -> None:
    stream(px4, 3.0, lambda: attitude(px4, 7, 0, 0, 0, 0.6))
    assert px4.vehicle.condition().mode == "OFFBOARD"
    px4.fly(1.1)
    assert px4.vehicle.condition().mode == "AUTO_RTL"


@pytest.mark.parametrize("frame", [1, 7, 8, 9])
def test_copter_local_frames(copter: Client, frame: int) -> None:
    """1 from home; 7 from here; 8 and 9 from here, turned by the heading."""
    assert copter.command(mavlink.MAV_CMD_CONDITION_YAW, 90, 60, 1, 0) == [ACCEPTED]
    copter.fly(4.0)
    assert copter.vehicle.truth().yaw_rad == pytest.approx(math.pi / 2, abs=0.05)
    east, north, up = copter.vehicle.truth().position_enu_m
    local(copter, POSITION, frame, x=6.0, y=2.0, z=-12.0 if frame == 1 else -2.0)
    copter.fly(8.0)
    goals = {1: (2.0, 6.0, 12.0), 7: (east + 2.0, north + 6.0, up + 2.0)}
    goal = goals.get(frame, (east + 6.0, north - 2.0, up + 2.0))
    assert copter.vehicle.truth().position_enu_m == pytest.approx(goal, abs=0.3)


@pytest.mark.parametrize(
    ("frame", "altitude"), [(0, 500.0), (3, 12.0), (5, 500.0), (6, 12.0), (10, 12.0), (11, 12.0)]
)
def test_copter_global_frames(copter: Client, frame: int, altitude: float) -> None:
    earth(copter, POSITION, frame, 5.0, -4.0, altitude)
    copter.fly(8.0)
    assert copter.vehicle.truth().position_enu_m == pytest.approx((-4.0, 5.0, 12.0), abs=0.3)
    earth(copter, POSITION, 1, 0.0, 0.0, 10.0)
    copter.fly(1.0)
    assert "Unknown mavlink coordinate frame 1" in copter.texts()


@pytest.mark.parametrize(
    "wrong",
    [
        {"mask": 0xFFF},
        {"mask": VELOCITY | 0x08, "vx": 3.0},
        {"mask": VELOCITY, "frame": 12, "vx": 3.0},
        {"mask": VELOCITY, "frame": 99, "vx": 3.0},
        {"mask": VELOCITY, "vx": NAN},
    ],
)
def test_copter_stops_at_nonsense(copter: Client, wrong: dict[str, Any]) -> None:
    """Everything masked, a group half masked, unknown frames, NaN: no text, no motion."""
    text_count = len(copter.texts())
    local(copter, VELOCITY, vx=3.0)
    copter.fly(2.0)
    local(copter, **wrong)
    copter.fly(4.0)
    assert math.dist(copter.vehicle.truth().velocity_enu_mps, (0, 0, 0)) < 0.1
    assert len(copter.texts()) == text_count


def test_copter_accelerates_and_lapses(copter: Client) -> None:
    """Acceleration builds velocity; silence of three seconds stops it. The nose goes where it flies."""
    copter.fly(2.0, lambda: local(copter, ACCELERATION, afy=1.0))
    assert copter.vehicle.truth().velocity_enu_mps[0] == pytest.approx(2.0, abs=0.4)
    assert copter.vehicle.truth().yaw_rad == pytest.approx(math.pi / 2, abs=0.3)
    copter.fly(7.0)
    assert abs(copter.vehicle.truth().velocity_enu_mps[0]) < 0.1


def test_copter_attitude_thrust_is_climb(copter: Client) -> None:
    """0.5 holds the height, 1 climbs at WPNAV_SPEED_UP; three seconds of silence level and stop it."""
    copter.fly(3.0, lambda: attitude(copter, 7, 10, 0, 0, 0.5))
    truth = copter.vehicle.truth()
    assert truth.roll_rad == pytest.approx(10 * DEG, abs=1.5 * DEG)
    assert truth.position_enu_m[2] == pytest.approx(10.0, abs=0.5)
    copter.fly(3.0, lambda: attitude(copter, 7, 0, 0, 0, 1.0))
    assert copter.vehicle.truth().velocity_enu_mps[2] == pytest.approx(2.5, abs=0.3)
    copter.fly(8.0)
    assert math.dist(copter.vehicle.truth().velocity_enu_mps, (0, 0, 0)) < 0.2


def test_copter_echoes_targets_in_guided_alone(copter: Client) -> None:
    """On the way to a position; nothing with velocities. Other modes take no setpoints either."""
    number = mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT
    assert copter.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 100_000) == [ACCEPTED]
    local(copter, POSITION, x=5.0, z=-10.0)
    *_, echo = of("POSITION_TARGET_GLOBAL_INT", copter.fly(2.0))
    assert (echo.coordinate_frame, echo.type_mask) == (0, 65016)
    assert echo.alt == pytest.approx(498.0, abs=0.1)
    copter.fly(0.1, lambda: local(copter, VELOCITY, vx=1.0))
    assert not of("POSITION_TARGET_GLOBAL_INT", copter.fly(1.0))
    assert copter.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 17) == [ACCEPTED]
    local(copter, VELOCITY, vx=3.0)
    assert not of("POSITION_TARGET_GLOBAL_INT", copter.fly(2.0))
    assert math.dist(copter.vehicle.truth().velocity_enu_mps, (0, 0, 0)) < 0.1


def test_a_setpoint_is_empty_or_too_large_as_its_numbers_say() -> None:
    """Against the plain definitions, with whole vectors left out and single axes; one bad axis of eleven is found."""
    random = Random(7)
    values = (0.0, -3.5, 999_999.0, 1e6, -1e6, math.inf, -math.inf, math.nan)
    outcomes = set()
    for _ in range(3000):
        common = random.choice((values[:3], values, (math.nan,), (0.0, math.nan)))
        vectors: Any = [
            MASKED if random.random() < 0.4 else tuple(random.choices(common, k=3)) for _ in range(3)
        ]
        yaw = random.choice(random.choice((values, values[:2])))
        position, velocity, acceleration = vectors
        setpoint = _Setpoint(position, velocity, acceleration, yaw, math.nan)
        axes = [value for vector in vectors for value in vector]
        assert setpoint.empty == all(math.isnan(value) for value in axes)
        assert setpoint.sane == (not any(abs(value) >= 1e6 for value in (*axes, setpoint.yaw_rad)))
        outcomes.add((setpoint.empty, setpoint.sane))
    assert len(outcomes) == 4
