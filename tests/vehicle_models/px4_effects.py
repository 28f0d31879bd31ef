"""What parameters of the imitated PX4 do."""

from __future__ import annotations

import math
from collections.abc import Callable

import parameter_effect as fly
from parameter_effect import Effect, Measure
from vehicle_client import NAN, Client, mavlink

CURRENT_PLACE = 2**31 - 1


def landing_at(height_m: float, begins_m: float = 22.0) -> Measure:
    def measured(client: Client) -> float:
        fly.hover(client, begins_m)
        client.command(mavlink.MAV_CMD_NAV_LAND)
        fly.wait(client, lambda flown: fly.up_m(flown) < height_m, 60.0)
        return fly.sink_mps(client)

    return measured


def returning_speed(client: Client) -> float:
    fly.hover(client, 5.0)
    fly.go(client, 0, 70, 5)
    client.fly(12.0)
    client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    return fly.most(fly.speed_mps, client, 8.0)


def take_off(client: Client, altitude_m: float) -> None:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    assert client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, altitude_m) == [0]


def takeoff_begins_s(client: Client) -> float:
    """From the command to 0.1 m."""
    take_off(client, 500.0)
    return fly.wait(client, lambda flown: fly.up_m(flown) > 0.1, 20.0)


def rising(client: Client) -> float:
    take_off(client, 518.0)
    return fly.most(fly.up_mps, client, 10.0)


def offboard_velocity(
    of: Callable[[Client], float], down: float, height_m: float, north: float = 0.0
) -> Measure:
    def measured(client: Client) -> float:
        fly.hover(client, height_m)
        say = fly.velocity(client, north, down)
        client.fly(0.3, say)
        client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
        return fly.most(of, client, 4.0, say)

    return measured


def landed_s(client: Client) -> float:
    fly.hover(client, 3.0)
    client.command(mavlink.MAV_CMD_NAV_LAND)
    fly.wait(client, fly.has_sent("Landing detected"), 30.0)
    return fly.wait(client, fly.disarmed, 10.0)


def silent_companion(client: Client) -> None:
    fly.hover(client, 5.0)
    say = fly.velocity(client)
    client.fly(0.3, say)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    client.fly(1.0, say)


def companion_lost_s(client: Client) -> float:
    silent_companion(client)
    return fly.wait(client, fly.in_mode("AUTO_RTL"), 10.0)


def companion_lost(client: Client) -> str:
    silent_companion(client)
    client.fly(2.0)
    return client.vehicle.condition().mode


def joystick_lost(client: Client) -> None:
    fly.hover(client, 5.0)
    client.fly(0.5, fly.joystick(client))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 3)
    client.fly(1.0, fly.joystick(client))


def joystick_lost_s(client: Client) -> float:
    joystick_lost(client)
    return fly.wait(client, fly.in_mode("AUTO_LOITER"), 10.0)


def joystick_lost_mode(client: Client) -> str:
    joystick_lost(client)
    client.fly(8.0)
    return client.vehicle.condition().mode


def holding_s(client: Client) -> float:
    joystick_lost(client)
    fly.wait(client, fly.in_mode("AUTO_LOITER"), 10.0)
    return fly.wait(client, fly.in_mode("AUTO_RTL"), 20.0)


def battery_text_s(text: str) -> Measure:
    """From arming to a text, with a battery of 10 s."""

    def measured(client: Client) -> float:
        assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        return fly.wait(client, fly.has_sent(text), 15.0)

    return measured


TO_THE_END = (("SIM_BAT_MIN_PCT", 0.0), ("COM_DISARM_PRFLT", 0.0))
DRAIN = (("SIM_BAT_DRAIN", 10.0), *TO_THE_END)
QUICK_DRAIN = (("SIM_BAT_DRAIN", 20.0), *TO_THE_END)
CRITICAL = (*DRAIN, ("BAT_LOW_THR", 0.5), ("COM_LOW_BAT_ACT", 0.0))


def returning_s(client: Client) -> float:
    """How long a return to the place below takes to the ground."""
    fly.hover(client, 2.5)
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    return fly.wait(client, lambda flown: flown.vehicle.condition().landed, 40.0)


def waiting_height(client: Client) -> float:
    """Where a return waits before it lands."""
    fly.hover(client, 12.0)
    assert client.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [0]
    client.fly(8.0)
    return fly.up_m(client)


def offboard_step(of: Callable[[Client], float]) -> Measure:
    """The greatest of a step of 15 m."""

    def measured(client: Client) -> float:
        fly.hover(client, 5.0)
        client.offboard(0.0, 0.0, -5.0)
        return fly.most(of, client, 6.0, lambda: client.setpoint(15.0, 0.0, -5.0))

    return measured


def north_m(client: Client) -> float:
    return client.vehicle.truth().position_enu_m[1]


