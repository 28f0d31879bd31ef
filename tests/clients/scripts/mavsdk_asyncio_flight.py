"""MAVSDK 4 on PX4, the asyncio API: python mavsdk_asyncio_flight.py udpin://127.0.0.1:14540 CHAPTER...

Flies parameters, takeoff, place, orbit, RTL, offboard, mission, fence, gimbal.
Is refused: arming during the start, disarming in the air, an unknown parameter, offboard without a setpoint.
"""

from __future__ import annotations

import asyncio
import math
import os
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from logbook import apart, distance_m, place, run_chapters_async
from mavsdk import ComponentType
from mavsdk.asyncio import Configuration, Mavsdk, System
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.geofence import GeofenceAsync
from mavsdk.asyncio.plugins.gimbal import GimbalAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action.action import OrbitYawBehavior
from mavsdk.plugins.geofence.geofence import Circle, FenceType, GeofenceData, Point
from mavsdk.plugins.gimbal.gimbal import ControlMode, GimbalMode, SendMode
from mavsdk.plugins.mission.mission import MissionItem, MissionPlan
from mavsdk.plugins.offboard.offboard import PositionNedYaw, VelocityBodyYawspeed

HEIGHT_M = 8.0
PATIENCE_S = 60.0


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
        result = getattr(error, "result", None)
        return result.name if result is not None else repr(error)
    return "SUCCESS"


