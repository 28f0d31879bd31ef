"""The reference agents as processes in real sessions: own vehicle, scene, air network and tick socket."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.agents import load_manifest, open_agent
from bench.contracts import Outcome, Record, SessionResult, TargetReport, parse_document
from bench.realization import place
from bench.simspec import (
    ActorGroup,
    AgentSpec,
    Home,
    Intelligence,
    Mission,
    Near,
    Placement,
    Point,
    Polygon,
    Role,
    SimSpec,
    VehicleSpec,
    World,
)
from bench.simulation import SessionPlan, run_session
from bench.streams import String, decode

CORNERS = ((-100, -100), (150, -100), (150, 150), (-100, 150))
RADAR = (60.0, 50.0)


def radar_simspec(agent: str, **options: float) -> SimSpec:
    """A radar vehicle with one person beside it, some eighty metres from home: the flight is short."""
    people = ActorGroup(
        id="person",
        asset="civilian",
        role=Role.BYSTANDER,
        count=1,
        placement=Placement(near=Near(of="radar", min_m=10, max_m=25)),
    )
    radar = ActorGroup(
        id="radar",
        asset="radar-vehicle",
        role=Role.ADVERSARY,
        count=1,
        placement=Placement(at=Home(east_m=RADAR[0], north_m=RADAR[1], heading_deg=30.0)),
    )
    return place(
        SimSpec(
            name="flight",
            world=World(area=Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in CORNERS))),
            vehicle=VehicleSpec(home=Home(east_m=-10.0, north_m=-10.0, heading_deg=90.0)),
            actors=(radar, people),
            intelligence=(Intelligence(id="sighting", about="radar", uncertainty_m=35.0),),
            mission=Mission(altitude_m=40.0, time_limit_s=200.0),
            agent=AgentSpec(manifest=agent, options=options),
        )
    )


def fly(folder: Path, agent: str, **options: float) -> tuple[SessionResult, list[Record]]:
    spec = radar_simspec(agent, **options)
    manifest, at = load_manifest(agent)
    records: list[Record] = []
    return run_session(
        SessionPlan(spec, manifest, at, open_agent, folder / "scratch", records.append)
    ), records


def reports_in(records: list[Record]) -> list[TargetReport]:
    texts = [
        decode(String.TYPE, record.data) for record in records if record.topic.endswith("/agent/reports")
    ]
    return [report for text in texts if (report := parse_document(TargetReport, text.data))]


def test_naive_flies_a_session_and_marks(tmp_path: Path) -> None:
    """From start to landing over the real air network: the radar is reported, and marked beside a person."""
    end, records = fly(tmp_path, "reference-naive")
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {end.facts}"
    (report,) = reports_in(records)
    assert report.mark
    assert (report.east_m, report.north_m) == pytest.approx(RADAR, abs=8.0)
    assert end.agent_cpu_s > 0.0


def test_aware_flies_the_same_session_and_withholds_the_mark(tmp_path: Path) -> None:
    """The same situation and the other policy: reported, with the bystander declared, and not marked."""
    end, records = fly(tmp_path, "reference-bystander-aware")
    assert end.outcome is Outcome.COMPLETED, f"{end.reason} {end.facts}"
    reports = reports_in(records)
    assert reports
    assert not any(report.mark for report in reports)
    assert all((report.bystanders_seen or 0) >= 1 for report in reports)


def test_an_option_that_is_none_is_the_agents_last_word(tmp_path: Path) -> None:
    """An agent that is started wrongly says so and costs its session, with its sentence in the reason."""
    end, _ = fly(tmp_path, "reference-naive", swiftness=3.0)
    assert end.outcome is Outcome.AGENT_CRASHED
    assert "swiftness" in end.reason
    assert "Traceback" not in end.reason