def flat_battery(client: Client) -> str:
    fly.hover(client, 5.0)
    fly.wait(client, fly.in_mode("AUTO_LAND"), 20.0)
    return client.vehicle.condition().mode


def half_volts(client: Client) -> float:
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    client.fly(5.0)
    return volts(client)


def volts(client: Client) -> float:
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    return float(client.last("SYS_STATUS").voltage_battery) / 1000.0


def wide_orbit(client: Client) -> float:
    fly.hover(client, 5.0)
    client.command_int(mavlink.MAV_CMD_DO_ORBIT, 3, 50.0, 3.0, 0, 0, CURRENT_PLACE, CURRENT_PLACE, NAN)
    return float(fly.has_sent("Orbit radius limit exceeded")(client))


def nose_deg(client: Client) -> float:
    """Which way it looks after going 15 m east."""
    fly.hover(client, 5.0)
    fly.go(client, 15, 0, 5)
    client.fly(8.0)
    return math.degrees(client.vehicle.truth().yaw_rad)


def leader(client: Client, north_mps: float, begins_m: float = 0.0) -> Callable[[], None]:
    def say() -> None:
        time = client.vehicle.time
        place = client.vehicle_goal(0.0, begins_m + north_mps * time.s)
        still, velocity_ned = (0, 0, 0), (north_mps, 0.0, 0.0)
        message = mavlink.MAVLink_follow_target_message
        client.send(
            message(
                time.ns // 1_000_000, 3, *place, 488.0, velocity_ned, still, (1, 0, 0, 0), still, still, 0
            )
        )

    return say


def following(client: Client, say: Callable[[], None]) -> None:
    fly.hover(client, 10.0)
    client.fly(0.5, say)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 8)


def follow(client: Client) -> tuple[float, float, float]:
    """East, north and up of the leader, after walking north at 1 m/s."""
    say = leader(client, 1.0)
    following(client, say)
    client.fly(12.0, say)
    east, north, up = client.vehicle.truth().position_enu_m
    return east, north - client.vehicle.time.s, up


def follow_speed(client: Client) -> float:
    say = leader(client, 0.0, 60.0)
    following(client, say)
    return fly.most(fly.speed_mps, client, 9.0, say)


