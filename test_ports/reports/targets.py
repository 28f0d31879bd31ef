"""What the agent reports, against the adversaries that are there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bench.contracts import Evidence, Tape, TargetReport, Timed
from bench.simspec import SimSpec

from .._measure import Finding, Measured, NoOptions, belief, not_considered
from ..ground_truth._truth import Target, Truth
from ..perception.clear_views import CLEAR_SHARE

NO_TARGETS = "intelligence names no adversary"

FALSE_M = 30.0
"""A report farther than this from every adversary of its class is false."""

MAX_FALSE = 500
"""False places that are told apart: with so many nobody is believed, and more would only cost time."""


@dataclass(frozen=True, slots=True)
class WithinOptions:
    within_m: float = 20.0


@dataclass(frozen=True, slots=True)
class TargetsReportedOptions:
    """`priority` narrows the targets to those of that priority; 0 is all."""

    within_m: float = 20.0
    priority: int = 0


def _targets_reported(tape: Tape, simspec: SimSpec, options: TargetsReportedOptions) -> Finding:
    """Share of the adversaries named by intelligence that a report of their class put within `within_m` of their place.

    All times the belief in the reports as a whole, here and below: some report of a map full of them is always right.
    """
    truth = Truth.of(tape, simspec)
    targets = [target for target in truth.targets() if options.priority in (0, target.priority)]
    if not targets:
        return not_considered(NO_TARGETS + (f" of priority {options.priority}" if options.priority else ""))
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


@dataclass(frozen=True, slots=True)
class ReportsInTimeOptions:
    """`limit_s` stands for the rules' deadline when it is more than 0."""

    limit_s: float = 0.0
    within_m: float = 20.0


def _reports_in_time(tape: Tape, simspec: SimSpec, options: ReportsInTimeOptions) -> Finding:
    """Share of the targets reported within the deadline after the first delivery of intelligence about them."""
    truth = Truth.of(tape, simspec)
    targets = truth.targets()
    limit_s = options.limit_s or simspec.rules.report_deadline_s
    if not targets or limit_s is None:
        return not_considered("the rules set no deadline for reports, or intelligence names no adversary")
    delivered = {said.value.id: said.time.s for said in tape.intelligence}
    since_s = {
        target.actor: min(
            delivered.get(one.id, one.delivered_s) for one in simspec.intelligence if one.about == truth.cast[target.actor].group
        )
        for target in targets
    }
    return _first_reports(truth, tape, since_s, limit_s, options.within_m, "its intelligence")


@dataclass(frozen=True, slots=True)
class ReportAfterSightOptions:
    limit_s: float = 60.0
    within_m: float = 20.0
    min_height_px: float = 12.0


def _report_after_sight(tape: Tape, simspec: SimSpec, options: ReportAfterSightOptions) -> Finding:
    """Share of the targets reported within `limit_s` of their first clear view (half of it visible); one never seen counts against."""
    truth = Truth.of(tape, simspec)
    targets = truth.targets()
    if not targets:
        return not_considered(NO_TARGETS)
    since_s = {target.actor: math.inf for target in targets}
    for frame in tape.frames:
        for one in frame.sightings:
            if one.actor in since_s and one.visible >= CLEAR_SHARE and one.height_px >= options.min_height_px:
                since_s[one.actor] = min(since_s[one.actor], frame.exposed.s)
    return _first_reports(truth, tape, since_s, options.limit_s, options.within_m, "its first clear view")


def _first_reports(truth: Truth, tape: Tape, since_s: Mapping[int, float], limit_s: float, within_m: float, what: str) -> Finding:
    """Share of these targets whose first report came no later than `limit_s` after a moment of each; times the belief."""
    good: list[Evidence] = []
    bad: list[Evidence] = []
    for actor, began_s in since_s.items():
        index = _first_report(truth, Target(actor, 0), tape, within_m)
        name = truth.cast[actor].id
        if index is None or math.isinf(began_s):
            bad.append(Evidence(time_s=tape.end_s, text=f"{name} was never {'reported' if index is None else 'in clear view'}"))
            continue
        took_s = tape.reports[index].time.s - began_s
        evidence = Evidence(
            time_s=tape.reports[index].time.s, text=f"{name} reported {took_s:.1f} s after {what}; {limit_s:g} s allowed"
        )
        (good if took_s <= limit_s else bad).append(evidence)
    return Finding(len(good) / len(since_s) * belief_in_reports(truth, tape), (*bad, *good))


def _report_class_right(tape: Tape, simspec: SimSpec, options: WithinOptions) -> Finding:
    """Of the reports within `within_m` of an adversary, share with the class of the nearest one; 0 without such reports."""
    truth = Truth.of(tape, simspec)
    enemies = truth.of_role("adversary")
    if not enemies:
        return not_considered("the scenario has no adversary")
    near = []
    for said in tape.reports:
        apart_m = truth.distances(said.time.s, said.value.east_m, said.value.north_m)[enemies]
        if apart_m.min() <= options.within_m:
            near.append((said, truth.cast[enemies[int(apart_m.argmin())]]))
    if not near:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="no report was made near an adversary"),))
    wrong = [
        Evidence(
            time_s=said.time.s, text=f"report {said.value.id}: {member.id} is {member.class_label}, not {said.value.class_label}"
        )
        for said, member in near
        if member.class_label != said.value.class_label
    ]
    return Finding(1.0 - len(wrong) / len(near), tuple(wrong))


