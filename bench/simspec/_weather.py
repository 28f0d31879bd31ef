"""Light and weather."""

from __future__ import annotations

import datetime as dt
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, model_validator

from bench.documents import Document, added_field


class Wind(Document):
    """Mean wind and turbulence near the ground."""

    speed_mps: float = Field(0.0, ge=0.0, le=20.0, description="Mean wind speed.")
    from_deg: float = Field(
        0.0, ge=0.0, lt=360.0, description="Direction from which the wind blows, clockwise from north."
    )
    turbulence_mps: float = Field(
        0.0,
        ge=0.0,
        le=20.0,
        description="Wind at 6 m height, which scales the Dryden gusts (W20 of MIL-F-8785C); 0 for no gusts.",
    )


WeatherLevel = Annotated[float, Field(ge=0.0, le=9.0)]


def _moment(value: object) -> dt.datetime:
    """A date and a time of day of ISO 8601; in UTC where they have no time zone, which the field's name promises."""
    if isinstance(value, str):
        try:
            # Of a date alone nobody knows where the sun is.
            has_time = ":" in value or "T" in value.upper()
            moment = dt.datetime.fromisoformat(value.upper()) if has_time else None
        except ValueError:
            moment = None
    else:
        # No number: pydantic would take it for seconds, or for milliseconds, since 1970.
        moment = value if isinstance(value, dt.datetime) else None
    if moment is None:
        raise ValueError(
            f"{str(value)[:60]!r} is no date with a time of day; write 2026-06-21T11:30:00Z, which is UTC, or "
            "2026-06-21T13:30:00+02:00 with another zone"
        )
    try:
        # In UTC whatever zone states it: texts and digests of one moment are then equal.
        return (moment if moment.tzinfo is not None else moment.replace(tzinfo=dt.UTC)).astimezone(dt.UTC)
    except OverflowError:
        # Within a day of the year 1 or 9999, both of which are refused as years.
        return moment.replace(tzinfo=dt.UTC)


# GPS time begins on 6 January 1980, so 1981 is its first whole year. The upper end is chosen.
FIRST_YEAR, YEAR_AFTER_LAST = 1981, 2100


class Environment(Document):
    """Light and weather. The levels are those of the paper: 0 for none, 9 for the worst."""

    start_utc: Annotated[
        dt.datetime,
        BeforeValidator(_moment),
        Field(
            description="The moment at which simulated time is zero, in UTC if it states no zone. It decides where the sun is."
        ),
        # Within minutes of solar noon over the default origin, near the longest day of the year.
    ] = dt.datetime(2026, 6, 21, 11, 30, tzinfo=dt.UTC)
    rain_level: WeatherLevel = 0.0
    fog_level: WeatherLevel = 0.0
    dust_level: WeatherLevel = added_field(0.0)
    visibility_m: float | None = added_field(
        None,
        "Distance at which 2 % of the contrast is left, through all that is in the air together. The fog level follows from it, "
        "and is not stated then.",
        gt=0.0,
        le=25_000.0,
    )
    wind: Wind = Wind()

    @model_validator(mode="after")
    def _fog_is_stated_once(self) -> Self:
        if self.visibility_m is not None and self.fog_level:
            raise ValueError("give either fog_level or visibility_m, from which the fog level follows")
        return self

    @model_validator(mode="after")
    def _satellites_count_the_year(self) -> Self:
        if not FIRST_YEAR <= self.start_utc.year < YEAR_AFTER_LAST:
            raise ValueError(
                f"the year of start_utc must be {FIRST_YEAR} to {YEAR_AFTER_LAST - 1}, which satellite navigation can count"
            )
        return self
