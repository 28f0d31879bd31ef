"""How the waypoints of a mission are approached, passed and left: PX4's speeds and ArduPilot's paths."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from bench.contracts import Vector

from ..state._flight_limits import FlightLimits, PathLimits
from ..state._flight_state import FlightState, NorthEast
from ..state._shaping import StraightLine
from ._manoeuvres import stopping_m, stopping_place

# PX4 turns towards a point of the line so far ahead, or farther where the acceptance radius is larger.
_LEAST_LEAD_M = 5.0
# It has turned when its course is within 11 degrees of the target's bearing, and does not turn below this speed.
_ALIGNED_COSINE, _LEAST_TURNING_MPS = 0.98, 0.2


@dataclass(frozen=True, slots=True)
class Following:
    """The place to fly on to without a stop, and the speed of an item on the way; None by the parameters."""

    place: NorthEast
    down_m: float
    speed_mps: float | None


class WaypointApproach:
    """PX4's way along a line: no faster than the distance, the turn at its end and the line behind that allow.

    Source: PX4, `PositionSmoothing` and `computeXYSpeedFromWaypoints`.
    """

    def __init__(
        self,
        flight: FlightState,
        line: tuple[NorthEast, NorthEast],
        following: NorthEast | None,
        radius_m: float,
    ) -> None:
        self._begin, self._place = line
        self._following, self._radius_m = following, radius_m
        # A turn keeps the speed that the approach of the last waypoint has left.
        self._entry_mps = math.hypot(flight.vn_mps, flight.ve_mps)
        self._turning = True
        self._passing_mps = 0.0
        self._judged: tuple[FlightLimits, float] | None = None

    def aim(self, flight: FlightState, limits: FlightLimits, cruise_mps: float) -> tuple[NorthEast, float]:
        """The point to steer to, and the speed there."""
        if self._judged != (limits, cruise_mps):
            self._judged = (limits, cruise_mps)
            self._passing_mps = self._speed_at_place(limits, cruise_mps)
        north, east = self._place[0] - flight.north_m, self._place[1] - flight.east_m
        distance_m = math.hypot(north, east)
        # Inside the radius the line is over, unless the height is missing: then it waits at the place.
        if distance_m <= self._radius_m:
            return self._place, cruise_mps
        speed_mps = min(cruise_mps, _speed_before(limits, distance_m, self._passing_mps))
        towards = (north / distance_m, east / distance_m)
        if self._is_turning(flight, towards):
            speed_mps = min(speed_mps, max(self._entry_mps, _LEAST_TURNING_MPS))
            towards = self._towards_line(flight)
        elif not self._passing_mps:
            return self._place, cruise_mps
        # Far enough for the airframe not to brake before it by itself.
        reach_m = distance_m + _braking_m(limits, speed_mps)
        return (flight.north_m + towards[0] * reach_m, flight.east_m + towards[1] * reach_m), speed_mps

    def _speed_at_place(self, limits: FlightLimits, cruise_mps: float) -> float:
        if self._following is None:
            return 0.0
        behind_m = math.dist(self._place, self._following)
        before_m = math.dist(self._begin, self._place)
        if behind_m < max(self._radius_m, 0.001) or before_m == 0.0:
            return 0.0
        cosine = sum(
            (place - begin) * (place - following)
            for begin, place, following in zip(self._begin, self._place, self._following, strict=True)
        ) / (before_m * behind_m)
        # The angle between both lines: a half turn where the course goes straight on.
        angle_rad = math.acos(min(max(cosine, -1.0), 1.0))
        turn_mps2 = limits.waypoint_turn_mps2 * self._radius_m
        turning_mps = math.sqrt(turn_mps2 * math.tan(min(0.5 * angle_rad, 1.57)))
        return min(turning_mps, cruise_mps, _speed_before(limits, behind_m, 0.0))

    def _is_turning(self, flight: FlightState, towards: NorthEast) -> bool:
        """Whether the course is still to be turned to the place; once aligned, it counts as turned."""
        speed_mps = math.hypot(flight.vn_mps, flight.ve_mps)
        if self._turning and speed_mps > _LEAST_TURNING_MPS:
            along_mps = flight.vn_mps * towards[0] + flight.ve_mps * towards[1]
            self._turning = along_mps < _ALIGNED_COSINE * speed_mps
        else:
            self._turning = False
        return self._turning

    def _towards_line(self, flight: FlightState) -> NorthEast:
        """The direction of the point of the line that lies ahead."""
        length_m = math.dist(self._begin, self._place)
        if length_m == 0.0:
            return 0.0, 0.0
        along = ((self._place[0] - self._begin[0]) / length_m, (self._place[1] - self._begin[1]) / length_m)
        here = (flight.north_m - self._begin[0], flight.east_m - self._begin[1])
        passed_m, off_m = here[0] * along[0] + here[1] * along[1], here[1] * along[0] - here[0] * along[1]
        lead_m = max(self._radius_m, _LEAST_LEAD_M)
        ahead_m = math.sqrt(max(lead_m * lead_m - off_m * off_m, 0.0))
        aim_m = passed_m + ahead_m
        north, east = aim_m * along[0] - here[0], aim_m * along[1] - here[1]
        distance_m = math.hypot(north, east)
        return (north / distance_m, east / distance_m) if distance_m > 0.0 else (0.0, 0.0)


def _speed_before(limits: FlightLimits, distance_m: float, final_mps: float) -> float:
    """The speed from which the vehicle still brakes to `final_mps` within a distance."""
    axis = limits.climb_shaping.horizontal
    squared = axis.base_m2ps2 + final_mps * final_mps + 2.0 * axis.brake_mps2 * distance_m
    return max(math.sqrt(squared) - axis.offset_mps, final_mps)


def _braking_m(limits: FlightLimits, speed_mps: float) -> float:
    axis = limits.climb_shaping.horizontal
    return ((speed_mps + axis.offset_mps) ** 2 - axis.base_m2ps2) / (2.0 * axis.brake_mps2)


@dataclass(slots=True)
class PathSegment:
    """A straight way from rest to rest in time. Places are north, east, down."""

    start_m: Vector
    end_m: Vector
    line: StraightLine
    towards: Vector
    begun_ns: int | None = None

    @classmethod
    def between(cls, start_m: Vector, end_m: Vector, path: PathLimits, limits: FlightLimits) -> PathSegment:
        """As fast as `path` allows horizontally and `limits` vertically."""
        way = tuple(end - start for start, end in zip(start_m, end_m, strict=True))
        length_m = math.hypot(*way)
        north, east, down = (part / length_m for part in way) if length_m > 0.0 else (0.0, 0.0, 0.0)
        level, vertical_mps = math.hypot(north, east), limits.descent_mps if down > 0.0 else limits.climb_mps
        line = StraightLine(
            length_m,
            min(_over(path.speed_mps, level), _over(vertical_mps, abs(down))),
            min(_over(path.accel_mps2, level), _over(path.vertical_accel_mps2, abs(down))),
            path.jerk_mps3,
        )
        return cls(start_m, end_m, line, (north, east, down))

    def elapsed_s(self, now_ns: int) -> float:
        return 0.0 if self.begun_ns is None else (now_ns - self.begun_ns) * 1e-9

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Way, speed, acceleration along the segment."""
        return self.line.at(time_s)


