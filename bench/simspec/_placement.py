"""Relations of a group: where its members may stand, and which way they head."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._ground import Home, Point, Polygon
from ._quantities import Identifier, NotNegative, Positive

HOME = "home"
"""In `of` of a relation, where no group is called so: the place vehicle.home."""

GroupOrHome = Annotated[Identifier, Field(description="A group, or home: the vehicle's, where no group is called so.")]


class Near(Document):
    """Keep between `min_m` and `max_m` from some member of another group."""

    of: GroupOrHome
    min_m: NotNegative = 0.0
    max_m: Positive

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        if self.max_m <= self.min_m:
            raise ValueError(f"max_m {self.max_m} must exceed min_m {self.min_m}")
        return self


class MeanDistance(Document):
    """The mean distance of the group's members to the first member of another group (the paper's proximity)."""

    of: GroupOrHome
    mean_m: Positive
    tolerance: Annotated[float, Field(gt=0.0, le=0.5, description="Allowed relative deviation of the mean.")] = 0.01


class Distance(Document):
    """Keep between `min_m` and `max_m` from every member, or from some member, of a group or of all groups of a role.

    Or from a point: one of `of` and `point`.
    """

    of: Annotated[
        Identifier | None, Field(description="A group, or a role or home where no group is called so; never the group itself.")
    ] = None
    point: Point | None = None
    whom: Literal["every", "some"] = "every"
    min_m: NotNegative = 0.0
    max_m: Annotated[Positive | None, Field(description="No upper bound when absent.")] = None

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        if (self.of is None) == (self.point is None):
            raise ValueError("give either of (a group, a role or home) or point, not both and not neither")
        if self.max_m is not None and self.max_m <= self.min_m:
            raise ValueError(f"max_m {self.max_m} must exceed min_m {self.min_m}")
        if self.max_m is None and self.min_m == 0.0:
            raise ValueError("give min_m, max_m or both; any distance keeps this one")
        return self


class PlaceReference(Document):
    """The first member of a group, or a point: one of the two."""

    of: GroupOrHome | None = None
    point: Point | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.of is None) == (self.point is None):
            raise ValueError("give either of (a group) or point, not both and not neither")
        return self


CompassDegrees = Annotated[float, Field(ge=0.0, lt=360.0)]


class Bearing(PlaceReference):
    """Stand in a sector, as seen from the first member of another group or from a point."""

    from_deg: Annotated[CompassDegrees, Field(description="Clockwise from north.")]
    to_deg: Annotated[CompassDegrees, Field(description="Clockwise from from_deg on: 315 to 45 is to the north.")]

    @model_validator(mode="after")
    def _opens(self) -> Self:
        if self.from_deg == self.to_deg:
            raise ValueError(f"a sector from {self.from_deg:g} to {self.to_deg:g} degrees holds nothing")
        return self


class Facing(PlaceReference):
    """Head towards the first member of another group or a point, or by the compass: one of the three."""

    heading_deg: Annotated[CompassDegrees | None, Field(description="Clockwise from north.")] = None
    within_deg: Annotated[float, Field(ge=0.5, le=180.0, description="Largest deviation to either side.")] = 10.0

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if [self.of, self.point, self.heading_deg].count(None) != 2:
            raise ValueError("give one of of (a group or home), point and heading_deg, not more and not none")
        return self


class Inside(Document):
    """The whole footprint inside a named area, or inside the footprint of a member of another group: one of the two."""

    area: Annotated[Identifier | None, Field(description="One of world.areas.")] = None
    of: Annotated[
        Identifier | None, Field(description="A group; overlapping the member that one stands in is no collision then.")
    ] = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.area is None) == (self.of is None):
            raise ValueError("give either area (one of world.areas) or of (a group), not both and not neither")
        return self


class Between(Document):
    """The centre beside the straight way from the first member of one group to that of another, strictly between the two.

    The same group twice means its first and its second member.
    """

    first: GroupOrHome
    second: GroupOrHome
    within_m: Annotated[Positive, Field(description="Largest distance of the centre from the straight way.")] = 5.0


class Sight(PlaceReference):
    """An eye over a point or over the members of a group; solid assets of other groups stand in its way.

    What is looked at is the middle of a member's top.
    """

    height_m: Annotated[float, Field(ge=0.0, le=6000.0, description="Height of the eye above the ground.")] = 1.7


class Along(Document):
    """Stand on a road, or beside it."""

    road: Annotated[Identifier, Field(description="One of world.roads.")]
    where: Annotated[Literal["on", "beside"], Field(description="on: the whole footprint on the road; beside: none of it.")] = (
        "on"
    )
    at_least_m: Annotated[NotNegative, Field(description="For beside: least gap between footprint and road.")] = 0.0
    within_m: Annotated[Positive, Field(description="For beside: largest gap between footprint and road.")] = 5.0
    parallel_deg: Annotated[
        float | None, Field(ge=0.5, le=90.0, description="Head along the road within this, either way; any heading when absent.")
    ] = None

    @model_validator(mode="after")
    def _leaves_a_verge(self) -> Self:
        if self.where == "on" and self.at_least_m > 0.0:
            raise ValueError("what stands on a road keeps no distance from it; drop at_least_m, or say where: beside")
        if self.at_least_m >= self.within_m:
            raise ValueError(f"within_m {self.within_m:g} must exceed at_least_m {self.at_least_m:g}")
        return self

    @property
    def gap_text(self) -> str:
        """The gap to the road, for people."""
        return f"within {self.within_m:g} m" if self.at_least_m == 0.0 else f"{self.at_least_m:g} to {self.within_m:g} m"


class Placement(Document):
    """Where the members of a group may stand. Relations are all kept at once; `at` fixes a single member."""

    at: Home | None = None
    region: Annotated[Polygon | None, Field(description="Stay inside; the world's area when absent.")] = None
    inside: Inside | None = None
    near: Near | None = None
    away: Annotated[Near | None, Field(description="As near, but to every member of the other group.")] = None
    mean_distance: MeanDistance | None = None
    distances: Annotated[
        tuple[Distance, ...], Field(max_length=16, description="More distances, to groups or to everybody of a role.")
    ] = ()
    along: Along | None = None
    bearing: Bearing | None = None
    between: Between | None = None
    facing: Facing | None = None
    hidden_from: Annotated[Sight | None, Field(description="Out of sight of the point, or of every member of the group.")] = None
    visible_from: Annotated[Sight | None, Field(description="In sight of the point, or of some member of the group.")] = None
    spread_m: Annotated[Positive | None, Field(description="Least distance between members of this group, centre to centre.")] = (
        None
    )
    separation_m: Annotated[NotNegative, Field(description="Free gap between footprints.")] = 0.5

    @model_validator(mode="after")
    def _fixed_or_free(self) -> Self:
        bound = [
            name
            for name, field in type(self).model_fields.items()
            if name not in ("at", "separation_m") and getattr(self, name) != field.default
        ]
        if self.at and bound:
            raise ValueError(f"at fixes the place; drop {', '.join(bound)} or drop at")
        return self

    @property
    def place_references(self) -> dict[str, PlaceReference]:
        """The relations to a point or a first member, and those of sight, by their field's name."""
        named = {
            "bearing": self.bearing,
            "facing": self.facing,
            "hidden_from": self.hidden_from,
            "visible_from": self.visible_from,
        }
        return {name: one for name, one in named.items() if one is not None}
