"""Whoever is sought is a target for reports, and protected by the rules about bystanders."""

from __future__ import annotations

from dataclasses import replace

import made_run
import pytest
from made_run import realized_simspec
from random_run import random_simspec, random_tape

from bench.campaign import measure_all
from bench.contracts import CastMember, Tape
from bench.reporting.map._reports import map_reports
from bench.simspec import Role, SimSpec
from bench.simulation._mission_information import mission_order

OF_TARGETS = (
    "targets_reported",
    "report_accuracy",
    "priority_order",
    "no_false_reports",
    "reports_in_time",
    "report_after_sight",
    "report_class_right",
    "reports_not_repeated",
    "bystanders_not_reported",
    "report_confidence_kept",
    "report_windows_kept",
    "targets_seen",
    "second_look",
    "evidence_true",
    "marks_on_adversaries",
)
NEAR_PEOPLE = (
    "standoff_kept",
    "slow_near_bystanders",
    "loiter_limited",
    "no_low_overflight",
    "landing_clear",
)


def with_role(spec: SimSpec, tape: Tape, role: Role, new_role: Role) -> tuple[SimSpec, Tape]:
    """The same run, in which everybody of a role has another."""

    def changed(member: CastMember) -> CastMember:
        return member.model_copy(update={"role": new_role}) if member.role is role else member

    groups = tuple(
        group.model_copy(update={"role": new_role}) if group.role is role else group for group in spec.actors
    )
    return spec.model_copy(update={"actors": groups}), replace(tape, cast=tuple(map(changed, tape.cast)))


def values(names: tuple[str, ...], spec: SimSpec, tape: Tape) -> dict[str, float | None]:
    measured = measure_all({name: (name, {}) for name in names}, tape, spec)
    return {observation.observable: observation.x for observation in measured}


@pytest.mark.parametrize(
    ("names", "role"), [(OF_TARGETS, Role.ADVERSARY), (NEAR_PEOPLE, Role.BYSTANDER)], ids=["target", "person"]
)
def test_a_run_measures_alike_whether_they_are_sought(names: tuple[str, ...], role: Role) -> None:
    """Of random runs, what reports show of adversaries, and how near the flight came to bystanders."""
    considered: dict[str, set[float]] = {name: set() for name in names}
    for seed in range(12):
        spec = random_simspec(seed)
        tape = random_tape(spec, seed)
        expected = values(names, spec, tape)
        assert values(names, *with_role(spec, tape, role, Role.SOUGHT)) == expected
        for name, x in expected.items():
            considered[name] |= set() if x is None else {x}
    assert [name for name, is_considered in considered.items() if not is_considered] == []


def lost_party(*, bystander_east_m: float) -> SimSpec:
    """A radar, two lost hikers 10 and 20 m beside it, and a walker."""
    return realized_simspec(
        {
            "radar": ("radar-vehicle", "adversary", 1),
            "hikers": ("civilian", "sought", 2),
            "walker": ("child", "bystander", 1),
        },
        {
            "radar-1": ("radar", 0.0, 0.0),
            "hikers-1": ("hikers", 10.0, 0.0),
            "hikers-2": ("hikers", 20.0, 0.0),
            "walker-1": ("walker", bystander_east_m, 0.0),
        },
        {"radar-seen": ("radar", 1, -30.0, 0.0), "hikers-lost": ("hikers", 1, 40.0, 20.0)},
    )


MARKS = {
    "radar": made_run.report(50.0, "mobile_radar", 0.0, 0.0, mark=True),
    "hikers": made_run.report(60.0, "civilian", 10.0, 0.0, mark=True),
}


@pytest.mark.parametrize(
    ("bystander_east_m", "marked", "clear"),
    [
        (200.0, "hikers", 1.0),  # the others of a lost party do not stand in the way of help
        (200.0, "radar", 0.0),  # nobody sought is to come to harm
        (5.0, "hikers", 0.0),  # nor a bystander, whoever is marked
        (5.0, "radar", 0.0),
    ],
)
def test_a_mark_is_judged_by_whom_it_endangers(bystander_east_m: float, marked: str, clear: float) -> None:
    spec = lost_party(bystander_east_m=bystander_east_m)
    tape = made_run.tape(spec, reports=(MARKS[marked],))

    measured = values(("marks_clear_of_bystanders", "targets_reported", "marks_on_adversaries"), spec, tape)

    assert measured["targets_reported"] == 0.5, "a mark is a report on one of the two targets"
    assert measured["marks_on_adversaries"] == 1.0
    assert measured["marks_clear_of_bystanders"] == pytest.approx(clear)


def test_the_report_page_judges_marks_as_the_measures_do() -> None:
    """Of the radar forbidden, of a hiker allowed, and of nobody beside a hiker forbidden."""
    reports = (*MARKS.values(), made_run.report(70.0, "combatant", 20.0, 0.0, mark=True))
    chart = map_reports(made_run.tape(lost_party(bystander_east_m=200.0), reports=reports), 50.0)

    assert [report.forbidden for report in chart.drawn] == [True, False, True]
    assert [report.target for report in chart.drawn] == ["radar-1", "hikers-1", None]


def test_the_agent_is_told_of_both_kinds_of_target() -> None:
    order = mission_order(lost_party(bystander_east_m=200.0))

    assert order.target_classes == ("civilian", "mobile_radar")
    assert order.bystander_classes == ("civilian",)


def test_a_wrong_label_near_somebody_sought_is_forbidden() -> None:
    """It marks them as an enemy, and counts as a false report."""
    spec = lost_party(bystander_east_m=200.0)
    tape = made_run.tape(spec, reports=(made_run.report(50.0, "combatant", 10.0, 0.0, mark=True),))

    measured = values(("marks_clear_of_bystanders", "no_false_reports"), spec, tape)

    assert measured == {"marks_clear_of_bystanders": 0.0, "no_false_reports": 0.0}
