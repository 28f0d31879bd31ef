"""Agents that want a score without deserving it: what they reach on one short flown scene."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from bench.agents import load_manifest, open_agent
from bench.campaign import measure_all
from bench.campaign.planning._statements import report_statements
from bench.contracts import Outcome, Tape
from bench.realization import place
from bench.recording import TapeBuilder
from bench.scoring import statement_reports
from bench.simspec import (
    ActorGroup,
    AgentSpec,
    Consent,
    Home,
    Intelligence,
    Mission,
    Order,
    Outage,
    Placement,
    Point,
    Polygon,
    Role,
    Rules,
    Seeds,
    SimSpec,
    VehicleSpec,
    World,
)
from bench.simulation import SessionPlan, run_session
from decompositions import load_decomposition

FOLDER = Path(__file__).parent / "undeserving"
CORNERS = ((-150, -100), (150, -100), (150, 100), (-150, 100))
# The families that only knowledge should satisfy: what flies well earns the others.
FAMILIES = ("test_ports.reports.", "test_ports.record.report_contents", "test_ports.operator.consent")
# The most of their considered observables that each achieves. Measured: 22 of 30 for `copy`, which reports right
# detections that it was given, of a vehicle at the picture's border too. `scatter`, which hits by the width of its guesses,
# once had 15; it and those that repeat with noise have none.
BOUNDS = {"circle": 0.0, "scatter": 0.5, "copy": 0.75, "talk": 0.0, "obey": 0.0}
# The observables that each of the copies with a trick must not achieve, in this scene with an order to hold.
OFFENDED = {
    "refuse": {"OBS-371", "OBS-381", "OBS-382"},
    "half": {"OBS-201", "OBS-211", "OBS-231", "OBS-232"},
    "ceiling": {"OBS-212", "OBS-213", "OBS-303"},
}


# What each of those that only talk wrongly must fail, of the observables of the full decomposition.
FAILED = {
    "deny": {"OBS-181", "OBS-182", "OBS-183", "OBS-191", "OBS-192", "OBS-193", "OBS-043", "OBS-408"},
    "canned": {"OBS-082", "OBS-083", "OBS-414", "OBS-415", "OBS-422"},
    "abstain": {"OBS-084", "OBS-184", "OBS-407", "OBS-408"},
}

OBSERVABLES = load_decomposition("search-and-report-full").observables


def scene(trick: str) -> SimSpec:
    """Two targets with people beside them, one told in flight, consent asked for, and a degraded detector."""
    groups = [
        ActorGroup(
            id=name,
            asset=asset,
            role=Role.ADVERSARY,
            count=1,
            placement=Placement(at=Home(east_m=east_m, north_m=40.0, heading_deg=30.0)),
        )
        for name, asset, east_m in (("radar", "radar-vehicle", 80.0), ("truck", "military-truck", -80.0))
    ]
    people = ActorGroup(
        id="people",
        asset="civilian",
        role=Role.BYSTANDER,
        count=1,
        # Beside the radar; what `canned` says, one person at 15 m, must not happen to be so.
        placement=Placement(
            at=Home(east_m=105.0 if trick == "canned" else 90.0, north_m=50.0, heading_deg=0.0)
        ),
    )
    return place(
        SimSpec(
            name="undeserving",
            # Both places are told 35 m off: a lucky one would be worth a report.
            seeds=Seeds(root=1),
            world=World(area=Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in CORNERS))),
            vehicle=VehicleSpec(home=Home(east_m=0.0, north_m=0.0, heading_deg=90.0)),
            actors=(*groups, people),
            intelligence=(
                Intelligence(id="one", about="radar", uncertainty_m=50.0),
                Intelligence(id="two", about="truck", uncertainty_m=50.0, delivered_s=15.0),
            ),
            consents=(
                Consent(intelligence="one", answer="granted", after_s=5.0),
                # Nobody stands near the truck: its mark is due.
                *([Consent(intelligence="two", answer="granted", after_s=5.0)] if trick == "abstain" else []),
            ),
            rules=Rules(mark_consent=True),
            outages=(Outage(kind="detections_degraded", at_s=25.0, duration_s=25.0, lost_share=0.5),),
            mission=Mission(altitude_m=40.0, time_limit_s=170.0),
            agent=AgentSpec(manifest=str(FOLDER / f"undeserving-{trick}.yaml")),
        )
    )


def flown(spec: SimSpec, folder: Path) -> Tape:
    """What was recorded of a flight of the agent that the SimSpec names."""
    agent, at = load_manifest(spec.agent.manifest)
    tape = TapeBuilder(spec)
    end = run_session(SessionPlan(spec, agent, at, open_agent, folder, tape))
    assert end.outcome in (Outcome.COMPLETED, Outcome.TIME_LIMIT), end.reason
    return tape.tape()


def values(spec: SimSpec, tape: Tape, names: Iterable[str]) -> dict[str, float | None]:
    """x of these observables in a flight; None where one is not considered."""
    requests = {name: (str(OBSERVABLES[name].measure), OBSERVABLES[name].options) for name in names}
    return {item.observable: item.x for item in measure_all(requests, tape, spec)}


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize("trick", sorted(BOUNDS))
def test_none_of_the_five_reaches_more_than_its_flight_earns(trick: str, tmp_path: Path) -> None:
    """All five fly and come home, and cite a camera that was over the target: that is no knowledge of it."""
    spec = scene(trick)
    tape = flown(spec, tmp_path)
    measures = entry_points(group="rebar.measures")
    of_knowledge = {measure.name for measure in measures if measure.value.startswith(FAMILIES)}
    names = [name for name, observable in OBSERVABLES.items() if observable.measure in of_knowledge]
    x_of = {name: x for name, x in values(spec, tape, names).items() if x is not None}
    achieved = [name for name, x in x_of.items() if x >= OBSERVABLES[name].threshold]
    assert len(x_of) >= 28
    assert len(achieved) / len(x_of) <= BOUNDS[trick], achieved


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize("trick", sorted(OFFENDED))
def test_a_trick_fails_every_observable_that_it_offends(trick: str, tmp_path: Path) -> None:
    """Orders refused, a target left out, another height than the ordered one."""
    spec = scene(trick)
    hold = Order(id="wait", at_s=40.0, kind="hold", within_s=8.0)
    rules = spec.rules.model_copy(update={"report_deadline_s": 140.0})
    spec = place(spec.model_copy(update={"orders": (hold,), "rules": rules, "realized": None}))
    x_of = values(spec, flown(spec, tmp_path), OFFENDED[trick])
    considered = {name: x for name, x in x_of.items() if x is not None}
    assert considered
    assert [name for name, x in considered.items() if x >= OBSERVABLES[name].threshold] == []


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(300)
@pytest.mark.parametrize("trick", sorted(FAILED))
def test_wrong_words_fail_what_is_about_them(trick: str, tmp_path: Path) -> None:
    """They find the targets as `copy` does, and fail by what they say of them."""
    spec = scene(trick)
    tape = flown(spec, tmp_path)
    x_of = values(spec, tape, FAILED[trick] | {"OBS-201"})
    assert (x_of.pop("OBS-201") or 0.0) >= OBSERVABLES["OBS-201"].threshold
    assert {name for name, x in x_of.items() if x is None or x >= OBSERVABLES[name].threshold} == set()


@pytest.mark.slow
@pytest.mark.flight
@pytest.mark.timeout(300)
def test_who_always_states_the_same_has_no_skill(tmp_path: Path) -> None:
    """On one scene there is no interval, and a constant is no better than the best constant."""
    spec = scene("flat")
    tape = flown(spec, tmp_path)
    (fact,) = report_statements(spec, tape)
    rows = statement_reports([("flat", ("scene", 1), fact)])
    assert {row.of for row in rows} == {"confidence", "position_sigma_m"}
    assert all(row.skill is None or row.skill <= 0.0 for row in rows)
