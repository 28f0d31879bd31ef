"""ArduPilot's topics for a companion: the same flight as by MAVLink, and what is told of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from random import Random
from typing import Any

import numpy as np
import pytest
import test_vehicle_px4_topics
from scipy.spatial.transform import Rotation
from vehicle_client import NAN, Make, mavlink, simspec

from bench.contracts import VehiclePlan
from bench.streams import AP_TO_AGENT, Header, Twist, Vector3, ap_message, decode, encode, filled
from vehicle_models import open_x500
from vehicle_models.controller.telemetry._attitude import quaternion, turned_to_ned

GUIDED, LAND, STABILIZE = 4, 9, 0


class Companion(test_vehicle_px4_topics.Companion):
    """A vehicle with ArduPilot's topics and services."""

    def send(self, topic: str, **fields: Any) -> None:
        self.vehicle.take_samples([(topic, fields)])

    def call(self, service: str, **fields: Any) -> Any:
        """Ask, let one step pass, and return the answer."""
        begun = len(self.heard)
        self.send(service, **fields)
        self.fly(0.02)
        (answer,) = [fields for _, topic, fields in self.heard[begun:] if topic == service]
        return answer

    def velocity(self, frame: str, linear: Any, turn: float = 0.0) -> None:
        twist = Twist(Vector3(*linear), Vector3(0.0, 0.0, turn))
        self.send("/ap/cmd_vel", header=Header(frame_id=frame), twist=twist)

    def position(
        self, latitude: float, longitude: float, altitude_m: float, frame: int = 6, mask: int = 0xDF8
    ) -> None:
        place = {"latitude": latitude, "longitude": longitude, "altitude": altitude_m}
        self.send(
            "/ap/cmd_gps_pose", header=Header(frame_id="map"), coordinate_frame=frame, type_mask=mask, **place
        )

    def last(self, topic: str) -> Any:
        """The last message of a topic, as it comes out of its bytes."""
        kind = ap_message(AP_TO_AGENT[topic])
        return decode(kind, encode(filled(kind, super().last(topic))))

    def airborne(self) -> None:
        """At 5 m in GUIDED."""
        self.fly(5.0)
        assert self.call("/ap/mode_switch", mode=GUIDED) == {"status": True, "curr_mode": GUIDED}
        assert self.call("/ap/arm_motors", arm=True) == {"result": True}
        assert self.call("/ap/experimental/takeoff", alt=5.0) == {"status": True}
        self.fly(12.0)
        assert self.vehicle.truth().position_enu_m[2] == pytest.approx(5.0, abs=0.1)

    @property
    def ignored(self) -> int:
        return int(self.vehicle.counters()["setpoints_ignored"])


Build = Callable[..., Companion]


@pytest.fixture
def build() -> Iterator[Build]:
    with ExitStack() as stack:

        def made(**changes: Any) -> Companion:
            plan = VehiclePlan(simspec("ardupilot", **changes), (), companion_topics=True)
            return Companion(stack.enter_context(open_x500(plan)))

        yield made


def floats(random: Random, bound: float, count: int = 3) -> tuple[float, ...]:
    """Numbers that a float of 32 bits has."""
    return tuple(float(np.float32(random.uniform(-bound, bound))) for _ in range(count))


