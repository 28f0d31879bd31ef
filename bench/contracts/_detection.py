"""The stated detection model, as detector and surrogates share it; docs/detection.md has the sources."""

from __future__ import annotations

import math

# The contrast threshold of Koschmieder's meteorological range: 3.912 / b, and 3.912 = -ln 0.02.
THRESHOLD_CONTRAST = 0.02
"""Apparent contrast below which nothing is seen at any size: the meteorological range ends there."""

DAY_SUN_RAD = math.radians(6.0)
# The end of civil twilight.
NIGHT_SUN_RAD = math.radians(-6.0)
"""Sun elevation above which light costs no contrast, and below which only `night_contrast` is left."""

LABEL_EVIDENCE = 1.5
"""Distance between the evidence for right and for wrong labels, in its standard deviations."""

LEAST_DOUBT = 0.02
"""The detector never claims to be surer of a label than 1 minus this before it weighs the evidence."""

FALSE_SCORE = (2.0, 5.0)
"""Parameters of the beta distribution from which false detections draw their scores."""


def light_of(elevation_rad: float, night_contrast: float) -> float:
    """Share of contrast that the light leaves: 1 by day, `night_contrast` by night, smooth in twilight."""
    x = min(1.0, max(0.0, (elevation_rad - NIGHT_SUN_RAD) / (DAY_SUN_RAD - NIGHT_SUN_RAD)))
    return night_contrast + (1.0 - night_contrast) * x * x * (3.0 - 2.0 * x)
