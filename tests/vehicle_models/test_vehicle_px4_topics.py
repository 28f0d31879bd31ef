"""PX4's topics for a companion: the same flight as by MAVLink, with the offboard mode's own sign of life."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from random import Random
from typing import Any

import numpy as np
import pytest
from vehicle_client import NAN, Client, Make, mavlink, simspec

from bench.contracts import CompanionSample, HasCompanionTopics, Vehicle, VehiclePlan
from bench.simspec import SimSpec
from vehicle_models import open_wing, open_x500

FLAGS = (
    "position",
    "velocity",
    "acceleration",
    "attitude",
    "body_rate",
    "thrust_and_torque",
    "direct_actuator",
)
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = range(4)
OFFBOARD, HOLD, LAND, RETURN = 14, 4, 18, 5
OPEN = (NAN,) * 3


class Companion:
    """A vehicle with PX4's topics. `fly` lets time pass and keeps what was published."""

    def __init__(self, vehicle: Vehicle) -> None:
        assert isinstance(vehicle, HasCompanionTopics)
        self.vehicle: Any = vehicle
        self.heard: list[tuple[float, str, Any]] = []

    def send(self, topic: str, **fields: Any) -> None:
        self.vehicle.take_samples([(f"/fmu/in/{topic}", fields)])

    def life(self, *flags: str) -> None:
        self.send("offboard_control_mode", **{flag: flag in flags for flag in FLAGS})

    def trajectory(self, position: Any = OPEN, **more: Any) -> None:
        fields = {"velocity": OPEN, "acceleration": OPEN, "yaw": NAN, "yawspeed": NAN}
        self.send("trajectory_setpoint", position=position, **{**fields, **more})

    def post(self, number: int, *params: float, **to: int) -> None:
        padded = [*params, *[0.0] * (7 - len(params))]
        given = {f"param{index}": value for index, value in enumerate(padded, start=1)}
        whom = {"target_system": 1, "target_component": 1, "source_system": 7, "source_component": 8, **to}
        self.send("vehicle_command", command=number, **given, **whom)

    def command(self, number: int, *params: float, **to: int) -> list[int]:
        """Send a command, let one step pass, and return the results acknowledged to the sender."""
        self.post(number, *params, **to)
        begun = len(self.heard)
        self.fly(0.02)
        acks = [fields for _, topic, fields in self.heard[begun:] if topic == "vehicle_command_ack"]
        assert all((ack["target_system"], ack["target_component"]) == (7, 8) for ack in acks)
        return [int(ack["result"]) for ack in acks if ack["command"] == number]

    def fly(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        """`each` is called ten times a second, before a step."""
        for step in range(round(seconds * 50)):
            if each and step % 5 == 0:
                each()
            self.vehicle.step()
            samples: list[CompanionSample] = self.vehicle.published_samples()
            now_s = round(self.vehicle.time.s, 3)
            self.heard += [(now_s, topic.removeprefix("/fmu/out/"), fields) for topic, fields in samples]

    def last(self, topic: str) -> Any:
        return next(fields for _, name, fields in reversed(self.heard) if name == topic)

    def times(self, topic: str) -> list[float]:
        return [time for time, name, _ in self.heard if name == topic]

    def state(self) -> tuple[int, int, bool]:
        """What is asked for, what is flown, and whether a failsafe acts."""
        status = self.last("vehicle_status")
        return status["nav_state_user_intention"], status["nav_state"], status["failsafe"]

    def airborne(self) -> None:
        """At 5 m in the offboard mode, by positions."""
        self.fly(5.0)
        self.life("position")
        self.trajectory((0.0, 0.0, -5.0))
        assert self.command(176, 1.0, 6.0) == [ACCEPTED]
        assert self.command(400, 1.0) == [ACCEPTED]
        self.fly(12.0, self.hold)
        assert self.vehicle.truth().position_enu_m[2] == pytest.approx(5.0, abs=0.1)

    def hold(self) -> None:
        self.life("position")
        self.trajectory((0.0, 0.0, -5.0))


Build = Callable[..., Companion]


@pytest.fixture
def build() -> Iterator[Build]:
    with ExitStack() as stack:

        def made(spec: SimSpec | None = None, opened: Any = open_x500) -> Companion:
            plan = VehiclePlan(spec or simspec(), (), companion_topics=True)
            return Companion(stack.enter_context(opened(plan)))

        yield made


def floats(random: Random, bound: float, count: int = 3) -> tuple[float, ...]:
    """Numbers that a float of 32 bits has."""
    return tuple(float(np.float32(random.uniform(-bound, bound))) for _ in range(count))


@pytest.mark.parametrize("seed", range(3))
def test_a_flight_by_topics_is_the_same_as_by_mavlink(seed: int, make: Make, build: Build) -> None:
    """Random setpoints of trajectories, attitudes and rates, bit for bit."""
    client, companion, random = make(), build(), Random(seed)
    companion.fly(1.1)
    client.fly(5.0)
    companion.fly(5.0)
    for command in ((400, 1.0), (22, 0.0, 0.0, 0.0, NAN, NAN, NAN, 508.0)):
        assert client.command(*command) == companion.command(*command) == [ACCEPTED]
    client.fly(16.0)
    companion.fly(16.0)
    kinds = [random.choice((trajectory, attitude, rates)) for _ in range(20)]
    for number, kind in enumerate((trajectory, *kinds)):
        kind(random, client, companion)
        if not number:
            assert client.command(176, 1.0, 6.0) == [ACCEPTED] * 2
            assert companion.command(176, 1.0, 6.0) == [ACCEPTED]
        for _ in range(10):
            client.fly(0.02)
            companion.fly(0.02)
            assert companion.vehicle.truth() == client.vehicle.truth()
    assert companion.state()[1] == OFFBOARD


def trajectory(random: Random, client: Client, companion: Companion) -> None:
    vectors = [floats(random, bound) if random.random() < 0.6 else OPEN for bound in (20.0, 3.0, 1.0)]
    if all(vector is OPEN for vector in vectors):
        vectors[0] = (1.0, 2.0, -20.0)
    turn = [floats(random, 3.0, 1)[0] if random.random() < 0.5 else NAN for _ in range(2)]
    mask = sum(0b111 << 3 * index for index, vector in enumerate(vectors) if vector is OPEN)
    mask |= sum(bit for bit, value in zip((0x400, 0x800), turn, strict=True) if math.isnan(value))
    numbers = (0.0 if math.isnan(value) else value for value in (*sum(vectors, ()), *turn))
    message = mavlink.MAVLink_set_position_target_local_ned_message
    client.send(message(0, 1, 1, 1, mask, *numbers))
    companion.life(random.choice(FLAGS[:3]))
    position, velocity, more = vectors
    companion.trajectory(position, velocity=velocity, acceleration=more, yaw=turn[0], yawspeed=turn[1])


def attitude(random: Random, client: Client, companion: Companion) -> None:
    q = np.array((1.0, *floats(random, 0.1)))
    w, x, y, z = (float(np.float32(part)) for part in q / np.linalg.norm(q))
    thrust = float(np.float32(random.uniform(0.3, 0.7)))
    client.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, (w, x, y, z), 0, 0, 0, thrust))
    companion.life("attitude")
    down = (0.0, 0.0, -thrust)
    companion.send("vehicle_attitude_setpoint", q_d=(w, x, y, z), yaw_sp_move_rate=NAN, thrust_body=down)


