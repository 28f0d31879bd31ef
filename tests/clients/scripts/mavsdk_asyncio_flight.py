"""MAVSDK 4 on PX4, the asyncio API: python mavsdk_asyncio_flight.py udpin://127.0.0.1:14540 CHAPTER...

Flies parameters, takeoff and landing. Is refused: arming during the start, disarming in the air, an unknown parameter. The
other chapters fly with the synchronous API (mavsdk_flight.py).
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from logbook import distance_m, run_chapters_async
from mavsdk import ComponentType
from mavsdk.asyncio import Configuration, Mavsdk, System
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

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
