"""pymavlink on ArduPilot: python pymavlink_ardupilot_flight.py tcp:127.0.0.1:5760 CHAPTER...

Flies all parameters, GUIDED places, velocities and their timeout, CONDITION_YAW, CIRCLE, a mission with speeds and
RTL, FENCE_RADIUS, gimbal, camera.
Is refused: arming and takeoff during the start, disarming in the air, unknown modes, DO_REPOSITION as
COMMAND_LONG, plans by verdict, arming in AUTO without a mission.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from logbook import apart, distance_m, place, run_chapters
from pymavlink_talk import Item, Talk, mavlink

HEIGHT_M = 8.0
STABILIZE, AUTO, GUIDED, RTL, CIRCLE = 0, 3, 4, 6, 7
VELOCITY_ONLY, POSITION_ONLY = 0xFC7, 0xFF8  # what a type_mask ignores
FENCE = 1


class Flight:
    def __init__(self, talk: Talk) -> None:
        self.talk = talk
        self.ask_for_streams()

    def ask_for_streams(self) -> None:
        self.talk.link.mav.request_data_stream_send(*self.talk.target, mavlink.MAV_DATA_STREAM_ALL, 10, 1)

    def here(self) -> tuple[float, float]:
        at = self.talk.until("a position", "GLOBAL_POSITION_INT")
        return at.lat / 1e7, at.lon / 1e7

    def item(
        self, command: int, start: tuple[float, float], north_m: float = 0.0, east_m: float = 0.0, **more: Any
    ) -> Item:
        latitude, longitude = place(*start, north_m, east_m)
        frame = more.pop("frame", mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
        return Item(
            command,
            round(latitude * 1e7),
            round(longitude * 1e7),
            more.pop("z", HEIGHT_M),
            frame=frame,
            **more,
        )

    def set_mode(self, number: int) -> list[str]:
        return self.talk.command(
            mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, number
        )

    def arm(self) -> list[str]:
        return self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def ready(self) -> tuple[float, float]:
        """Where it stands, once SYS_STATUS says that it may be armed in GUIDED."""
        self.set_mode(GUIDED)
        self.talk.mode(GUIDED)
        self.talk.until(
            "the way to GUIDED",
            "EKF_STATUS_REPORT",
            lambda message: message.flags & mavlink.EKF_POS_HORIZ_ABS,
        )
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        self.talk.until(
            "a vehicle that is ready",
            "SYS_STATUS",
            lambda status: status.onboard_control_sensors_health & bit,
        )
        return self.here()

    def up(self) -> tuple[float, float]:
        start = self.ready()
        self.arm()
        self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)
        self.talk.until(
            "takeoff", "GLOBAL_POSITION_INT", lambda at: at.relative_alt > (HEIGHT_M - 0.4) * 1000
        )
        return start

    def travel_near(self, target: tuple[float, float], within_m: float = 1.0) -> None:
        self.talk.until(
            "the place",
            "GLOBAL_POSITION_INT",
            lambda at: distance_m((at.lat / 1e7, at.lon / 1e7), target) < within_m,
        )

    def early(self) -> dict[str, Any]:
        """Started again, and arming before the vehicle is ready; a restart ends the streams."""
        restart = self.talk.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        self.ask_for_streams()
        takeoff = self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)
        arm = self.arm()
        return {"restart": restart, "arm": arm, "takeoff": takeoff, "texts": self.talk.texts}

    def parameters(self) -> dict[str, Any]:
        stored = self.talk.parameter("RTL_ALT").param_value
        return {
            "listed": self.talk.all_parameters(),
            "before": stored,
            "after": self.talk.set_parameter("RTL_ALT", 999999.0).param_value,
            "restored": self.talk.set_parameter("RTL_ALT", stored).param_value,
            "whole": self.talk.set_parameter("RTL_ALT_FINAL", 0.6).param_value,
            "unknown": self.talk.parameter("NO_SUCH_PARAM"),
        }

    def hop(self) -> dict[str, Any]:
        start = self.up()
        disarm = self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        land = self.talk.command(mavlink.MAV_CMD_NAV_LAND)
        self.talk.disarmed()
        return {"disarm_in_air": disarm, "land": land, "from_start_m": distance_m(start, self.here())}

    def travel(self) -> dict[str, Any]:
        """DO_REPOSITION, a heading, CIRCLE, refused modes and commands, RTL."""
        start = self.up()
        target = place(*start, 14.0, 14.0)
        x, y = (round(degrees * 1e7) for degrees in target)
        moved = self.talk.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, -1, 0, 0, 0, x, y, HEIGHT_M)
        as_long = self.talk.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 0, 0, 0, *target, HEIGHT_M)
        self.travel_near(target)
        reached = apart(start, self.here())
        turned = self.talk.command(mavlink.MAV_CMD_CONDITION_YAW, 90, 30, 1, 0)
        self.talk.until("the heading", "GLOBAL_POSITION_INT", lambda at: abs(at.hdg / 100 - 90) < 4)
        # CIRCLE turns about a place CIRCLE_RADIUS ahead of the nose, and sinks when the throttle is not held
        self.talk.set_parameter("CIRCLE_RADIUS", 600.0)
        self.talk.set_parameter("CIRCLE_RATE", 25.0)
        center = place(*self.here(), 0.0, 6.0)
        self.talk.feed = lambda: self.talk.link.mav.rc_channels_override_send(
            *self.talk.target, 0, 0, 1500, 0, 0, 0, 0, 0
        )
        self.talk.until("a first override", "ATTITUDE")
        circled = self.set_mode(CIRCLE)
        radii: list[float] = []
        quarters: set[tuple[bool, bool]] = set()

        def round_it(at: Any) -> bool:
            north, east = apart(center, (at.lat / 1e7, at.lon / 1e7))
            radii.append(math.hypot(north, east))
            quarters.add((north > 0.0, east > 0.0))
            return len(quarters) >= 3

        self.talk.until("most of a circle", "GLOBAL_POSITION_INT", round_it)
        self.talk.feed = None
        refused = {
            "FLIP": self.set_mode(14),
            "none": self.set_mode(99),
            "unknown_command": self.talk.command(44999),
        }
        self.set_mode(RTL)
        self.talk.disarmed()
        return {
            "moved": moved, "as_long": as_long, "reached": reached, "turned": turned, "circled": circled,
            "radii_m": [min(radii), max(radii)], "refused": refused, "from_start_m": distance_m(start, self.here()),
        }  # fmt: skip

    def setpoints(self) -> dict[str, Any]:
        start = self.up()
        self.talk.feed = lambda: self.talk.setpoint(VELOCITY_ONLY, velocity=(2.0, 0.0, 0.0))
        moving = self.talk.until("the speed", "LOCAL_POSITION_NED", lambda at: at.vx > 1.8)
        self.talk.feed = None
        self.talk.until("the lapse", "LOCAL_POSITION_NED", lambda at: math.hypot(at.vx, at.vy) < 0.2)
        self.talk.setpoint(POSITION_ONLY, position=(5.0, 6.0, -9.0))
        self.talk.until(
            "the position",
            "LOCAL_POSITION_NED",
            lambda at: math.dist((at.x, at.y, at.z), (5.0, 6.0, -9.0)) < 0.5,
        )
        self.set_mode(RTL)
        self.talk.disarmed()
        return {"speed_mps": moving.vx, "from_start_m": distance_m(start, self.here())}

    def plan(self) -> dict[str, Any]:
        """A mission with a takeoff, two speeds and a return; what is refused as it is sent up."""
        start = self.ready()
        waypoint, speed = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_DO_CHANGE_SPEED
        items = [
            self.item(waypoint, start, frame=0, z=0.0),
            self.item(mavlink.MAV_CMD_NAV_TAKEOFF, start),
            Item(speed, params=(1, 3, -1, 0), frame=0),
            self.item(waypoint, start, 20.0),
            Item(speed, params=(1, 6, -1, 0), frame=0),
            self.item(waypoint, start, 20.0, 30.0),
            Item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=0),
        ]
        refused = {
            "unknown_command": self.talk.upload([items[0], self.item(31999, start)]),
            "bad_frame": self.talk.upload([items[0], self.item(waypoint, start, frame=1)]),
            "bad_latitude": self.talk.upload([items[0], Item(waypoint, x=950_000_000, frame=3)]),
            "kept": self.talk.download(),
        }
        no_mission = [self.set_mode(AUTO), self.arm()]
        self.set_mode(GUIDED)
        uploaded, stored = self.talk.upload(items), self.talk.download()
        self.arm()
        self.set_mode(AUTO)
        started = self.talk.command(mavlink.MAV_CMD_MISSION_START)
        fastest = {3: 0.0, 5: 0.0}
        current = 0
        while current < 6:
            message = self.talk.listen()
            if message is None:
                continue
            if message.get_type() == "MISSION_CURRENT":
                current = message.seq
            elif message.get_type() == "GLOBAL_POSITION_INT" and current in fastest:
                fastest[current] = max(fastest[current], math.hypot(message.vx, message.vy) / 100)
        self.talk.disarmed()
        return {
            "uploaded": uploaded, "kept": stored, "refused": refused, "no_mission": no_mission, "started": started,
            "fastest_mps": [fastest[3], fastest[5]], "from_start_m": distance_m(start, self.here()), "cleared": self.talk.upload([]),
        }  # fmt: skip

    def fence(self) -> dict[str, Any]:
        """FENCE_RADIUS by parameters, broken by a velocity: RTL. A polygon of two corners is refused."""
        start = self.ready()
        corner = self.item(
            mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, start, params=(2, 0, 0, 0), z=0.0
        )
        two_corners = self.talk.upload([corner, corner], FENCE)
        for name, value in (
            ("FENCE_RADIUS", 30.0),
            ("FENCE_TYPE", 2.0),
            ("FENCE_ACTION", 1.0),
            ("FENCE_ENABLE", 1.0),
        ):
            self.talk.set_parameter(name, value)
        self.up()
        self.talk.feed = lambda: self.talk.setpoint(VELOCITY_ONLY, velocity=(0.0, -5.0, 0.0))
        self.talk.mode(RTL)
        self.talk.feed = None
        breached_at_m = distance_m(start, self.here())
        status = self.talk.until("the fence's status", "FENCE_STATUS", lambda message: message.breach_count)
        self.talk.disarmed()
        self.talk.set_parameter("FENCE_ENABLE", 0.0)
        return {
            "two_corners": two_corners, "breached_at_m": breached_at_m, "breach_type": status.breach_type,
            "from_start_m": distance_m(start, self.here()), "texts": self.talk.texts,
        }  # fmt: skip

    def payload(self) -> dict[str, Any]:
        self.ready()
        turned = self.talk.command(
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, -45, 20, math.nan, math.nan, 0, 0, 0
        )
        interval = self.talk.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 285, 100_000)

        def pitch_deg(message: Any) -> float:
            w, x, y, z = message.q
            return math.degrees(math.asin(2 * (w * y - z * x)))

        self.talk.until(
            "the angle", "GIMBAL_DEVICE_ATTITUDE_STATUS", lambda message: abs(pitch_deg(message) + 45) < 1.0
        )
        photo = self.talk.command(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1, 1, component=100)
        return {"turned": turned, "interval": interval, "photo": photo}


def main() -> None:
    url, *wanted = sys.argv[1:]
    run_chapters(Flight(Talk(url)), wanted)


if __name__ == "__main__":
    main()
