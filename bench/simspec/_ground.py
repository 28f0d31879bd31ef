"""The ground: points, polygons, roads, and the world that contains them."""

from __future__ import annotations

import itertools
import math
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from bench.documents import Document, added_field
from bench.polygons import is_inside

from ._quantities import Identifier, Metres


class Point(Document):
    """A point on the ground, in the local tangent plane of the world."""

    east_m: Metres
    north_m: Metres


class Polygon(Document):
    """A simple polygon on the ground: its corners in either direction, without repeating the first."""

    corners: tuple[Point, ...] = Field(min_length=3, max_length=64)

    @property
    def area_m2(self) -> float:
        """Enclosed area in square metres (shoelace formula)."""
        corners = self.corners
        twice = sum(
            a.east_m * b.north_m - b.east_m * a.north_m
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        )
        return abs(twice) / 2.0

    def contains(self, point: Point) -> bool:
        """Whether `point` is inside. A point on the edge may count either way."""
        corners = [(corner.east_m, corner.north_m) for corner in self.corners]
        return is_inside((point.east_m, point.north_m), corners)

    @model_validator(mode="after")
    def _encloses_an_area(self) -> Self:
        if self.area_m2 < 1.0:
            raise ValueError(
                "the polygon encloses less than one square metre; give at least three corners that are not in a line"
            )
        return self


# Parallels bend, by the tangent of the latitude. The maps of the shipped agents are flat: they put a place 300 m north
# and 300 m east of the origin 2 cm off at 47 degrees, 18 cm at 85, 90 cm at 89.
MAX_LATITUDE_DEG = 85.0


class Origin(Document):
    """The point at which the local tangent plane touches the earth (WGS84)."""

    # The defaults are the home of PX4's simulator, rounded (SIH_LOC_LAT0, SIH_LOC_LON0).
    latitude_deg: float = Field(
        47.3977, json_schema_extra={"minimum": -MAX_LATITUDE_DEG, "maximum": MAX_LATITUDE_DEG}
    )
    longitude_deg: float = Field(8.5456, ge=-180.0, le=180.0)
    altitude_m: float = Field(488.0, ge=-400.0, le=5000.0, description="Ground height above mean sea level.")

    @field_validator("latitude_deg")
    @classmethod
    def _no_pole(cls, latitude_deg: float) -> float:
        if not -MAX_LATITUDE_DEG <= latitude_deg <= MAX_LATITUDE_DEG:
            raise ValueError(
                "a map of metres east and north is no longer flat so near a pole; "
                f"place the origin from -{MAX_LATITUDE_DEG:g} to {MAX_LATITUDE_DEG:g} degrees"
            )
        return latitude_deg


class Road(Document):
    """A strip of ground along a line, with flat ends."""

    id: Identifier
    points: tuple[Point, ...] = Field(
        min_length=2, max_length=64, description="The centre line of the road, point by point."
    )
    width_m: float = Field(6.0, gt=0.0, le=200.0)

    @model_validator(mode="after")
    def _points_are_apart(self) -> Self:
        for number, (a, b) in enumerate(itertools.pairwise(self.points), start=1):
            if math.hypot(b.east_m - a.east_m, b.north_m - a.north_m) < 0.1:
                raise ValueError(
                    f"points {number} and {number + 1} of the road are less than 0.1 m apart; delete one"
                )
        return self


class Area(Polygon):
    """A named area, such as a village, a yard or a sector. The camera does not see it."""

    id: Identifier


GroundKind = Literal["grass", "farmland", "desert", "gravel", "urban", "snow"]


class World(Document):
    """The ground of the situation."""

    origin: Origin = Origin()
    scene: Identifier = Field(
        "plain", description="Name of the scene backend in the entry-point group rebar.scenes."
    )
    area: Polygon = Field(description="The area of interest. Densities refer to it.")
    roads: tuple[Road, ...] = Field((), max_length=64, description="Roads along which groups can be placed.")
    areas: tuple[Area, ...] = Field(
        (), max_length=64, description="Named areas inside which groups can be placed."
    )
    ground: GroundKind = added_field("grass", "What the ground is made of, for the camera's pictures alone.")

    def road(self, name: str) -> Road:
        """The road with this id, which validation promises to relations along it."""
        return next(road for road in self.roads if road.id == name)


class Home(Point):
    """A point with a heading: the vehicle's home, or the fixed place of a member."""

    heading_deg: float = Field(0.0, ge=0.0, lt=360.0)
