"""A hop with pymavlink, in real time: arm, take off, ten metres north in offboard, land.

    rebar fly --autopilot px4 &
    python examples/pymavlink_hop.py

The link is REBAR_MAVLINK, or udpin:127.0.0.1:14540.
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any

from pymavlink import mavutil

TIMEOUT_S = 30.0
POSITION_AND_YAW = 2552  # type_mask: fly the position, ignore all but the yaw
OFFBOARD_MAIN_MODE = 6


def command(link: Any, number: int, *params: float) -> int:
    """Send a COMMAND_LONG and return the last result that is acknowledged: PX4 may acknowledge twice."""
    padded = [*params, *[0.0] * (7 - len(params))]
    link.mav.command_long_send(link.target_system, link.target_component, number, 0, *padded)
    result = -1
    patience_s = 2.0
    while ack := link.recv_match(
        type="COMMAND_ACK", condition=f"COMMAND_ACK.command=={number}", blocking=True, timeout=patience_s
    ):
        result, patience_s = ack.result, 0.3
    return result


def insist(what: str, link: Any, number: int, *params: float) -> None:
    """Repeat a command once a second until it is accepted."""
    end = time.monotonic() + TIMEOUT_S
    while command(link, number, *params) != mavutil.mavlink.MAV_RESULT_ACCEPTED:
        if time.monotonic() > end:
            sys.exit(f"{what} was refused for {TIMEOUT_S:.0f} s")
        time.sleep(1.0)
    print(what, flush=True)


def fly_to(link: Any, north: float, east: float, down: float) -> None:
    """Stream a position until the vehicle says that it is there."""
    end = time.monotonic() + TIMEOUT_S
    here = (1e9, 1e9, 1e9)
    while max(abs(a - b) for a, b in zip(here, (north, east, down), strict=True)) > 0.5:
        if time.monotonic() > end:
            sys.exit("did not arrive")
        setpoint(link, north, east, down)
        message = link.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=1.0)
        if message:
            here = (message.x, message.y, message.z)
    print(f"at north {north:.0f} m", flush=True)


def setpoint(link: Any, north: float, east: float, down: float) -> None:
    frame = mavutil.mavlink.MAV_FRAME_LOCAL_NED
    target = (link.target_system, link.target_component)
    link.mav.set_position_target_local_ned_send(
        0, *target, frame, POSITION_AND_YAW, north, east, down, 0, 0, 0, 0, 0, 0, 0, 0
    )


def main() -> None:
    link = mavutil.mavlink_connection(
        os.environ.get("REBAR_MAVLINK", "udpin:127.0.0.1:14540"), source_system=245
    )
    if link.wait_heartbeat(timeout=TIMEOUT_S) is None:
        sys.exit("no heartbeat")
    insist("armed", link, mavutil.mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    nan = float("nan")
    insist("taking off", link, mavutil.mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, nan)
    link.recv_match(
        type="EXTENDED_SYS_STATE",
        condition="EXTENDED_SYS_STATE.landed_state==2",
        blocking=True,
        timeout=TIMEOUT_S,
    )
    here = link.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=TIMEOUT_S)
    setpoint(link, here.x, here.y, -4.0)
    link.mav.command_long_send(
        1, 1, mavutil.mavlink.MAV_CMD_DO_SET_MODE, 0, 1, OFFBOARD_MAIN_MODE, 0, 0, 0, 0, 0
    )
    fly_to(link, 10.0, 0.0, -4.0)
    insist("landing", link, mavutil.mavlink.MAV_CMD_NAV_LAND)
    end = time.monotonic() + TIMEOUT_S
    while link.motors_armed():
        link.wait_heartbeat(timeout=2.0)
        if time.monotonic() > end:
            sys.exit("did not land")
    print("landed", flush=True)


if __name__ == "__main__":
    main()
