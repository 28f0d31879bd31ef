"""What parameters of the imitated ArduCopter do."""

from __future__ import annotations

import math
from collections.abc import Callable

import parameter_effect as fly
from parameter_effect import Effect, Measure
from vehicle_client import Client, mavlink


def level(client: Client) -> float:
    fly.hover(client, 5.0)
    fly.go(client, 0, 100, 5)
    return fly.most(fly.speed_mps, client, 8.0)


def copter_returning_speed(client: Client) -> float:
    """The greatest on a way home of 20 m."""
    fly.hover(client, 5.0)
    fly.go(client, 0, 20, 5)
    client.fly(7.0)
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    return fly.most(fly.speed_mps, client, 7.0)


def waiting_above_home_s(client: Client) -> float:
    """From the return's start to the descent, with no way to fly.go."""
    fly.hover(client, 15.0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    return fly.wait(client, lambda flown: fly.up_m(flown) < 14.0, 30.0)


def lapse_s(client: Client) -> float:
    fly.hover(client, 5.0)
    fly.velocity(client, north=2.0)()
    client.fly(1.0)
    return 1.0 + fly.wait(client, lambda flown: fly.speed_mps(flown) < 1.0, 15.0)


def thrust(client: Client) -> float:
    """Climb at a thrust of 0.8."""
    fly.hover(client, 10.0)

    def say() -> None:
        client.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.8))

    return fly.most(fly.up_mps, client, 1.6, say)


def circling(of: Callable[[Client], float]) -> Measure:
    def measured(client: Client) -> float:
        fly.hover(client, 5.0)
        client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        client.fly(0.5, fly.joystick(client))
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 7)
        client.fly(10.0, fly.joystick(client))
        return of(client)

    return measured


def north_of_centre_m(client: Client) -> float:
    """Widest distance from the start along more than half a circle is its diameter."""
    start = client.vehicle.truth().position_enu_m
    return 0.5 * fly.most(
        lambda flown: math.dist(start, flown.vehicle.truth().position_enu_m),
        client,
        10.0,
        fly.joystick(client),
    )


def sticks_kept_s(client: Client) -> float:
    """How long the stick of a fly.joystick that has gone still holds the height."""
    fly.hover(client, 10.0)
    client.fly(0.5, fly.joystick(client))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 2)
    client.fly(1.0, fly.joystick(client))
    return fly.wait(client, lambda flown: fly.sink_mps(flown) > 0.5, 15.0)


def radio_lost(client: Client) -> str:
    fly.hover(client, 5.0)
    client.put(SIM_RC_FAIL=1)
    client.fly(2.0)
    return client.vehicle.condition().mode


def low_volts(client: Client) -> str:
    fly.hover(client, 4.0)
    client.put(SIM_BATT_VOLTAGE=10.0)
    client.fly(4.0)
    return client.vehicle.condition().mode


def ceiling_m(client: Client) -> float:
    fly.hover(client, 5.0)
    return fly.most(fly.up_m, client, 8.0, fly.velocity(client, down=-2.0))


