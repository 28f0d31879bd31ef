"""Placement relations of a group: where its members may stand, and where they head."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document, added_field

from ._ground import Home, Point, Polygon
from ._quantities import Identifier, NotNegative, Positive

HOME = "home"
"""In `of` of a relation: the place vehicle.home, unless a group has this id."""

GroupOrHome = Annotated[
    Identifier,
    Field(description="Id of a group, or home for the vehicle's home (unless a group has that id)."),
]


class Near(Document):
    """A distance between `min_m` and `max_m` to at least one member of another group."""

    of: GroupOrHome
    min_m: NotNegative = 0.0
    max_m: Positive

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        # Equal bounds leave a circle without width, which no sampled position hits.
        if self.max_m <= self.min_m:
            raise ValueError(f"max_m {self.max_m} must exceed min_m {self.min_m}")
        return self


class MeanDistance(Document):
    """The mean distance of the members to the first member of another group (the proximity of the paper)."""

    of: GroupOrHome
    mean_m: Positive
    tolerance: float = Field(0.01, gt=0.0, le=0.5, description="Permitted relative deviation from the mean.")


class Distance(Document):
    """A distance between `min_m` and `max_m` to a group, to all groups of a role, or to a point.

    Give exactly one of `of` and `point`. `whom` says whether the distance holds to every member or to at
    least one.
    """

    of: Identifier | None = Field(
        None, description="Id of another group, or a role or home (unless a group has that id)."
    )
    point: Point | None = None
    whom: Literal["every", "some"] = "every"
    min_m: NotNegative = 0.0
    max_m: Positive | None = Field(None, description="No upper bound when absent.")

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        if (self.of is None) == (self.point is None):
            raise ValueError("give either of (a group, a role or home) or point, not both")
        if self.max_m is not None and self.max_m <= self.min_m:
            raise ValueError(f"max_m {self.max_m} must exceed min_m {self.min_m}")
        if self.max_m is None and self.min_m == 0.0:
            raise ValueError("give min_m, max_m or both; without them every distance is permitted")
        return self


class PlaceReference(Document):
    """A place: the first member of a group, or a point. Exactly one of the two."""

    of: GroupOrHome | None = None
    point: Point | None = None

    @model_validator(mode="after")
    def _exactly_one_reference(self) -> Self:
        if (self.of is None) == (self.point is None):
            raise ValueError("give either of (a group or home) or point, not both")
        return self


CompassDegrees = Annotated[float, Field(ge=0.0, lt=360.0)]


class Bearing(PlaceReference):
    """A position in a sector, as seen from the first member of another group or from a point."""

    from_deg: CompassDegrees = Field(description="Degrees clockwise from north.")
    to_deg: CompassDegrees = Field(
        description="End of the sector, clockwise from from_deg: 315 to 45 is around north."
    )

    @model_validator(mode="after")
    def _sector_is_open(self) -> Self:
        if self.from_deg == self.to_deg:
            raise ValueError(f"a sector from {self.from_deg:g} to {self.to_deg:g} degrees is empty")
        return self


class Facing(PlaceReference):
    """A heading: towards the first member of another group, towards a point, or a compass heading.

    Exactly one of the three.
    """

    heading_deg: CompassDegrees | None = Field(None, description="Degrees clockwise from north.")
    within_deg: float = Field(
        10.0, ge=0.5, le=180.0, description="Largest permitted deviation to either side."
    )

    @model_validator(mode="after")
    def _exactly_one_reference(self) -> Self:
        # Two of the three are absent. 0 is a heading, so truth values would not do.
        if [self.of, self.point, self.heading_deg].count(None) != 2:
            raise ValueError("give one of the three: of (a group or home), point or heading_deg")
        return self


class Inside(Document):
    """The whole footprint inside a named area, or inside the footprint of a member of another group.

    Exactly one of the two.
    """

    area: Identifier | None = Field(None, description="Id of an area in world.areas.")
    of: Identifier | None = Field(
        None, description="Id of a group. Overlapping its member is then no collision."
    )

    @model_validator(mode="after")
    def _exactly_one_reference(self) -> Self:
        if (self.area is None) == (self.of is None):
            raise ValueError("give either area (one of world.areas) or of (a group), not both")
        return self


class Avoid(Document):
    """Ground or actors to keep out of: the gap from the footprint to them, edge to edge.

    Exactly one of `area` and `of`. With `of` the gap holds to every member.
    """

    area: Identifier | None = Field(
        None, description="Id of an area in world.areas; no part of the footprint is in it."
    )
    of: Identifier | None = Field(
        None, description="Id of another group, or a role or home (unless a group has that id)."
    )
    at_least_m: NotNegative = Field(0.0, description="Smallest permitted gap.")

    @model_validator(mode="after")
    def _exactly_one_reference(self) -> Self:
        if (self.area is None) == (self.of is None):
            raise ValueError(
                "give either area (one of world.areas) or of (a group, a role or home), not both"
            )
        if self.of is not None and self.at_least_m == 0.0:
            raise ValueError("give at_least_m: without it, separation_m already keeps footprints apart")
        return self


class AreaCount(Document):
    """How many members of the group stand inside a named area. No member stands across its border.

    Give `exactly`, or `at_least`, `at_most` or both.
    """

    area: Identifier = Field(description="Id of an area in world.areas.")
    exactly: int | None = Field(None, ge=0, le=5000)
    at_least: int | None = Field(None, ge=0, le=5000)
    at_most: int | None = Field(None, ge=0, le=5000)

    @model_validator(mode="after")
    def _bounds_leave_a_number(self) -> Self:
        bounds = [bound for bound in (self.at_least, self.at_most) if bound is not None]
        if (self.exactly is None) == (not bounds):
            raise ValueError("give either exactly, or at_least, at_most or both")
        if len(bounds) == 2 and bounds[0] > bounds[1]:
            raise ValueError(f"at_most {bounds[1]} must not be less than at_least {bounds[0]}")
        return self

    @property
    def low(self) -> int:
        """The least number of members inside."""
        return self.at_least or 0 if self.exactly is None else self.exactly

    def high(self, count: int) -> int:
        """The largest number of members inside, of `count` in all."""
        bound = self.at_most if self.exactly is None else self.exactly
        return count if bound is None else bound

    @property
    def text(self) -> str:
        """The numbers as text for people."""
        if self.exactly is not None:
            return f"exactly {self.exactly}"
        bounds = (("at least", self.at_least), ("at most", self.at_most))
        return " and ".join(f"{words} {bound}" for words, bound in bounds if bound is not None)


class Between(Document):
    """The centre close to the straight line between the first members of two groups, strictly between them.

    The same group twice means its first and its second member.
    """

    first: GroupOrHome
    second: GroupOrHome
    within_m: Positive = Field(5.0, description="Largest distance of the centre from the straight line.")


class Sight(PlaceReference):
    """A viewpoint above a point or above the members of a group. Solid assets of other groups can block the
    view.

    A member is visible when the middle of its top is.
    """

    height_m: float = Field(1.7, ge=0.0, le=6000.0, description="Height of the viewpoint above the ground.")


class Along(Document):
    """A position on a road, or beside it."""

    road: Identifier = Field(description="Id of a road in world.roads.")
    where: Literal["on", "beside"] = Field(
        "on", description="on: the whole footprint is on the road; beside: no part of it."
    )
    at_least_m: NotNegative = Field(
        0.0, description="For beside: smallest permitted gap between footprint and road."
    )
    within_m: Positive = Field(
        5.0, description="For beside: largest permitted gap between footprint and road."
    )
    parallel_deg: float | None = Field(
        None,
        ge=0.5,
        le=90.0,
        description="Largest permitted angle to the road, in either direction; any heading when absent.",
    )

    @model_validator(mode="after")
    def _gap_fits_the_side(self) -> Self:
        if self.where == "on" and self.at_least_m > 0.0:
            raise ValueError(
                "a position on the road has no gap to it: delete at_least_m, or set where to beside"
            )
        if self.at_least_m >= self.within_m:
            raise ValueError(f"within_m {self.within_m:g} must exceed at_least_m {self.at_least_m:g}")
        return self

    @property
    def gap_text(self) -> str:
        """The gap to the road as text for people."""
        return (
            f"within {self.within_m:g} m"
            if self.at_least_m == 0.0
            else f"{self.at_least_m:g} to {self.within_m:g} m"
        )


class Placement(Document):
    """Where the members of a group may stand.

    All relations hold at once; `at` fixes the place of a single member.
    """

    at: Home | None = None
    region: Polygon | None = Field(
        None, description="The members stand inside this polygon; inside world.area when absent."
    )
    inside: Inside | None = None
    near: Near | None = None
    away: Near | None = Field(
        None, description="As near, but the distance holds to every member of the other group."
    )
    mean_distance: MeanDistance | None = None
    distances: tuple[Distance, ...] = Field(
        (), max_length=16, description="Further distances to groups, roles or points."
    )
    along: Along | None = None
    bearing: Bearing | None = None
    between: Between | None = None
    facing: Facing | None = None
    hidden_from: Sight | None = Field(
        None, description="Hidden from the viewpoint, or from the viewpoints above all members of the group."
    )
    visible_from: Sight | None = Field(
        None,
        description="Visible from the viewpoint, or from the viewpoint above at least one member of the group.",
    )
    spread_m: Positive | None = Field(
        None, description="Smallest permitted distance between members of this group, centre to centre."
    )
    separation_m: NotNegative = Field(0.5, description="Smallest permitted gap between footprints.")
    # The following are left out where they are not set: SimSpecs without them keep their bytes.
    extent_m: Positive | None = added_field(
        None, "Largest permitted distance between two members of this group, centre to centre."
    )
    avoid: tuple[Avoid, ...] = added_field(
        (), "Areas, groups, roles or home to keep out of and away from, edge to edge.", max_length=16
    )
    counts: tuple[AreaCount, ...] = added_field(
        (), "How many members stand inside which areas.", max_length=4
    )

    @model_validator(mode="after")
    def _fixed_place_stands_alone(self) -> Self:
        other_fields = [
            name
            for name, field in type(self).model_fields.items()
            # The gap to other footprints applies to a fixed member as well.
            if name not in ("at", "separation_m") and getattr(self, name) != field.default
        ]
        if self.at and other_fields:
            raise ValueError(f"at fixes the place: delete either at or {', '.join(other_fields)}")
        return self

    @model_validator(mode="after")
    def _extent_leaves_room(self) -> Self:
        # Equal bounds leave a circle without width, which no sampled position hits.
        if self.extent_m is not None and self.spread_m is not None and self.extent_m <= self.spread_m:
            raise ValueError(f"extent_m {self.extent_m:g} must exceed spread_m {self.spread_m:g}")
        return self

    @property
    def place_references(self) -> dict[str, PlaceReference]:
        """The relations that refer to a point or to a first member, by the name of their field."""
        relations = {
            "bearing": self.bearing,
            "facing": self.facing,
            "hidden_from": self.hidden_from,
            "visible_from": self.visible_from,
        }
        return {name: relation for name, relation in relations.items() if relation is not None}
