"""Following somebody who says where they are: FOLLOW_TARGET."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .._flight import Behaviour, Flight, Target
from .._personality import ChaseLimits, Limits
from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import beyond

_HAS_POSITION, _HAS_VELOCITY = 1, 2
_LOST_AFTER_NS = 3_000_000_000
_WALKS_MPS = 0.5  # slower than this a leader has no direction
_FAR_MPS = 100.0
# By stick: half of its way means nothing, full deflection this much a second, within these bounds.
_DEAD, _CLIMB_MPS, _AWAY_MPS, _AROUND_RADPS = 0.5, 1.5, 2.0, 1.5
_LEAST_M, _MOST_M = 1.0, 100.0


class Leader:
    """Who is followed, as last heard: local metres, metres per second."""

    def __init__(self) -> None:
        self.place = (0.0, 0.0)
        self.velocity = (0.0, 0.0)
        self.heard_ns: int | None = None

    def hear(self, place: tuple[float, float], velocity: tuple[float, float] | None, now_ns: int) -> None:
        """Take a report; a velocity that is not said is made from the way since the last one."""
        if velocity is None and self.heard_ns is not None and now_ns > self.heard_ns:
            span_s = (now_ns - self.heard_ns) * 1e-9
            velocity = ((place[0] - self.place[0]) / span_s, (place[1] - self.place[1]) / span_s)
        self.place, self.heard_ns = place, now_ns
        self.velocity = velocity if velocity and math.hypot(*velocity) < _FAR_MPS else (0.0, 0.0)

    def fresh(self, now_ns: int) -> bool:
        return self.heard_ns is not None and now_ns - self.heard_ns < _LOST_AFTER_NS

    def at(self, now_ns: int) -> tuple[float, float]:
        """Where the leader is by now."""
        ago_s = (now_ns - (self.heard_ns or now_ns)) * 1e-9
        return self.place[0] + self.velocity[0] * ago_s, self.place[1] + self.velocity[1] * ago_s


class Chase:
    """At a distance and an angle from the leader's course, at a height above home, looking at the leader.

    Sticks change all three for as long as it lasts: up the height, forward the distance, right the angle, clockwise.
    """

    def __init__(self, flight: Flight, leader: Leader) -> None:
        self._leader = leader
        self._angle_rad: float | None = None
        self._higher_m = self._farther_m = self._around_rad = 0.0

    def target(self, flight: Flight, limits: Limits) -> Target:
        leader, most = self._leader, limits.chase
        north, east = leader.at(flight.time_ns)
        if math.hypot(*leader.velocity) > _WALKS_MPS:
            self._angle_rad = math.atan2(leader.velocity[1], leader.velocity[0]) + most.angle_rad
        elif self._angle_rad is None:
            self._angle_rad = math.atan2(flight.east_m - east, flight.north_m - north)
        self._adjust(flight, most)
        distance_m, angle_rad = most.distance_m + self._farther_m, self._angle_rad + self._around_rad
        away = (distance_m * math.cos(angle_rad), distance_m * math.sin(angle_rad))
        ground = flight.home.down_m if flight.home else 0.0
        return Target(
            north_east_m=(north + away[0], east + away[1]),
            down_m=ground - most.height_m - self._higher_m,
            velocity_ned_mps=(*leader.velocity, 0.0),
            yaw_rad=math.atan2(east - flight.east_m, north - flight.north_m),
            speed_max_mps=max(most.speed_mps, math.hypot(*leader.velocity) + 2.0),
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
        )

    def _adjust(self, flight: Flight, most: ChaseLimits) -> None:
        if flight.sticks is None:
            return
        sticks = flight.sticks
        up, ahead, right = (beyond(one, _DEAD) * flight.step_s for one in (sticks.throttle, sticks.pitch, sticks.roll))
        self._higher_m = _kept(self._higher_m + up * _CLIMB_MPS, most.height_m)
        self._farther_m = _kept(self._farther_m + ahead * _AWAY_MPS, most.distance_m)
        around_radps = min(_AROUND_RADPS, most.speed_mps / (most.distance_m + self._farther_m))
        self._around_rad = math.remainder(self._around_rad + right * around_radps, 2.0 * math.pi)

    def done(self, flight: Flight) -> bool:
        return False


def _kept(change_m: float, from_m: float) -> float:
    return min(max(change_m, min(_LEAST_M - from_m, 0.0)), max(_MOST_M - from_m, 0.0))


class FollowMe:
    """FOLLOW_TARGET, heard in any mode; a mode that chases flies by it. Without news it holds."""

    def __init__(self, board: ServiceContext, guidance: Guidance) -> None:
        self._board = board
        self._guidance = guidance
        self._leader = Leader()

    def handlers(self) -> Mapping[str, Handler]:
        return {"FOLLOW_TARGET": self._hear}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        flight, guidance = self._board.flight, self._guidance
        if flight.mode.behaviour is not Behaviour.CHASE:
            return
        chases, fresh = isinstance(guidance.manoeuvre, Chase), self._leader.fresh(flight.time_ns)
        if fresh and not chases:
            guidance.manoeuvre = Chase(flight, self._leader)
        elif chases and not fresh:
            guidance.manoeuvre = guidance.manoeuvres.hold(flight)

    def _hear(self, m: Any, sender: Sender) -> None:
        """A velocity alone leads nowhere."""
        nowhere = m.lat == 0 and m.lon == 0
        if not m.est_capabilities & _HAS_POSITION or nowhere or abs(m.lat) > 900_000_000 or abs(m.lon) > 1_800_000_000:
            return
        velocity = None
        if m.est_capabilities & _HAS_VELOCITY and math.isfinite(m.vel[0] + m.vel[1]):
            velocity = (m.vel[0], m.vel[1])
        place = self._board.airframe.to_local_m(m.lat * 1e-7, m.lon * 1e-7)
        self._leader.hear(place, velocity, self._board.flight.time_ns)
