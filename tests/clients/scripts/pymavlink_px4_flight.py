"""pymavlink on PX4: python pymavlink_px4_flight.py udpin:127.0.0.1:14540 CHAPTER...

Flies all parameters, DO_REPOSITION, DO_ORBIT, offboard and the reaction to its silence, a mission with speeds and
RTL, a fence, gimbal, camera.
Is refused: arming during the start, PARAM_ERROR, offboard without a stream, plans by verdict, a place outside the
fence, MISSION_START without a mission.
"""

from __future__ import annotations

import math
import struct
import sys
from typing import Any

from logbook import apart, distance_m, place, run_chapters
from pymavlink_talk import Item, Talk, mavlink

NAN = math.nan
HEIGHT_M = 8.0
RETURN = 4 << 16 | 5 << 24
OFFBOARD = 6 << 16
VELOCITY_ONLY, POSITION_ONLY = 0xFC7, 0xFF8  # what a type_mask ignores
FENCE = 1


class Flight:
    def __init__(self, talk: Talk) -> None:
        self.talk = talk

    def here(self) -> tuple[float, float]:
        at = self.talk.until("a position", "GLOBAL_POSITION_INT")
        return at.lat / 1e7, at.lon / 1e7

    def item(
        self, command: int, start: tuple[float, float], north_m: float = 0.0, east_m: float = 0.0, **more: Any
    ) -> Item:
        latitude, longitude = place(*start, north_m, east_m)
        return Item(command, round(latitude * 1e7), round(longitude * 1e7), more.pop("z", HEIGHT_M), **more)

    def ready(self) -> tuple[float, float]:
        """Where it stands, once SYS_STATUS says that it may be armed."""
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        self.talk.until(
            "a vehicle that is ready",
            "SYS_STATUS",
            lambda status: status.onboard_control_sensors_health & bit,
        )
        return self.here()

    def set_mode(self, custom_mode: int) -> list[str]:
        return self.talk.command(mavlink.MAV_CMD_DO_SET_MODE, 1, custom_mode >> 16 & 0xFF, custom_mode >> 24)

    def up(self) -> tuple[float, float]:
        start = self.ready()
        self.talk.set_parameter("MIS_TAKEOFF_ALT", HEIGHT_M)
        self.talk.set_parameter("RTL_RETURN_ALT", HEIGHT_M)
        self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
        self.talk.until(
            "takeoff",
            "EXTENDED_SYS_STATE",
            lambda state: state.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR,
        )
        return start

    def travel_near(self, target: tuple[float, float], within_m: float = 0.8) -> None:
        self.talk.until(
            "the place",
            "GLOBAL_POSITION_INT",
            lambda at: distance_m((at.lat / 1e7, at.lon / 1e7), target) < within_m,
        )

    def early(self) -> dict[str, Any]:
        results = self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        return {"arm": results, "texts": self.talk.texts}

    def parameters(self) -> dict[str, Any]:
        integer = struct.unpack("<i", struct.pack("<f", self.talk.parameter("GF_ACTION").param_value))[0]
        unknown = self.talk.parameter("NO_SUCH_PARAM")
        wrong = self.talk.set_parameter("GF_ACTION", 1.0)
        return {
            "listed": self.talk.all_parameters(),
            "float": self.talk.parameter("MPC_XY_VEL_MAX").param_value,
            "integer": integer,
            "unknown": [unknown.get_type(), unknown.error],
            "wrong_type": [wrong.get_type(), wrong.error],
        }

    def hop(self) -> dict[str, Any]:
        start = self.up()
        height_m = self.talk.until("a height", "GLOBAL_POSITION_INT").relative_alt / 1000
        disarm = self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        land = self.talk.command(mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, NAN, NAN, NAN)
        self.talk.disarmed()
        return {
            "height_m": height_m,
            "disarm_in_air": disarm,
            "land": land,
            "from_start_m": distance_m(start, self.here()),
        }

    def travel(self) -> dict[str, Any]:
        """DO_REPOSITION, DO_ORBIT, an unknown command, and back by the return mode."""
        start = self.up()
        target = place(*start, 14.0, 14.0)
        x, y = (round(degrees * 1e7) for degrees in target)
        altitude_m = self.talk.until("a height", "GLOBAL_POSITION_INT").alt / 1000
        moved = self.talk.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, NAN, x, y, altitude_m)
        self.travel_near(target)
        reached = apart(start, self.here())
        circled = self.talk.command_int(mavlink.MAV_CMD_DO_ORBIT, 0, 10, 4, 0, NAN, x, y, altitude_m)
        radii: list[float] = []
        quarters: set[tuple[bool, bool]] = set()

        def round_it(at: Any) -> bool:
            north, east = apart(target, (at.lat / 1e7, at.lon / 1e7))
            if math.hypot(north, east) > 9.0 or radii:
                radii.append(math.hypot(north, east))
                quarters.add((north > 0.0, east > 0.0))
            return len(quarters) == 4

        self.talk.until("the circle", "GLOBAL_POSITION_INT", round_it)
        status = self.talk.until("the orbit's status", "ORBIT_EXECUTION_STATUS")
        unknown = self.talk.command(31999)
        self.set_mode(RETURN)
        self.talk.disarmed()
        return {
            "moved": moved, "reached": reached, "circled": circled, "radii_m": [min(radii), max(radii)], "radius_m": status.radius,
            "unknown_command": unknown, "from_start_m": distance_m(start, self.here()),
        }  # fmt: skip

    def setpoints(self) -> dict[str, Any]:
        start = self.up()
        unfed = self.set_mode(OFFBOARD)
        self.talk.feed = lambda: self.talk.setpoint(VELOCITY_ONLY, velocity=(2.0, 0.0, 0.0))
        self.talk.until("a first setpoint", "ATTITUDE")
        fed = self.set_mode(OFFBOARD)
        moving = self.talk.until("the speed", "LOCAL_POSITION_NED", lambda at: at.vx > 1.8)
        self.talk.feed = lambda: self.talk.setpoint(POSITION_ONLY, position=(5.0, 6.0, -9.0))
        self.talk.until(
            "the position",
            "LOCAL_POSITION_NED",
            lambda at: math.dist((at.x, at.y, at.z), (5.0, 6.0, -9.0)) < 0.4,
        )
        self.talk.feed = None
        self.talk.mode(RETURN)  # what becomes of it one second after the last setpoint
        self.talk.disarmed()
        return {
            "unfed": unfed,
            "fed": fed,
            "speed_mps": moving.vx,
            "from_start_m": distance_m(start, self.here()),
        }

    def plan(self) -> dict[str, Any]:
        """A mission with a takeoff, two speeds and a return."""
        start = self.ready()
        waypoint, speed = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_DO_CHANGE_SPEED
        items = [
            self.item(mavlink.MAV_CMD_NAV_TAKEOFF, start),
            Item(speed, params=(1, 3, -1, 0), frame=mavlink.MAV_FRAME_MISSION),
            self.item(waypoint, start, 20.0),
            Item(speed, params=(1, 6, -1, 0), frame=mavlink.MAV_FRAME_MISSION),
            self.item(waypoint, start, 20.0, 30.0),
            Item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=mavlink.MAV_FRAME_MISSION),
        ]
        self.talk.set_parameter("RTL_RETURN_ALT", HEIGHT_M)
        uploaded, stored = self.talk.upload(items), self.talk.download()
        refused = {
            "unknown_command": self.talk.upload([self.item(31999, start)]),
            "bad_frame": self.talk.upload([self.item(waypoint, start, frame=1)]),
            "bad_type": self.talk.upload(items, mission_type=99),
        }
        self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        started = self.talk.command(mavlink.MAV_CMD_MISSION_START)
        fastest = {2: 0.0, 4: 0.0}
        current = 0

        def flown(at: Any) -> bool:
            if current in fastest:
                fastest[current] = max(fastest[current], math.hypot(at.vx, at.vy) / 100)
            return current == 4

        while current < 4:
            current = self.talk.until("the next item", "MISSION_CURRENT", lambda now: now.seq >= current).seq  # noqa: B023
            self.talk.until("a position", "GLOBAL_POSITION_INT", lambda at: flown(at) or True)
        self.talk.until("the fast leg", "GLOBAL_POSITION_INT", lambda at: flown(at) and fastest[4] > 5.0)
        self.talk.mode(RETURN)
        self.talk.disarmed()
        return {
            "uploaded": uploaded, "kept": stored, "refused": refused, "started": started, "slow_mps": fastest[2],
            "from_start_m": distance_m(start, self.here()), "cleared": self.talk.upload([]),
            "nothing_to_start": self.talk.command(mavlink.MAV_CMD_MISSION_START),
        }  # fmt: skip

    def fence(self) -> dict[str, Any]:
        """A circle to stay in; a place beyond is refused by a text, and a velocity through it ends in the
        return.
        """
        start = self.ready()
        circle = self.item(
            mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, start, params=(25, 0, 0, 0), z=0.0, frame=5
        )
        corner = self.item(
            mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, start, params=(2, 0, 0, 0), z=0.0, frame=5
        )
        two_corners = self.talk.upload([corner, corner], FENCE)
        uploaded = self.talk.upload([circle], FENCE)
        self.talk.set_parameter(
            "GF_ACTION", struct.unpack("<f", struct.pack("<i", 3))[0], mavlink.MAV_PARAM_TYPE_INT32
        )
        self.up()
        x, y = (round(degrees * 1e7) for degrees in place(*start, 60.0, 0.0))
        beyond = self.talk.command_int(mavlink.MAV_CMD_DO_REPOSITION, 0, -1, 1, 0, NAN, x, y, 496.0)
        self.talk.until("the text", "ATTITUDE", lambda _: "Reposition is outside geofence" in self.talk.texts)
        self.talk.feed = lambda: self.talk.setpoint(VELOCITY_ONLY, velocity=(0.0, -5.0, 0.0))
        self.talk.until("a first setpoint", "ATTITUDE")
        self.set_mode(OFFBOARD)
        self.talk.mode(RETURN)
        self.talk.feed = None
        breached_at_m = distance_m(start, self.here())
        self.talk.disarmed()
        return {
            "two_corners": two_corners, "uploaded": uploaded, "beyond": beyond, "breached_at_m": breached_at_m,
            "from_start_m": distance_m(start, self.here()), "cleared": self.talk.upload([], FENCE),
        }  # fmt: skip

    def payload(self) -> dict[str, Any]:
        self.ready()
        turn = (mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, -45, 20, NAN, NAN, 0, 0, 0)
        uncontrolled = self.talk.command(*turn)
        control = self.talk.command(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, 255, 190, -1, -1, 0, 0, 0)
        turned = self.talk.command(*turn)

        def pitch_deg(message: Any) -> float:
            w, x, y, z = message.q
            return math.degrees(math.asin(2 * (w * y - z * x)))

        self.talk.until(
            "the angle", "GIMBAL_DEVICE_ATTITUDE_STATUS", lambda message: abs(pitch_deg(message) + 45) < 1.0
        )
        self.talk.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 259, component=100)
        photo = self.talk.command(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1, 1, component=100)
        return {"uncontrolled": uncontrolled, "control": control, "turned": turned, "photo": photo}


def main() -> None:
    url, *wanted = sys.argv[1:]
    run_chapters(Flight(Talk(url)), wanted)


if __name__ == "__main__":
    main()
