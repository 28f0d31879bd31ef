"""The same scene is the same flight everywhere on earth, with the reference agent and a null agent."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.agents import load_manifest, open_agent
from bench.campaign import load_measurable_decomposition, measure_all, measures_of
from bench.contracts import Observation, Outcome
from bench.realization import place
from bench.recording import TapeBuilder
from bench.simspec import SimSpec
from bench.simulation import SessionPlan, run_session

Where = tuple[float, float, float]
"""Latitude, longitude, altitude."""

USUAL: Where = (47.3977, 8.5456, 10.0)
# The vehicle starts 40 m west of the origin and flies to 30 m east of it, so it crosses what lies there.
PLACES: dict[str, Where] = {
    "equator and Greenwich": (0.0, 0.0, 0.0),
    "Greenwich": (51.4778, 0.0, 10.0),
    "date line, origin at 180": (0.0, 180.0, 10.0),
    "date line, origin at -180": (-17.0, -180.0, 10.0),
    "date line, east of the origin": (60.0, 179.9999, 10.0),
    "date line, west of the origin": (60.0, -179.9999, 10.0),
    "south and west": (-54.8, -68.3, 10.0),
    "near the north pole": (85.0, 0.0, 10.0),
    "near the south pole, date line": (-85.0, -180.0, 10.0),
}
# Between two places the rotation of the earth and gravity differ, and what autopilots report is rounded to 1e-7
# degrees: 1.1 cm along a meridian.
SAME_TRACK_M = 0.03


def scene(where: Where, agent: str, autopilot: str) -> SimSpec:
    """A target and a bystander 70 m from home, seen without errors: no draw decides at a centimetre."""
    corners = [{"east_m": e, "north_m": n} for e, n in ((-60, -60), (60, -60), (60, 60), (-60, 60))]

    def actor(name: str, asset: str, role: str, east_m: float) -> dict[str, Any]:
        at = {"east_m": east_m, "north_m": 20.0, "heading_deg": 30.0}
        return {"id": name, "asset": asset, "role": role, "count": 1, "placement": {"at": at}}

    latitude, longitude, altitude = where
    document = {
        "name": "everywhere",
        "world": {
            "origin": {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude},
            "area": {"corners": corners},
        },
        "vehicle": {
            "autopilot": autopilot,
            "home": {"east_m": -40.0, "north_m": 0.0, "heading_deg": 90.0},
        },
        "actors": [
            actor("radar", "radar-vehicle", "adversary", 30.0),
            actor("walker", "civilian", "bystander", 18.0),
        ],
        "intelligence": [{"id": "sighting", "about": "radar", "uncertainty_m": 10.0}],
        "perception": {"source": "truth"},
        "mission": {"altitude_m": 20.0, "time_limit_s": 90.0},
        "agent": {"manifest": agent},
    }
    return place(SimSpec.model_validate(document))


@cache
def flown(where: Where, agent: str, autopilot: str) -> tuple[NDArray[np.float64], Sequence[Observation]]:
    """The true track, and every observation."""
    spec = scene(where, agent, autopilot)
    manifest, at = load_manifest(agent)
    tape = TapeBuilder(spec)
    with tempfile.TemporaryDirectory() as folder:
        end = run_session(SessionPlan(spec, manifest, at, open_agent, Path(folder), tape))
    assert end.outcome is Outcome.COMPLETED, end
    decomposition = load_measurable_decomposition("search-and-report-full")
    built = tape.tape()
    return built.vehicle_position_enu_m, measure_all(measures_of(decomposition), built, spec)


def assert_same_observables(one: Sequence[Observation], other: Sequence[Observation]) -> None:
    for a, b in zip(one, other, strict=True):
        assert (a.observable, a.considered) == (b.observable, b.considered)
        # A share of time in bounds changes by one sample where the height meets a bound within millimetres.
        assert b.x == (None if a.x is None else pytest.approx(a.x, abs=0.02)), (a, b)


@pytest.mark.parametrize(
    ("where", "agent", "autopilot"),
    [
        # By turns: each agent meets the date line and a pole.
        *(
            (where, ("reference-naive", "null-mark")[number % 2], "px4")
            for number, where in enumerate(PLACES)
        ),
        ("date line, east of the origin", "reference-naive", "ardupilot"),
        ("near the south pole, date line", "null-mark", "ardupilot"),
    ],
)
def test_a_scene_is_the_same_flight_everywhere(where: str, agent: str, autopilot: str) -> None:
    usual_m, usual = flown(USUAL, agent, autopilot)
    track_m, observations = flown(PLACES[where], agent, autopilot)

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
