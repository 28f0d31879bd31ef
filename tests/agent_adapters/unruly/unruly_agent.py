"""Breaks the rules that every other agent keeps, so that the measures of these rules are seen to fail in flight."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress

from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import open_bench, read_environment
from agent_adapters.null._autopilot import LINK, Autopilot
from agent_adapters.null._session import MISSION, NullSession, subscriptions

ABOVE_CEILING_M = 12.0
TOO_FAST_MPS = 5.0
# Often enough that no failsafe stays in its mode for a second.
AGAIN_S = 0.4
LOW_FROM_S, CRASH_S = 45.0, 85.0
LOW_M = 4.0
# MAV_CMD_COMPONENT_ARM_DISARM obeys in flight with this in its second parameter (PX4, ArduPilot).
FORCE = 21196.0


def steps(session: NullSession, autopilot: Autopilot) -> Iterator[None]:
    """Up through the ceiling, far out in haste, back too low, then the motors off in flight."""
    while not session.mission:
        yield
    height_m = session.mission["max_altitude_m"] + ABOVE_CEILING_M
    yield from autopilot.take_off(height_m)
    asked_s = 0.0
    while session.now_s < CRASH_S:
        if session.now_s - asked_s >= AGAIN_S:
            asked_s = session.now_s
            high = session.now_s < LOW_FROM_S
            place = (90.0, 0.0) if high else (-90.0, 0.0)
            speed_mps = session.mission["max_speed_mps"] + TOO_FAST_MPS
            autopilot.go_to(place, height_m if high else LOW_M, speed_mps, session.mission["origin"])
        yield
    while autopilot.armed:
        autopilot._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, FORCE)
        yield


def main() -> None:
    """Follow one session to its end."""
    environment = read_environment(os.environ, {LINK: "REBAR_MAVLINK"})
    with open_bench("unruly", environment, subscriptions(environment.vehicle, (MISSION,))) as bench:
        session = NullSession(environment.vehicle, bench.publish, environment.seed)
        autopilot = Autopilot(bench.links[LINK])
        flight = steps(session, autopilot)
        for moment in bench.moments("unruly"):
            session.receive(moment)
            autopilot.receive(moment)
            with suppress(StopIteration):
                next(flight)


if __name__ == "__main__":
    main()
