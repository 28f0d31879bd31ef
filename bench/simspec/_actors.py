"""Groups of actors: what they are, how many, and how they move."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self, cast

from pydantic import Discriminator, Field, PrivateAttr, Tag, model_validator

from bench.documents import Document, added_field
from bench.errors import Fault

from ._assets import ASSETS, Asset, asset_fault
from ._ground import Point
from ._placement import Placement
from ._quantities import Fraction, Identifier
from ._roles import Role


class Motion(Document):
    """How a member moves.

    `wander`: to random points within `radius_m` of its start. `patrol`: along `route`, in a loop.
    Before `depart_s` and from `halt_s` on it stands still.
    """

    kind: Literal["still", "wander", "patrol"] = "still"
    speed_mps: float = Field(1.2, gt=0.0, le=40.0)
    radius_m: float = Field(25.0, gt=0.0, le=2000.0)
    pause_s: float = Field(5.0, ge=0.0, le=3600.0, description="Mean pause at each point of the path.")
    route: tuple[Point, ...] = ()
    depart_s: float = added_field(0.0, "Simulated time at which it sets off.", ge=0.0, le=7200.0)
    halt_s: float | None = added_field(
        None, "Simulated time at which it stops for good, wherever it is; never when absent.", gt=0.0
    )

    @model_validator(mode="after")
    def _halt_follows_departure(self) -> Self:
        if self.halt_s is not None and self.halt_s <= self.depart_s:
            raise ValueError(f"halt_s {self.halt_s:g} must be later than depart_s {self.depart_s:g}")
        return self

    @model_validator(mode="after")
    def _patrol_has_a_route(self) -> Self:
        if (self.kind == "patrol") != (len(self.route) >= 2):
            raise ValueError("a patrol needs a route of at least two points, and only a patrol has one")
        return self


class CountRange(Document):
    """A number of members that is drawn uniformly for each scene, with the placement seed.

    Key factors use `low`, so that no draw makes the situation easier than its rating says.
    """

    low: int = Field(ge=0, le=5000)
    high: int = Field(ge=0, le=5000)

    @model_validator(mode="after")
    def _range_has_several_values(self) -> Self:
        if self.high <= self.low:
            raise ValueError(
                f"high {self.high} must exceed low {self.low}; for a fixed number write count: {self.low}"
            )
        return self


def _count_kind(value: object) -> str:
    # Chosen before validation: without it, pydantic would report a wrong range a second time as a wrong
    # number.
    return "range" if isinstance(value, (dict, CountRange)) else "number"


Count = Annotated[
    Annotated[CountRange, Tag("range")] | Annotated[int, Field(ge=0, le=5000), Tag("number")],
    Discriminator(_count_kind),
]


Color = Literal[
    "black", "blue", "brown", "green", "grey", "orange", "pink", "purple", "red", "silver", "white", "yellow"
]


class ActorGroup(Document):
    """A group of actors of one kind: how many, where they are, and how they move."""

    id: Identifier
    asset: Identifier = Field(
        description="Name in the asset catalogue, in `assets` or in a package; it decides size and class label."
    )
    role: Role = Field(
        # No document keeps it: the validators here and of SimSpec put the asset's in its place, or refuse the group.
        cast(Any, None),
        validate_default=False,
        description="`adversary` and `sought` are to be found and reported; the rules about bystanders protect "
        "`bystander` and `sought`. That of the asset when absent.",
    )
    count: Count | None = Field(
        None, description="The number of members, or the range from which it is drawn."
    )
    density_per_km2: float | None = Field(
        None, ge=0.0, le=1e6, description="Members per km2 of world.area, instead of count."
    )
    concealment: Fraction = Field(
        0.0, description="0 in the open, 1 under full camouflage. The detection model uses it."
    )
    placement: Placement = Placement()
    motion: Motion = Motion()
    color: Color | None = added_field(
        None,
        "The colour in which the camera draws it: paintwork, clothes, walls. Without effect on simulated detections. Drawn from "
        "the asset's colours when absent.",
    )
    _own: Asset | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _role_of_the_asset(self) -> Self:
        if self.asset in ASSETS:
            self._state_role(ASSETS[self.asset])
        return self

    def adopt(self, own: Asset) -> None:
        """Take what a SimSpec or a package says of the asset."""
        self._own = own
        self._state_role(own)

    def _state_role(self, asset: Asset) -> None:
        # Frozen for everybody else; this completes the reading.
        if "role" not in self.model_fields_set:
            self.__dict__["role"] = asset.role

    @property
    def has_role(self) -> bool:
        """Whether somebody stated the role; a complete SimSpec has no group without."""
        return self.__dict__["role"] is not None

    @property
    def own(self) -> Asset | None:
        """What was adopted; None for an asset of the catalogue."""
        return self._own

    @property
    def definition(self) -> Asset:
        """The asset. Raises KeyError for one that nobody knows."""
        return self._own or ASSETS[self.asset]

    def asset_fault(self, where: str) -> Fault | None:
        """The fault of naming an asset that nobody defines; None for any other."""
        return None if self._own else asset_fault(where, self.asset)

    @property
    def is_known(self) -> bool:
        """Whether somebody defines the asset."""
        return self._own is not None or self.asset in ASSETS

    @model_validator(mode="after")
    def _count_or_density(self) -> Self:
        if (self.count is None) == (self.density_per_km2 is None):
            raise ValueError("give either count or density_per_km2, not both")
        if self.placement.at and self.count != 1:
            raise ValueError("placement.at fixes a single member: set count to 1")
        return self

    def member_count(self, area_m2: float) -> int:
        """Number of members in an area of interest of `area_m2` square metres; the smallest number when it is
        drawn.
        """
        if isinstance(self.count, CountRange):
            return self.count.low
        if self.count is not None:
            return self.count
        assert self.density_per_km2 is not None
        # A half is rounded up; round() would round it to the even neighbour.
        return math.floor(self.density_per_km2 * area_m2 / 1e6 + 0.5)
