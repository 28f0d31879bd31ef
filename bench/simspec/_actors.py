"""Groups of actors: what they are, how many, and how they move."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from bench.documents import Document

from ._ground import Point
from ._placement import Placement
from ._quantities import Fraction, Identifier


class Role(StrEnum):
    """What an actor is to the mission, whatever it looks like."""

    ADVERSARY = "adversary"
    BYSTANDER = "bystander"
    CLUTTER = "clutter"


class Motion(Document):
    """How a member moves. `wander` walks to random points within `radius_m` of its own start; `patrol` walks `route` in a loop."""

    kind: Literal["still", "wander", "patrol"] = "still"
    speed_mps: Annotated[float, Field(gt=0.0, le=40.0)] = 1.2
    radius_m: Annotated[float, Field(gt=0.0, le=2000.0)] = 25.0
    pause_s: Annotated[float, Field(ge=0.0, le=3600.0, description="Mean pause at each point.")] = 5.0
    route: tuple[Point, ...] = ()

    @model_validator(mode="after")
    def _patrol_has_a_route(self) -> Self:
        if (self.kind == "patrol") != (len(self.route) >= 2):
            raise ValueError("a patrol needs a route of at least two points, and only a patrol has one")
        return self


class CountRange(Document):
    """A number of members that is drawn for each scene, uniformly, from the placement seed.

    Key factors read `low` from it: however the draw comes out, the situation is no easier than that.
    """

    low: Annotated[int, Field(ge=0, le=5000)]
    high: Annotated[int, Field(ge=0, le=5000)]

    @model_validator(mode="after")
    def _leaves_a_choice(self) -> Self:
        if self.high <= self.low:
            raise ValueError(f"high {self.high} must exceed low {self.low}; a fixed number is written count: {self.low}")
        return self


def _number_or_range(value: object) -> str:
    return "range" if isinstance(value, (dict, CountRange)) else "number"


Count = Annotated[
    Annotated[CountRange, Tag("range")] | Annotated[int, Field(ge=0, le=5000), Tag("number")], Discriminator(_number_or_range)
]


class ActorGroup(Document):
    """Actors of one kind that are wanted in the scene: how many, where, what they do."""

    id: Identifier
    asset: Annotated[Identifier, Field(description="Entry of the asset catalogue; decides size and class label.")]
    role: Role
    count: Annotated[Count | None, Field(description="A number, or a range to draw it from.")] = None
    density_per_km2: Annotated[
        float | None, Field(ge=0.0, le=1e6, description="Instead of count: members per km2 of world.area.")
    ] = None
    concealment: Annotated[Fraction, Field(description="0 in the open, 1 under full camouflage; enters the detection model.")] = (
        0.0
    )
    placement: Placement = Placement()
    motion: Motion = Motion()

    @model_validator(mode="after")
    def _one_way_to_count(self) -> Self:
        if (self.count is None) == (self.density_per_km2 is None):
            raise ValueError("give either count or density_per_km2, not both and not neither")
        if self.placement.at and self.count != 1:
            raise ValueError("placement.at fixes one place; count must be 1")
        return self

    def member_count(self, area_m2: float) -> int:
        """Number of members over an area of interest of `area_m2` square metres; the least one where the number is drawn."""
        if isinstance(self.count, CountRange):
            return self.count.low
        if self.count is not None:
            return self.count
        assert self.density_per_km2 is not None
        return math.floor(self.density_per_km2 * area_m2 / 1e6 + 0.5)
