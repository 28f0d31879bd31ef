"""MAVSDK 4 on PX4, the synchronous API: python mavsdk_flight.py udpin://127.0.0.1:14540 CHAPTER...

Flies all parameters, takeoff, `goto_location`, `do_orbit`, RTL, land; offboard velocities, positions (local,
global, with a velocity), acceleration, attitude, rates; logs; a mission with speeds, a pause and a return; raw items,
rally points; a fence and its action; sticks; follow-me; gimbal, camera; the fixed wing.
Is refused: arming during the start, disarming in the air, unknown and mistyped parameters, offboard and position
control without input, unknown commands and frames in a plan, mission mode without a mission, a fence with two
corners, a gimbal without control, video.
"""

from __future__ import annotations

import math
import os
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

from logbook import apart, distance_m, place, run_chapters, wait_until
from mavsdk import ComponentType, Configuration, Mavsdk, System
from mavsdk.plugins.action import Action
from mavsdk.plugins.action.action import OrbitYawBehavior
from mavsdk.plugins.camera import Camera
from mavsdk.plugins.follow_me import FollowMe
from mavsdk.plugins.follow_me.follow_me import Config, TargetLocation
from mavsdk.plugins.geofence import Geofence
from mavsdk.plugins.geofence.geofence import Circle, FenceType, GeofenceData, Point, Polygon
from mavsdk.plugins.gimbal import Gimbal
from mavsdk.plugins.gimbal.gimbal import ControlMode, GimbalMode, SendMode
from mavsdk.plugins.info import Info
from mavsdk.plugins.log_files import LogFiles
from mavsdk.plugins.manual_control import ManualControl
from mavsdk.plugins.mission import Mission
from mavsdk.plugins.mission.mission import MissionItem, MissionPlan
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.mission_raw.mission_raw import MissionItem as RawItem
from mavsdk.plugins.offboard import Offboard
from mavsdk.plugins.offboard.offboard import (
    AccelerationNed,
    Attitude,
    AttitudeRate,
    PositionGlobalYaw,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

HEIGHT_M = 10.0
CAMERA = 100
GLOBAL_RELATIVE_INT, MISSION_FRAME, GLOBAL_FRAME_1 = 6, 2, 1


def outcome(call: Callable[..., Any], *arguments: Any) -> str:
    """How a call ended: the name of its result, of an exception too."""
    try:
        call(*arguments)
    except Exception as error:
        result = getattr(error, "result", None)
        return result.name if result is not None else repr(error)
    return "SUCCESS"


def raw_item(
    seq: int, command: int, north_m: float = 0.0, frame: int = GLOBAL_RELATIVE_INT, **given: float
) -> RawItem:
    """A raw mission item, so far north of the default home."""
    latitude, longitude = place(47.3977, 8.5456, north_m, 0.0)
    params = {"param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": math.nan}
    fields: dict[str, Any] = {**params, "z": HEIGHT_M, **given}
    return RawItem(
        seq=seq, frame=frame, command=command, current=int(seq == 0), autocontinue=1,
        x=round(latitude * 1e7), y=round(longitude * 1e7), mission_type=0, **fields,
    )  # fmt: skip


class Flight:
    def __init__(self, system: System) -> None:
        self.system = system
        self.action, self.telemetry, self.param = Action(system), Telemetry(system), Param(system)
        self.offboard = Offboard(system)
        self.modes: list[str] = []

    def here(self) -> tuple[float, float]:
        position = self.telemetry.position()
        return position.latitude_deg, position.longitude_deg

    def height_m(self) -> float:
        return float(self.telemetry.position().relative_altitude_m)

    def mode(self) -> str:
        return str(self.telemetry.flight_mode().name)

    def ready(self) -> tuple[float, float]:
        """Where it stands, once it may be armed."""
        wait_until("a vehicle that is healthy", self.telemetry.health_all_ok)
        return self.here()

    def up(self) -> tuple[float, float]:
        """Where it took off, once it hangs above."""
        start = self.ready()
        self.action.set_takeoff_altitude(HEIGHT_M)
        self.action.set_return_to_launch_altitude(HEIGHT_M)
        self.action.arm()
        self.action.takeoff()
        wait_until("takeoff", lambda: self.mode() == "HOLD" and self.height_m() > HEIGHT_M - 0.5)
        return start

    def down(self) -> None:
        wait_until("disarming", lambda: not self.telemetry.armed())

    def early(self) -> dict[str, Any]:
        """Arming before it is ready."""
        return {"arm": outcome(self.action.arm)}

    def parameters(self) -> dict[str, Any]:
        listed = self.param.get_all_params()
        before = self.param.get_param_float("MPC_XY_VEL_MAX")
        self.param.set_param_float("MPC_XY_VEL_MAX", 9.5)
        Info(self.system).get_version()  # an error when none comes
        return {
            "listed": len(listed.int_params) + len(listed.float_params),
            "before": before,
            "after": self.param.get_param_float("MPC_XY_VEL_MAX"),
            "restored": outcome(self.param.set_param_float, "MPC_XY_VEL_MAX", before),
            "unknown": outcome(self.param.get_param_float, "NO_SUCH_PARAM"),
            "unknown_set": outcome(self.param.set_param_int, "NO_SUCH_PARAM", 1),
            "wrong_type": outcome(self.param.get_param_int, "MPC_XY_VEL_MAX"),
        }

    def hop(self) -> dict[str, Any]:
        """Take off, try to disarm, land."""
        start = self.up()
        disarm = outcome(self.action.disarm)
        self.action.land()
        self.down()
        return {"disarm_in_air": disarm, "from_start_m": distance_m(start, self.here())}

    def logs(self) -> dict[str, Any]:
        """Ask for the list of logs, and find none."""
        return {"listed": outcome(LogFiles(self.system).get_entries)}

    def travel(self) -> dict[str, Any]:
        """A place, an orbit, and back by return to launch."""
        start = self.up()
        altitude_m = self.telemetry.position().absolute_altitude_m
        target = place(*start, 25.0, 15.0)
        self.action.goto_location(*target, altitude_m, math.nan)
        wait_until("the place", lambda: distance_m(self.here(), target) < 0.7)
        reached = apart(start, self.here())
        self.action.do_orbit(12.0, 4.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *target, altitude_m)
        wait_until("the circle", lambda: distance_m(self.here(), target) > 11.0)
        radii, quarters = [], set()
        end = time.monotonic() + 20.0
        while len(quarters) < 4 and time.monotonic() < end:
            north, east = apart(target, self.here())
            radii.append(math.hypot(north, east))
            quarters.add((north > 0.0, east > 0.0))
            time.sleep(0.02)
        self.action.hold()
        self.action.return_to_launch()
        wait_until("return", lambda: self.mode() == "RETURN_TO_LAUNCH")
        self.down()
        radii_m = [min(radii), max(radii)]
        return {"reached": reached, "radii_m": radii_m, "from_start_m": distance_m(start, self.here())}

    def setpoints(self) -> dict[str, Any]:
        """Offboard: refused without a setpoint, a velocity, a position, and out of it again."""
        start = self.up()
        unfed = outcome(self.offboard.start)
        self.offboard.set_velocity_ned(VelocityNedYaw(2.0, 0.0, 0.0, 0.0))
        self.offboard.start()
        wait_until("offboard", lambda: self.mode() == "OFFBOARD")
        wait_until("the speed", lambda: self.telemetry.velocity_ned().north_m_s > 1.7)
        self.offboard.set_position_ned(PositionNedYaw(10.0, -10.0, -12.0, 90.0))
        wait_until("the position", lambda: math.dist(apart(start, self.here()), (10.0, -10.0)) < 1.0)
        wait_until("the height", lambda: abs(self.height_m() - 12.0) < 0.5)
        wait_until("the heading", lambda: abs(self.telemetry.heading().heading_deg - 90.0) < 5.0)
        self.offboard.stop()
        wait_until("hold", lambda: self.mode() == "HOLD")
        self.action.land()
        self.down()
        return {"unfed": unfed, "landed_at": apart(start, self.here())}

    def every_setpoint(self) -> dict[str, Any]:
        """One kind of setpoint after the other, each until it shows."""
        start, offboard = self.up(), self.offboard
        hover = 0.59  # the share of all thrust that holds this airframe
        offboard.set_velocity_body(VelocityBodyYawspeed(2.0, 0.0, 0.0, 0.0))
        offboard.start()
        wait_until("a body velocity", lambda: self.telemetry.velocity_ned().north_m_s > 1.5)
        offboard.set_attitude(Attitude(0.0, -8.0, 0.0, hover))
        wait_until("a pitch", lambda: self.telemetry.attitude_euler().pitch_deg < -6.5)
        offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, 0.0, 0.0))
        wait_until("standing still", lambda: abs(self.telemetry.velocity_ned().north_m_s) < 0.3)
        offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 30.0, hover))
        wait_until("a turn", lambda: self.telemetry.attitude_angular_velocity_body().yaw_rad_s > 0.4)
        offboard.set_acceleration_ned(AccelerationNed(0.0, 1.0, 0.0))
        wait_until("a push", lambda: self.telemetry.velocity_ned().east_m_s > 1.0)
        offboard.set_position_velocity_ned(
            PositionNedYaw(5.0, 5.0, -HEIGHT_M, 0.0), VelocityNedYaw(0.0, 0.0, 0.0, 0.0)
        )
        wait_until(
            "a position with a velocity", lambda: math.dist(apart(start, self.here()), (5.0, 5.0)) < 1.0
        )
        target = place(*start, -5.0, 5.0)
        above_home = PositionGlobalYaw.AltitudeType.REL_HOME
        offboard.set_position_global(PositionGlobalYaw(*target, HEIGHT_M, 0.0, above_home))
        wait_until("a global position", lambda: distance_m(self.here(), target) < 1.0)
        offboard.stop()
        self.action.return_to_launch()
        self.down()
        return {"from_start_m": distance_m(start, self.here())}

    def sticks(self) -> dict[str, Any]:
        """A joystick: without one position control is refused in the air; with it, forward goes forward."""
        manual, start = ManualControl(self.system), self.up()
        unheld = outcome(manual.start_position_control)

        def push(forward: float) -> None:
            manual.set_manual_control_input(forward, 0.0, 0.5, 0.0)

        wait_until(
            "sticks that are heard", lambda: push(0.0) or outcome(manual.start_position_control) == "SUCCESS"
        )
        wait_until("position control", lambda: push(0.0) or self.mode() == "POSCTL")
        wait_until("ten metres", lambda: push(0.6) or apart(start, self.here())[0] > 10.0)
        moved = apart(start, self.here())
        self.action.return_to_launch()
        self.down()
        return {"unheld": unheld, "moved": moved, "from_start_m": distance_m(start, self.here())}

    def follow(self) -> dict[str, Any]:
        """A leader who walks north, followed from behind."""
        leader, start = FollowMe(self.system), self.up()
        leader.set_config(Config(8.0, 8.0, 0.1, Config.FollowAltitudeMode.CONSTANT, 8.0, 180.0))
        altitude_m = self.telemetry.home().absolute_altitude_m
        north_m = 0.0

        def walk() -> None:
            nonlocal north_m
            north_m += 0.05
            leader.set_target_location(
                TargetLocation(*place(*start, north_m, 0.0), altitude_m, 1.0, 0.0, 0.0)
            )

        leader.start()
        wait_until("following", leader.is_active)
        wait_until("twelve metres", lambda: walk() or apart(start, self.here())[0] > 12.0)
        behind_m = north_m - apart(start, self.here())[0]
        leader.stop()
        self.action.return_to_launch()
        self.down()
        return {"behind_m": behind_m, "from_start_m": distance_m(start, self.here())}

    def wing(self) -> dict[str, Any]:
        """A fixed wing: takeoff, one place that it circles, the return."""
        start = self.ready()
        self.action.set_takeoff_altitude(40.0)
        self.action.arm()
        self.action.takeoff()
        wait_until("takeoff", lambda: self.height_m() > 35.0)
        target = place(*start, 300.0, 0.0)
        self.action.goto_location(*target, self.telemetry.home().absolute_altitude_m + 50.0, math.nan)
        wait_until("the circle", lambda: distance_m(self.here(), target) < 90.0)
        airspeed_mps = self.telemetry.fixedwing_metrics().airspeed_m_s
        self.action.return_to_launch()
        wait_until("the circle above home", lambda: distance_m(self.here(), start) < 90.0)
        self.param.set_param_float("RTL_LAND_DELAY", 5.0)  # -1, a fixed wing's default, circles on
        self.action.hold()
        self.action.return_to_launch()
        self.down()
        return {"airspeed_mps": airspeed_mps, "from_start_m": distance_m(start, self.here())}

    def plan(self) -> dict[str, Any]:
        """A mission with two speeds, paused on the way, with a return after it."""
        mission, start = Mission(self.system), self.ready()
        items = [
            MissionItem(*place(*start, north, east), HEIGHT_M, speed, True)
            for north, east, speed in ((20.0, 0.0, 3.0), (20.0, 30.0, 6.0), (0.0, 30.0, math.nan))
        ]
        mission.set_return_to_launch_after_mission(True)
        mission.upload_mission(MissionPlan(items))
        downloaded = len(mission.download_mission().mission_items)
        self.action.set_return_to_launch_altitude(HEIGHT_M)
        self.action.arm()
        mission.start_mission()
        speeds: dict[int, list[float]] = {}

        def flying_item() -> int:
            velocity, current = self.telemetry.velocity_ned(), int(mission.mission_progress().current)
            if self.mode() == "MISSION":
                speeds.setdefault(current, []).append(math.hypot(velocity.north_m_s, velocity.east_m_s))
            return current

        wait_until("the second item", lambda: flying_item() == 1)
        wait_until(
            "half of the second leg", lambda: flying_item() == 1 and apart(start, self.here())[1] > 15.0
        )
        mission.pause_mission()
        wait_until("the pause", lambda: self.mode() == "HOLD")
        mission.start_mission()
        wait_until("return to launch", lambda: flying_item() < 9 and self.mode() == "RETURN_TO_LAUNCH")
        finished = mission.is_mission_finished()
        self.down()
        return {
            "downloaded": downloaded, "finished": finished,
            "speeds_mps": [statistics.median(speeds[1]), max(speeds[2])],
            "from_start_m": distance_m(start, self.here()), "cleared": outcome(mission.clear_mission),
        }  # fmt: skip

    def raw(self) -> dict[str, Any]:
        """Raw items: what is refused at upload, what comes back, and a mission that cannot start."""
        raw, mission = MissionRaw(self.system), Mission(self.system)
        accepted = [raw_item(0, 22), raw_item(1, 16, north_m=20.0), raw_item(2, 20, frame=MISSION_FRAME)]
        cleared = outcome(raw.clear_mission)
        self.ready()
        nothing = outcome(mission.start_mission)  # a mode, which PX4 grants whoever is disarmed
        unarmable = outcome(self.action.arm)
        self.action.hold()
        wait_until("hold", lambda: self.mode() == "HOLD")
        return {
            "cleared": cleared,
            "nothing_to_fly": [nothing, unarmable],
            "good": outcome(raw.upload_mission, accepted),
            "commands": [item.command for item in raw.download_mission()],
            "unknown_command": outcome(raw.upload_mission, [raw_item(0, 31999)]),
            "bad_frame": outcome(raw.upload_mission, [raw_item(0, 16, frame=GLOBAL_FRAME_1)]),
            "after_refusal": [item.command for item in raw.download_mission()],
            "rally": outcome(raw.upload_rally_points, [self.rally_point()]),
            "rally_points": len(raw.download_rallypoints()),
        }

    @staticmethod
    def rally_point() -> RawItem:
        item = raw_item(0, 5100, north_m=15.0)
        item.mission_type = 2
        return item

    def fence(self) -> dict[str, Any]:
        """A circle to stay in; flying out of it leads to the return that GF_ACTION asks for."""
        fence, start = Geofence(self.system), self.ready()
        triangle = [Point(*place(*start, north, east)) for north, east in ((80, 0), (-80, 80), (-80, -80))]
        self.param.set_param_int("GF_ACTION", 3)
        two_corners = outcome(
            fence.upload_geofence, GeofenceData([Polygon(triangle[:2], FenceType.INCLUSION)], [])
        )
        circle = Circle(Point(*start), 30.0, FenceType.INCLUSION)
        polygon = Polygon(triangle, FenceType.INCLUSION)
        uploaded = outcome(fence.upload_geofence, GeofenceData([polygon], [circle]))
        downloaded = fence.download_geofence()
        self.up()
        self.offboard.set_velocity_ned(VelocityNedYaw(0.0, 5.0, 0.0, 0.0))
        self.offboard.start()
        wait_until("the breach", lambda: self.mode() == "RETURN_TO_LAUNCH")
        breached_at_m = distance_m(start, self.here())
        self.down()
        return {
            "two_corners": two_corners, "uploaded": uploaded, "kept": [len(downloaded.polygons), len(downloaded.circles)],
            "breached_at_m": breached_at_m, "from_start_m": distance_m(start, self.here()), "cleared": outcome(fence.clear_geofence),
        }  # fmt: skip

    def payload(self) -> dict[str, Any]:
        """The gimbal and the camera, on the ground."""
        gimbal, camera = Gimbal(self.system), Camera(self.system)
        captured: list[Any] = []
        camera.subscribe_capture_info(lambda info, _: captured.append(info))
        gimbals = wait_until("a gimbal", lambda: gimbal.gimbal_list().gimbals)
        number = gimbals[0].gimbal_id
        turn = (number, 0.0, -45.0, 30.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        before = outcome(gimbal.set_angles, *turn)
        control = outcome(gimbal.take_control, number, ControlMode.PRIMARY)
        turned = outcome(gimbal.set_angles, *turn)

        def angles() -> tuple[float, float]:
            euler = gimbal.get_attitude(number).euler_angle_forward
            return euler.pitch_deg, euler.yaw_deg

        wait_until("the angles", lambda: math.dist(angles(), (-45.0, 30.0)) < 1.0, 20.0)
        cameras = wait_until("a camera", lambda: camera.camera_list().cameras)
        first = cameras[0].component_id
        photo = outcome(camera.take_photo, first)
        wait_until("the picture", lambda: captured)
        return {
            "uncontrolled": before, "control": control, "turned": turned, "angles": angles(),
            "released": outcome(gimbal.release_control, number), "camera": first,
            "vendor": cameras[0].vendor_name, "photo": photo, "pictures": [info.index for info in captured],
            "video": outcome(camera.start_video, first), "no_such_camera": outcome(camera.take_photo, 101),
        }  # fmt: skip


def main() -> None:
    url, *wanted = sys.argv[1:]
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(url)
    system = mavsdk.first_autopilot(30.0)
    if system is None:
        sys.exit(f"no autopilot on {url}")
    run_chapters(Flight(system), wanted)
    os._exit(0)  # taking MAVSDK's threads down in order takes seconds and says nothing about the vehicle


if __name__ == "__main__":
    main()
