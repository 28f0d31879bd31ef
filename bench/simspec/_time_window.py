"""An interval of simulated time, as rules and the mission order state it."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from bench.documents import Document

from ._quantities import NotNegative


class TimeWindow(Document):
    """An interval of simulated time. The end is not included."""

    from_s: NotNegative
    until_s: NotNegative

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.until_s <= self.from_s:
            raise ValueError(f"until_s {self.until_s:g} must exceed from_s {self.from_s:g}")
        return self
