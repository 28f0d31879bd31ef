"""Measures of what the agent writes down against references written as plain loops.

The references share no code with the measures: they go through samples, reports and actors one by one.
"""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from references.agreement import assert_agreement
from references.flown_samples import Reference, Sample
from references.looks import looks_s
from references.target_reports import known, targets

from bench.contracts import Option, Tape
from bench.simspec import SimSpec


def evidence_count(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not targets(spec, tape):
        return None
    enough = []
    for report in tape.reports:
        actor = known(spec, tape, report.value, report.time.s)
        if actor is None:
            continue
        cited = [time_s for time_s in report.value.evidence if time_s <= report.time.s + 0.01]
        looks = {
            look_s
            for look_s in looks_s(spec, tape, actor)
            for cited_s in cited
            if abs(look_s - cited_s) <= 0.01 + 1e-9
        }
        enough.append(len(looks) >= 1)
    return sum(enough) / len(enough) if enough else 0.0


def evidence_true(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not targets(spec, tape):
        return None
    right = []
    for report in tape.reports:
        actor = known(spec, tape, report.value, report.time.s)
        if actor is None:
            continue
        for cited_s in set(report.value.evidence):
            looked = any(abs(look_s - cited_s) <= 1.5 + 1e-6 for look_s in looks_s(spec, tape, actor, 8.0))
            right.append(looked and cited_s <= report.time.s + 1e-6)
    return sum(right) / len(right) if right else 0.0


REFERENCES: Mapping[str, tuple[Reference, Mapping[str, Option]]] = {
    "evidence_count": (evidence_count, {"min_frames": 1}),
    "evidence_true": (evidence_true, {"slack_s": 1.5}),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_a_measure_agrees_with_its_reference(name: str) -> None:
    """On every random run the same value, and the same verdict on whether the run is considered."""
    reference, options = REFERENCES[name]
    assert_agreement(name, reference, options)
