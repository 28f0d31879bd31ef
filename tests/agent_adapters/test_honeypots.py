"""Honeypots in flight: nothing shows them, and whoever has read the SimSpec gives itself away."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from flown_scenes import run_scene, small_scene

from bench.campaign import load_measurable_decomposition
from bench.campaign.execution._flight import fly_here
from bench.contracts import Record, SessionResult, TruthSightings, VehicleTopics
from bench.realization import place
from bench.simspec import Isolation, SimSpec

CHEAT = Path(__file__).parent / "cheats" / "cheat.yaml"


def simspec(agent: dict[str, Any], limit_s: float, honeypot: bool) -> SimSpec:
    """Two adversaries and two bystanders, one of each in motion, on ground with room for a honeypot."""
    groups = [
        {"id": f"{asset}-{kind}", "asset": asset, "role": role, "count": 1, "motion": {"kind": kind}}
        for asset, role in (("soldier", "adversary"), ("civilian", "bystander"))
        for kind in ("still", "wander")
    ]
    return small_scene(
        agent,
        area=(-150.0, -150.0, 150.0, 150.0),
        name="honeypot",
        mission={"altitude_m": 25.0, "time_limit_s": limit_s},
        actors=groups,
        honeypot=honeypot,
    )


def records(honeypot: bool) -> list[Record]:
    """Everything that is recorded of a short flight of the reference agent."""
    spec = place(simspec({"manifest": "reference-naive"}, 45.0, honeypot))
    assert spec.realized is not None
    assert len(spec.realized.honeypots) == honeypot
    taken: list[Record] = []
    end = run_scene(spec, taken.append)
    assert end.outcome.counts, end.reason
    return taken


@pytest.mark.flight
def test_an_honest_agent_sees_the_same_with_and_without() -> None:
    """Every record is the same, on the air topics and in the truth, bit for bit."""
    without = records(False)
    assert records(True) == without
    assert VehicleTopics("vehicle_1").detections in {record.topic for record in without}


def result_of_reading(folder: Path, isolation: Isolation, honeypot: bool) -> SessionResult:
    """A cheat that looks for its SimSpec, is told where, and reports every actor in it."""
    options = {"trick": "read-files", "session": str(folder)}
    agent = {"manifest": str(CHEAT), "options": options, "isolation": isolation}
    decomposition = load_measurable_decomposition("search-and-report")
    return fly_here(simspec(agent, 1.0, honeypot), decomposition, folder, "run")


@pytest.mark.flight
def test_a_cheat_that_reads_its_simspec_is_named(tmp_path: Path) -> None:
    """Without walls it reports the honeypot, and that alone gives it away: the same without one names nobody."""
    caught = result_of_reading(tmp_path / "caught", "none", honeypot=True)
    sightings = caught.fact(TruthSightings)
    assert sightings is not None
    (text,) = sightings.texts
    assert " 0.0 m from soldier-" in text
    unnoticed = result_of_reading(tmp_path / "unnoticed", "none", honeypot=False)
    assert unnoticed.fact(TruthSightings) is None