class Flight:
    def __init__(self, system: System) -> None:
        self.system = system
        self.action, self.telemetry, self.param = (
            ActionAsync(system),
            TelemetryAsync(system),
            ParamAsync(system),
        )

    async def here(self) -> tuple[float, float]:
        position = await self.telemetry.position()
        return position.latitude_deg, position.longitude_deg

    async def mode(self, name: str) -> None:
        await until(f"mode {name}", self.telemetry.subscribe_flight_mode(), lambda mode: mode.name == name)

    async def travel_near(self, target: tuple[float, float], within_m: float = 0.7) -> None:
        await until(
            "the place",
            self.telemetry.subscribe_position(),
            lambda at: distance_m((at.latitude_deg, at.longitude_deg), target) < within_m,
        )

    async def ready(self) -> tuple[float, float]:
        await until("a vehicle that is healthy", self.telemetry.subscribe_health_all_ok(), bool)
        return await self.here()

    async def up(self) -> tuple[float, float]:
        start = await self.ready()
        await self.action.set_takeoff_altitude(HEIGHT_M)
        await self.action.set_return_to_launch_altitude(HEIGHT_M)
        await self.action.arm()
        await self.action.takeoff()
        await until(
            "takeoff",
            self.telemetry.subscribe_position(),
            lambda position: position.relative_altitude_m > HEIGHT_M - 0.5,
        )
        await self.mode("HOLD")
        return start

    async def down(self, start: tuple[float, float]) -> float:
        await until("disarming", self.telemetry.subscribe_armed(), lambda armed: not armed)
        return distance_m(start, await self.here())

    async def early(self) -> dict[str, Any]:
        return {"arm": await outcome(self.action.arm())}

    async def parameters(self) -> dict[str, Any]:
        return {
            "before": await self.param.get_param_float("MPC_XY_VEL_MAX"),
            "unknown": await outcome(self.param.get_param_float("NO_SUCH_PARAM")),
        }

    async def hop(self) -> dict[str, Any]:
        start = await self.up()
        refused = await outcome(self.action.disarm())
        await self.action.land()
        return {"disarm_in_air": refused, "from_start_m": await self.down(start)}

    async def travel(self) -> dict[str, Any]:
        start = await self.up()
        altitude_m = (await self.telemetry.position()).absolute_altitude_m
        target = place(*start, -20.0, 12.0)
        await self.action.goto_location(*target, altitude_m, math.nan)
        await self.travel_near(target)
        reached = apart(start, await self.here())
        await self.action.do_orbit(
            10.0, 3.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *target, altitude_m
        )
        radii: list[float] = []
        quarters: set[tuple[bool, bool]] = set()

        def round_it(at: Any) -> bool:
            north, east = apart(target, (at.latitude_deg, at.longitude_deg))
            if math.hypot(north, east) > 9.0 or radii:
                radii.append(math.hypot(north, east))
                quarters.add((north > 0.0, east > 0.0))
            return len(quarters) == 4

        await until("the circle", self.telemetry.subscribe_position(), round_it)
        await self.action.return_to_launch()
        return {
            "reached": reached,
            "radii_m": [min(radii), max(radii)],
            "from_start_m": await self.down(start),
        }

    async def setpoints(self) -> dict[str, Any]:
        offboard, start = OffboardAsync(self.system), await self.up()
        unfed = await outcome(offboard.start())
        await offboard.set_velocity_body(VelocityBodyYawspeed(2.0, 0.0, 0.0, 0.0))
        await offboard.start()
        await self.mode("OFFBOARD")
        await until(
            "the speed",
            self.telemetry.subscribe_velocity_ned(),
            lambda v: math.hypot(v.north_m_s, v.east_m_s) > 1.7,
        )
        await offboard.set_position_ned(PositionNedYaw(-6.0, 8.0, -HEIGHT_M, 0.0))
        await self.travel_near(place(*start, -6.0, 8.0), 1.0)
        await offboard.stop()
        await self.action.land()
        await until("disarming", self.telemetry.subscribe_armed(), lambda armed: not armed)
        return {"unfed": unfed, "landed_at": apart(start, await self.here())}

    async def plan(self) -> dict[str, Any]:
        mission, start = MissionAsync(self.system), await self.ready()
        items = [
            MissionItem(*place(*start, north, east), HEIGHT_M, speed, True)
            for north, east, speed in ((15.0, 0.0, 3.0), (15.0, 25.0, 5.0))
        ]
        await mission.set_return_to_launch_after_mission(True)
        await mission.upload_mission(MissionPlan(items))
        downloaded = await mission.download_mission()
        await self.action.set_return_to_launch_altitude(HEIGHT_M)
        await self.action.arm()
        await mission.start_mission()
        await until(
            "progress",
            mission.subscribe_mission_progress(),
            lambda progress: progress.current == progress.total,
        )
        await self.mode("RETURN_TO_LAUNCH")
        finished = await mission.is_mission_finished()
        return {
            "downloaded": len(downloaded.mission_items), "finished": finished, "from_start_m": await self.down(start),
            "cleared": await outcome(mission.clear_mission()),
        }  # fmt: skip

    async def fence(self) -> dict[str, Any]:
        fence, start = GeofenceAsync(self.system), await self.ready()
        circle = Circle(Point(*start), 25.0, FenceType.INCLUSION)
        await self.param.set_param_int("GF_ACTION", 3)
        uploaded = await outcome(fence.upload_geofence(GeofenceData([], [circle])))
        offboard = OffboardAsync(self.system)
        await self.up()
        await offboard.set_velocity_body(VelocityBodyYawspeed(5.0, 0.0, 0.0, 0.0))
        await offboard.start()
        await self.mode("RETURN_TO_LAUNCH")
        breached_at_m = distance_m(start, await self.here())
        return {
            "uploaded": uploaded, "breached_at_m": breached_at_m, "from_start_m": await self.down(start),
            "cleared": await outcome(fence.clear_geofence()),
        }  # fmt: skip

    async def payload(self) -> dict[str, Any]:
        gimbal = GimbalAsync(self.system)
        listed = await until("a gimbal", gimbal.subscribe_gimbal_list(), lambda camera: camera.gimbals)
        number = listed.gimbals[0].gimbal_id
        control = await outcome(gimbal.take_control(number, ControlMode.PRIMARY))
        turned = await outcome(
            gimbal.set_angles(number, 0.0, -60.0, 0.0, GimbalMode.YAW_FOLLOW, SendMode.ONCE)
        )
        reached = await until(
            "the angles",
            gimbal.subscribe_attitude(),
            lambda at: abs(at.euler_angle_forward.pitch_deg + 60.0) < 1.0,
        )
        return {"control": control, "turned": turned, "pitch_deg": reached.euler_angle_forward.pitch_deg}


async def main() -> None:
    url, *wanted = sys.argv[1:]
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    await mavsdk.add_any_connection(url)
    system = await mavsdk.first_autopilot(30.0)
    if system is None:
        sys.exit(f"no autopilot on {url}")
    await run_chapters_async(Flight(system), wanted)
    os._exit(0)  # taking MAVSDK's threads down in order takes seconds and says nothing about the vehicle


if __name__ == "__main__":
    asyncio.run(main())
