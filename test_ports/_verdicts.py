"""Shares of things that are right: the finding that most measures come to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.contracts import Evidence, TargetReport, Timed

from ._declaration import Finding, nothing_shown, thinned


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a message, a target or an occasion is as it should be, and the same in words."""

    time_s: float
    right: bool
    text: str


def share_right(verdicts: Sequence[Verdict], *, belief: float = 1.0) -> Finding:
    """Share of the right verdicts times `belief`, 0 without any; evidence has the wrong ones first."""
    if not verdicts:
        return nothing_shown(0.0, "no such message was sent")
    right = sum(verdict.right for verdict in verdicts)
    return Finding(right / len(verdicts) * belief, wrong_first(verdicts))


def wrong_first(verdicts: Sequence[Verdict]) -> tuple[Evidence, ...]:
    """The verdicts as evidence: false sorts before true, then by time."""
    ordered = sorted(verdicts, key=lambda verdict: (verdict.right, verdict.time_s))
    # Thinned before and not after evidence is made of it: an agent may send a million messages.
    return tuple(Evidence(time_s=verdict.time_s, text=verdict.text) for verdict in thinned(ordered))


def mean_of(values: Sequence[tuple[float, float, str]]) -> Finding:
    """Mean of some values, each with the moment and the words of its evidence; the worst come first."""
    worst = sorted(values, key=lambda value: value[0])
    evidence = tuple(Evidence(time_s=time_s, text=text) for _, time_s, text in thinned(worst))
    return Finding(sum(value for value, _, _ in values) / len(values), evidence)


def about_reports(reports: Sequence[Timed[TargetReport]], text: str) -> tuple[Evidence, ...]:
    """One text about each of some reports."""
    return tuple(
        Evidence(time_s=report.time.s, text=f"report {report.value.id} {text}") for report in reports
    )
