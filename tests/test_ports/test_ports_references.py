"""Measures against references written as plain loops, on random runs."""

from __future__ import annotations

import pytest
from references import flight, perception, record, reliability, reports
from references.agreement import AGREEMENTS
from references.flown_samples import SEEDS, random_run
from references.target_reports import targets

from bench.contracts import CastMember


def test_the_random_runs_have_two_of_everything() -> None:
    """Otherwise a reference could agree with a measure that looks at the first element only."""
    runs = [random_run(seed) for seed in SEEDS]
    members: tuple[CastMember, ...] = runs[0][1].cast
    assert sum(member.role == "bystander" for member in members) == 5
    assert sum(member.group == "radar" for member in members) == 2
    assert any(len(targets(spec, tape)) == 2 for spec, tape in runs)
    assert any(len(spec.rules.no_fly) == 2 for spec, _ in runs)
    assert any(len(spec.rules.report_windows) == 2 for spec, _ in runs)
    assert any(sum(fault.kind == "battery_drop" for fault in spec.vehicle.failures) == 2 for spec, _ in runs)
    assert any(sum(outage.kind == "operator_link" for outage in spec.outages) == 2 for spec, _ in runs)
    kinds = [[order.kind for order in spec.orders] for spec, _ in runs]
    assert any(len(set(kinds_of_run)) < len(kinds_of_run) for kinds_of_run in kinds)


def test_each_reference_belongs_to_one_measure() -> None:
    modules = (flight, perception, record, reliability, reports)
    agreements = [agreement.reference.__module__ for agreement in AGREEMENTS.values()]
    assert {module.__name__ for module in modules} == set(agreements)


@pytest.mark.parametrize("name", AGREEMENTS)
def test_a_measure_agrees_with_its_reference(name: str) -> None:
    AGREEMENTS[name].check(name)
