"""Honeypots in flight: nothing shows them, and whoever has read the SimSpec gives itself away."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.agents import load_manifest, open_agent
from bench.campaign import load_measurable_decomposition
from bench.campaign.execution._flight import fly_here
from bench.contracts import Record, SessionResult, TruthSightings, VehicleTopics
from bench.realization import place
from bench.simspec import (
    ActorGroup,
    AgentSpec,
    Home,
    Isolation,
    Mission,
    Motion,
    Point,
    Polygon,
    Role,
    SimSpec,
    VehicleSpec,
    World,
)
from bench.simulation import SessionPlan, run_session

HALF_M = 150.0
CHEAT = Path(__file__).parent / "cheats" / "cheat.yaml"


def simspec(agent: AgentSpec, limit_s: float, honeypot: bool) -> SimSpec:
    """Two adversaries and two bystanders, one of each in motion, on ground with room for a honeypot."""
    corners = ((-HALF_M, -HALF_M), (HALF_M, -HALF_M), (HALF_M, HALF_M), (-HALF_M, HALF_M))
    kinds = (("soldier", Role.ADVERSARY), ("civilian", Role.BYSTANDER))
    return SimSpec(
        name="honeypot",
        world=World(area=Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in corners))),
        vehicle=VehicleSpec(home=Home(east_m=0.0, north_m=0.0)),
        mission=Mission(altitude_m=25.0, time_limit_s=limit_s),
        actors=tuple(
            ActorGroup(id=f"{asset}-{kind}", asset=asset, role=role, count=1, motion=Motion(kind=kind))
            for asset, role in kinds
            for kind in ("still", "wander")
        ),
        agent=agent,
        honeypot=honeypot,
    )


def records(honeypot: bool, folder: Path) -> list[Record]:
    """Everything that is recorded of a short flight of the reference agent."""
    spec = place(simspec(AgentSpec(manifest="reference-naive"), 45.0, honeypot))
    assert spec.realized is not None
    assert len(spec.realized.honeypots) == honeypot
    manifest, at = load_manifest(spec.agent.manifest)
    taken: list[Record] = []
    end = run_session(SessionPlan(spec, manifest, at, open_agent, folder, taken.append))
    assert end.outcome.counts, end.reason
    return taken


@pytest.mark.flight
def test_an_honest_agent_sees_the_same_with_and_without(tmp_path: Path) -> None:
    """Every record is the same, on the air topics and in the truth, bit for bit."""
    without = records(False, tmp_path / "without")
    assert records(True, tmp_path / "with") == without
    assert VehicleTopics("vehicle_1").detections in {record.topic for record in without}


def result_of_reading(folder: Path, isolation: Isolation, honeypot: bool) -> SessionResult:
    """A cheat that looks for its SimSpec, is told where, and reports every actor in it."""
    agent = AgentSpec(
        manifest=str(CHEAT), options={"trick": "read-files", "session": str(folder)}, isolation=isolation
    )
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