def _over(limit: float, share: float) -> float:
    return limit / share if share > 1e-6 else math.inf


class WaypointPath:
    """ArduPilot's course over waypoints in time: each segment goes from rest to rest, and where a waypoint is only
    passed the next one begins while the last is still braking, so that the sum of both rounds the corner.

    Source: ArduPilot, `SCurve::advance_target_along_track` and `AC_WPNav`.
    """

    def __init__(
        self,
        segment: PathSegment,
        following: PathSegment | None,
        radius_m: float,
        corner_mps2: float,
        now_ns: int,
        previous: PathSegment | None = None,
    ) -> None:
        self.segment, self.following, self._previous = segment, following, previous
        self._radius_m, self._corner_mps2 = radius_m, corner_mps2
        if segment.begun_ns is None:
            segment.begun_ns = now_ns

    @property
    def passes(self) -> bool:
        """Whether the way goes on behind the waypoint without a stop."""
        return self.following is not None

    def over(self, now_ns: int) -> bool:
        """Whether the vehicle is to be at the waypoint: at rest, or halfway through the turn to the next one."""
        remaining_s = self.segment.line.duration_s - self.segment.elapsed_s(now_ns)
        if remaining_s <= 0.0:
            return True
        turned = self.following is not None and self.following.begun_ns is not None
        return turned and self.following is not None and self.following.elapsed_s(now_ns) >= remaining_s

    def is_at_rest(self, now_ns: int) -> bool:
        """Whether the way ends here and has taken its time."""
        return self.following is None and self.segment.elapsed_s(now_ns) > self.segment.line.duration_s

    def target_at(self, now_ns: int) -> tuple[Vector, Vector, Vector]:
        """Place, velocity and acceleration at a moment; called once a step."""
        self._begin_turn(now_ns)
        parts = [(self.segment, self.segment.elapsed_s(now_ns))]
        place = list(self.segment.start_m)
        if self._previous is not None:
            parts.append((self._previous, self._previous.elapsed_s(now_ns)))
            for axis in range(3):
                place[axis] += self._previous.start_m[axis] - self._previous.end_m[axis]
        if self.following is not None and self.following.begun_ns is not None:
            parts.append((self.following, self.following.elapsed_s(now_ns)))
        velocity, acceleration = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        for segment, elapsed_s in parts:
            way_m, speed_mps, accel_mps2 = segment.at(elapsed_s)
            for axis, share in enumerate(segment.towards):
                place[axis] += share * way_m
                velocity[axis] += share * speed_mps
                acceleration[axis] += share * accel_mps2
        return _vector(place), _vector(velocity), _vector(acceleration)

    def _begin_turn(self, now_ns: int) -> None:
        """Begin the next segment when the middle of the turn is near enough, slow enough and gentle enough."""
        following = self.following
        if following is None or following.begun_ns is not None:
            return
        elapsed_s = self.segment.elapsed_s(now_ns)
        remaining_s = self.segment.line.duration_s - elapsed_s
        if remaining_s > min(self.segment.line.ramp_s, following.line.ramp_s):
            return
        middle_s = 0.5 * max(remaining_s, 0.0)
        left_m, braking_mps, braking_mps2 = self.segment.at(self.segment.line.duration_s - middle_s)
        left_m -= self.segment.line.length_m
        way_m, speed_mps, accel_mps2 = following.at(middle_s)
        pairs = list(zip(self.segment.towards, following.towards, strict=True))
        off_m = math.hypot(*(left_m * old + way_m * new for old, new in pairs))
        turning_mps = math.hypot(*(braking_mps * old + speed_mps * new for old, new in pairs))
        turning_mps2 = math.hypot(*(braking_mps2 * old + accel_mps2 * new for old, new in pairs[:2]))
        slowest_mps = min(self.segment.line.speed_mps, following.line.speed_mps)
        if off_m < self._radius_m and turning_mps <= slowest_mps and turning_mps2 < self._corner_mps2:
            following.begun_ns = now_ns