FENCED = ("FENCE_ENABLE", 1.0)
QUICK = ("BATT_LOW_TIMER", 1.0)
LOW = (("RTL_ALT", 500.0),)
ARDUPILOT = (
    Effect("WPNAV_SPEED", (400.0, 800.0), level, (4.0, 8.0)),
    Effect("WPNAV_SPEED_UP", (100.0, 250.0), fly.climbing, (1.0, 2.5)),
    Effect("WPNAV_SPEED_DN", (80.0, 150.0), fly.sinking, (0.8, 1.5)),
    Effect("WPNAV_ACCEL", (100.0, 250.0), fly.speed_after(2.5), (2.35, 5.5), 0.3),
    Effect("PSC_JERK_XY", (1.0, 10.0), fly.speed_after(1.5), (1.1, 3.4), 0.3),
    Effect("WPNAV_ACCEL_Z", (50.0, 200.0), fly.climbing_s, (8.1, 4.1), 0.4),
    Effect("RTL_SPEED", (300.0, 600.0), copter_returning_speed, (3.0, 4.6), 0.3, beside=LOW),
    Effect("WPNAV_JERK", (1.0, 5.0), copter_returning_speed, (4.6, 6.5), 0.4, beside=LOW),
    Effect("LAND_SPEED", (30.0, 80.0), fly.touching, (0.3, 0.8), 0.12),
    Effect("RTL_ALT", (1500.0, 2000.0), fly.returning_height(12.0), (15.0, 20.0), 0.5),
    Effect("RTL_CLIMB_MIN", (0.0, 1000.0), fly.returning_height(12.0), (15.0, 20.0), 0.5),
    Effect("RTL_LOIT_TIME", (1000.0, 6000.0), waiting_above_home_s, (3.0, 8.0), 0.3),
    Effect("DISARM_DELAY", (4.0, 10.0), fly.idling_s, (4.0, 10.0)),
    Effect("GUID_TIMEOUT", (2.0, 5.0), lapse_s, (2.5, 5.5), 0.5),
    Effect("GUID_OPTIONS", (0.0, 8.0), thrust, (2.4, 5.0), 0.8),
    Effect("ANGLE_MAX", (1500.0, 3000.0), fly.sticks((2,), fly.tilt_deg, ahead=1000), (15.0, 30.0), 2.5),
    Effect("LOIT_SPEED", (300.0, 600.0), fly.sticks((5,), fly.speed_mps, ahead=1000), (3.0, 6.0), 0.5),
    Effect("PILOT_SPEED_UP", (100.0, 200.0), fly.sticks((5,), fly.up_mps, up=1000), (1.0, 2.0)),
    Effect("PILOT_SPEED_DN", (100.0, 200.0), fly.sticks((5,), fly.sink_mps, up=0), (1.0, 2.0)),
    Effect("PILOT_Y_RATE", (20.0, 40.0), fly.sticks((5,), fly.turn_radps, turn=1000), (0.35, 0.7), 0.06),
    Effect("RC_OVERRIDE_TIME", (1.0, 4.0), sticks_kept_s, (1.5, 4.5), 0.6),
    Effect("CIRCLE_RADIUS", (500.0, 1000.0), circling(north_of_centre_m), (5.0, 10.0), 0.6),
    Effect("CIRCLE_RATE", (6.0, 12.0), circling(fly.speed_mps), (1.05, 2.1), 0.2),
    Effect(
        "FS_GCS_TIMEOUT", (3.0, 7.0), fly.station_lost_s("RTL"), (3.0, 7.0), beside=(("FS_GCS_ENABLE", 1.0),)
    ),
    Effect(
        "FS_GCS_ENABLE",
        (0.0, 1.0),
        fly.station_lost(6.0),
        ("GUIDED", "RTL"),
        beside=(("FS_GCS_TIMEOUT", 3.0),),
    ),
    Effect("FS_THR_ENABLE", (0.0, 3.0), radio_lost, ("GUIDED", "LAND")),
    Effect(
        "BATT_LOW_VOLT", (9.0, 11.0), low_volts, ("GUIDED", "RTL"), beside=(QUICK, ("BATT_FS_LOW_ACT", 2.0))
    ),
    Effect("BATT_LOW_TIMER", (1.0, 20.0), low_volts, ("RTL", "GUIDED"), beside=(("BATT_FS_LOW_ACT", 2.0),)),
    Effect("BATT_FS_LOW_ACT", (1.0, 2.0), low_volts, ("LAND", "RTL"), beside=(QUICK,)),
    Effect(
        "BATT_CRT_VOLT", (9.0, 10.5), low_volts, ("GUIDED", "LAND"), beside=(QUICK, ("BATT_FS_CRT_ACT", 1.0))
    ),
    Effect(
        "BATT_FS_CRT_ACT", (1.0, 2.0), low_volts, ("LAND", "RTL"), beside=(QUICK, ("BATT_CRT_VOLT", 10.5))
    ),
    Effect("FENCE_ALT_MAX", (12.0, 18.0), ceiling_m, (10.0, 16.0), 0.5, beside=(FENCED,)),
    Effect(
        "FENCE_MARGIN", (2.0, 5.0), ceiling_m, (13.0, 10.0), 0.5, beside=(FENCED, ("FENCE_ALT_MAX", 15.0))
    ),
    Effect("FENCE_ENABLE", (0.0, 1.0), ceiling_m, (20.0, 13.0), 2.0, beside=(("FENCE_ALT_MAX", 15.0),)),
    Effect("FENCE_TYPE", (7.0, 2.0), ceiling_m, (13.0, 20.0), 2.0, beside=(FENCED, ("FENCE_ALT_MAX", 15.0))),
)