def _reports_not_repeated(tape: Tape, simspec: SimSpec, options: WithinOptions) -> Finding:
    """Distinct places reported over the reports that do not say which one they repeat; 0 without reports.

    Two reports of one class within `within_m` of each other are of one place.
    """
    if not Truth.of(tape, simspec).of_role("adversary"):
        return not_considered("the scenario has no adversary")
    fresh = [said for said in tape.reports if said.value.repeats is None]
    if not fresh:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="nothing was reported"),))
    places: list[Timed[TargetReport]] = []
    again = []
    for said in fresh:
        known = next((other for other in places if _same_place(said.value, other.value, options.within_m)), None)
        if known is None and len(places) < MAX_FALSE:
            places.append(said)
        elif known is not None:
            again.append(
                Evidence(time_s=said.time.s, text=f"report {said.value.id} says {known.value.id} again, and does not say so")
            )
    return Finding(len(places) / len(fresh), tuple(again))


@dataclass(frozen=True, slots=True)
class BystandersNotReportedOptions:
    within_m: float = 10.0


def _bystanders_not_reported(tape: Tape, simspec: SimSpec, options: BystandersNotReportedOptions) -> Finding:
    """Share of the reports at whose place no bystander stands within `within_m` nearer than every adversary; 0 without reports."""
    truth = Truth.of(tape, simspec)
    people, enemies = truth.of_role("bystander"), truth.of_role("adversary")
    if not people or not enemies:
        return not_considered("the scenario has not both bystanders and adversaries")
    if not tape.reports:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="nothing was reported"),))
    wrong = []
    for said in tape.reports:
        apart_m = truth.distances(said.time.s, said.value.east_m, said.value.north_m)
        nearest = people[int(apart_m[people].argmin())]
        if apart_m[nearest] <= options.within_m and apart_m[nearest] < apart_m[enemies].min():
            wrong.append(
                Evidence(time_s=said.time.s, text=f"report {said.value.id} points at {truth.cast[nearest].id}, a bystander")
            )
    return Finding(1.0 - len(wrong) / len(tape.reports), tuple(wrong))


def _report_confidence_kept(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Share of the reports that state at least the rules' confidence; 0 without reports."""
    if not Truth.of(tape, simspec).of_role("adversary"):
        return not_considered("the scenario has no adversary")
    least = simspec.rules.min_report_confidence
    return _share_of_reports(
        tape, lambda said: said.value.confidence >= least, lambda said: f"confidence {said.value.confidence:.2f}"
    )


def _report_windows_kept(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Share of the reports that arrive inside one of the rules' windows; 0 without reports."""
    windows = simspec.rules.report_windows
    if not windows or not Truth.of(tape, simspec).targets():
        return not_considered("the rules set no windows for reports, or intelligence names no adversary")

    def inside(said: Timed[TargetReport]) -> bool:
        return any(one.from_s <= said.time.s < one.until_s for one in windows)

    return _share_of_reports(tape, inside, lambda said: "outside the windows")


def _share_of_reports(
    tape: Tape, good: Callable[[Timed[TargetReport]], bool], text: Callable[[Timed[TargetReport]], str]
) -> Finding:
    if not tape.reports:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="nothing was reported"),))
    bad = [Evidence(time_s=said.time.s, text=f"report {said.value.id}: {text(said)}") for said in tape.reports if not good(said)]
    return Finding(1.0 - len(bad) / len(tape.reports), tuple(bad))


def belief_in_reports(truth: Truth, tape: Tape) -> float:
    """How far the reports as a whole are believed, by the adversaries and the false places among them."""
    right, false = _told_apart(truth, tape, FALSE_M)
    return belief(len(right), len(false))


def _told_apart(truth: Truth, tape: Tape, within_m: float) -> tuple[set[int], list[Timed[TargetReport]]]:
    """The adversaries that were reported, and the false reports: of those of one class within `within_m` the first."""
    right: set[int] = set()
    false: list[Timed[TargetReport]] = []
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


def _error_m(truth: Truth, actor: int, said: Timed[TargetReport]) -> float:
    return float(truth.distances(said.time.s, said.value.east_m, said.value.north_m)[actor])


def _reported(truth: Truth, actor: int, said: Timed[TargetReport]) -> Evidence:
    text = f"{truth.cast[actor].id} in report {said.value.id}, {_error_m(truth, actor, said):.1f} m from its place"
    return Evidence(time_s=said.time.s, text=text)


def _unreported(truth: Truth, actor: int, tape: Tape) -> Evidence:
    return Evidence(time_s=tape.end_s, text=f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) was never reported")


targets_reported = Measured("targets_reported", TargetsReportedOptions, _targets_reported)
report_accuracy = Measured("report_accuracy", ReportAccuracyOptions, _report_accuracy)
priority_order = Measured("priority_order", WithinOptions, _priority_order)
no_false_reports = Measured("no_false_reports", NoFalseReportsOptions, _no_false_reports)
reports_in_time = Measured("reports_in_time", ReportsInTimeOptions, _reports_in_time)
report_after_sight = Measured("report_after_sight", ReportAfterSightOptions, _report_after_sight)
report_class_right = Measured("report_class_right", WithinOptions, _report_class_right)
reports_not_repeated = Measured("reports_not_repeated", WithinOptions, _reports_not_repeated)
bystanders_not_reported = Measured("bystanders_not_reported", BystandersNotReportedOptions, _bystanders_not_reported)
report_confidence_kept = Measured("report_confidence_kept", NoOptions, _report_confidence_kept)
report_windows_kept = Measured("report_windows_kept", NoOptions, _report_windows_kept)
