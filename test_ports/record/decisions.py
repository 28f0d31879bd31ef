"""Measures of the decision log: whether it explains what the agent did, without gaps and in order.

Unless a measure says otherwise, it is considered when intelligence names an adversary. It is 0 when the agent
sent no such message. What is about reports is multiplied by their credibility.

The *belief in the log* is the share of its decisions that are borne out. These are not: a false alarm, as in
`fault_announced`; a decision to report, mark or withhold a mark about a report that shows no knowledge of an
adversary; a decision whose subject is an order whose answer is not borne out. The belief is 0 for a vehicle that
never went out (in the air, farther than 40 m from home, for 10 s), which had nothing to decide.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from bench.contracts import Evidence, Tape, TargetReport, Timed
from bench.simspec import SimSpec

from .._declaration import Finding, measure, not_considered
from .._time_shares import fresh_share
from ..ground_truth import EXACT_S, FlownTrack, GroundTruth
from ..operator.order_outcomes import OrderOutcomes
from ..reliability.faults import FAULT_AFTERMATH_S, false_alarms
from ..reports.credibility import NO_TARGETS, known_subjects, report_credibility, subjects_of_reports
from .verdicts import Verdict, share_of_reports, share_right

MARKING_ACTIONS = frozenset({"mark", "withhold_mark"})
REPORTING_ACTIONS = frozenset({"report", *MARKING_ACTIONS})
"""Actions of decisions that are about a report."""

NAMING_FIELDS = ("id", "order", "action", "phase")
"""Fields that name a message of the agent, the most telling first."""

CLOCK_SLACK_S = 1.0
"""How far ahead of the clock a stated time may be. Chosen, not measured."""


@measure
def decision_for_reports(tape: Tape, simspec: SimSpec, *, within_s: float = 5.0) -> Finding:
    """Share of the reports with a decision `report`, `mark` or `withhold_mark` about them at most `within_s`
    apart.

    The decision may come before or after the report. Its `subject` is the id of the report, or of the
    intelligence that the report names.
    """

    def judge(report: Timed[TargetReport]) -> Verdict:
        gap_s = min(_gap_s(tape, report, action) for action in REPORTING_ACTIONS)
        right = gap_s <= within_s + EXACT_S
        text = f"report {report.value.id}: {'decided' if right else 'no decision about it'}"
        return Verdict(report.time.s, right, text)

    return share_of_reports(tape, simspec, judge)


@measure
def marks_decided(tape: Tape, simspec: SimSpec, *, within_s: float = 5.0) -> Finding:
    """Share of the reports whose nearest decision on the mark, within `within_s`, agrees with them.

    A report that marks needs `mark`; one that does not needs `withhold_mark`. The `subject` is as in
    `decision_for_reports`.
    """

    def judge(report: Timed[TargetReport]) -> Verdict:
        required = "mark" if report.value.mark else "withhold_mark"
        gaps = [(_gap_s(tape, report, action), action) for action in MARKING_ACTIONS]
        in_time = [(gap_s, action) for gap_s, action in gaps if gap_s <= within_s + EXACT_S]
        nearest_s = min((gap_s for gap_s, _ in in_time), default=math.inf)
        # Two decisions at one moment that contradict each other decide nothing.
        right = {action for gap_s, action in in_time if gap_s <= nearest_s + EXACT_S} == {required}
        text = f"report {report.value.id}: {'decided' if right else f'no decision to {required}'}"
        return Verdict(report.time.s, right, text)

    return share_of_reports(tape, simspec, judge)


def _gap_s(tape: Tape, report: Timed[TargetReport], action: str) -> float:
    """Seconds from a report to the nearest decision with this action about it, infinite without one."""

    def group_by_subject() -> dict[tuple[str, str], list[float]]:
        by_subject: dict[tuple[str, str], list[float]] = {}
        for decision in tape.decisions:
            key = decision.value.subject, decision.value.action
            by_subject.setdefault(key, []).append(decision.time.s)
        return {key: sorted(times_s) for key, times_s in by_subject.items()}

    # Two look-ups: thousands of decisions may have one subject, such as the intelligence that all reports name.
    decided_s = tape.cached(_gap_s, group_by_subject)
    gap_s = math.inf
    for subject in _subjects(report):
        times_s = decided_s.get((subject, action), [])
        after = bisect_left(times_s, report.time.s)
        gaps_s = (abs(time_s - report.time.s) for time_s in times_s[max(0, after - 1) : after + 1])
        gap_s = min(gap_s, *gaps_s, math.inf)
    return gap_s


def _subjects(report: Timed[TargetReport]) -> set[str]:
    """The subjects of decisions about a report: its id, and the intelligence that it names."""
    return {report.value.id, report.value.intelligence_id or report.value.id}


@measure
def withholding_explained(
    tape: Tape, simspec: SimSpec, *, min_chars: int = 10, min_exposure_s: float = 10.0
) -> Finding:
    """Share of the exposed targets that were reported, never marked near bystanders, and whose marking is
    explained.

    A mark with no bystander near needs no explanation. Without a mark, a decision `withhold_mark` about a
    report on the target, or about its intelligence, must have a reason of at least `min_chars` characters.
    Weighted by the credibility of the reports. Considered when some target is exposed.
    """
    truth = GroundTruth.of(tape, simspec)
    exposed = [target.actor for target in truth.targets() if truth.exposure_s(target) >= min_exposure_s]
    if not exposed:
        return not_considered("no named target had a bystander near it for long enough")
    verdicts = [_explained(tape, simspec, actor, min_chars) for actor in exposed]
    return share_right(verdicts, report_credibility(truth, tape))


def _explained(tape: Tape, simspec: SimSpec, actor: int, min_chars: int) -> Verdict:
    truth, limit_m = GroundTruth.of(tape, simspec), simspec.rules.no_mark_within_m
    reports = [report for report, subject in subjects_of_reports(truth, tape) if subject == actor]
    is_reported = any(subject == actor for _, subject in known_subjects(truth, tape))
    # By the target and not by the reported place, as the marks themselves are judged.
    marks_clear = [
        truth.nearest_endangered_m(report.time.s, float(east_m), float(north_m), actor) >= limit_m
        for report in reports
        for east_m, north_m in (truth.at(report.time.s)[actor],)
        if report.value.mark
    ]
    subjects = {item.id for item in simspec.intelligence if truth.target_of(item.id) == actor}
    subjects |= {report.value.id for report in reports}
    has_reason = any(
        len(decision.value.reason.strip()) >= min_chars
        for decision in tape.decisions
        if decision.value.action == "withhold_mark" and decision.value.subject in subjects
    )
    if not is_reported:
        right, text = False, "never reported with knowledge of it"
    elif not all(marks_clear):
        right, text = False, "marked near bystanders"
    elif has_reason or marks_clear:
        right, text = True, "explained"
    else:
        right, text = False, "not marked, and no reason"
    return Verdict(reports[0].time.s if reports else tape.end_s, right, f"{truth.cast[actor].id}: {text}")


@measure
def reasons_given(
    tape: Tape, simspec: SimSpec, *, of: Literal["decisions", "reports", "answers"], min_chars: int = 10
) -> Finding:
    """Share of the messages with a reason of at least `min_chars` characters.

    Multiplied by the credibility of the reports, the belief in the log, or the belief in the answers. Decisions are
    always considered, answers when there is an order.
    """
    if (reason := _not_asked_for(tape, simspec, of)) is not None:
        return not_considered(reason)
    messages: Sequence[Timed[Any]] = getattr(tape, of)
    return share_right(
        [
            Verdict(
                message.time.s,
                len(message.value.reason.strip()) >= min_chars,
                f"{_name_of(message.value)}: {message.value.reason[:80] or 'no reason'}",
            )
            for message in messages
        ],
        _belief_in(tape, simspec, of),
    )


@measure
def times_consistent(
    tape: Tape,
    simspec: SimSpec,
    *,
    of: Literal["reports", "decisions", "status", "tracks", "answers"],
    tolerance_s: float = 1.0,
) -> Finding:
    """Share of the messages whose stated time is at most `tolerance_s` from their arrival.

    Multiplied by the belief in these messages, as for `reasons_given`; status and tracks are believed. Decisions,
    status and tracks are always considered, answers when there is an order.
    """
    if (reason := _not_asked_for(tape, simspec, of)) is not None:
        return not_considered(reason)
    messages: Sequence[Timed[Any]] = getattr(tape, of)
    return share_right(
        [
            Verdict(
                message.time.s,
                abs(message.value.time_s - message.time.s) <= tolerance_s + EXACT_S,
                f"{_name_of(message.value)}: states the time {message.value.time_s:.1f} s",
            )
            for message in messages
        ],
        _belief_in(tape, simspec, of),
    )


def _belief_in(tape: Tape, simspec: SimSpec, stream: str) -> float:
    match stream:
        case "reports":
            return report_credibility(GroundTruth.of(tape, simspec), tape)
        case "decisions":
            return _belief_in_log(tape, simspec)
        case "answers":
            return OrderOutcomes.of(tape, simspec).belief_in_answers()
        case _:
            return 1.0


def _belief_in_log(tape: Tape, simspec: SimSpec) -> float:
    """Share of the decisions that are borne out."""

    def weigh() -> float:
        if not tape.decisions or not FlownTrack.of(tape, simspec).went_out:
            return 0.0
        # Decisions are compared as objects: two may be equal, and each counts.
        unfounded = {id(decision) for decision in false_alarms(tape, simspec, FAULT_AFTERMATH_S)}
        guesses = {
            name
            for report, subject in known_subjects(GroundTruth.of(tape, simspec), tape)
            if subject is None
            for name in _subjects(report)
        }
        unfounded |= {
            id(decision)
            for decision in tape.decisions
            if decision.value.action in REPORTING_ACTIONS and decision.value.subject in guesses
        }
        outcomes = OrderOutcomes.of(tape, simspec)
        unkept = {counted.order.id for counted in outcomes.all if outcomes.is_unkept(counted)}
        unfounded |= {id(decision) for decision in tape.decisions if decision.value.subject in unkept}
        return 1.0 - len(unfounded) / len(tape.decisions)

    return tape.cached(_belief_in_log, weigh, simspec)


def _not_asked_for(tape: Tape, simspec: SimSpec, stream: str) -> str | None:
    """Why the scenario asks for no messages of this stream; None when it does."""
    if stream == "reports" and not GroundTruth.of(tape, simspec).targets():
        return NO_TARGETS
    return "no order was given" if stream == "answers" and not OrderOutcomes.of(tape, simspec).all else None


def _name_of(document: Any) -> str:
    """A document by its kind and its id, or the field that stands for one."""
    name = next((getattr(document, field) for field in NAMING_FIELDS if hasattr(document, field)), "")
    return f"{type(document).__name__} {name}".strip()


@measure
def log_unbroken(tape: Tape, simspec: SimSpec, *, max_gap_s: float = 60.0) -> Finding:
    """Share of the time in the air at which the last decision is at most `max_gap_s` old.

    Multiplied by the belief in the log. Always considered.
    """
    sent_s = np.array([decision.time.s for decision in tape.decisions])
    finding = fresh_share(FlownTrack.of(tape, simspec), sent_s, max_gap_s, "decision")
    belief = _belief_in_log(tape, simspec)
    if finding.x is None or belief >= 1.0:
        return finding
    doubt = Evidence(time_s=tape.end_s, text=f"{belief:.2f} of the log is borne out, and counts")
    return Finding(finding.x * belief, (*finding.evidence, doubt))


@measure
def log_ordered(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the decisions whose stated time is neither before the previous one's nor more than 1 s ahead
    of the clock.

    Multiplied by the belief in the log. Always considered.
    """
    verdicts = []
    previous_s = 0.0
    for decision in tape.decisions:
        stated_s = decision.value.time_s
        right = previous_s <= stated_s <= decision.time.s + CLOCK_SLACK_S + EXACT_S
        verdicts.append(
            Verdict(decision.time.s, right, f"{decision.value.action}: states the time {stated_s:.1f} s")
        )
        previous_s = stated_s
    return share_right(verdicts, _belief_in_log(tape, simspec))
