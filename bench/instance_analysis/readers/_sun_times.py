"""The moment of sunrise, sunset, noon or midnight on a day at a place."""

from __future__ import annotations

import datetime as dt
import math
from typing import Literal

from bench.simspec import sun_at

HORIZON_RAD = math.radians(-0.833)
"""Height of the sun's middle when its upper rim is on the horizon, with the usual refraction."""


def sun_moment(
    what: Literal["rise", "set", "noon", "midnight"], day: dt.date, latitude_deg: float, longitude_deg: float
) -> dt.datetime | None:
    """The moment in UTC, to the minute; None where the sun does not rise or set that day.

    The day is the one whose solar noon lies on the date in UTC; midnight is the one after it.
    """
    begin = dt.datetime.combine(day, dt.time(), dt.UTC)
    # By trying all minutes: the formula of the sun's position has no inverse.
    noon = min(
        (begin + dt.timedelta(minutes=m) for m in range(1440)),
        key=lambda at: sun_at(at, latitude_deg, longitude_deg).hours_from_noon,
    )
    if what == "noon":
        return noon
    if what == "midnight":
        return noon + dt.timedelta(hours=12)
    step = dt.timedelta(minutes=-1 if what == "rise" else 1)
    for minutes in range(721):
        at = noon + minutes * step
        if sun_at(at, latitude_deg, longitude_deg).elevation_rad < HORIZON_RAD:
            return at - step if what == "rise" else at
    return None