@pytest.mark.parametrize("seed", range(2))
def test_a_flight_by_topics_is_the_same_as_by_mavlink(seed: int, make: Make, build: Build) -> None:
    """Random velocities with and without a rate of yaw, and places in three frames, bit for bit."""
    client, companion, random = make(simspec("ardupilot")), build(), Random(seed)
    companion.fly(1.1)  # what the client has flown to be heard
    client.fly(5.0)
    companion.fly(5.0)
    assert client.command(176, 1.0, GUIDED) == client.command(400, 1.0) == [0]
    companion.call("/ap/mode_switch", mode=GUIDED)
    companion.call("/ap/arm_motors", arm=True)
    assert client.command(22, *(0.0,) * 6, 5.0) == [0]
    assert companion.call("/ap/experimental/takeoff", alt=5.0)["status"]
    client.fly(10.0)
    companion.fly(10.0)
    for number in range(12):
        if number % 3 < 2:
            east, north, up = floats(random, 2.0)
            turn = NAN if number % 3 else floats(random, 0.5, 1)[0]
            mask, rate = (0xDC7, 0.0) if math.isnan(turn) else (0x5C7, -turn)
            client.setpoint(0, 0, 0, mask, vn=north, ve=east, vd=-up, yawrate=rate)
            companion.velocity("map", (east, north, up), turn)
        else:
            latitude_e7 = 473977000 + random.randint(-2000, 2000)
            longitude_e7 = 85456000 + random.randint(-2000, 2000)
            frame, height_m = random.choice(((5, 496.0), (6, 8.0), (11, 7.5)))
            message = mavlink.MAVLink_set_position_target_global_int_message
            client.send(message(0, 1, 1, frame, 0xDF8, latitude_e7, longitude_e7, height_m, *(0.0,) * 8))
            companion.position(latitude_e7 * 1e-7, longitude_e7 * 1e-7, height_m, frame)
        for _ in range(15):
            client.fly(0.02)
            companion.fly(0.02)
            assert companion.vehicle.truth() == client.vehicle.truth()
    assert companion.vehicle.truth().position_enu_m[:2] != (0.0, 0.0)


def test_a_velocity_of_the_body_turns_with_the_nose(build: Build) -> None:
    companion = build(vehicle={"home": {"east_m": 0.0, "north_m": 0.0, "heading_deg": 90.0}})
    companion.airborne()
    for _ in range(5):
        companion.velocity("base_link", (1.0, 0.5, 0.0))
        companion.fly(0.5)
    # The nose points east: forward is east, left is north.
    east_mps, north_mps, up_mps = companion.vehicle.truth().velocity_enu_mps
    assert (east_mps, north_mps, up_mps) == pytest.approx((1.0, 0.5, 0.0), abs=0.1)
    for _ in range(4):
        companion.velocity("base_link", (0.0, 0.0, 0.0), turn=0.4)
        companion.fly(0.5)
    # To the left, as seen from above.
    assert companion.vehicle.truth().rates_body_radps[2] == pytest.approx(-0.4, abs=0.05)


BAD: dict[str, Callable[[Companion], None]] = {
    "a frame that nobody knows": lambda companion: companion.velocity("odom", (1.0, 0.0, 0.0)),
    "an airspeed, of a fixed wing alone": lambda companion: companion.velocity("base_link", (9.0, NAN, NAN)),
    "no number": lambda companion: companion.velocity("map", (math.inf, 0.0, 0.0)),
    "a turn without end": lambda companion: companion.velocity("map", (1.0, 0.0, 0.0), math.inf),
    "an altitude frame that is not flown": lambda companion: companion.position(47.0, 8.0, 9.0, frame=3),
    "no longitude": lambda companion: companion.position(47.3977, 8.5456, 9.0, mask=2),
    "no altitude": lambda companion: companion.position(47.3977, 8.5456, NAN),
    "a place off the earth": lambda companion: companion.position(91.0, 8.5456, 9.0),
    "three axes": lambda companion: companion.send("/ap/joy", axes=(1.0, 1.0, 1.0)),
}


def test_what_makes_no_sense_is_counted_and_changes_nothing(build: Build) -> None:
    disturbed, other = build(), build()
    for companion in (disturbed, other):
        companion.airborne()
    for count, (name, send) in enumerate(BAD.items(), start=1):
        for companion in (disturbed, other):
            companion.velocity("map", (0.0, 1.0, 0.0))
            companion.fly(0.2)
        send(disturbed)
        for companion in (disturbed, other):
            companion.fly(0.4)
        assert disturbed.vehicle.truth() == other.vehicle.truth(), name
        assert (disturbed.ignored, other.ignored) == (count, 0), name


