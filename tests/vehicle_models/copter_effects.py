"""What parameters of the imitated ArduCopter do."""

from __future__ import annotations

import math
from collections.abc import Callable

from parameter_effect import (
    Effect,
    Measure,
    beat,
    climbing,
    climbing_s,
    go,
    has_sent,
    hover,
    idling_s,
    in_mode,
    joystick,
    most,
    returning_height,
    sink_mps,
    sinking,
    speed_after,
    speed_mps,
    sticks,
    tilt_deg,
    turn_radps,
    up_m,
    up_mps,
    velocity,
    wait,
)
from vehicle_client import NAN, Client, mavlink


def level(client: Client) -> float:
    hover(client, 5.0)
    go(client, 0, 100, 5)
    return most(speed_mps, client, 8.0)


def copter_returning_speed(client: Client) -> float:
    """The greatest on a way home of 20 m."""
    hover(client, 15.0)
    place = client.vehicle_goal(0.0, 20.0)
    client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, -1, 1, 0, NAN, *place, 15.0)
    client.fly(10.0)
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    return most(speed_mps, client, 8.0)


def copter_landing(client: Client) -> float:
    hover(client, 5.0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 9)
    wait(client, lambda flown: up_m(flown) < 1.0, 30.0)
    return sink_mps(client)


def waiting_above_home_s(client: Client) -> float:
    """From the return's start to the descent, with no way to go."""
    hover(client, 15.0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    return wait(client, lambda flown: up_m(flown) < 14.0, 30.0)


def lapse_s(client: Client) -> float:
    hover(client, 5.0)
    velocity(client, north=2.0)()
    client.fly(1.0)
    return 1.0 + wait(client, lambda flown: speed_mps(flown) < 1.0, 15.0)


def thrust(client: Client) -> float:
    """Climb at a thrust of 0.8."""
    hover(client, 10.0)

    def say() -> None:
        client.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.8))

    return most(up_mps, client, 1.6, say)


def circling(of: Callable[[Client], float]) -> Measure:
    def measured(client: Client) -> float:
        hover(client, 5.0)
        client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        client.fly(0.5, joystick(client))
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 7)
        client.fly(15.0, joystick(client))
        return of(client)

    return measured


def north_of_centre_m(client: Client) -> float:
    """Widest distance from the start along a whole circle is its diameter."""
    start = client.vehicle.truth().position_enu_m
    return 0.5 * most(
        lambda flown: math.dist(start, flown.vehicle.truth().position_enu_m), client, 20.0, joystick(client)
    )


def sticks_kept_s(client: Client) -> float:
    """How long the stick of a joystick that has gone still holds the height."""
    hover(client, 20.0)
    client.fly(0.5, joystick(client))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 2)
    client.fly(1.0, joystick(client))
    return wait(client, lambda flown: sink_mps(flown) > 0.5, 15.0)


def copter_station_lost_s(client: Client) -> float:
    hover(client, 5.0)
    client.fly(1.0, beat(client))
    return wait(client, in_mode("RTL"), 20.0)


def copter_station_lost(client: Client) -> str:
    copter_station_lost_s(client)
    return client.vehicle.condition().mode


def put(client: Client, name: str, value: float) -> None:
    client.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
    client.fly(0.1)


def radio_lost(client: Client) -> str:
    hover(client, 5.0)
    put(client, "SIM_RC_FAIL", 1)
    client.fly(2.0)
    return client.vehicle.condition().mode


def low_volts(client: Client) -> str:
    hover(client, 10.0)
    put(client, "SIM_BATT_VOLTAGE", 10.0)
    client.fly(6.0)
    return client.vehicle.condition().mode


def ceiling_m(client: Client) -> float:
    hover(client, 5.0)
    return most(up_m, client, 12.0, velocity(client, down=-2.0))


def circle_m(client: Client) -> float:
    """How far out a velocity leads before it is turned back."""
    hover(client, 5.0)
    return most(
        lambda flown: flown.vehicle.truth().position_enu_m[1], client, 14.0, velocity(client, north=2.0)
    )


def breached(client: Client) -> str:
    circle_m(client)
    return client.vehicle.condition().mode


def streamed_hz(client: Client) -> float:
    client.fly(2.0)
    return sum(bool(message.get_type() == "GLOBAL_POSITION_INT") for message in client.fly(4.0)) / 4.0


def copter_radio(client: Client) -> str:
    """What arming and flying come to while the radio is silent."""
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 5.0)
    client.fly(4.0)
    return str(int(has_sent("Radio Failsafe")(client)))


