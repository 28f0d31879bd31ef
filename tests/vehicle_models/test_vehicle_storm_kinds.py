"""Under fire on every kind of vehicle: the fixed wing too, messages that may change the mode, and what is
counted.
"""

from __future__ import annotations

import math
import random

import pytest
from test_vehicle_storm import extreme_frames, fire, hover, mutilated
from test_vehicle_wing import MakeWing, take_off
from test_vehicle_wing import make_wing as make_wing
from vehicle_client import Client, Make, mavlink, simspec

from vehicle_models.controller.links._frames import KINDS, message_id


def still_circles(client: Client) -> None:
    condition, truth = client.vehicle.condition(), client.vehicle.truth()
    assert condition.armed
    assert not condition.crashed
    assert truth.position_enu_m[2] > 15.0
    assert 8.0 < math.hypot(*truth.velocity_enu_mps) < 30.0
    client.fly(10.0)  # what still waits to be heard comes first
    assert client.command(31999) == [3]


def test_every_message_of_the_dialect_is_fired() -> None:
    """All but two: one that locks other clients out, and one that may terminate the flight by command."""
    fired = {message_id(frame) for frame in extreme_frames(random.Random(1), 1)}
    assert {KINDS[name].id for name in KINDS} - fired == {KINDS["SETUP_SIGNING"].id, KINDS["SET_MODE"].id}


def test_every_message_with_extreme_values_leaves_the_wing_flying(make_wing: MakeWing) -> None:
    client = make_wing()
    take_off(client)
    unheard = client.vehicle.counters()["mavlink_unheard"]
    fire(client, extreme_frames(random.Random(3), 2), 50)
    still_circles(client)
    assert client.vehicle.counters()["mavlink_unheard"] > unheard + 200


def test_rubbish_leaves_the_wing_flying(make_wing: MakeWing) -> None:
    client = make_wing()
    take_off(client)
    draw = random.Random(4)
    whole = list(extreme_frames(draw, 1))
    fire(client, (mutilated(draw, whole) for _ in range(5000)), 100)
    still_circles(client)
    assert sum(client.vehicle.counters().values()) > 40_000


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_modes_that_are_none_leave_it_flying(make: Make, autopilot: str) -> None:
    """SET_MODE and DO_SET_MODE with every extreme that names no mode; what is refused changes nothing."""
    client = hover(make, autopilot)
    before = client.vehicle.condition().mode
    for base in (0, 1, 127, 255):
        for custom in (99, 2**31 - 1, 2**31, 2**32 - 1):
            client.send(mavlink.MAVLink_set_mode_message(1, base, custom))
            client.fly(0.02)
    for value in (math.nan, math.inf, -math.inf, 3.4e38, -1.0):
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, value, value)
        client.command(mavlink.MAV_CMD_DO_SET_MODE, value, 99, 99)
    client.fly(1.0)
    condition = client.vehicle.condition()
    assert (condition.mode, condition.armed, condition.landed) == (before, True, False)


def test_a_signing_key_of_extremes_shuts_out_and_no_more(make: Make) -> None:
    """SETUP_SIGNING with limits in its fields: the vehicle rejects clients without the key, counts that, and
    flies on.
    """
    client = make(simspec())
    client.airborne(10.0)
    client.send(mavlink.MAVLink_setup_signing_message(1, 1, [255] * 32, 2**64 - 1))
    client.fly(0.1)
    before = client.vehicle.counters()
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 5) == []
    after = client.vehicle.counters()
    assert sum(after.values()) > sum(before.values())
    client.fly(5.0)
    condition = client.vehicle.condition()
    assert (condition.mode, condition.armed, condition.landed, condition.crashed) == (
        "AUTO_LOITER",
        True,
        False,
        False,
    )


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_two_hundred_thousand_datagrams_leave_the_wing_flying(make_wing: MakeWing) -> None:
    client = make_wing()
    take_off(client)
    draw = random.Random(5)
    whole = list(extreme_frames(draw, 1))
    fire(client, (mutilated(draw, whole) for _ in range(200_000)), 100)
    fire(client, extreme_frames(draw, 50), 50)
    still_circles(client)