def test_setpoints_are_flown_in_guided_and_armed_alone(build: Build) -> None:
    companion = build()
    companion.fly(5.0)
    companion.velocity("map", (0.0, 0.0, 1.0))
    companion.call("/ap/mode_switch", mode=GUIDED)
    companion.velocity("map", (0.0, 0.0, 1.0))
    companion.fly(1.0)
    assert companion.ignored == 2
    companion.airborne()
    companion.call("/ap/mode_switch", mode=LAND)
    companion.velocity("map", (3.0, 0.0, 0.0))
    companion.position(47.4, 8.6, 9.0)
    companion.fly(2.0)
    assert companion.ignored == 4
    assert abs(companion.vehicle.truth().velocity_enu_mps[0]) < 0.1


def test_services_answer_what_mavlink_would_refuse(build: Build) -> None:
    companion = build()
    companion.fly(1.0)
    assert companion.call("/ap/prearm_check", structure_needs_at_least_one_member=0)["success"]
    assert companion.call("/ap/mode_switch", mode=99) == {"status": False, "curr_mode": STABILIZE}
    assert companion.call("/ap/experimental/takeoff", alt=5.0) == {"status": False}
    # A landing cannot be armed in.
    assert companion.call("/ap/mode_switch", mode=LAND)["status"]
    assert companion.call("/ap/arm_motors", arm=True) == {"result": False}
    companion.airborne()
    assert companion.call("/ap/arm_motors", arm=True) == {"result": True}
    # In the air it is not disarmed.
    assert companion.call("/ap/arm_motors", arm=False) == {"result": False}
    low = build(vehicle={"parameters": {"BATT_LOW_VOLT": 20.0}})
    low.fly(1.0)
    answer = low.call("/ap/prearm_check", structure_needs_at_least_one_member=0)
    assert answer == {"success": False, "message": "Vehicle is Not Armable"}


def test_a_request_before_a_restart_is_answered_once(build: Build) -> None:
    """In the step of the request the controller starts again: the new one answers."""
    companion = build()
    companion.fly(1.0)
    companion.vehicle._controller._restart.requested = True
    answer = companion.call("/ap/mode_switch", mode=GUIDED)
    assert answer["curr_mode"] in (STABILIZE, GUIDED)
    assert not companion.vehicle._controller.restart_requested


def test_axes_of_a_joystick_override_the_radio_until_they_are_released(build: Build) -> None:
    """Of eight channels at most; what is beyond the travel is its end."""
    companion = build()
    companion.fly(1.0)
    resting_us = companion.vehicle._flight.rc_us
    companion.send("/ap/joy", axes=(0.0, 0.5, -2.0, 1.0, NAN, NAN, NAN, NAN, 1.0))
    companion.fly(0.02)
    assert companion.vehicle._flight.rc_us[:4] == (1500, 1750, 1000, 2000)
    assert companion.vehicle._flight.rc_us[4:] == resting_us[4:]
    companion.send("/ap/joy", axes=(NAN,) * 4)
    companion.fly(0.02)
    assert companion.vehicle._flight.rc_us == resting_us