def _vector(values: list[float]) -> Vector:
    return values[0], values[1], values[2]


def waypoint_course(
    flight: FlightState,
    limits: FlightLimits,
    line: tuple[NorthEast, NorthEast],
    down_m: float,
    radius_m: float,
    speed_mps: float | None,
    passed: WaypointPath | None,
    following: Following | None,
) -> WaypointApproach | WaypointPath:
    """How the autopilot approaches the end of a line, at a height, and leaves it again; `passed` is its path before."""
    if limits.waypoint_path is None:
        return WaypointApproach(flight, line, following.place if following else None, radius_m)
    end = (*line[1], down_m)
    if passed and passed.following and passed.following.end_m == end:
        segment, previous = passed.following, passed.segment
    else:
        start = (*stopping_place(flight), flight.down_m + stopping_m(flight.vd_mps))
        segment, previous = _segment(start, end, speed_mps, limits.waypoint_path, limits), None
    behind = None
    if following:
        behind_m = (*following.place, following.down_m)
        behind = _segment(end, behind_m, following.speed_mps, limits.waypoint_path, limits)
    return WaypointPath(segment, behind, radius_m, limits.waypoint_corner_mps2, flight.time_ns, previous)


def _segment(
    start_m: Vector, end_m: Vector, speed_mps: float | None, path: PathLimits, limits: FlightLimits
) -> PathSegment:
    path = replace(path, speed_mps=speed_mps or path.speed_mps)
    return PathSegment.between(start_m, end_m, path, limits)
