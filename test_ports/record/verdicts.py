"""Shares of right messages: the finding that most measures of the record come to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bench.contracts import Evidence, Tape, TargetReport, Timed
from bench.simspec import SimSpec

from .._declaration import Finding, not_considered, nothing_shown, thinned
from ..ground_truth import GroundTruth
from ..reports.credibility import NO_TARGETS, known_reports


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether one message is as it should be, and the same in words."""

    time_s: float
    right: bool
    text: str


def share_right(verdicts: Sequence[Verdict]) -> Finding:
    """Share of the right messages, 0 without any; the wrong ones come first in evidence."""
    if not verdicts:
        return nothing_shown(0.0, "no such message was sent")
    # False sorts before true, then by time.
    wrong_first = sorted(verdicts, key=lambda verdict: (verdict.right, verdict.time_s))
    # Thinned before and not after evidence is made of it: an agent may send a million messages.
    evidence = tuple(Evidence(time_s=verdict.time_s, text=verdict.text) for verdict in thinned(wrong_first))
    return Finding(sum(verdict.right for verdict in verdicts) / len(verdicts), evidence)


def share_of_reports(
    tape: Tape, simspec: SimSpec, judge: Callable[[Timed[TargetReport]], Verdict]
) -> Finding:
    """Share of the reports with knowledge that are right; considered when intelligence names an adversary."""
    truth = GroundTruth.of(tape, simspec)
    if not truth.targets():
        return not_considered(NO_TARGETS)
    return share_right([judge(report) for report in known_reports(truth, tape)])