FENCED = (("FENCE_ENABLE", 1.0),)
QUICK_LOW = (("BATT_LOW_TIMER", 1.0), ("BATT_FS_LOW_ACT", 2.0))
QUICK_CRITICAL = (
    ("BATT_LOW_TIMER", 1.0),
    ("BATT_CRT_VOLT", 10.5),
    ("BATT_FS_CRT_ACT", 1.0),
    ("BATT_LOW_VOLT", 0.0),
)
ARDUPILOT = (
    Effect("WPNAV_SPEED", (400.0, 800.0), level, (4.0, 8.0)),
    Effect("WPNAV_SPEED_UP", (100.0, 250.0), climbing, (1.0, 2.5)),
    Effect("WPNAV_SPEED_DN", (80.0, 150.0), sinking, (0.8, 1.5)),
    Effect("WPNAV_ACCEL", (100.0, 250.0), speed_after(2.5), (2.35, 5.5), 0.3),
    Effect("PSC_JERK_XY", (1.0, 10.0), speed_after(1.5), (1.1, 3.4), 0.3),
    Effect("WPNAV_ACCEL_Z", (50.0, 200.0), climbing_s, (8.1, 4.1), 0.4),
    Effect("RTL_SPEED", (300.0, 600.0), copter_returning_speed, (3.0, 4.6), 0.3),
    Effect("WPNAV_JERK", (1.0, 5.0), copter_returning_speed, (4.6, 6.5), 0.4),
    Effect("LAND_SPEED", (30.0, 80.0), copter_landing, (0.3, 0.8), 0.12),
    Effect("RTL_ALT", (1500.0, 2500.0), returning_height(20.0), (15.0, 25.0), 0.5),
    Effect("RTL_CLIMB_MIN", (0.0, 1000.0), returning_height(20.0), (15.0, 20.0), 0.5),
    Effect("RTL_LOIT_TIME", (1000.0, 6000.0), waiting_above_home_s, (2.6, 7.6), 0.6),
    Effect("DISARM_DELAY", (4.0, 10.0), idling_s, (4.0, 10.0)),
    Effect("GUID_TIMEOUT", (2.0, 5.0), lapse_s, (2.5, 5.5), 0.5),
    Effect("GUID_OPTIONS", (0.0, 8.0), thrust, (2.4, 5.0), 0.8),
    Effect("ANGLE_MAX", (1500.0, 3000.0), sticks((2,), tilt_deg, ahead=1000), (15.0, 30.0), 2.5),
    Effect("LOIT_SPEED", (300.0, 600.0), sticks((5,), speed_mps, ahead=1000), (3.0, 6.0), 0.5),
    Effect("PILOT_SPEED_UP", (100.0, 200.0), sticks((5,), up_mps, up=1000), (1.0, 2.0)),
    Effect("PILOT_SPEED_DN", (100.0, 200.0), sticks((5,), sink_mps, up=0), (1.0, 2.0)),
    Effect("PILOT_Y_RATE", (20.0, 40.0), sticks((5,), turn_radps, turn=1000), (0.35, 0.7), 0.06),
    Effect("RC_OVERRIDE_TIME", (1.0, 4.0), sticks_kept_s, (1.5, 4.5), 0.6),
    Effect("CIRCLE_RADIUS", (500.0, 1000.0), circling(north_of_centre_m), (5.0, 10.0), 0.6),
    Effect("CIRCLE_RATE", (6.0, 12.0), circling(speed_mps), (1.05, 2.1), 0.2),
    Effect("FS_GCS_TIMEOUT", (3.0, 7.0), copter_station_lost_s, (3.0, 7.0), beside=(("FS_GCS_ENABLE", 1.0),)),
    Effect("FS_GCS_ENABLE", (0.0, 1.0), copter_station_lost, ("GUIDED", "RTL")),
    Effect("FS_THR_ENABLE", (0.0, 3.0), radio_lost, ("GUIDED", "LAND")),
    Effect("SIM_RC_FAIL", (0.0, 1.0), copter_radio, ("0", "1")),
    Effect("BATT_LOW_VOLT", (9.0, 11.0), low_volts, ("GUIDED", "RTL"), beside=QUICK_LOW),
    Effect("BATT_LOW_TIMER", (1.0, 20.0), low_volts, ("RTL", "GUIDED"), beside=(("BATT_FS_LOW_ACT", 2.0),)),
    Effect("BATT_FS_LOW_ACT", (1.0, 2.0), low_volts, ("LAND", "RTL"), beside=(("BATT_LOW_TIMER", 1.0),)),
    Effect(
        "BATT_CRT_VOLT",
        (9.0, 10.5),
        low_volts,
        ("GUIDED", "LAND"),
        beside=QUICK_CRITICAL[:1] + QUICK_CRITICAL[2:],
    ),
    Effect(
        "BATT_FS_CRT_ACT",
        (1.0, 2.0),
        low_volts,
        ("LAND", "RTL"),
        beside=QUICK_CRITICAL[:2] + QUICK_CRITICAL[3:],
    ),
    Effect("FENCE_ALT_MAX", (12.0, 18.0), ceiling_m, (10.0, 16.0), 0.5, beside=FENCED),
    Effect(
        "FENCE_MARGIN", (2.0, 5.0), ceiling_m, (13.0, 10.0), 0.5, beside=(*FENCED, ("FENCE_ALT_MAX", 15.0))
    ),
    Effect("FENCE_ENABLE", (0.0, 1.0), ceiling_m, (27.0, 13.0), 3.0, beside=(("FENCE_ALT_MAX", 15.0),)),
    Effect("FENCE_TYPE", (7.0, 2.0), ceiling_m, (13.0, 27.0), 3.0, beside=(*FENCED, ("FENCE_ALT_MAX", 15.0))),
    Effect("FENCE_RADIUS", (15.0, 25.0), circle_m, (16.0, 26.0), 1.0, beside=FENCED),
    Effect("FENCE_ACTION", (1.0, 2.0), breached, ("RTL", "LAND"), beside=(*FENCED, ("FENCE_RADIUS", 15.0))),
    Effect("SR0_POSITION", (2.0, 5.0), streamed_hz, (2.0, 5.0)),
)
