"""What the agent reports, against the adversaries that are there."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.contracts import At, Evidence, Tape, TargetReport
from bench.simspec import SimSpec

from ._measured import Finding, Measured, belief, not_considered
from ._truth import Target, Truth

NO_TARGETS = "intelligence names no adversary"

FALSE_M = 30.0
"""A report farther than this from every adversary of its class is false."""

MAX_FALSE = 500
"""False places that are told apart: with so many nobody is believed, and more would only cost time."""


@dataclass(frozen=True, slots=True)
class WithinOptions:
    within_m: float = 20.0


def _targets_reported(tape: Tape, simspec: SimSpec, options: WithinOptions) -> Finding:
    """Share of the adversaries named by intelligence that a report of their class put within `within_m` of their place.

    All times the belief in the reports as a whole, here and below: some report of a map full of them is always right.
    """
    truth = Truth.of(tape, simspec)
    targets = truth.targets()
    if not targets:
        return not_considered(NO_TARGETS)
    first = {target.actor: _first_report(truth, target, tape, options.within_m) for target in targets}
    missed = [_unreported(truth, actor, tape) for actor, index in first.items() if index is None]
    made = [_reported(truth, actor, tape.reports[index]) for actor, index in first.items() if index is not None]
    return Finding(len(made) / len(targets) * belief_in_reports(truth, tape), (*missed, *made))


@dataclass(frozen=True, slots=True)
class ReportAccuracyOptions:
    scale_m: float = 25.0

    def __post_init__(self) -> None:
        if self.scale_m <= 0.0:
            raise ValueError("option 'scale_m' must exceed 0")


def _report_accuracy(tape: Tape, simspec: SimSpec, options: ReportAccuracyOptions) -> Finding:
    """Mean over the reported targets of max(0, 1 - error / scale) in the last report about each; 0 when none was reported."""
    truth = Truth.of(tape, simspec)
    targets = truth.targets()
    if not targets:
        return not_considered(NO_TARGETS)
    last = {truth.subject(said.value, said.time.s): said for said in tape.reports}
    reported = {target.actor: last[target.actor] for target in targets if target.actor in last}
    if not reported:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="no target was reported"),))
    errors_m = {actor: _error_m(truth, actor, said) for actor, said in reported.items()}
    worst_first = sorted(reported, key=lambda actor: -errors_m[actor])
    x = sum(max(0.0, 1.0 - error_m / options.scale_m) for error_m in errors_m.values()) / len(reported)
    return Finding(x * belief_in_reports(truth, tape), tuple(_reported(truth, actor, reported[actor]) for actor in worst_first))


def _priority_order(tape: Tape, simspec: SimSpec, options: WithinOptions) -> Finding:
    """Share of pairs of targets of unequal priority that were reported, the more urgent one first.

    A pair of which one was never reported is out of order, whichever it is.
    """
    truth = Truth.of(tape, simspec)
    targets = truth.targets()
    pairs = [(urgent, other) for urgent in targets for other in targets if urgent.priority < other.priority]
    if not pairs:
        return not_considered("intelligence names no two targets of unequal priority")
    first = {target.actor: _first_report(truth, target, tape, options.within_m) for target in targets}
    kept: list[Evidence] = []
    broken: list[Evidence] = []
    for urgent, other in pairs:
        early, late = first[urgent.actor], first[other.actor]
        in_order = early is not None and late is not None and early < late
        names = f"{truth.cast[urgent.actor].id} (priority {urgent.priority}), {truth.cast[other.actor].id} ({other.priority})"
        made = [index for index in (early, late) if index is not None]
        time_s = tape.reports[min(made)].time.s if made else tape.end_s
        (kept if in_order else broken).append(
            Evidence(time_s=time_s, text=f"{names}: {'in order' if in_order else 'not reported in this order'}")
        )
    return Finding(len(kept) / len(pairs) * belief_in_reports(truth, tape), (*broken, *kept))


@dataclass(frozen=True, slots=True)
class NoFalseReportsOptions:
    within_m: float = FALSE_M


def _no_false_reports(tape: Tape, simspec: SimSpec, options: NoFalseReportsOptions) -> Finding:
    """Of what was reported, each adversary and each false place once, the share that is an adversary.

    An adversary is meant by the reports of its class within `within_m`; so repeating a true report makes up for no false one.
    Without reports 0, for nothing was shown; 1 in a scenario without adversaries, where silence is right.
    """
    truth = Truth.of(tape, simspec)
    if not tape.reports:
        silent = Evidence(time_s=tape.end_s, text="the agent reported nothing")
        return Finding(0.0 if truth.of_role("adversary") else 1.0, (silent,))
    right, false = _told_apart(truth, tape, options.within_m)
    evidence = [
        Evidence(time_s=said.time.s, text=f"report {said.value.id} ({said.value.class_label}): no such adversary there")
        for said in false
    ]
    return Finding(len(right) / (len(right) + len(false)), tuple(evidence))


def belief_in_reports(truth: Truth, tape: Tape) -> float:
    """How far the reports as a whole are believed, by the adversaries and the false places among them."""
    right, false = _told_apart(truth, tape, FALSE_M)
    return belief(len(right), len(false))


def _told_apart(truth: Truth, tape: Tape, within_m: float) -> tuple[set[int], list[At[TargetReport]]]:
    """The adversaries that were reported, and the false reports: of those of one class within `within_m` the first."""
    right: set[int] = set()
    false: list[At[TargetReport]] = []
    for said in tape.reports:
        about = truth.subject(said.value, said.time.s, within_m)
        if about is not None:
            right.add(about)
        elif len(false) < MAX_FALSE and not any(_same_place(said.value, other.value, within_m) for other in false):
            false.append(said)
    return right, false


def _same_place(one: TargetReport, other: TargetReport, within_m: float) -> bool:
    apart_m = math.hypot(one.east_m - other.east_m, one.north_m - other.north_m)
    return one.class_label == other.class_label and apart_m <= within_m


def _first_report(truth: Truth, target: Target, tape: Tape, within_m: float) -> int | None:
    """Index of the first report of the target's class within `within_m` of where it then was."""
    label = truth.cast[target.actor].class_label
    for index, said in enumerate(tape.reports):
        if said.value.class_label == label and _error_m(truth, target.actor, said) <= within_m:
            return index
    return None


def _error_m(truth: Truth, actor: int, said: At[TargetReport]) -> float:
    return float(truth.distances(said.time.s, said.value.east_m, said.value.north_m)[actor])


def _reported(truth: Truth, actor: int, said: At[TargetReport]) -> Evidence:
    text = f"{truth.cast[actor].id} in report {said.value.id}, {_error_m(truth, actor, said):.1f} m from its place"
    return Evidence(time_s=said.time.s, text=text)


def _unreported(truth: Truth, actor: int, tape: Tape) -> Evidence:
    return Evidence(time_s=tape.end_s, text=f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) was never reported")


targets_reported = Measured("targets_reported", WithinOptions, _targets_reported)
report_accuracy = Measured("report_accuracy", ReportAccuracyOptions, _report_accuracy)
priority_order = Measured("priority_order", WithinOptions, _priority_order)
no_false_reports = Measured("no_false_reports", NoFalseReportsOptions, _no_false_reports)
