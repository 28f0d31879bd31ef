"""What the agent is told that it must and must not do."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._consistency import raise_inconsistencies, rule_inconsistencies
from ._ground import Polygon
from ._quantities import Fraction, Identifier, NotNegative, Positive


class TimeWindow(Document):
    """A stretch of simulated time, its end not included."""

    from_s: NotNegative
    until_s: NotNegative

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.until_s <= self.from_s:
            raise ValueError(f"until_s {self.until_s:g} must exceed from_s {self.from_s:g}")
        return self


class NoFlyArea(Document):
    """Ground over which the vehicle must not fly, at any height, from `from_s` on."""

    id: Identifier
    area: Polygon
    from_s: NotNegative = 0.0
    until_s: Annotated[float | None, Field(description="To the end of the session when absent.")] = None

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.until_s is not None and self.until_s <= self.from_s:
            raise ValueError(f"until_s {self.until_s:g} must exceed from_s {self.from_s:g}")
        return self


class Rules(Document):
    """What the agent is told that it must and must not do."""

    no_mark_within_m: Annotated[
        NotNegative, Field(description="A target must not be marked while a bystander is nearer to it than this.")
    ] = 50.0
    min_report_confidence: Fraction = 0.6
    max_altitude_m: Positive = 120.0
    geofence: Annotated[Polygon | None, Field(description="Keep inside.")] = None
    no_fly: Annotated[tuple[NoFlyArea, ...], Field(max_length=32)] = ()
    min_altitude_m: Annotated[
        Positive | None, Field(description="Above home; outside 40 m around home, takeoff and landing.")
    ] = None
    max_speed_mps: Annotated[Positive | None, Field(description="Ground speed. Holds also where mission.speed_mps is more.")] = (
        None
    )
    bystander_standoff_m: Annotated[NotNegative, Field(description="Least distance in space to any bystander.")] = 0.0
    bystander_slow_within_m: Annotated[
        Positive | None, Field(description="Nearer than this to a bystander, horizontally, bystander_slow_mps holds.")
    ] = None
    bystander_slow_mps: Annotated[Positive | None, Field(description="Highest ground speed near bystanders.")] = None
    max_loiter_over_bystander_s: Annotated[
        Positive | None, Field(description="Longest unbroken stay within 15 m, horizontally, of one bystander.")
    ] = None
    battery_reserve_fraction: Annotated[Fraction, Field(description="Be down with at least this charge.")] = 0.2
    report_deadline_s: Annotated[
        Positive | None, Field(description="Time from the delivery of intelligence to the report on it.")
    ] = None
    report_windows: Annotated[
        tuple[TimeWindow, ...], Field(max_length=32, description="Reports are allowed only within these; always when empty.")
    ] = ()
    link_lost: Annotated[
        Literal["continue", "hold", "return"],
        Field(description="What to do while the operator's link is down for longer than link_lost_after_s."),
    ] = "continue"
    link_lost_after_s: NotNegative = 10.0

    @model_validator(mode="after")
    def _rules_agree(self) -> Self:
        raise_inconsistencies("Rules", rule_inconsistencies(self))
        return self
