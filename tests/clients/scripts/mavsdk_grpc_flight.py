"""mavsdk-grpc, MAVSDK's API of version 3, on PX4: python mavsdk_grpc_flight.py udpin://127.0.0.1:14540
CHAPTER...

Flies parameters, takeoff, place, orbit, RTL, offboard, mission, fence, gimbal, camera.
Is refused: arming during the start, disarming in the air, an unknown parameter, offboard without a setpoint,
video, an unknown item.
"""

from __future__ import annotations

import asyncio
import math
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from logbook import apart, distance_m, place, run_chapters_async
from mavsdk_grpc import System
from mavsdk_grpc.action import OrbitYawBehavior
from mavsdk_grpc.geofence import Circle, FenceType, GeofenceData, Point
from mavsdk_grpc.gimbal import ControlMode, GimbalMode, SendMode
from mavsdk_grpc.mission import MissionItem, MissionPlan
from mavsdk_grpc.mission_raw import MissionItem as RawItem
from mavsdk_grpc.offboard import PositionNedYaw, VelocityNedYaw

HEIGHT_M = 8.0
PATIENCE_S = 60.0
NAN = math.nan


async def until(what: str, stream: AsyncIterator[Any], holds: Callable[[Any], bool]) -> Any:
    """The first value of a stream for which `holds` does."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            async for value in stream:
                if holds(value):
                    return value
    except TimeoutError:
        pass
    return sys.exit(f"gave up waiting {PATIENCE_S:.0f} s for {what}")


async def outcome(call: Awaitable[Any]) -> str:
    """How a call ended: the name of its result, of an exception too."""
    try:
        await call
    except Exception as error:
        result = getattr(error, "_result", None)
        return result.result.name if result is not None else repr(error)
    return "SUCCESS"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Flight:
    def __init__(self, drone: System) -> None:
        self.drone = drone

    async def here(self) -> tuple[float, float]:
        position = await anext(aiter(self.drone.telemetry.position()))
        return position.latitude_deg, position.longitude_deg

    async def mode(self, name: str) -> None:
        await until(f"mode {name}", self.drone.telemetry.flight_mode(), lambda mode: mode.name == name)

    async def travel_near(self, target: tuple[float, float], within_m: float = 0.7) -> None:
        await until(
            "the place",
            self.drone.telemetry.position(),
            lambda at: distance_m((at.latitude_deg, at.longitude_deg), target) < within_m,
        )

    async def ready(self) -> tuple[float, float]:
        await until("a vehicle that is healthy", self.drone.telemetry.health_all_ok(), bool)
        return await self.here()

    async def up(self) -> tuple[float, float]:
        start = await self.ready()
        await self.drone.action.set_takeoff_altitude(HEIGHT_M)
        await self.drone.action.set_return_to_launch_altitude(HEIGHT_M)
        await self.drone.action.arm()
        await self.drone.action.takeoff()
        await until(
            "takeoff", self.drone.telemetry.position(), lambda at: at.relative_altitude_m > HEIGHT_M - 0.5
        )
        await self.mode("HOLD")
        return start

    async def down(self, start: tuple[float, float]) -> float:
        await until("disarming", self.drone.telemetry.armed(), lambda armed: not armed)
        return distance_m(start, await self.here())

    async def early(self) -> dict[str, Any]:
        return {"arm": await outcome(self.drone.action.arm())}

    async def parameters(self) -> dict[str, Any]:
        everything = await self.drone.param.get_all_params()
        return {
            "listed": len(everything.int_params) + len(everything.float_params),
            "before": await self.drone.param.get_param_float("MPC_XY_VEL_MAX"),
            "unknown": await outcome(self.drone.param.get_param_float("NO_SUCH_PARAM")),
        }

    async def hop(self) -> dict[str, Any]:
        start = await self.up()
        refused = await outcome(self.drone.action.disarm())
        await self.drone.action.land()
        return {"disarm_in_air": refused, "from_start_m": await self.down(start)}

    async def travel(self) -> dict[str, Any]:
        start = await self.up()
        position = await anext(aiter(self.drone.telemetry.position()))
        target = place(*start, 18.0, -14.0)
        await self.drone.action.goto_location(*target, position.absolute_altitude_m, NAN)
        await self.travel_near(target)
        reached = apart(start, await self.here())
        behavior = OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER
        await self.drone.action.do_orbit(10.0, 3.0, behavior, *target, position.absolute_altitude_m)
        radii: list[float] = []
        quarters: set[tuple[bool, bool]] = set()

        def round_it(at: Any) -> bool:
            north, east = apart(target, (at.latitude_deg, at.longitude_deg))
            if math.hypot(north, east) > 9.0 or radii:
                radii.append(math.hypot(north, east))
                quarters.add((north > 0.0, east > 0.0))
            return len(quarters) == 4

        await until("the circle", self.drone.telemetry.position(), round_it)
        await self.drone.action.return_to_launch()
        return {
            "reached": reached,
            "radii_m": [min(radii), max(radii)],
            "from_start_m": await self.down(start),
        }

    async def setpoints(self) -> dict[str, Any]:
        start, offboard = await self.up(), self.drone.offboard
        unfed = await outcome(offboard.start())
        await offboard.set_velocity_ned(VelocityNedYaw(0.0, 2.0, 0.0, 0.0))
        await offboard.start()
        await self.mode("OFFBOARD")
        await until("the speed", self.drone.telemetry.velocity_ned(), lambda v: v.east_m_s > 1.7)
        await offboard.set_position_ned(PositionNedYaw(6.0, 9.0, -HEIGHT_M, 0.0))
        await self.travel_near(place(*start, 6.0, 9.0), 1.0)
        await offboard.stop()
        await self.drone.action.land()
        await until("disarming", self.drone.telemetry.armed(), lambda armed: not armed)
        return {"unfed": unfed, "landed_at": apart(start, await self.here())}

    async def plan(self) -> dict[str, Any]:
        start, mission = await self.ready(), self.drone.mission
        action, vehicle = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
        items = [
            MissionItem(
                *place(*start, north, east),
                HEIGHT_M,
                speed,
                True,
                NAN,
                NAN,
                action,
                NAN,
                NAN,
                NAN,
                NAN,
                NAN,
                vehicle,
            )
            for north, east, speed in ((15.0, 0.0, 3.0), (15.0, 25.0, 5.0))
        ]
        await mission.set_return_to_launch_after_mission(True)
        await mission.upload_mission(MissionPlan(items))
        downloaded = await mission.download_mission()
        await self.drone.action.set_return_to_launch_altitude(HEIGHT_M)
        await self.drone.action.arm()
        await mission.start_mission()
        await until(
            "progress", mission.mission_progress(), lambda progress: progress.current == progress.total
        )
        await self.mode("RETURN_TO_LAUNCH")
        finished = await mission.is_mission_finished()
        from_start_m = await self.down(start)
        bad = RawItem(0, 6, 31999, 1, 1, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, 0)
        return {
            "downloaded": len(downloaded.mission_items), "finished": finished, "from_start_m": from_start_m,
            "cleared": await outcome(mission.clear_mission()),
            "unknown_command": await outcome(self.drone.mission_raw.upload_mission([bad])),
        }  # fmt: skip

    async def fence(self) -> dict[str, Any]:
        start = await self.ready()
        circle = Circle(Point(*start), 25.0, FenceType.INCLUSION)
        await self.drone.param.set_param_int("GF_ACTION", 3)
        uploaded = await outcome(self.drone.geofence.upload_geofence(GeofenceData([], [circle])))
        await self.up()
        await self.drone.offboard.set_velocity_ned(VelocityNedYaw(-5.0, 0.0, 0.0, 0.0))
        await self.drone.offboard.start()
        await self.mode("RETURN_TO_LAUNCH")
        breached_at_m = distance_m(start, await self.here())
        return {
            "uploaded": uploaded, "breached_at_m": breached_at_m, "from_start_m": await self.down(start),
            "cleared": await outcome(self.drone.geofence.clear_geofence()),
        }  # fmt: skip

    async def payload(self) -> dict[str, Any]:
        gimbal, camera = self.drone.gimbal, self.drone.camera
        listed = await until("a gimbal", gimbal.gimbal_list(), lambda reported: reported.gimbals)
        number = listed.gimbals[0].gimbal_id
        control = await outcome(gimbal.take_control(number, ControlMode.PRIMARY))
        turned = await outcome(
            gimbal.set_angles(number, 0.0, -60.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        )
        await until(
            "the angles", gimbal.attitude(), lambda at: abs(at.euler_angle_forward.pitch_deg + 60.0) < 1.0
        )
        cameras = await until("a camera", camera.camera_list(), lambda reported: reported.cameras)
        first = cameras.cameras[0].component_id
        return {
            "control": control, "turned": turned, "camera": first, "photo": await outcome(camera.take_photo(first)),
            "video": await outcome(camera.start_video(first)),
        }  # fmt: skip


async def main() -> None:
    url, *wanted = sys.argv[1:]
    drone = System(port=free_port())
    await asyncio.wait_for(drone.connect(system_address=url), 60.0)
    await until("the vehicle", drone.core.connection_state(), lambda state: state.is_connected)
    await run_chapters_async(Flight(drone), wanted)


if __name__ == "__main__":
    asyncio.run(main())
