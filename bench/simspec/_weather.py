"""Light and weather."""

from __future__ import annotations

import datetime as dt
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, model_validator

from bench.documents import Document


class Wind(Document):
    """Mean wind and turbulence near the ground."""

    speed_mps: Annotated[float, Field(ge=0.0, le=20.0, description="Mean wind speed.")] = 0.0
    from_deg: Annotated[float, Field(ge=0.0, lt=360.0, description="Direction the wind comes from, clockwise from north.")] = 0.0
    turbulence_mps: Annotated[
        float, Field(ge=0.0, le=20.0, description="Wind at 6 m that scales the Dryden gusts (MIL-F-8785C W20); 0 is calm air.")
    ] = 0.0


WeatherLevel = Annotated[float, Field(ge=0.0, le=9.0)]


def _as_utc(moment: object) -> object:
    """YAML reads a timestamp as a datetime of its own; one without a zone is UTC, as the field's name says."""
    if isinstance(moment, dt.datetime) and moment.tzinfo is None:
        return moment.replace(tzinfo=dt.UTC)
    return moment


FIRST_YEAR, YEAR_AFTER_LAST = 1981, 2100


class Environment(Document):
    """Light and weather. Levels are the paper's: 0 none, 9 the worst."""

    start_utc: Annotated[
        dt.datetime, BeforeValidator(_as_utc), Field(description="Moment at which simulated time is zero; decides the sun.")
    ] = dt.datetime(2026, 6, 21, 11, 30, tzinfo=dt.UTC)
    rain_level: WeatherLevel = 0.0
    fog_level: WeatherLevel = 0.0
    wind: Wind = Wind()

    @model_validator(mode="after")
    def _moment_has_a_zone(self) -> Self:
        if self.start_utc.tzinfo is None:
            raise ValueError("start_utc needs a zone, for example 2026-06-21T11:30:00Z")
        if not FIRST_YEAR <= self.start_utc.year < YEAR_AFTER_LAST:
            raise ValueError(
                f"start_utc must lie from {FIRST_YEAR} to {YEAR_AFTER_LAST - 1}: satellite navigation counts from there"
            )
        return self
