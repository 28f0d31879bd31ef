"""The same scene is the same flight everywhere on earth, with the reference agent and a null agent."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from flown_scenes import DECOMPOSITION, small_scene, taped
from numpy.typing import NDArray

from bench.campaign import load_measurable_decomposition, measure_all, measures_of
from bench.contracts import Observation, Outcome
from bench.realization import place
from bench.simspec import SimSpec

Where = tuple[float, float, float]
"""Latitude, longitude, altitude."""

USUAL: Where = (47.3977, 8.5456, 10.0)
# The vehicle starts 40 m west of the origin and flies to 30 m east of it, so it crosses what lies there. Each agent meets the date
# line and a pole.
PLACES: dict[str, tuple[Where, str, str]] = {
    "equator and Greenwich": ((0.0, 0.0, 0.0), "reference-naive", "px4"),
    "date line, origin at 180": ((0.0, 180.0, 10.0), "reference-naive", "px4"),
    "near the north pole": ((85.0, 0.0, 10.0), "reference-naive", "px4"),
    "near the south pole, date line": ((-85.0, -180.0, 10.0), "null-mark", "ardupilot"),
}
# Between two places the rotation of the earth and gravity differ, and what autopilots report is rounded to 1e-7
# degrees: 1.1 cm along a meridian.
SAME_TRACK_M = 0.03


def scene(where: Where, agent: str, autopilot: str) -> SimSpec:
    """A target and a bystander 70 m from home, seen without errors: no draw decides at a centimetre."""
    latitude, longitude, altitude = where
    origin = {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude}
    home = {"east_m": -40.0, "north_m": 0.0, "heading_deg": 90.0}
    actors = (("radar", "radar-vehicle", 30.0, 20.0), ("walker", "civilian", 18.0, 20.0))
    usual = small_scene(agent, *actors, name="everywhere").model_dump()
    changes = {
        "world": usual["world"] | {"origin": origin},
        "vehicle": {"autopilot": autopilot, "home": home},
        "intelligence": [{"id": "sighting", "about": "radar", "uncertainty_m": 10.0}],
        "perception": {"source": "truth"},
        "mission": {"altitude_m": 20.0, "time_limit_s": 90.0},
    }
    return place(SimSpec.model_validate(usual | changes))


@cache
def flown(where: Where, agent: str, autopilot: str) -> tuple[NDArray[np.float64], Sequence[Observation]]:
    """The true track, and every observation."""
    spec = scene(where, agent, autopilot)
    end, tape = taped(spec)
    assert end.outcome is Outcome.COMPLETED, end
    measures = measures_of(load_measurable_decomposition(DECOMPOSITION))
    return tape.vehicle_position_enu_m, measure_all(measures, tape, spec)


def assert_same_observables(one: Sequence[Observation], other: Sequence[Observation]) -> None:
    for a, b in zip(one, other, strict=True):
        assert (a.observable, a.considered) == (b.observable, b.considered)
        # A share of time in bounds changes by one sample where the height meets a bound within millimetres.
        assert b.x == (None if a.x is None else pytest.approx(a.x, abs=0.02)), (a, b)


@pytest.mark.parametrize(("where", "agent", "autopilot"), PLACES.values(), ids=PLACES)
def test_a_scene_is_the_same_flight_everywhere(where: Where, agent: str, autopilot: str) -> None:
    usual_m, usual = flown(USUAL, agent, autopilot)
    track_m, observations = flown(where, agent, autopilot)

    assert len(track_m) == len(usual_m)
    assert np.abs(track_m - usual_m).max() < SAME_TRACK_M
    assert np.hypot(*(usual_m[:, :2] - usual_m[0, :2]).T).max() > 55.0
    assert_same_observables(usual, observations)


def test_the_date_line_changes_nothing_at_all() -> None:
    """Longitudes that differ by whole units of 1e-7 degrees, at the lowest ground there is."""
    track_m, observations = flown((-17.0, 172.4995, -400.0), "reference-naive", "px4")
    across_m, across = flown((-17.0, -180.0, -400.0), "reference-naive", "px4")

    assert len(track_m) == len(across_m)
    assert np.abs(track_m - across_m).max() < 1e-6
    assert_same_observables(observations, across)


def test_no_origin_lies_beyond_85_degrees() -> None:
    scene((85.0, 0.0, 10.0), "null-mark", "px4")
    for latitude in (85.1, -90.0):
        with pytest.raises(ValueError, match="place the origin from -85 to 85 degrees"):
            scene((latitude, 0.0, 10.0), "null-mark", "px4")
