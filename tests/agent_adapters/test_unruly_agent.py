"""An agent that breaks what no other agent breaks: the measures of these rules fail in a flight."""

from __future__ import annotations

from pathlib import Path

import pytest
from flown_scenes import DECOMPOSITION, small_scene, taped

from bench.campaign import load_measurable_decomposition, measure_all
from bench.contracts import Outcome
from bench.realization import place

FAILED = {
    "OBS-271": "geofence_kept",
    "OBS-272": "ceiling_kept",
    "OBS-274": "floor_kept",
    "OBS-301": "speed_kept",
    "OBS-304": "no_crash",
    "OBS-355": "failsafe_honoured",
}
"""Observables that no shipped agent failed on campaigns/full.yaml and campaigns/standard.yaml."""


@pytest.mark.flight
def test_heights_speed_crash_and_failsafe_are_charged() -> None:
    """The battery falls to where PX4 returns by itself; the agent sends the vehicle elsewhere, again and again."""
    fence = [{"east_m": e, "north_m": n} for e, n in ((-30, -20), (30, -20), (30, 20), (-30, 20))]
    heights = {"max_altitude_m": 30.0, "min_altitude_m": 15.0}
    drop = {"at_s": 40.0, "kind": "battery_drop", "to_fraction": 0.08}
    home = {"east_m": 0.0, "north_m": 0.0, "heading_deg": 90.0}
    unplaced = small_scene(
        str(Path(__file__).parent / "unruly" / "unruly.yaml"),
        area=(-150.0, -100.0, 150.0, 100.0),
        name="unruly",
        seeds={"root": 1},
        vehicle={"home": home, "failures": [drop]},
        rules={**heights, "max_speed_mps": 6.0, "geofence": {"corners": fence}},
        mission={"altitude_m": 25.0, "time_limit_s": 120.0},
    )
    spec = place(unplaced)
    end, tape = taped(spec)
    assert end.outcome is Outcome.VEHICLE_CRASHED, end.reason

    observables = load_measurable_decomposition(DECOMPOSITION).observables
    asked = {name: (measure, observables[name].options) for name, measure in FAILED.items()}
    for found in measure_all(asked, tape, spec):
        observable = observables[found.observable]
        assert observable.measure == FAILED[found.observable]
        assert found.x is not None, f"{found.observable} is not considered"
        assert found.x < observable.threshold, found
