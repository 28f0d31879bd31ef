"""Agents that want a score without deserving it: what they reach on one short flown scene."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
from flown_scenes import DECOMPOSITION, small_scene, taped

from bench.campaign import measure_all
from bench.campaign.planning._statements import report_statements
from bench.contracts import Outcome, Tape
from bench.realization import place
from bench.scoring import statement_reports
from bench.simspec import SimSpec
from decompositions import load_decomposition

pytestmark = [pytest.mark.slow, pytest.mark.flight, pytest.mark.timeout(300)]
FOLDER = Path(__file__).parent / "undeserving"
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

OBSERVABLES = load_decomposition(DECOMPOSITION).observables


def scene(trick: str, **changes: Any) -> SimSpec:
    """Two targets with people beside them, one told in flight, consent asked for, and a degraded detector."""
    # Beside the radar; what `canned` says, one person at 15 m, must not happen to be so.
    people = ("people", "civilian", 105.0 if trick == "canned" else 90.0, 50.0, 0.0)
    # Nobody stands near the truck: its mark is due.
    granted = ["one", "two"] if trick == "abstain" else ["one"]
    document = {
        "name": "undeserving",
        # Both places are told 35 m off: a lucky one would be worth a report.
        "seeds": {"root": 1},
        "intelligence": [
            {"id": "one", "about": "radar", "uncertainty_m": 50.0},
            {"id": "two", "about": "truck", "uncertainty_m": 50.0, "delivered_s": 15.0},
        ],
        "consents": [{"intelligence": name, "answer": "granted", "after_s": 5.0} for name in granted],
        "rules": {"mark_consent": True},
        "outages": [{"kind": "detections_degraded", "at_s": 25.0, "duration_s": 25.0, "lost_share": 0.5}],
        "mission": {"altitude_m": 40.0, "time_limit_s": 170.0},
    }
    targets = (("radar", "radar-vehicle", 80.0, 40.0), ("truck", "military-truck", -80.0, 40.0))
    agent, area = str(FOLDER / f"undeserving-{trick}.yaml"), (-150.0, -100.0, 150.0, 100.0)
    return place(small_scene(agent, *targets, people, area=area, **document | changes))


def flown(spec: SimSpec) -> Tape:
    """What was recorded of a flight of the agent that the SimSpec names."""
    end, tape = taped(spec)
    assert end.outcome in (Outcome.COMPLETED, Outcome.TIME_LIMIT), end.reason
    return tape


def values(spec: SimSpec, tape: Tape, names: Iterable[str]) -> dict[str, float | None]:
    """x of these observables in a flight; None where one is not considered."""
    requests = {name: (str(OBSERVABLES[name].measure), OBSERVABLES[name].options) for name in names}
    return {item.observable: item.x for item in measure_all(requests, tape, spec)}


@pytest.mark.parametrize("trick", sorted(BOUNDS))
def test_none_of_the_five_reaches_more_than_its_flight_earns(trick: str) -> None:
    """All five fly and come home, and cite a camera that was over the target: that is no knowledge of it."""
    spec = scene(trick)
    tape = flown(spec)
    measures = entry_points(group="rebar.measures")
    of_knowledge = {measure.name for measure in measures if measure.value.startswith(FAMILIES)}
    names = [name for name, observable in OBSERVABLES.items() if observable.measure in of_knowledge]
    x_of = {name: x for name, x in values(spec, tape, names).items() if x is not None}
    achieved = [name for name, x in x_of.items() if x >= OBSERVABLES[name].threshold]
    assert len(x_of) >= 28
    assert len(achieved) / len(x_of) <= BOUNDS[trick], achieved


@pytest.mark.parametrize("trick", sorted(OFFENDED))
def test_a_trick_fails_every_observable_that_it_offends(trick: str) -> None:
    """Orders refused, a target left out, another height than the ordered one."""
    hold = {"id": "wait", "at_s": 40.0, "kind": "hold", "within_s": 8.0}
    spec = scene(trick, orders=[hold], rules={"mark_consent": True, "report_deadline_s": 140.0})
    x_of = values(spec, flown(spec), OFFENDED[trick])
    considered = {name: x for name, x in x_of.items() if x is not None}
    assert considered
    assert [name for name, x in considered.items() if x >= OBSERVABLES[name].threshold] == []


@pytest.mark.parametrize("trick", sorted(FAILED))
def test_wrong_words_fail_what_is_about_them(trick: str) -> None:
    """They find the targets as `copy` does, and fail by what they say of them."""
    spec = scene(trick)
    tape = flown(spec)
    x_of = values(spec, tape, FAILED[trick] | {"OBS-201"})
    assert (x_of.pop("OBS-201") or 0.0) >= OBSERVABLES["OBS-201"].threshold
    assert {name for name, x in x_of.items() if x is None or x >= OBSERVABLES[name].threshold} == set()


def test_who_always_states_the_same_has_no_skill() -> None:
    """On one scene there is no interval, and a constant is no better than the best constant."""
    spec = scene("flat")
    tape = flown(spec)
    (fact,) = report_statements(spec, tape)
    rows = statement_reports([("flat", ("scene", 1), fact)])
    assert {row.of for row in rows} == {"confidence", "position_sigma_m"}
    assert all(row.skill is None or row.skill <= 0.0 for row in rows)