def test_what_is_told_is_the_estimate_in_the_frames_of_ardupilot(build: Build) -> None:
    """Compared with the vehicle's truth, which has no error here, and the attitude turned by another formula."""
    companion = build(vehicle={"home": {"east_m": 3.0, "north_m": 4.0, "heading_deg": 70.0}})
    companion.airborne()
    for _ in range(6):
        companion.velocity("map", (1.0, -2.0, 0.5))
        companion.fly(0.5)
    truth, flight = companion.vehicle.truth(), companion.vehicle._flight
    east_m, north_m, up_m = truth.position_enu_m
    pose = companion.last("/ap/pose/filtered")
    place = pose.pose.position
    # Said up to two steps ago.
    assert (place.x, place.y, place.z) == pytest.approx((east_m - 3.0, north_m - 4.0, up_m), abs=0.1)
    nose = turned_to_ned(quaternion(flight), (1.0, 0.0, 0.0))
    left = turned_to_ned(quaternion(flight), (0.0, -1.0, 0.0))
    turn = pose.pose.orientation
    matrix = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_matrix()
    assert matrix[:, 0] == pytest.approx((nose[1], nose[0], -nose[2]), abs=0.02)
    assert matrix[:, 1] == pytest.approx((left[1], left[0], -left[2]), abs=0.02)
    twist = companion.last("/ap/twist/filtered").twist
    assert (twist.linear.x, twist.linear.y, twist.linear.z) == pytest.approx(truth.velocity_enu_mps, abs=0.1)
    imu = companion.last("/ap/imu/experimental/data")
    told = (imu.orientation.x, imu.orientation.y, imu.orientation.z, imu.orientation.w)
    assert told == pytest.approx(quaternion(flight), abs=1e-9)
    assert imu.header.frame_id == "base_link_ned"
    # Nearly 1 g upwards: z is down.
    assert imu.linear_acceleration.z == pytest.approx(-9.8, abs=1.0)
    stamp = companion.last("/ap/time")
    now_s = (flight.unix_start_us + flight.time_us) * 1e-6
    assert stamp.sec + stamp.nanosec * 1e-9 == pytest.approx(now_s, abs=1e-6)
    geopose = companion.last("/ap/geopose/filtered").pose.position
    assert geopose.altitude == pytest.approx(flight.altitude_m, abs=0.05)
    degrees = (flight.latitude_e7 * 1e-7, flight.longitude_e7 * 1e-7)
    assert (geopose.latitude, geopose.longitude) == pytest.approx(degrees, abs=2e-6)


def test_each_topic_has_its_rate_and_the_changing_ones_tell_changes(build: Build) -> None:
    companion = build()
    companion.airborne()
    companion.heard.clear()
    begun_s = companion.vehicle.time.s
    for _ in range(20):
        companion.position(47.3978, 8.5457, 6.0)
        companion.fly(0.5)
    counts = {topic: sum(name == topic for _, name, _ in companion.heard) for topic in AP_TO_AGENT}
    assert companion.vehicle.time.s - begun_s == pytest.approx(10.0)
    assert counts == {
        **dict.fromkeys(("/ap/time", "/ap/clock", "/ap/imu/experimental/data"), 500),
        **dict.fromkeys(("/ap/pose/filtered", "/ap/twist/filtered", "/ap/geopose/filtered"), 300),
        **dict.fromkeys(("/ap/battery", "/ap/gps_global_origin/filtered"), 10),
        "/ap/navsat": counts["/ap/navsat"],
        "/ap/status": 20,
        "/ap/goal_lla": 1,
        "/ap/tf_static": 0,
    }
    assert 10 < counts["/ap/navsat"] <= 100
    goal = companion.last("/ap/goal_lla").position
    assert (goal.latitude, goal.longitude) == pytest.approx((47.3978, 8.5457), abs=1e-7)
    assert goal.altitude == pytest.approx(companion.vehicle._flight.home.altitude_m + 6.0, abs=0.01)
    companion.heard.clear()
    companion.call("/ap/mode_switch", mode=LAND)
    companion.fly(0.12)
    status = companion.last("/ap/status")
    assert (status.mode, status.armed, status.flying, status.failsafe) == (LAND, True, True, b"")


def test_the_battery_is_told_as_ardupilot_counts_it(build: Build) -> None:
    companion = build()
    companion.airborne()
    battery, flight = companion.last("/ap/battery"), companion.vehicle._flight
    assert battery.percentage == pytest.approx(round(100 * flight.battery_fraction) * 0.01, abs=0.011)
    assert battery.charge == pytest.approx(battery.percentage * 3.3, abs=1e-5)
    assert battery.current < 0.0
    assert (battery.power_supply_status, battery.present) == (2, True)
    assert math.isnan(battery.temperature)
