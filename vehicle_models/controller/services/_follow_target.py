"""Following a leader that reports its position by FOLLOW_TARGET."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import Manoeuvre
from ..guidance._sticks import beyond_dead_zone
from ..state._flight_limits import FlightLimits, FollowTargetLimits
from ..state._flight_state import Behaviour, FlightState, FlightTarget, NorthEast
from ..state._service import MessageHandler, MessageSender
from ..state._service_context import ServiceContext

# Looked up once, because every step compares with it.
_FOLLOW_TARGET = Behaviour.FOLLOW_TARGET
# FOLLOW_TARGET.est_capabilities
_HAS_POSITION, _HAS_VELOCITY = 1, 2
_LOST_AFTER_NS = 3_000_000_000
# A slower leader has no course.
_MIN_COURSE_MPS = 0.5
# A faster one is a client's error.
_MAX_LEADER_MPS = 100.0
# Sticks: half of their travel has no effect; full deflection changes this much a second, within these bounds.
_DEAD_ZONE, _CLIMB_MPS, _DISTANCE_MPS, _AROUND_RADPS = 0.5, 1.5, 2.0, 1.5
_MIN_DISTANCE_M, _MAX_DISTANCE_M = 1.0, 100.0


class LeaderTrack:
    """The leader as last reported: local metres, metres per second."""

    def __init__(self) -> None:
        self.place: NorthEast = (0.0, 0.0)
        self.velocity: NorthEast = (0.0, 0.0)
        self.reported_ns: int | None = None

    def update(self, place: NorthEast, velocity: NorthEast | None, now_ns: int) -> None:
        """Take a report; a missing velocity is the distance from the last report over its age."""
        if velocity is None and self.reported_ns is not None and now_ns > self.reported_ns:
            span_s = (now_ns - self.reported_ns) * 1e-9
            velocity = ((place[0] - self.place[0]) / span_s, (place[1] - self.place[1]) / span_s)
        self.place, self.reported_ns = place, now_ns
        self.velocity = velocity if velocity and math.hypot(*velocity) < _MAX_LEADER_MPS else (0.0, 0.0)

    def fresh(self, now_ns: int) -> bool:
        return self.reported_ns is not None and now_ns - self.reported_ns < _LOST_AFTER_NS

    def predicted(self, now_ns: int) -> NorthEast:
        """Where the leader is by now."""
        age_s = (now_ns - (self.reported_ns or now_ns)) * 1e-9
        return self.place[0] + self.velocity[0] * age_s, self.place[1] + self.velocity[1] * age_s


class FollowTarget(Manoeuvre):
    """Fly at a distance and an angle from the leader's course, at a height above home, looking at the leader.

    Sticks change all three while it lasts: up the height, forward the distance, right the angle, clockwise.
    """

    def __init__(self, flight: FlightState, leader: LeaderTrack) -> None:
        self._leader = leader
        self._angle_rad: float | None = None
        self._height_change_m = self._distance_change_m = self._angle_change_rad = 0.0

    def target(self, flight: FlightState, limits: FlightLimits) -> FlightTarget:
        leader, follow = self._leader, limits.follow_target
        north, east = leader.predicted(flight.time_ns)
        if math.hypot(*leader.velocity) > _MIN_COURSE_MPS:
            self._angle_rad = math.atan2(leader.velocity[1], leader.velocity[0]) + follow.angle_rad
        elif self._angle_rad is None:
            self._angle_rad = math.atan2(flight.east_m - east, flight.north_m - north)
        self._adjust(flight, follow)
        distance_m = follow.distance_m + self._distance_change_m
        angle_rad = self._angle_rad + self._angle_change_rad
        offset = (distance_m * math.cos(angle_rad), distance_m * math.sin(angle_rad))
        ground = flight.home.down_m if flight.home else 0.0
        return FlightTarget(
            north_east_m=(north + offset[0], east + offset[1]),
            down_m=ground - follow.height_m - self._height_change_m,
            velocity_ned_mps=(*leader.velocity, 0.0),
            yaw_rad=math.atan2(east - flight.east_m, north - flight.north_m),
            speed_max_mps=max(follow.speed_mps, math.hypot(*leader.velocity) + 2.0),
            climb_max_mps=limits.climb_mps,
            descent_max_mps=limits.descent_mps,
        )

    def _adjust(self, flight: FlightState, follow: FollowTargetLimits) -> None:
        if flight.sticks is None:
            return
        sticks = (flight.sticks.throttle, flight.sticks.pitch, flight.sticks.roll)
        up, forward, right = (beyond_dead_zone(stick, _DEAD_ZONE) * flight.step_s for stick in sticks)
        self._height_change_m = _bounded(self._height_change_m + up * _CLIMB_MPS, follow.height_m)
        change_m = self._distance_change_m + forward * _DISTANCE_MPS
        self._distance_change_m = _bounded(change_m, follow.distance_m)
        around_radps = min(_AROUND_RADPS, follow.speed_mps / (follow.distance_m + self._distance_change_m))
        self._angle_change_rad = math.remainder(self._angle_change_rad + right * around_radps, 2.0 * math.pi)


def _bounded(change_m: float, from_m: float) -> float:
    """A change of a distance that leaves it between the bounds, or does not take it farther out of them."""
    return min(max(change_m, min(_MIN_DISTANCE_M - from_m, 0.0)), max(_MAX_DISTANCE_M - from_m, 0.0))


class FollowTargetService:
    """Takes FOLLOW_TARGET in any mode; the mode that follows flies by it, and holds without reports."""

    def __init__(self, context: ServiceContext, guidance: Guidance) -> None:
        self._context = context
        self._guidance = guidance
        self._leader = LeaderTrack()

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"FOLLOW_TARGET": self._take_report}

    def tick(self) -> None:
        flight, guidance = self._context.flight, self._guidance
        if flight.mode.behaviour is not _FOLLOW_TARGET:
            return
        follows, fresh = isinstance(guidance.manoeuvre, FollowTarget), self._leader.fresh(flight.time_ns)
        if fresh and not follows:
            guidance.manoeuvre = FollowTarget(flight, self._leader)
        elif follows and not fresh:
            guidance.manoeuvre = guidance.manoeuvres.hold(flight)

    def _take_report(self, m: Any, sender: MessageSender) -> None:
        # 0, 0 is the report of a leader without a position.
        has_position = m.est_capabilities & _HAS_POSITION and not (m.lat == 0 and m.lon == 0)
        if not has_position or abs(m.lat) > 900_000_000 or abs(m.lon) > 1_800_000_000:
            return
        velocity = None
        if m.est_capabilities & _HAS_VELOCITY and math.isfinite(m.vel[0] + m.vel[1]):
            velocity = (m.vel[0], m.vel[1])
        place = self._context.frame.to_local_m(m.lat * 1e-7, m.lon * 1e-7)
        self._leader.update(place, velocity, self._context.flight.time_ns)
