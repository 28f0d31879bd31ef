"""What the agent writes down."""

from __future__ import annotations

from bench.contracts import Tape
from bench.simspec import SimSpec

from .agreement import agrees
from .flown_samples import Sample
from .looks import looks_s
from .target_reports import known, targets


@agrees(min_frames=1)
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


@agrees(slack_s=1.5)
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