def rates(random: Random, client: Client, companion: Companion) -> None:
    roll, pitch, yaw = floats(random, 0.2)
    thrust = float(np.float32(random.uniform(0.3, 0.7)))
    client.send(
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 128, (1, 0, 0, 0), roll, pitch, yaw, thrust)
    )
    companion.life("body_rate")
    companion.send("vehicle_rates_setpoint", roll=roll, pitch=pitch, yaw=yaw, thrust_body=(0.0, 0.0, -thrust))


def test_the_sign_of_life_alone_keeps_the_offboard_mode(build: Build) -> None:
    """One setpoint is held for ever; setpoints alone are lost after COM_OF_LOSS_T, in the step in which it is over."""
    companion = build()
    companion.airborne()
    companion.trajectory((3.0, 0.0, -5.0))
    companion.fly(8.0, lambda: companion.life("position"))
    assert companion.vehicle.truth().position_enu_m[1] == pytest.approx(3.0, abs=0.3)
    companion.life("position")
    companion.fly(0.02)
    last_s = companion.vehicle.time.s - 0.02
    companion.fly(0.96, companion.trajectory)
    assert companion.state() == (OFFBOARD, OFFBOARD, False)
    assert not companion.last("failsafe_flags")["offboard_control_signal_lost"]
    companion.fly(0.06, companion.trajectory)
    assert companion.state() == (OFFBOARD, RETURN, True)
    assert companion.last("failsafe_flags")["offboard_control_signal_lost"]
    # The state is told at the end of the step that begins with the loss.
    told_s = [time for time, topic, fields in companion.heard if fields.get("failsafe")]
    assert told_s[0] == pytest.approx(last_s + 1.0 + 0.02, abs=1e-6)


@pytest.mark.parametrize("flags", [(), ("thrust_and_torque",), ("direct_actuator",)])
def test_what_cannot_be_controlled_ends_the_offboard_mode_at_once(
    flags: tuple[str, ...], build: Build
) -> None:
    companion = build()
    companion.airborne()
    companion.life(*flags)
    companion.fly(0.04)
    assert companion.state()[1:] == (RETURN, True)
    assert companion.vehicle.counters()["setpoints_ignored"] == 1


