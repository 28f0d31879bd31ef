"""The ground: places, polygons, roads, and the world that they lie in."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._quantities import Identifier, Metres


class Point(Document):
    """A place on the ground in the world's local tangent plane."""

    east_m: Metres
    north_m: Metres


class Polygon(Document):
    """A simple polygon on the ground, by its corners in either direction; closed by itself."""

    corners: Annotated[tuple[Point, ...], Field(min_length=3, max_length=64)]

    @property
    def area_m2(self) -> float:
        """Enclosed area in square metres (shoelace formula)."""
        corners = self.corners
        twice = sum(a.east_m * b.north_m - b.east_m * a.north_m for a, b in zip(corners, corners[1:] + corners[:1], strict=True))
        return abs(twice) / 2.0

    def contains(self, point: Point) -> bool:
        """Whether `point` lies inside (even-odd rule); points on the edge may count either way."""
        inside = False
        for a, b in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if (a.north_m > point.north_m) != (b.north_m > point.north_m):
                share = (point.north_m - a.north_m) / (b.north_m - a.north_m)
                inside ^= point.east_m < a.east_m + share * (b.east_m - a.east_m)
        return inside

    @model_validator(mode="after")
    def _encloses_something(self) -> Self:
        if self.area_m2 < 1.0:
            raise ValueError("the polygon encloses less than one square metre; give at least three corners not in a line")
        return self


class Origin(Document):
    """Where the local tangent plane touches the earth (WGS84)."""

    latitude_deg: Annotated[float, Field(ge=-89.0, le=89.0)] = 47.3977
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 8.5456
    altitude_m: Annotated[float, Field(ge=-400.0, le=5000.0, description="Ground height above mean sea level.")] = 488.0


class Road(Document):
    """A strip of ground along a line; it ends flat at both ends."""

    id: Identifier
    points: Annotated[tuple[Point, ...], Field(min_length=2, max_length=64, description="The middle of the road, in order.")]
    width_m: Annotated[float, Field(gt=0.0, le=200.0)] = 6.0

    @model_validator(mode="after")
    def _leads_somewhere(self) -> Self:
        for number, (a, b) in enumerate(itertools.pairwise(self.points), start=1):
            if math.hypot(b.east_m - a.east_m, b.north_m - a.north_m) < 0.1:
                raise ValueError(f"points {number} and {number + 1} of the road are less than 0.1 m apart; drop one")
        return self


class Area(Polygon):
    """Named ground: a village, a yard, a sector. Nothing is drawn of it."""

    id: Identifier


class World(Document):
    """The ground that everything stands on."""

    origin: Origin = Origin()
    scene: Annotated[Identifier, Field(description="Scene backend, by its name in the entry-point group rebar.scenes.")] = "plain"
    area: Annotated[Polygon, Field(description="The area of interest; densities count over it.")]
    roads: Annotated[tuple[Road, ...], Field(max_length=64, description="Roads that groups may be placed along.")] = ()
    areas: Annotated[tuple[Area, ...], Field(max_length=64, description="Named ground that groups may be placed inside.")] = ()


class Home(Point):
    """Where the vehicle stands at the start."""

    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 0.0
