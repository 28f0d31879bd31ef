"""Solids, lines and labels in the frame `map`, with the colours that mean the same in every panel."""

from __future__ import annotations

import math
from collections.abc import Iterable

from bench.simspec import Point as GroundPoint
from bench.simspec import Role
from bench.streams import Point, Pose, Quaternion, Time, Vector3

from ._messages import Color, CubePrimitive, LinePrimitive, LineType, SceneEntity, TextPrimitive

MAP_FRAME = "map"

ROLE_COLORS = {
    Role.ADVERSARY: Color(0.85, 0.15, 0.15, 1.0),
    Role.BYSTANDER: Color(0.20, 0.45, 0.90, 1.0),
    Role.SOUGHT: Color(0.95, 0.65, 0.10, 1.0),
    Role.CLUTTER: Color(0.55, 0.55, 0.55, 1.0),
}
AREA_COLOR = Color(0.90, 0.90, 0.90, 1.0)
GEOFENCE_COLOR = Color(1.00, 0.80, 0.10, 1.0)
NO_FLY_COLOR = Color(1.00, 0.10, 0.10, 1.0)
NAMED_AREA_COLOR = Color(0.35, 0.75, 0.45, 1.0)
ROAD_COLOR = Color(0.40, 0.40, 0.40, 1.0)
HOME_COLOR = Color(0.30, 0.85, 0.30, 1.0)
VEHICLE_COLOR = Color(0.95, 0.95, 0.20, 1.0)
TRACK_COLOR = Color(0.10, 0.85, 0.85, 0.7)
REPORT_COLOR = Color(0.90, 0.20, 0.90, 0.6)
MARK_COLOR = Color(0.90, 0.20, 0.90, 1.0)
INTELLIGENCE_COLOR = Color(0.70, 0.50, 1.00, 1.0)
LABEL_COLOR = Color(1.0, 1.0, 1.0, 1.0)

# Screen pixels, so that names stay legible from the height of a whole mission area.
LABEL_PIXELS = 12.0
LINE_PIXELS = 2.0
_CIRCLE_CORNERS = 48
# Lines and labels a little above the ground, which would hide parts of what lies in it.
ABOVE_GROUND_M = 0.1


def entity(time: Time, name: str, **primitives: object) -> SceneEntity:
    """An entity in the map frame that stays until one of the same name replaces it."""
    # Locked to its frame: the map never moves, and a viewer then needs no transform of that moment.
    return SceneEntity(time, MAP_FRAME, name, frame_locked=True, **primitives)  # type: ignore[arg-type]


def standing_cube(place: Point, turn: Quaternion, size_m: Vector3, color: Color) -> CubePrimitive:
    """A cuboid that stands on `place`."""
    return CubePrimitive(Pose(Point(place.x, place.y, place.z + size_m.z / 2.0), turn), size_m, color)


def label(text: str, place: Point, color: Color = LABEL_COLOR) -> TextPrimitive:
    """Text that always faces the reader, with its centre at `place`."""
    return TextPrimitive(Pose(place), True, LABEL_PIXELS, True, color, text)


def closed_line(corners: Iterable[Point], color: Color) -> LinePrimitive:
    """The outline of a polygon."""
    return LinePrimitive(LineType.LOOP, Pose(), LINE_PIXELS, True, tuple(corners), color)


def on_ground(point: GroundPoint, height_m: float = ABOVE_GROUND_M) -> Point:
    """A point of the SimSpec in the map frame."""
    return Point(point.east_m, point.north_m, height_m)


def circle(east_m: float, north_m: float, radius_m: float) -> tuple[Point, ...]:
    """Corners of a circle on the ground."""
    angles = (2.0 * math.pi * corner / _CIRCLE_CORNERS for corner in range(_CIRCLE_CORNERS))
    return tuple(
        Point(east_m + radius_m * math.cos(angle), north_m + radius_m * math.sin(angle), ABOVE_GROUND_M)
        for angle in angles
    )


def centre(corners: Iterable[Point]) -> Point:
    """The mean of some corners: where the name of an area stands."""
    points = tuple(corners)
    return Point(
        sum(point.x for point in points) / len(points),
        sum(point.y for point in points) / len(points),
        ABOVE_GROUND_M,
    )
