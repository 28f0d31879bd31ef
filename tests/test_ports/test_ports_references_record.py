"""Measures of what the agent writes down against references written as plain loops.

The references share no code with the measures: they go through samples, reports and actors one by one.
"""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from references.agreement import assert_agreement
from references.flown_samples import Reference, Sample
from references.looks import looks_s
from references.target_reports import credibility, known, targets

from bench.contracts import Option, Tape
from bench.simspec import SimSpec


def evidence_count(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not targets(spec, tape):
        return None
    enough = [len(set(report.value.evidence)) >= 3 for report in tape.reports]
    return sum(enough) / len(enough) * credibility(spec, tape) if enough else 0.0


def ids_unique(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if not targets(spec, tape):
        return None
    if not tape.reports:
        return 0.0
    return len({report.value.id for report in tape.reports}) / len(tape.reports) * credibility(spec, tape)


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
    return sum(right) / len(right) * credibility(spec, tape) if right else 0.0


REFERENCES: Mapping[str, tuple[Reference, Mapping[str, Option]]] = {
    "evidence_count": (evidence_count, {}),
    "ids_unique": (ids_unique, {}),
    "evidence_true": (evidence_true, {"slack_s": 1.5}),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_a_measure_agrees_with_its_reference(name: str) -> None:
    """On every random run the same value, and the same verdict on whether the run is considered."""
    reference, options = REFERENCES[name]
    assert_agreement(name, reference, options)
