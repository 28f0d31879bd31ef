"""mavsdk-grpc, MAVSDK's API of version 3, on PX4: python mavsdk_grpc_flight.py udpin://127.0.0.1:14540
CHAPTER...

Flies parameters, takeoff and landing. Is refused: arming during the start, disarming in the air, an unknown parameter. The
other chapters fly with the synchronous API (mavsdk_flight.py).
"""

from __future__ import annotations

import asyncio
import math
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

from logbook import distance_m, run_chapters_async
from mavsdk_grpc import System

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


async def main() -> None:
    url, *wanted = sys.argv[1:]
    drone = System(port=free_port())
    await asyncio.wait_for(drone.connect(system_address=url), 60.0)
    await until("the vehicle", drone.core.connection_state(), lambda state: state.is_connected)
    await run_chapters_async(Flight(drone), wanted)


if __name__ == "__main__":
    asyncio.run(main())