def test_without_a_sign_of_life_offboard_is_entered_on_the_ground_and_not_armed(build: Build) -> None:
    companion = build()
    companion.fly(5.0)
    assert companion.command(176, 1.0, 6.0) == [ACCEPTED]
    assert companion.state()[1] == OFFBOARD
    assert not companion.last("vehicle_status")["pre_flight_checks_pass"]
    companion.trajectory((0.0, 0.0, -5.0))
    assert companion.command(400, 1.0) == [REJECTED]
    companion.life("velocity")
    assert companion.command(400, 1.0) == [ACCEPTED]


def test_zero_is_a_value_and_nan_is_none(build: Build) -> None:
    """What examples leave at zero turns the nose north and stops; NaN keeps the heading."""
    home = {"east_m": 0.0, "north_m": 0.0, "heading_deg": 90.0}
    companion = build(simspec(vehicle={"home": home}))
    companion.airborne()
    assert companion.last("vehicle_local_position")["heading"] == pytest.approx(math.pi / 2, abs=0.05)

    def as_the_example_does() -> None:
        companion.life("position")
        zero = (0.0, 0.0, 0.0)
        companion.trajectory((0.0, 0.0, -5.0), velocity=zero, acceleration=zero, yaw=0.0, yawspeed=0.0)

    companion.fly(6.0, as_the_example_does)
    assert companion.last("vehicle_local_position")["heading"] == pytest.approx(0.0, abs=0.05)


def test_setpoints_of_another_level_and_bad_ones_are_counted_and_not_flown(build: Build) -> None:
    companion = build()
    companion.airborne()

    def attitude(w: float) -> None:
        q = (w, 0.0, 0.0, 0.0)
        companion.send("vehicle_attitude_setpoint", q_d=q, yaw_sp_move_rate=0.0, thrust_body=(0, 0, -1))

    def rates(roll: float, thrust: float = 0.5) -> None:
        turn = {"roll": roll, "pitch": 0.0, "yaw": 0.0}
        companion.send("vehicle_rates_setpoint", thrust_body=(0.0, 0.0, -thrust), **turn)

    companion.hold()
    rates(1.0)
    attitude(1.0)
    companion.trajectory()
    companion.trajectory((1e9, 0.0, 0.0))
    companion.fly(2.0, companion.hold)
    assert companion.vehicle.counters()["setpoints_ignored"] == 4
    assert companion.vehicle.truth().position_enu_m[2] == pytest.approx(5.0, abs=0.1)
    companion.life("attitude")
    attitude(0.0)
    companion.trajectory((0.0, 0.0, -9.0))
    companion.life("body_rate")
    rates(NAN)
    rates(0.0, NAN)
    companion.hold()
    companion.fly(0.02)
    assert companion.vehicle.counters()["setpoints_ignored"] == 8


@pytest.mark.parametrize(
    ("number", "params", "to", "results"),
    [
        (400, (1.0,), {"target_system": 0, "target_component": 0}, [ACCEPTED]),
        (400, (1.0,), {"target_system": 2}, []),
        (400, (1.0,), {"target_component": 190}, []),
        (400, (7.0,), {}, []),
        (400, (0.0,), {}, [ACCEPTED]),
        (176, (1.0, 4.0, 3.0), {}, [ACCEPTED]),
        (176, (1.0, 99.0), {}, [REJECTED]),
        (100001, (float(OFFBOARD),), {}, [ACCEPTED]),
        (100001, (99.0,), {}, [DENIED]),
        (100001, (NAN,), {}, [DENIED]),
        # Of PX4's MAVLink and not of its commander.
        (511, (30.0, 1e5), {}, [UNSUPPORTED]),
        (60000, (), {}, [UNSUPPORTED]),
        (410, (), {}, [UNSUPPORTED]),
    ],
)
def test_commands_are_acknowledged_once_to_their_sender(
    number: int, params: tuple[float, ...], to: dict[str, int], results: list[int], build: Build
) -> None:
    companion = build()
    companion.fly(5.0)
    assert companion.command(number, *params, **to) == results


def test_modes_by_nav_state_and_the_landing_of_the_example(build: Build) -> None:
    companion = build()
    companion.airborne()
    assert companion.command(100001, float(HOLD)) == [ACCEPTED]
    assert companion.state() == (HOLD, HOLD, False)
    # Offboard has no sign of life any more when it is asked for again.
    companion.fly(1.0)
    assert companion.command(100001, float(OFFBOARD)) == [REJECTED]
    assert companion.command(21) == [ACCEPTED]
    assert companion.state() == (LAND, LAND, False)
    assert not companion.last("vehicle_land_detected")["landed"]
    companion.fly(20.0)
    assert companion.last("vehicle_land_detected")["landed"]
    assert companion.last("vehicle_status")["arming_state"] == 1


