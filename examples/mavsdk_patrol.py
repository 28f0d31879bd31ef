"""A small patrol with MAVSDK 4, in real time: an agent that knows nothing of the bench.

Against a stand-alone vehicle:

    rebar fly --autopilot px4 &
    python examples/mavsdk_patrol.py

As an agent under test it takes its link from REBAR_MAVLINK (`udpin:127.0.0.1:14540` and the like). REBAR_OPTIONS
may hold a JSON object with side_m, height_m and timeout_s.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, System
from mavsdk.plugins.action import Action
from mavsdk.plugins.telemetry import Telemetry

# Of latitude on the mean sphere; a patrol of some tens of metres asks for no more
METRES_PER_DEGREE = 111_194.9


def connection_url(given: str) -> str:
    """`udpin:HOST:PORT`, as the bench hands it over, in MAVSDK's words: `udpin://HOST:PORT`,
    `tcpout://HOST:PORT`.
    """
    if "://" in given:
        return given
    kind, host, port = given.split(":")
    return f"{ {'udpin': 'udpin', 'udpout': 'udpout', 'tcp': 'tcpout'}[kind] }://{host}:{port}"


def wait_until(what: str, holds: Callable[[], bool], timeout_s: float) -> None:
    """Return when `holds` does; exit with a sentence when it does not within `timeout_s` of the host's
    clock.
    """
    end = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() > end:
            sys.exit(f"gave up waiting: {what} within {timeout_s:.0f} s")
        time.sleep(0.05)


def corners(latitude: float, longitude: float, side_m: float) -> Iterator[tuple[float, float]]:
    """The square north-east of a place, and back to it."""
    north = side_m / METRES_PER_DEGREE
    east = north / math.cos(math.radians(latitude))
    for n, e in ((1, 0), (1, 1), (0, 1), (0, 0)):
        yield latitude + n * north, math.remainder(longitude + e * east, 360.0)


def distance_m(telemetry: Telemetry, latitude: float, longitude: float) -> float:
    here = telemetry.position()
    north = (latitude - here.latitude_deg) * METRES_PER_DEGREE
    turn = math.remainder(longitude - here.longitude_deg, 360.0)  # the date line may lie in between
    east = turn * METRES_PER_DEGREE * math.cos(math.radians(latitude))
    return math.hypot(north, east)


def patrol(system: System, side_m: float, height_m: float, timeout_s: float) -> None:
    """Arm, take off, fly the square, return, land."""
    action, telemetry = Action(system), Telemetry(system)
    wait_until("a vehicle that is healthy and armable", telemetry.health_all_ok, timeout_s)
    start = telemetry.position()
    print(f"healthy at {start.latitude_deg:.6f}, {start.longitude_deg:.6f}", flush=True)

    action.set_takeoff_altitude(height_m)
    action.set_return_to_launch_altitude(height_m)
    action.arm()
    action.takeoff()
    wait_until("take-off", lambda: telemetry.position().relative_altitude_m > height_m - 0.5, timeout_s)
    print("in the air", flush=True)

    altitude = start.absolute_altitude_m + height_m
    for number, (latitude, longitude) in enumerate(
        corners(start.latitude_deg, start.longitude_deg, side_m), start=1
    ):
        action.goto_location(latitude, longitude, altitude, math.nan)
        wait_until(f"corner {number}", lambda: distance_m(telemetry, latitude, longitude) < 1.0, timeout_s)  # noqa: B023
        print(f"corner {number}", flush=True)

    action.return_to_launch()
    wait_until("landing and disarming", lambda: not telemetry.armed(), timeout_s)
    print(
        f"landed {distance_m(telemetry, start.latitude_deg, start.longitude_deg):.2f} m from the start",
        flush=True,
    )


def main() -> None:
    options = json.loads(os.environ.get("REBAR_OPTIONS") or "{}")
    url = connection_url(os.environ.get("REBAR_MAVLINK", "udpin:127.0.0.1:14540"))
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    result = mavsdk.add_any_connection(url)
    if result != ConnectionResult.SUCCESS:
        sys.exit(f"cannot connect to {url}: {result}")
    timeout_s = float(options.get("timeout_s", 60.0))
    system = mavsdk.first_autopilot(timeout_s)
    if system is None:
        sys.exit(f"no autopilot on {url} within {timeout_s:.0f} s")
    print(f"connected over {url}", flush=True)
    patrol(system, float(options.get("side_m", 20.0)), float(options.get("height_m", 5.0)), timeout_s)


if __name__ == "__main__":
    main()
