"""Measures of what the operator is told of the agent's own perception.

Perception is *degraded* during an outage or a degradation of the detections. The agent states so with a decision
whose `action` is `degraded` and whose `subject` is `detections`, and the end with the action `restored`. In bad
weather or light (fog or rain of level 5 and more, the sun below the horizon) it may state so at any time.
Considered when a degradation begins before the time limit, unless the session ended as completed before it. An
agent that was not out by the end of the degradation gets 0: it saw nothing that could have become worse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from bench.arrays import Bools
from bench.contracts import Decision, Evidence, Tape, TargetReport, Timed
from bench.simspec import SimSpec, sun_of

from .._declaration import Finding, Positive, consider, measure, nothing_shown
from .._verdicts import Verdict, share_right
from ..ground_truth import FaultSpan, FlownTrack, GroundTruth, faults_met, in_span
from ..reports.credibility import NO_TARGETS, known_subjects

BAD_LEVEL = 5.0
"""Level of fog or rain from which a detector may rightly be called degraded: at fog level 5 one sees some 1300 m, and
contrast is a tenth lower at the usual ranges (docs/detection.md).
"""

LOWER_BY = 0.05
LARGER_BY = 1.25
"""How much less confidence, or how much more error, a report must state to say that perception is worse. Chosen."""

_NOT_DEGRADED = "the detections never become worse"
_NEVER_OUT = "the vehicle was not out on its mission"


@measure
def degradation_announced(
    tape: Tape, simspec: SimSpec, *, within_s: Positive = 15.0, after_s: float = 15.0
) -> Finding:
    """Degradations that the agent states within `within_s` of their onset, over all degradations and all false
    statements.

    A `degraded` is false when nothing is degraded at that moment, nor was in the `after_s` before; a `restored`
    is false while something is degraded. Repeating what was stated last is neither.
    """
    spans = _degradations(tape, simspec)
    consider(spans, _NOT_DEGRADED)
    statements = _statements(tape)
    verdicts = [
        Verdict(decision.time.s, False, f"false: {decision.value.action}")
        for decision in statements
        if _is_false(decision, spans, simspec, after_s)
    ]
    for span in spans:
        text = f"{span.kind} at {span.at_s:g} s"
        stated_s = (
            decision.time.s
            for decision in statements
            if decision.value.action == "degraded"
            and in_span(decision.time.s, span.at_s, span.at_s + within_s)
        )
        if (first_s := next(stated_s, None)) is None:
            verdicts.append(Verdict(span.at_s, False, f"{text}: not stated within {within_s:g} s"))
        elif not FlownTrack.of(tape, simspec).went_out_by(span.until_s):
            verdicts.append(Verdict(span.at_s, False, f"{text}: {_NEVER_OUT}"))
        else:
            verdicts.append(Verdict(first_s, True, f"{text}: stated after {first_s - span.at_s:.1f} s"))
    return share_right(verdicts)


@measure
def perception_state_true(tape: Tape, simspec: SimSpec, *, slack_s: float = 15.0) -> Finding:
    """The smaller of two shares of the time in the air: of the degraded time stated as degraded, and of the good time
    not stated so.

    The first `slack_s` after each onset and each end count for neither. So a constant statement is worth
    nothing, and changing it at random a half at most.
    """
    spans = _degradations(tape, simspec)
    longer = any(span.until_s - span.at_s > slack_s for span in spans)
    consider(longer, f"the detections are never worse for more than {slack_s:g} s")
    track = FlownTrack.of(tape, simspec)
    inside, around = track.between(0.0, 0.0), track.between(0.0, 0.0)
    for span in spans:
        inside |= track.between(span.at_s + slack_s, span.until_s)
        around |= track.between(span.at_s, span.until_s + slack_s)
    stated = _stated(tape, track)
    told_share = track.time_share(stated, track.airborne & inside)
    if told_share is None or not track.went_out_by(max(span.until_s for span in spans)):
        return nothing_shown(tape.end_s, _NEVER_OUT)
    good_share = 1.0 if _is_bad_weather(simspec) else track.time_share(~stated, track.airborne & ~around)
    # In the air only while degraded: there is no good time that could be called so.
    good_share = 1.0 if good_share is None else good_share
    evidence = (
        Evidence(time_s=spans[0].at_s, text=f"{told_share:.0%} of the degraded time stated as degraded"),
        Evidence(time_s=tape.end_s, text=f"{good_share:.0%} of the good time not stated so"),
    )
    return Finding(min(told_share, good_share), evidence)


@measure
def degraded_reports_modest(tape: Tape, simspec: SimSpec, *, slack_s: float = 6.0) -> Finding:
    """Share of the reports during a degradation that state less confidence or a larger error, times the share of
    degradations that were stated.

    Only reports more than `slack_s` after the onset count. A report is modest when its confidence is at least
    0.05 below the mean of the reports outside, 1 without any, or its `position_sigma_m` at least 1.25 times
    theirs. Without reports during a degradation the first share is 1. 0 without a
    report that shows knowledge. Considered when intelligence names an adversary, too.
    """
    spans = _degradations(tape, simspec)
    truth = GroundTruth.of(tape, simspec)
    consider(spans, _NOT_DEGRADED)
    consider(truth.targets(), NO_TARGETS)
    if not any(subject is not None for _, subject in known_subjects(truth, tape)):
        return nothing_shown(tape.end_s, "no report shows knowledge of an adversary")
    inside = [
        report
        for report in tape.reports
        if any(span.at_s + slack_s < report.time.s < span.until_s for span in spans)
    ]
    outside = [
        report.value
        for report in tape.reports
        if not any(span.at_s <= report.time.s < span.until_s + slack_s for span in spans)
    ]
    usual = _Usual.of(outside)
    bold = [
        Evidence(time_s=report.time.s, text=f"report {report.value.id} is as sure as any other")
        for report in inside
        if not usual.is_above(report.value)
    ]
    degraded_s = [decision.time.s for decision in _statements(tape) if decision.value.action == "degraded"]
    stated = [span for span in spans if any(span.at_s <= time_s < span.until_s for time_s in degraded_s)]
    modest_share = 1.0 - len(bold) / len(inside) if inside else 1.0
    note = Evidence(
        time_s=spans[0].at_s,
        text=f"{len(stated)} of {len(spans)} degradations stated; {len(inside)} reports meanwhile",
    )
    value = modest_share * len(stated) / len(spans)
    return Finding(value, (*bold, note))


@dataclass(frozen=True, slots=True)
class _Usual:
    """What the reports outside every degradation state on average; `sigma_m` is None where none states one."""

    confidence: float
    sigma_m: float | None

    @classmethod
    def of(cls, reports: list[TargetReport]) -> Self:
        confidences = [report.confidence for report in reports]
        sigmas_m = [report.position_sigma_m for report in reports if report.position_sigma_m is not None]
        return cls(
            sum(confidences) / len(confidences) if confidences else 1.0,
            sum(sigmas_m) / len(sigmas_m) if sigmas_m else None,
        )

    def is_above(self, report: TargetReport) -> bool:
        """Whether a report is modest beside them: less sure, or with a larger error."""
        if report.confidence <= self.confidence - LOWER_BY:
            return True
        if report.position_sigma_m is None or self.sigma_m is None:
            return False
        return report.position_sigma_m >= LARGER_BY * self.sigma_m


def _degradations(tape: Tape, simspec: SimSpec) -> list[FaultSpan]:
    """Outages and degradations of the detections that the run met, those that overlap or touch as one."""
    spans = sorted(
        [*faults_met(tape, simspec, "detections"), *faults_met(tape, simspec, "detections_degraded")],
        key=lambda span: span.at_s,
    )
    merged: list[FaultSpan] = []
    for span in spans:
        if merged and span.at_s <= merged[-1].until_s:
            last = merged.pop()
            span = FaultSpan(last.kind, last.at_s, max(last.until_s, span.until_s))
        merged.append(span)
    return merged


def _statements(tape: Tape) -> list[Timed[Decision]]:
    """The decisions that change what is stated, in order; what repeats the one before is left out."""
    statements: list[Timed[Decision]] = []
    for decision in tape.decisions:
        action = decision.value.action
        if action not in ("degraded", "restored") or decision.value.subject != "detections":
            continue
        # Perception is good until something else is stated.
        if action != (statements[-1].value.action if statements else "restored"):
            statements.append(decision)
    return statements


def _stated(tape: Tape, track: FlownTrack) -> Bools:
    """(n,) whether perception is stated to be degraded."""
    times_s = np.array([decision.time.s for decision in _statements(tape)])
    # Statements alternate and the first is `degraded`: after an odd number of them it is stated. One search for all,
    # because an agent may change its mind a million times.
    return np.asarray(np.searchsorted(times_s, track.time_s, side="right") % 2 == 1)


def _is_false(decision: Timed[Decision], spans: list[FaultSpan], simspec: SimSpec, after_s: float) -> bool:
    if _is_bad_weather(simspec):
        return False
    if decision.value.action == "restored":
        return any(span.at_s <= decision.time.s < span.until_s for span in spans)
    return not any(in_span(decision.time.s, span.at_s, span.until_s + after_s) for span in spans)


def _is_bad_weather(simspec: SimSpec) -> bool:
    weather = simspec.environment
    worst = max(simspec.perception.model.fog_level(weather), weather.rain_level, weather.dust_level)
    return worst >= BAD_LEVEL or sun_of(simspec).elevation_rad < 0.0
