"""Types of names, numbers and intervals that the parts of a SimSpec share."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._words import IDENTIFIER

Identifier = Annotated[str, Field(pattern=IDENTIFIER)]
# ROS 2 names have no hyphens.
RosName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,62}$")]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
# A limit against typing errors. At 100 km from its origin, the tangent plane is 785 m above the ground.
Metres = Annotated[float, Field(ge=-1e5, le=1e5)]


class TimeWindow(Document):
    """An interval of simulated time. The end is not included."""

    from_s: NotNegative
    until_s: NotNegative

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.until_s <= self.from_s:
            raise ValueError(f"until_s {self.until_s:g} must exceed from_s {self.from_s:g}")
        return self
