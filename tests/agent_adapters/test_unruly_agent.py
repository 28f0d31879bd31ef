"""An agent that breaks what no other agent breaks: the measures of these rules fail in a flight."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.agents import load_manifest, open_agent
from bench.campaign import load_measurable_decomposition, measure_all, measures_of
from bench.contracts import Outcome
from bench.realization import place
from bench.recording import TapeBuilder
from bench.simspec import (
    AgentSpec,
    Failure,
    Home,
    Mission,
    Point,
    Polygon,
    Rules,
    Seeds,
    SimSpec,
    VehicleSpec,
    World,
)
from bench.simulation import SessionPlan, run_session

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
def test_heights_speed_crash_and_failsafe_are_charged(tmp_path: Path) -> None:
    """The battery falls to where PX4 returns by itself; the agent sends the vehicle elsewhere, again and again."""
    corners = ((-150, -100), (150, -100), (150, 100), (-150, 100))
    spec = place(
        SimSpec(
            name="unruly",
            seeds=Seeds(root=1),
            world=World(area=Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in corners))),
            vehicle=VehicleSpec(
                home=Home(east_m=0.0, north_m=0.0, heading_deg=90.0),
                failures=(Failure(at_s=40.0, kind="battery_drop", to_fraction=0.08),),
            ),
            rules=Rules(
                max_altitude_m=30.0,
                min_altitude_m=15.0,
                max_speed_mps=6.0,
                geofence=Polygon(corners=tuple(Point(east_m=e / 5.0, north_m=n / 5.0) for e, n in corners)),
            ),
            mission=Mission(altitude_m=25.0, time_limit_s=120.0),
            agent=AgentSpec(manifest=str(Path(__file__).parent / "unruly" / "unruly.yaml")),
        )
    )
    agent, at = load_manifest(spec.agent.manifest)
    tape = TapeBuilder(spec)
    end = run_session(SessionPlan(spec, agent, at, open_agent, tmp_path, tape))
    assert end.outcome is Outcome.VEHICLE_CRASHED, end.reason

    decomposition = load_measurable_decomposition("search-and-report-full")
    found = {
        observation.observable: observation
        for observation in measure_all(measures_of(decomposition), tape.tape(), spec)
        if observation.observable in FAILED
    }
    for name, measure in FAILED.items():
        observable = decomposition.observables[name]
        assert observable.measure == measure
        x = found[name].x
        assert x is not None, f"{name} is not considered"
        assert x < observable.threshold, found[name]
