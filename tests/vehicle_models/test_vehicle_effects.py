"""What parameters do: each is set to two values, and what the vehicle does is measured. docs/parameters.md
lists them all.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from vehicle_client import NAN, Client, mavlink, simspec

from bench.contracts import LinkSpec, VehiclePlan
from vehicle_models import open_wing, open_x500
from vehicle_models.controller.ardupilot import _modes, _telemetry
from vehicle_models.documentation import PARAMETER_SECTIONS, parameters_read

CURRENT_PLACE = 2**31 - 1
ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "parameters.md"
Measured = float | str
Measure = Callable[[Client], Measured]


@dataclass(frozen=True)
class Effect:
    """A parameter, two values of it, how its effect is measured, and what comes of each value."""

    name: str
    values: tuple[float, float]
    measure: Measure
    comes: tuple[Measured, Measured]
    within: float = 0.3
    beside: tuple[tuple[str, float], ...] = ()  # parameters that have to be so as well


# What is measured. A client comes standing and ready for takeoff.


def speed_mps(client: Client) -> float:
    return math.hypot(*client.vehicle.truth().velocity_enu_mps[:2])


def up_mps(client: Client) -> float:
    return client.vehicle.truth().velocity_enu_mps[2]


def up_m(client: Client) -> float:
    return client.vehicle.truth().position_enu_m[2]


def sink_mps(client: Client) -> float:
    return -up_mps(client)


def turn_radps(client: Client) -> float:
    return abs(client.vehicle.truth().rates_body_radps[2])


def tilt_deg(client: Client) -> float:
    truth = client.vehicle.truth()
    return math.degrees(math.acos(math.cos(truth.roll_rad) * math.cos(truth.pitch_rad)))


def most(
    of: Callable[[Client], float], client: Client, seconds: float, each: Callable[[], None] | None = None
) -> float:
    """The greatest value within so many seconds."""
    highest = -math.inf
    for _ in range(round(seconds * 5)):
        client.fly(0.2, each)
        highest = max(highest, of(client))
    return highest


def wait(
    client: Client, until: Callable[[Client], bool], seconds: float, each: Callable[[], None] | None = None
) -> float:
    """Seconds until something is so; the whole time when it never is."""
    begun = client.vehicle.time.s
    for _ in range(round(seconds * 10)):
        client.fly(0.1, each)
        if until(client):
            break
    return client.vehicle.time.s - begun


def in_mode(name: str) -> Callable[[Client], bool]:
    return lambda client: client.vehicle.condition().mode == name


def has_sent(text: str) -> Callable[[Client], bool]:
    return lambda client: any(text in sent for sent in client.texts())


def disarmed(client: Client) -> bool:
    return not client.vehicle.condition().armed


def hover(client: Client, height_m: float = 12.0) -> None:
    copter = client.vehicle.condition().mode in ("STABILIZE", "GUIDED")
    if copter:
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert client.command(
        mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, height_m if copter else 488.0 + height_m
    ) == [0]
    wait(client, lambda flown: up_m(flown) > height_m - 0.3, 60.0)
    client.fly(1.5)


def go(client: Client, east_m: float, north_m: float, height_m: float) -> None:
    place = client.vehicle_goal(east_m, north_m)
    assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, NAN, *place, 488.0 + height_m) == [
        0
    ]


def joystick(
    client: Client, ahead: int = 0, right: int = 0, up: int = 500, turn: int = 0
) -> Callable[[], None]:
    return lambda: client.send(mavlink.MAVLink_manual_control_message(1, ahead, right, up, turn, 0))


def velocity(client: Client, north: float = 0.0, down: float = 0.0) -> Callable[[], None]:
    return lambda: client.setpoint(0, 0, 0, mask=0xDC7, vn=north, vd=down)


def beat(client: Client) -> Callable[[], None]:
    return lambda: client.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))


def level(client: Client) -> float:
    hover(client, 5.0)
    go(client, 0, 100, 5)
    return most(speed_mps, client, 8.0)


def climbing(client: Client) -> float:
    hover(client, 10.0)
    go(client, 0, 0, 40)
    return most(up_mps, client, 5.0)


def sinking(client: Client) -> float:
    hover(client, 30.0)
    go(client, 0, 0, 5)
    return most(sink_mps, client, 6.0)


def speed_after(seconds: float) -> Measure:
    """Speed so long after a reposition to a place 60 m away."""

    def measured(client: Client) -> float:
        hover(client, 10.0)
        client.fly(2.0)
        place = client.vehicle_goal(0.0, 60.0)
        copter = client.vehicle.condition().mode == "GUIDED"
        frame, height_m = (6, 10.0) if copter else (0, 498.0)
        assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, frame, -1, 1, 0, NAN, *place, height_m) == [
            0
        ]
        client.fly(seconds)
        return speed_mps(client)

    return measured


def copter_returning_speed(client: Client) -> float:
    """The greatest on a way home of 20 m."""
    hover(client, 15.0)
    place = client.vehicle_goal(0.0, 20.0)
    client.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, -1, 1, 0, NAN, *place, 15.0)
    client.fly(10.0)
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    return most(speed_mps, client, 8.0)


def climbing_s(client: Client) -> float:
    """From the order to go 10 m higher to the last metre."""
    hover(client, 10.0)
    client.fly(2.0)
    place = client.vehicle_goal(0.0, 0.0)
    copter = client.vehicle.condition().mode == "GUIDED"
    frame, height_m = (6, 20.0) if copter else (0, 508.0)
    assert client.command_int(mavlink.MAV_CMD_DO_REPOSITION, frame, -1, 1, 0, NAN, *place, height_m) == [0]
    return wait(client, lambda flown: up_m(flown) > 19.0, 40.0)


def takeoff_begins_s(client: Client) -> float:
    """From the command to 0.1 m."""
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 500.0) == [0]
    return wait(client, lambda flown: up_m(flown) > 0.1, 20.0)


def idling_s(client: Client) -> float:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    return wait(client, disarmed, 15.0)


def touching(client: Client) -> float:
    """Speed of coming down, at about 1 m."""
    hover(client, 5.0)
    client.command(mavlink.MAV_CMD_NAV_LAND)
    wait(client, lambda flown: up_m(flown) < 1.0, 30.0)
    return sink_mps(client)


def landing_at(height_m: float) -> Measure:
    def measured(client: Client) -> float:
        hover(client, 22.0)
        client.command(mavlink.MAV_CMD_NAV_LAND)
        wait(client, lambda flown: up_m(flown) < height_m, 60.0)
        return sink_mps(client)

    return measured


def returning_height(away_m: float) -> Measure:
    def measured(client: Client) -> float:
        hover(client, 10.0)
        go(client, 0, away_m, 10)
        client.fly(3.0 + away_m / 3.0)
        client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        return most(up_m, client, 12.0)

    return measured


def returning_speed(client: Client) -> float:
    hover(client, 30.0)
    go(client, 0, 120, 30)
    client.fly(16.0)
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    return most(speed_mps, client, 12.0)


def sticks(mode: tuple[float, ...], of: Callable[[Client], float], **stick: int) -> Measure:
    """Full stick in a mode, for four seconds."""

    def measured(client: Client) -> float:
        hover(client, 12.0)
        client.fly(0.5, joystick(client))
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *mode)
        client.fly(4.0, joystick(client, **stick))
        return of(client)

    return measured


# PX4


def takeoff_height(client: Client) -> float:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, NAN)
    client.fly(20.0)
    return up_m(client)


def rising(client: Client) -> float:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 518.0)
    return most(up_mps, client, 10.0)


def offboard_velocity(
    of: Callable[[Client], float], down: float, height_m: float, north: float = 0.0
) -> Measure:
    def measured(client: Client) -> float:
        hover(client, height_m)
        say = velocity(client, north, down)
        client.fly(0.3, say)
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
        return most(of, client, 4.0, say)

    return measured


def landed_s(client: Client) -> float:
    hover(client, 3.0)
    client.command(mavlink.MAV_CMD_NAV_LAND)
    wait(client, has_sent("Landing detected"), 30.0)
    return wait(client, disarmed, 10.0)


def silent_companion(client: Client) -> None:
    hover(client, 5.0)
    say = velocity(client)
    client.fly(0.3, say)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    client.fly(1.0, say)


def companion_lost_s(client: Client) -> float:
    silent_companion(client)
    return wait(client, in_mode("AUTO_RTL"), 10.0)


def companion_lost(client: Client) -> str:
    silent_companion(client)
    client.fly(2.0)
    return client.vehicle.condition().mode


def station_lost_s(client: Client) -> float:
    hover(client, 5.0)
    client.fly(1.0, beat(client))
    return wait(client, in_mode("AUTO_RTL"), 40.0)


def station_lost(client: Client) -> str:
    station_lost_s(client)
    return client.vehicle.condition().mode


def joystick_lost(client: Client) -> None:
    hover(client, 5.0)
    client.fly(0.5, joystick(client))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3)
    client.fly(1.0, joystick(client))


def joystick_lost_s(client: Client) -> float:
    joystick_lost(client)
    return wait(client, in_mode("AUTO_LOITER"), 10.0)


def joystick_lost_mode(client: Client) -> str:
    joystick_lost(client)
    client.fly(8.0)
    return client.vehicle.condition().mode


def holding_s(client: Client) -> float:
    joystick_lost(client)
    wait(client, in_mode("AUTO_LOITER"), 10.0)
    return wait(client, in_mode("AUTO_RTL"), 20.0)


def battery_text_s(text: str) -> Measure:
    """From arming to a text, with a battery of 10 s."""

    def measured(client: Client) -> float:
        assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        return wait(client, has_sent(text), 15.0)

    return measured


DRAIN = (("SIM_BAT_DRAIN", 10.0), ("SIM_BAT_MIN_PCT", 0.0), ("COM_DISARM_PRFLT", 0.0))


def returning_s(client: Client) -> float:
    """How long a return to the place below takes to the ground."""
    hover(client, 2.5)
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    return wait(client, lambda flown: flown.vehicle.condition().landed, 40.0)


def flat_battery(client: Client) -> str:
    hover(client, 5.0)
    wait(client, in_mode("AUTO_LAND"), 20.0)
    return client.vehicle.condition().mode


def half_volts(client: Client) -> float:
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    client.fly(5.0)
    return volts(client)


def volts(client: Client) -> float:
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    return float(client.last("SYS_STATUS").voltage_battery) / 1000.0


def wide_orbit(client: Client) -> float:
    hover(client, 5.0)
    client.command_int(mavlink.MAV_CMD_DO_ORBIT, 3, 50.0, 3.0, 0, 0, CURRENT_PLACE, CURRENT_PLACE, NAN)
    return float(has_sent("Orbit radius limit exceeded")(client))


def nose_deg(client: Client) -> float:
    """Which way it looks after going 15 m east."""
    hover(client, 5.0)
    go(client, 15, 0, 5)
    client.fly(12.0)
    return math.degrees(client.vehicle.truth().yaw_rad)


def leader(client: Client, north_mps: float, begins_m: float = 0.0) -> Callable[[], None]:
    def say() -> None:
        north = begins_m + north_mps * client.vehicle.time.s
        place = client.vehicle_goal(0.0, north)
        velocity_ned = (north_mps, 0.0, 0.0)
        client.send(
            mavlink.MAVLink_follow_target_message(
                client.vehicle.time.ns // 1_000_000,
                3,
                *place,
                488.0,
                velocity_ned,
                (0, 0, 0),
                (1, 0, 0, 0),
                (0, 0, 0),
                (0, 0, 0),
                0,
            )
        )

    return say


def follow(client: Client) -> tuple[float, float, float]:
    """East, north and up of the leader, after half a minute of walking north at 1 m/s."""
    hover(client, 10.0)
    say = leader(client, 1.0)
    client.fly(0.5, say)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 8)
    client.fly(25.0, say)
    east, north, up = client.vehicle.truth().position_enu_m
    return east, north - client.vehicle.time.s, up


def follow_height(client: Client) -> float:
    return follow(client)[2]


def follow_distance(client: Client) -> float:
    return math.hypot(*follow(client)[:2])


def follow_side(client: Client) -> float:
    return follow(client)[0]


def follow_speed(client: Client) -> float:
    hover(client, 10.0)
    say = leader(client, 0.0, 60.0)
    client.fly(0.5, say)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 8)
    return most(speed_mps, client, 15.0, say)


POSITION, ALTITUDE = (3,), (2,)
PX4 = (
    Effect("MIS_TAKEOFF_ALT", (2.5, 6.0), takeoff_height, (2.5, 6.0)),
    Effect("MPC_TKO_SPEED", (1.5, 3.0), rising, (1.5, 3.0)),
    Effect("MPC_Z_V_AUTO_UP", (1.0, 3.0), climbing, (1.0, 3.0)),
    Effect("MPC_Z_V_AUTO_DN", (0.7, 2.0), sinking, (0.7, 2.0)),
    Effect("MPC_XY_VEL_MAX", (4.0, 8.0), offboard_velocity(speed_mps, 0.0, 5.0, north=20.0), (4.0, 8.0)),
    Effect("MPC_XY_CRUISE", (4.0, 8.0), returning_speed, (4.0, 8.0)),
    Effect("MPC_Z_VEL_MAX_UP", (1.0, 3.0), offboard_velocity(up_mps, -6.0, 5.0), (1.0, 3.0)),
    Effect("MPC_Z_VEL_MAX_DN", (0.7, 1.5), offboard_velocity(sink_mps, 6.0, 20.0), (0.7, 1.5)),
    Effect("MPC_ACC_HOR", (2.0, 5.0), speed_after(2.0), (3.1, 4.5), 0.2),
    Effect("MPC_JERK_AUTO", (2.0, 8.0), speed_after(1.5), (1.7, 3.4), 0.2),
    Effect("MPC_ACC_UP_MAX", (2.0, 6.0), climbing_s, (4.9, 6.8), 0.4),
    Effect("MPC_TKO_RAMP_T", (1.0, 3.0), takeoff_begins_s, (1.9, 2.5), 0.2),
    Effect("MPC_LAND_SPEED", (0.5, 1.0), touching, (0.5, 1.0), 0.15),
    Effect("MPC_LAND_ALT1", (10.0, 20.0), landing_at(10.0), (1.5, 0.97), 0.15),
    Effect("MPC_LAND_ALT2", (5.0, 9.0), landing_at(7.5), (1.1, 0.7), 0.15),
    Effect("COM_DISARM_LAND", (1.0, 4.0), landed_s, (1.0, 4.0)),
    Effect("COM_DISARM_PRFLT", (3.0, 10.0), idling_s, (3.0, 10.0)),
    Effect("COM_OF_LOSS_T", (1.0, 3.0), companion_lost_s, (1.0, 3.0)),
    Effect("COM_OBL_RC_ACT", (0.0, 4.0), companion_lost, ("AUTO_RTL", "AUTO_LAND")),
    Effect("COM_DL_LOSS_T", (5.0, 12.0), station_lost_s, (11.8, 18.8), beside=(("NAV_DLL_ACT", 2.0),)),
    Effect("NAV_DLL_ACT", (0.0, 2.0), station_lost, ("AUTO_LOITER", "AUTO_RTL")),
    Effect("COM_RC_LOSS_T", (0.5, 2.0), joystick_lost_s, (0.5, 2.0)),
    Effect("NAV_RCL_ACT", (2.0, 3.0), joystick_lost_mode, ("AUTO_RTL", "AUTO_LAND")),
    Effect("COM_FAIL_ACT_T", (2.0, 5.0), holding_s, (2.0, 5.0)),
    Effect("BAT_LOW_THR", (0.5, 0.8), battery_text_s("Low battery"), (5.0, 2.0), beside=DRAIN),
    Effect(
        "BAT_CRIT_THR",
        (0.1, 0.4),
        battery_text_s("Critical battery"),
        (9.0, 6.0),
        beside=(*DRAIN, ("BAT_LOW_THR", 0.5), ("COM_LOW_BAT_ACT", 0.0)),
    ),
    Effect(
        "BAT_EMERGEN_THR",
        (0.05, 0.06),
        battery_text_s("Emergency battery level"),
        (9.5, 9.4),
        0.15,
        beside=DRAIN,
    ),
    Effect(
        "COM_LOW_BAT_ACT",
        (0.0, 2.0),
        flat_battery,
        ("AUTO_LOITER", "AUTO_LAND"),
        beside=(("SIM_BAT_DRAIN", 20.0), *DRAIN[1:]),
    ),
    Effect("BAT1_N_CELLS", (4.0, 6.0), volts, (16.2, 24.3), beside=DRAIN),
    Effect("BAT1_V_CHARGED", (4.05, 4.2), volts, (16.2, 16.8), beside=DRAIN),
    Effect("BAT1_V_EMPTY", (3.6, 3.2), half_volts, (15.3, 14.5), 0.1, beside=DRAIN),
    Effect("MC_ORBIT_RAD_MAX", (1000.0, 30.0), wide_orbit, (0.0, 1.0)),
    Effect("MPC_YAW_MODE", (0.0, 3.0), nose_deg, (90.0, 0.0), 5.0),
    Effect("NAV_ACC_RAD", (2.0, 30.0), nose_deg, (90.0, 0.0), 5.0),
    Effect("RTL_RETURN_ALT", (20.0, 30.0), returning_height(30.0), (20.0, 30.0), 0.5),
    Effect("RTL_DESCEND_ALT", (10.0, 30.0), returning_s, (13.0, 4.6), 0.7),
    Effect("RTL_LAND_DELAY", (0.0, 4.0), returning_s, (13.0, 17.0), 0.7),
    Effect("RTL_MIN_DIST", (2.0, 20.0), returning_height(10.0), (30.0, 10.0), 0.7),
    Effect("MPC_MAN_TILT_MAX", (15.0, 30.0), sticks(ALTITUDE, tilt_deg, ahead=1000), (15.0, 30.0), 2.5),
    Effect("MPC_MAN_Y_MAX", (20.0, 40.0), sticks(POSITION, turn_radps, turn=1000), (0.35, 0.7), 0.06),
    Effect("MPC_VEL_MANUAL", (3.0, 6.0), sticks(POSITION, speed_mps, ahead=1000), (3.0, 6.0), 0.5),
    Effect("FLW_TGT_HT", (8.0, 15.0), follow_height, (8.0, 15.0), 0.5),
    Effect("FLW_TGT_DST", (8.0, 15.0), follow_distance, (8.0, 15.0), 1.5),
    Effect("FLW_TGT_FA", (180.0, 90.0), follow_side, (0.0, 8.0), 1.5),
    Effect("FLW_TGT_MAX_VEL", (3.0, 8.0), follow_speed, (3.0, 8.0), 1.5),
)

# ArduCopter


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


def radio_fails(client: Client) -> str:
    hover(client, 5.0)
    client.fly(2.0)
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


# The fixed wing


def circling_mps(client: Client) -> float:
    get_up(client)
    client.fly(20.0)
    return speed_mps(client)


def get_up(client: Client) -> None:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 538.0)
    wait(client, in_mode("AUTO_LOITER"), 60.0)


def wing_climbing(client: Client) -> float:
    get_up(client)
    go(client, 0, 300, 120)
    client.fly(12.0)
    return up_mps(client)


def wing_sinking(client: Client) -> float:
    get_up(client)
    go(client, 0, 300, 120)
    client.fly(25.0)
    go(client, 0, 300, 50)
    client.fly(10.0)
    return sink_mps(client)


WING = (
    Effect("FW_AIRSPD_TRIM", (14.0, 17.0), circling_mps, (14.0, 17.0), 0.6),
    Effect("FW_T_CLMB_R_SP", (1.5, 3.0), wing_climbing, (1.5, 3.0), 0.4),
    Effect("FW_T_SINK_R_SP", (1.0, 2.0), wing_sinking, (1.0, 2.0), 0.4),
)

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
    Effect("SIM_RC_FAIL", (0.0, 1.0), lambda client: copter_radio(client), ("0", "1")),
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


def copter_radio(client: Client) -> str:
    """What arming and flying come to while the radio is silent."""
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4)
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, 5.0)
    client.fly(4.0)
    return str(int(has_sent("Radio Failsafe")(client)))


# ArduPilot stands for 42 s before it may be armed: half of each flight, and no effect that is shown here.
START_SHORTENED = 8.0
START_TIMES = (
    "STANDBY_S",
    "ESTIMATOR_S",
    "ALIGNED_S",
    "RECEIVER_S",
    "POSITION_S",
    "AHRS_S",
    "STABILIZE_READY_S",
    "USES_GPS_S",
    "GUIDED_READY_S",
)


@pytest.fixture
def client_of(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Client]]:
    """A vehicle that is ready to fly, with the given parameters."""
    for module in (_modes, _telemetry):
        for name in START_TIMES:
            if hasattr(module, name):
                monkeypatch.setattr(module, name, getattr(module, name) / START_SHORTENED)
    with ExitStack() as stack:

        def build(autopilot: str, parameters: dict[str, float]) -> Client:
            client = Client(255)
            stack.callback(client.socket.close)
            wing = autopilot == "wing"
            vehicle = {"parameters": parameters, **({"model": "wing"} if wing else {})}
            link = LinkSpec("onboard", "udp_out", port=client.port, streams="none")
            plan = VehiclePlan(simspec("px4" if wing else autopilot, vehicle=vehicle), (link,))
            client.vehicle = stack.enter_context((open_wing if wing else open_x500)(plan))
            client.fly(1.1)
            client.fly(42.0 / START_SHORTENED if autopilot == "ardupilot" else 4.0)
            client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION)
            return client

        yield build


QUICK = {
    "px4": {"MPC_TKO_SPEED": 4.0},
    "ardupilot": {"WPNAV_SPEED_UP": 400.0},
    "wing": {},
}  # to the height where something is measured


def shown(client_of: Callable[..., Client], autopilot: str, effect: Effect) -> None:
    for value, comes in zip(effect.values, effect.comes, strict=True):
        measured = effect.measure(
            client_of(autopilot, {**QUICK[autopilot], **dict(effect.beside), effect.name: value})
        )
        expected = comes if isinstance(comes, str) else pytest.approx(comes, abs=effect.within)
        assert measured == expected, f"{effect.name} {value:g}"


@pytest.mark.parametrize("effect", PX4, ids=lambda case: case.name)
def test_px4_does_what_the_parameter_says(client_of: Callable[..., Client], effect: Effect) -> None:
    shown(client_of, "px4", effect)


@pytest.mark.parametrize("effect", ARDUPILOT, ids=lambda case: case.name)
def test_ardupilot_does_what_the_parameter_says(client_of: Callable[..., Client], effect: Effect) -> None:
    shown(client_of, "ardupilot", effect)


@pytest.mark.parametrize("effect", WING, ids=lambda case: case.name)
def test_the_wing_does_what_the_parameter_says(client_of: Callable[..., Client], effect: Effect) -> None:
    shown(client_of, "wing", effect)


# The page.

EFFECTS = {"px4": PX4, "ardupilot": ARDUPILOT, "wing": WING}
ROW = re.compile(r"\| `(\w+)` \| ([-\d.]+) \| (.+) \| (\S+|not shown) \|")


def on_the_page() -> dict[str, dict[str, tuple[float, str]]]:
    """Default and proof of each parameter, by section and name."""
    rows_by_section: dict[str, dict[str, tuple[float, str]]] = {}
    tables, _, _ = PAGE.read_text().partition("## How many have an effect")
    for line in tables.splitlines():
        if line.startswith("## "):
            section = rows_by_section.setdefault(line.removeprefix("## "), {})
        elif row := ROW.fullmatch(line):
            section[row[1]] = (float(row[2]), row[4])
    return rows_by_section


def test_the_page_lists_every_parameter_that_the_code_reads() -> None:
    """A parameter that comes to have an effect gets a row, and one that loses it loses the row."""
    assert {name: set(rows) for name, rows in on_the_page().items()} == parameters_read()


def test_the_page_has_the_defaults() -> None:
    for section, rows in on_the_page().items():
        defaults = {
            parameter.name: parameter.default
            for parameter in PARAMETER_SECTIONS[section].parameters.definitions
        }
        assert {name: default for name, (default, _) in rows.items()} == {
            name: defaults[name] for name in rows
        }


def test_the_page_says_where_each_effect_is_shown() -> None:
    """By the tables above, or by a test that sets the parameter, or nowhere."""
    for section, rows in on_the_page().items():
        names = {effect.name for effect in EFFECTS[section]}
        assert names == {name for name, (_, proof) in rows.items() if proof == "effects"}
        for name, (_, proof) in rows.items():
            if proof not in ("effects", "not shown"):
                assert name in (Path(__file__).parent / f"test_vehicle_{proof}.py").read_text(), name
    assert min(len(PX4), len(ARDUPILOT)) >= 25