def test_what_is_published_how_often(build: Build) -> None:
    """Motion with each step, the status twice a second and on change, landing and battery once a second, home on change."""
    companion = build()
    companion.fly(10.0)
    for topic in ("vehicle_attitude", "vehicle_local_position", "vehicle_odometry", "sensor_combined"):
        assert len(companion.times(topic)) == 500
    # From when home is known.
    assert len(companion.times("vehicle_global_position")) == pytest.approx(500 - 50 * 4.2, abs=2)
    assert np.diff(companion.times("vehicle_control_mode")) == pytest.approx(0.5)
    for topic in ("vehicle_land_detected", "battery_status"):
        assert np.diff(companion.times(topic)) == pytest.approx(1.0)
    assert len(companion.times("home_position")) == 1
    status = companion.times("vehicle_status")
    assert max(np.diff(status)) == pytest.approx(0.5)
    companion.command(400, 1.0)
    companion.fly(0.02)
    changed = companion.times("vehicle_status")[len(status) :]
    assert changed == [10.02]
    assert companion.last("vehicle_status")["armed_time"] == 10_020_000
    assert companion.times("home_position")[1:] == [10.02]


def test_the_control_mode_shows_the_level_of_the_companion(build: Build) -> None:
    companion = build()
    companion.airborne()
    names = ("position", "velocity", "altitude", "climb_rate", "acceleration", "attitude", "rates")
    shown = {}
    for flag in FLAGS[:5]:
        companion.life(flag)
        companion.fly(0.04)
        mode = companion.last("vehicle_control_mode")
        assert mode["flag_control_offboard_enabled"]
        assert not mode["flag_control_auto_enabled"]
        shown[flag] = [name for name in names if mode[f"flag_control_{name}_enabled"]]
        assert mode["flag_multicopter_position_control_enabled"] is (flag in FLAGS[:3])
    assert shown == {
        "position": [*names],
        "velocity": [*names[1:]],
        "acceleration": [*names[4:]],
        "attitude": [*names[5:]],
        "body_rate": ["rates"],
    }


def test_what_is_told_of_motion_is_the_estimate(build: Build) -> None:
    """NED around home for ENU around the origin; at rest the accelerometer feels one g upwards, and nothing accelerates."""
    home = {"east_m": 7.0, "north_m": 3.0, "heading_deg": 40.0}
    companion = build(simspec(vehicle={"home": home, "gps": {"wander_m": 0.4, "noise_m": 0.1}}))
    companion.fly(6.0)
    local, estimate = companion.last("vehicle_local_position"), companion.vehicle.estimate()
    east, north, up = estimate.position_enu_m
    assert (local["y"] + 7.0, local["x"] + 3.0, -local["z"]) == pytest.approx((east, north, up))
    assert local["heading"] == pytest.approx(math.radians(40.0), abs=1e-3)
    assert (local["ax"], local["ay"], local["az"]) == pytest.approx((0.0, 0.0, 0.0), abs=0.02)
    odometry = companion.last("vehicle_odometry")
    assert odometry["position"] == (local["x"], local["y"], local["z"])
    w, x, y, z = odometry["q"]
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(local["heading"])
    assert companion.last("sensor_combined")["accelerometer_m_s2"][2] == pytest.approx(-9.81, abs=0.02)
    assert companion.last("vehicle_status")["timestamp"] == pytest.approx(6e6, abs=5e5)


def test_before_the_position_is_known_it_is_not_valid(build: Build) -> None:
    companion = build()
    companion.fly(4.0)
    assert not companion.last("vehicle_local_position")["xy_valid"]
    assert companion.last("failsafe_flags")["local_position_invalid"]
    assert math.isnan(companion.last("vehicle_odometry")["position"][0])
    companion.fly(0.4)
    assert companion.last("vehicle_local_position")["xy_valid"]
    assert not companion.last("failsafe_flags")["local_position_invalid"]


def test_a_fixed_wing_has_them_too(build: Build) -> None:
    companion = build(opened=open_wing)
    companion.fly(5.0)
    status = companion.last("vehicle_status")
    assert (status["vehicle_type"], status["system_type"]) == (2, 1)
    assert not companion.last("vehicle_control_mode")["flag_multicopter_position_control_enabled"]


def test_a_vehicle_without_the_plan_publishes_nothing() -> None:
    with open_x500(VehiclePlan(simspec(), ())) as vehicle:
        assert isinstance(vehicle, HasCompanionTopics)
        vehicle.take_samples([("/fmu/in/offboard_control_mode", {})])
        vehicle.step()
        assert vehicle.published_samples() == []