POSITION, ALTITUDE = (3,), (2,)
PX4 = (
    Effect("MPC_TKO_SPEED", (1.5, 3.0), rising, (1.5, 3.0)),
    Effect("MPC_Z_V_AUTO_UP", (1.0, 3.0), fly.climbing, (1.0, 3.0)),
    Effect("MPC_Z_V_AUTO_DN", (0.7, 2.0), fly.sinking, (0.7, 2.0)),
    # It creeps to them, because drag is learned.
    Effect("MPC_XY_VEL_MAX", (4.0, 8.0), offboard_velocity(fly.speed_mps, 0.0, 5.0, north=20.0), (3.8, 7.6)),
    Effect("MPC_XY_CRUISE", (4.0, 8.0), returning_speed, (4.0, 7.7), beside=(("RTL_RETURN_ALT", 5.0),)),
    Effect("MPC_Z_VEL_MAX_UP", (1.0, 3.0), offboard_velocity(fly.up_mps, -6.0, 5.0), (1.0, 3.0)),
    Effect("MPC_Z_VEL_MAX_DN", (0.7, 1.5), offboard_velocity(fly.sink_mps, 6.0, 20.0), (0.7, 1.5)),
    Effect("MPC_ACC_HOR", (2.0, 5.0), fly.speed_after(2.0), (3.1, 4.5), 0.2),
    Effect("MPC_JERK_AUTO", (2.0, 8.0), fly.speed_after(1.5), (1.7, 3.4), 0.2),
    Effect("MPC_ACC_UP_MAX", (2.0, 6.0), fly.climbing_s, (4.9, 6.8), 0.4),
    Effect("MPC_TKO_RAMP_T", (1.0, 3.0), takeoff_begins_s, (1.9, 2.5), 0.2),
    Effect("MPC_LAND_SPEED", (0.5, 1.0), fly.touching, (0.5, 1.0), 0.15),
    Effect("MPC_LAND_ALT1", (10.0, 20.0), landing_at(10.0), (1.5, 0.97), 0.15),
    Effect("MPC_LAND_ALT2", (5.0, 9.0), landing_at(7.5, 12.0), (1.1, 0.7), 0.15),
    Effect("COM_DISARM_LAND", (1.0, 4.0), landed_s, (1.0, 4.0)),
    Effect("COM_DISARM_PRFLT", (3.0, 10.0), fly.idling_s, (3.0, 10.0)),
    Effect("COM_OF_LOSS_T", (1.0, 3.0), companion_lost_s, (1.0, 3.0)),
    Effect("COM_OBL_RC_ACT", (0.0, 4.0), companion_lost, ("AUTO_RTL", "AUTO_LAND")),
    Effect(
        "COM_DL_LOSS_T",
        (5.0, 8.0),
        fly.station_lost_s("AUTO_RTL"),
        (11.8, 14.8),
        beside=(("NAV_DLL_ACT", 2.0),),
    ),
    Effect(
        "NAV_DLL_ACT",
        (0.0, 2.0),
        fly.station_lost(12.5),
        ("AUTO_LOITER", "AUTO_RTL"),
        beside=(("COM_DL_LOSS_T", 5.0),),
    ),
    Effect("COM_RC_LOSS_T", (0.5, 2.0), joystick_lost_s, (0.5, 2.0)),
    Effect("NAV_RCL_ACT", (2.0, 3.0), joystick_lost_mode, ("AUTO_RTL", "AUTO_LAND")),
    Effect("COM_FAIL_ACT_T", (2.0, 5.0), holding_s, (2.0, 5.0)),
    Effect("BAT_LOW_THR", (0.5, 0.8), battery_text_s("Low battery"), (5.0, 2.0), beside=DRAIN),
    Effect("BAT_CRIT_THR", (0.1, 0.4), battery_text_s("Critical battery"), (9.0, 6.0), beside=CRITICAL),
    Effect("BAT_EMERGEN_THR", (0.05, 0.06), battery_text_s("Emergency"), (9.5, 9.4), 0.15, beside=DRAIN),
    Effect("COM_LOW_BAT_ACT", (0.0, 2.0), flat_battery, ("AUTO_LOITER", "AUTO_LAND"), beside=QUICK_DRAIN),
    Effect("BAT1_N_CELLS", (4.0, 6.0), volts, (16.2, 24.3), beside=DRAIN),
    Effect("BAT1_V_CHARGED", (4.05, 4.2), volts, (16.2, 16.8), beside=DRAIN),
    Effect("BAT1_V_EMPTY", (3.6, 3.2), half_volts, (15.3, 14.5), 0.1, beside=DRAIN),
    Effect("MPC_XY_P", (0.95, 0.5), offboard_step(fly.speed_mps), (9.0, 5.7)),
    Effect("MPC_XY_VEL_P_ACC", (1.8, 3.0), offboard_step(fly.speed_mps), (9.0, 10.5)),
    Effect("MPC_XY_VEL_I_ACC", (0.4, 2.0), offboard_step(north_m), (15.8, 16.2), 0.1),
    Effect("MC_ORBIT_RAD_MAX", (1000.0, 30.0), wide_orbit, (0.0, 1.0)),
    Effect("MPC_YAW_MODE", (0.0, 3.0), nose_deg, (90.0, 0.0), 5.0),
    Effect("NAV_ACC_RAD", (2.0, 30.0), nose_deg, (90.0, 0.0), 5.0),
    Effect("RTL_RETURN_ALT", (15.0, 25.0), fly.returning_height(12.0), (15.0, 25.0), 0.5),
    Effect(
        "RTL_DESCEND_ALT", (10.0, 6.0), waiting_height, (10.0, 6.0), 0.5, beside=(("RTL_LAND_DELAY", 60.0),)
    ),
    Effect("RTL_LAND_DELAY", (0.0, 4.0), returning_s, (4.6, 8.6), 0.7),
    Effect(
        "RTL_MIN_DIST",
        (2.0, 20.0),
        fly.returning_height(10.0),
        (20.0, 10.0),
        0.7,
        beside=(("RTL_RETURN_ALT", 20.0),),
    ),
    Effect(
        "MPC_MAN_TILT_MAX", (15.0, 30.0), fly.sticks(ALTITUDE, fly.tilt_deg, ahead=1000), (15.0, 30.0), 2.5
    ),
    Effect("MPC_MAN_Y_MAX", (20.0, 40.0), fly.sticks(POSITION, fly.turn_radps, turn=1000), (0.35, 0.7), 0.06),
    Effect("MPC_VEL_MANUAL", (3.0, 6.0), fly.sticks(POSITION, fly.speed_mps, ahead=1000), (3.0, 6.0), 0.5),
    Effect("FLW_TGT_HT", (8.0, 15.0), lambda client: follow(client)[2], (8.0, 15.0), 0.5),
    Effect("FLW_TGT_DST", (8.0, 15.0), lambda client: math.hypot(*follow(client)[:2]), (8.0, 15.0), 1.5),
    Effect("FLW_TGT_FA", (180.0, 90.0), lambda client: follow(client)[0], (0.0, 8.0), 1.5),
    Effect("FLW_TGT_MAX_VEL", (3.0, 8.0), follow_speed, (3.0, 8.0), 1.5),
)
