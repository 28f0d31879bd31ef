"""What the client programs share: patience, distances, and one JSON document on stdout.

Standard library alone.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

METRES_PER_DEGREE = 111_194.9  # of latitude on the mean sphere; the flights here are of some tens of metres
PATIENCE_S = 60.0


def wait_until(what: str, holds: Callable[[], Any], timeout_s: float = PATIENCE_S) -> Any:
    """What `holds` gives when it is first true; exits with a sentence when that is not within `timeout_s` of
    the host's clock.
    """
    end = time.monotonic() + timeout_s
    while not (value := holds()):
        if time.monotonic() > end:
            sys.exit(f"gave up waiting {timeout_s:.0f} s for {what}")
        time.sleep(0.01)
    return value


def place(latitude: float, longitude: float, north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude (degrees) of a place so far from another."""
    return (
        latitude + north_m / METRES_PER_DEGREE,
        longitude + east_m / METRES_PER_DEGREE / math.cos(math.radians(latitude)),
    )


def apart(start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    """Metres north and east from one latitude and longitude to another."""
    return (
        (end[0] - start[0]) * METRES_PER_DEGREE,
        (end[1] - start[1]) * METRES_PER_DEGREE * math.cos(math.radians(start[0])),
    )


def distance_m(start: tuple[float, float], end: tuple[float, float]) -> float:
    """Metres over ground."""
    return math.hypot(*apart(start, end))


def tell(record: Mapping[str, Any]) -> None:
    """The one document that the tests read: the last line on stdout."""
    print(json.dumps(record), flush=True)


def run_chapters(flight: object, wanted: list[str]) -> None:
    """Fly the chapters, methods of `flight`, in the order asked for, and tell what each saw."""
    record = {}
    for name in wanted:
        record[name] = getattr(flight, name)()
        print(f"{name}: {record[name]}", file=sys.stderr, flush=True)
    tell(record)


async def run_chapters_async(flight: object, wanted: list[str]) -> None:
    """The same of coroutines."""
    record = {}
    for name in wanted:
        record[name] = await getattr(flight, name)()
        print(f"{name}: {record[name]}", file=sys.stderr, flush=True)
    tell(record)
