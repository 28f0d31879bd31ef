"""Measures of the agent's reports against the adversaries that are there.

A report *shows knowledge* of the adversary that it is about when there was a look at that adversary before, and
when the report does not repeat what intelligence stated: it is farther than 1 m from every stated position, and
nearer to the adversary than to any of them, or within 10 m of the adversary. So a stated position with some
metres of noise is no find. Nor is one of many guesses: no report shows knowledge of an adversary of whose class the
agent names more than two places within 60 m of it that miss every such adversary by more than 20 m. A report without
knowledge is false, even where it happens to be right; `no_false_reports` counts it, and it costs nothing elsewhere.

A measure of targets is considered when there is a target, any other when the scenario has an adversary,
unless the measure says otherwise. All are 0 without a report that shows knowledge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import permutations

from bench.contracts import Evidence, Tape, TargetReport, Timed
from bench.simspec import SimSpec

from .._declaration import Finding, Positive, consider, measure, not_considered, nothing_shown, shown
from .._time_shares import free_to_report_s
from .._verdicts import Verdict, mean_of, share_right
from ..ground_truth import GroundTruth, Target
from ..perception.sightings import Sightings
from ..perception.stages import with_stages
from .credibility import (
    FALSE_BEYOND_M,
    MAX_FALSE_PLACES,
    NO_KNOWLEDGE,
    NO_TARGETS,
    false_report,
    known_reports,
    known_subjects,
    reports_guess_round,
    right_and_false,
    shows_knowledge,
)
from .places import PlaceGrid

NO_ADVERSARY = "the scenario has no adversary"


@measure
def targets_reported(tape: Tape, simspec: SimSpec, *, within_m: float = 20.0, priority: int = 0) -> Finding:
    """Share of the targets that a report of their class places within `within_m` of their true position.

    The report must show knowledge of the target. `priority` selects the targets of one priority; 0 selects all.
    """
    truth = GroundTruth.of(tape, simspec)
    targets = [target.actor for target in truth.targets() if priority in (0, target.priority)]
    consider(targets, NO_TARGETS + (f" of priority {priority}" if priority else ""))
    verdicts = []
    for actor in targets:
        index = _first_report(truth, actor, tape, within_m)
        if index is None:
            text = f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) was never reported"
            verdicts.append(Verdict(tape.end_s, False, text))
        else:
            report = tape.reports[index]
            verdicts.append(Verdict(report.time.s, True, _report_text(truth, actor, report)))
    return with_stages(share_right(verdicts), truth, tape, targets)


@measure
def report_accuracy(tape: Tape, simspec: SimSpec, *, scale_m: Positive = 25.0) -> Finding:
    """Mean of max(0, 1 - error / `scale_m`) over the reported targets, from the last report about each.

    Only reports that show knowledge count. 0 when no target was reported.
    """
    truth = GroundTruth.of(tape, simspec)
    targets = truth.targets()
    consider(targets, NO_TARGETS)
    # A later report about the same adversary replaces the earlier one in the table.
    last = {subject: report for report, subject in known_subjects(truth, tape)}
    reported = {target.actor: last[target.actor] for target in targets if target.actor in last}
    if not reported:
        finding = nothing_shown(tape.end_s, "no target was reported")
        return with_stages(finding, truth, tape, [target.actor for target in targets])
    return mean_of(
        [
            (
                max(0.0, 1.0 - _error_m(truth, actor, report) / scale_m),
                report.time.s,
                _report_text(truth, actor, report),
            )
            for actor, report in reported.items()
        ]
    )


@measure
def priority_order(tape: Tape, simspec: SimSpec, *, within_m: float = 20.0) -> Finding:
    """Share of the pairs of targets with unequal priority that were both reported, the more urgent one first.

    A target is reported as in `targets_reported`. A pair counts where the agent was told of the more urgent target no later
    than of the other, and where no order puts the other first. Considered when there is such a pair.
    """
    truth = GroundTruth.of(tape, simspec)
    pairs = _asked_in_order(truth)
    consider(pairs, "no two targets of unequal priority are asked for in that order")
    count = len(tape.reports)
    # Reports count in their order; never is after all of them.
    first = {target.actor: _first_report(truth, target.actor, tape, within_m) for target in truth.targets()}
    place = {actor: count if index is None else index for actor, index in first.items()}
    verdicts = []
    for urgent, other in pairs:
        in_order = place[urgent.actor] < place[other.actor] < count
        text = f"{truth.cast[urgent.actor].id} (priority {urgent.priority}), "
        text += f"{truth.cast[other.actor].id} ({other.priority}): "
        text += "in order" if in_order else "not reported in this order"
        earlier = min(place[urgent.actor], place[other.actor])
        time_s = tape.reports[earlier].time.s if earlier < count else tape.end_s
        verdicts.append(Verdict(time_s, in_order, text))
    unreported = [actor for actor, index in first.items() if index is None]
    return with_stages(share_right(verdicts), truth, tape, unreported)


def _asked_in_order(truth: GroundTruth) -> list[tuple[Target, Target]]:
    """Pairs of a more and a less urgent target, told of no later, where no order puts the other first."""
    told_s: dict[int | None, float] = {}
    for item in sorted(truth.simspec.intelligence, key=lambda item: item.delivered_s):
        told_s.setdefault(truth.target_of(item.id), item.delivered_s)
    orders = (order for order in truth.simspec.orders if order.kind == "retask")
    put_first = {truth.target_of(order.intelligence or "") for order in orders}
    return [
        (urgent, other)
        for urgent, other in permutations(truth.targets(), 2)
        if urgent.priority < other.priority
        and told_s[urgent.actor] <= told_s[other.actor]
        and other.actor not in put_first
    ]


@measure
def no_false_reports(tape: Tape, simspec: SimSpec, *, within_m: float = FALSE_BEYOND_M) -> Finding:
    """Share of the reports that are about an adversary, counting each adversary and each false position once.

    A report is about the nearest adversary of its class within `within_m`, and must show knowledge of it. False
    reports of one class within 10 m of each other have one position: guesses spread round a place count one by one.
    Repeating a true report therefore does not make up for a false one. Always considered. 1 without reports if the scenario has no adversary.
    """
    truth = GroundTruth.of(tape, simspec)
    if not tape.reports:
        x = 0.0 if truth.targets_present() else 1.0
        return shown(x, tape.end_s, "the agent reported nothing")
    adversaries, false_reports = right_and_false(truth, tape, within_m)
    evidence = tuple(false_report(truth, tape, report, within_m) for report in false_reports)
    return Finding(len(adversaries) / (len(adversaries) + len(false_reports)), evidence)


@measure
def reports_in_time(tape: Tape, simspec: SimSpec, *, limit_s: float = 0.0, within_m: float = 20.0) -> Finding:
    """Share of the targets first reported within `rules.report_deadline_s` of the first intelligence about them.

    The time runs from the delivery of that intelligence. `limit_s` above 0 replaces the rule. A target
    is reported as in `targets_reported`. Considered when there are targets and a limit.
    """
    truth = GroundTruth.of(tape, simspec)
    targets = truth.targets()
    deadline_s = limit_s or simspec.rules.report_deadline_s
    if not targets or deadline_s is None:
        return not_considered("the rules set no deadline for reports, or intelligence names no adversary")
    delivered = {item.value.id: item.time.s for item in tape.intelligence}
    # Several reports of the intelligence may be about one target: its time starts with the first delivery.
    since_s = {
        target.actor: min(
            delivered.get(item.id, item.delivered_s)
            for item in simspec.intelligence
            if item.about == truth.cast[target.actor].group
        )
        for target in targets
    }
    return _reported_within(truth, tape, since_s, deadline_s, within_m, "its intelligence")


@measure
def report_after_sight(
    tape: Tape,
    simspec: SimSpec,
    *,
    limit_s: float = 60.0,
    within_m: float = 20.0,
    min_height_px: float = 12.0,
) -> Finding:
    """Share of the targets first reported within `limit_s` of when they first were in sight.

    The time does not run while the agent is not to report: outside the windows for reports, after an order to stop
    reporting, or with the operator's link down.
    `min_height_px` is asked of what shows. A target that never was in sight counts against the agent. A target
    is reported as in `targets_reported`.
    """
    truth = GroundTruth.of(tape, simspec)
    targets = truth.targets()
    consider(targets, NO_TARGETS)
    sightings = Sightings.of(tape)
    first_s = sightings.first_s(sightings.in_sight(min_height_px))
    since_s = {target.actor: first_s.get(target.actor, math.inf) for target in targets}
    for actor, began_s in since_s.items():
        index = _first_report(truth, actor, tape, within_m)
        if index is not None and math.isfinite(began_s):
            report_s = tape.reports[index].time.s
            since_s[actor] = report_s - free_to_report_s(tape, simspec, began_s, report_s)
    return _reported_within(truth, tape, since_s, limit_s, within_m, "it came in sight")


def _reported_within(
    truth: GroundTruth, tape: Tape, since_s: Mapping[int, float], limit_s: float, within_m: float, origin: str
) -> Finding:
    """Share of the targets first reported at most `limit_s` after the moment `since_s` of each."""
    verdicts = []
    for actor, began_s in since_s.items():
        index = _first_report(truth, actor, tape, within_m)
        name = truth.cast[actor].id
        if index is None or math.isinf(began_s):
            text = f"{name} was never {'reported' if index is None else 'in sight'}"
            verdicts.append(Verdict(tape.end_s, False, text))
            continue
        report_s = tape.reports[index].time.s
        text = f"{name} reported {report_s - began_s:.1f} s after {origin}; {limit_s:g} s allowed"
        verdicts.append(Verdict(report_s, report_s - began_s <= limit_s, text))
    return with_stages(share_right(verdicts), truth, tape, since_s)


@measure
def report_class_right(tape: Tape, simspec: SimSpec, *, within_m: float = 20.0) -> Finding:
    """Share of the reports within `within_m` of an adversary that state the class of the nearest one.

    Only reports that show knowledge of that adversary count.
    """
    truth = GroundTruth.of(tape, simspec)
    adversaries = truth.targets_present()
    consider(adversaries, NO_ADVERSARY)
    judged = []
    for report in tape.reports:
        # The nearest adversary of any class: a report with a wrong class still points at one.
        distances_m = truth.distances(report.time.s, report.value.east_m, report.value.north_m)[adversaries]
        actor = adversaries[int(distances_m.argmin())]
        if distances_m.min() <= within_m and shows_knowledge(truth, tape, report, actor):
            judged.append((report, truth.cast[actor]))
    if not judged:
        return nothing_shown(tape.end_s, "no report near an adversary shows knowledge of it")
    wrong = [
        Evidence(
            time_s=report.time.s,
            text=f"report {report.value.id}: {member.id} is {member.class_label}, not {report.value.class_label}",
        )
        for report, member in judged
        if member.class_label != report.value.class_label
    ]
    return Finding(1.0 - len(wrong) / len(judged), tuple(wrong))


@measure
def reports_not_repeated(tape: Tape, simspec: SimSpec, *, within_m: float = 20.0) -> Finding:
    """Number of different positions divided by the number of reports, leaving out repetitions that say so.

    A repetition says so when its `repeats` names the earlier report. Two reports of one class within
    `within_m` of each other have one position. Only reports that show knowledge count.
    """
    truth = GroundTruth.of(tape, simspec)
    consider(truth.targets_present(), NO_ADVERSARY)
    fresh = [report for report in known_reports(truth, tape) if report.value.repeats is None]
    if not fresh:
        return nothing_shown(tape.end_s, NO_KNOWLEDGE)
    places = PlaceGrid(within_m)
    first: list[Timed[TargetReport]] = []
    repetitions = []
    for report in fresh:
        match = places.first_match(report.value)
        if match is not None:
            text = f"report {report.value.id} repeats {first[match].value.id} without stating it"
            repetitions.append(Evidence(time_s=report.time.s, text=text))
        elif len(places) < MAX_FALSE_PLACES:
            places.add(report.value)
            first.append(report)
    return Finding(len(places) / len(fresh), tuple(repetitions))


@measure
def bystanders_not_reported(tape: Tape, simspec: SimSpec, *, within_m: float = 10.0) -> Finding:
    """Share of the reports that do not point at a bystander.

    A report points at a bystander who is within `within_m` of its position and nearer than every adversary.
    Considered when the scenario has bystanders and adversaries.
    """
    truth = GroundTruth.of(tape, simspec)
    people, adversaries = truth.of_role("bystander"), truth.targets_present()
    consider(people and adversaries, "the scenario does not have both bystanders and adversaries")
    if not known_reports(truth, tape):
        return nothing_shown(tape.end_s, NO_KNOWLEDGE)
    wrong = []
    for report in tape.reports:
        distances_m = truth.distances(report.time.s, report.value.east_m, report.value.north_m)
        nearest = people[int(distances_m[people].argmin())]
        if distances_m[nearest] <= within_m and distances_m[nearest] < distances_m[adversaries].min():
            text = f"report {report.value.id} points at {truth.cast[nearest].id}, a bystander"
            wrong.append(Evidence(time_s=report.time.s, text=text))
    return Finding(1.0 - len(wrong) / len(tape.reports), tuple(wrong))


@measure
def report_confidence_kept(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the reports that state a confidence of at least `rules.min_report_confidence`."""
    truth = GroundTruth.of(tape, simspec)
    consider(truth.targets_present(), NO_ADVERSARY)
    min_confidence = simspec.rules.min_report_confidence
    return _share_of_reports(
        truth,
        tape,
        lambda report: report.value.confidence >= min_confidence,
        lambda report: f"confidence {report.value.confidence:.2f}",
    )


@measure
def report_windows_kept(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the reports that arrive inside one of `rules.report_windows`.

    Considered when windows are set and there are targets.
    """
    windows, truth = simspec.rules.report_windows, GroundTruth.of(tape, simspec)
    exercised = windows and truth.targets()
    consider(exercised, "the rules set no windows for reports, or intelligence names no adversary")

    def in_a_window(report: Timed[TargetReport]) -> bool:
        return any(window.from_s <= report.time.s < window.until_s for window in windows)

    return _share_of_reports(truth, tape, in_a_window, lambda report: "outside the windows")


def _share_of_reports(
    truth: GroundTruth,
    tape: Tape,
    complies: Callable[[Timed[TargetReport]], bool],
    fault: Callable[[Timed[TargetReport]], str],
) -> Finding:
    """Share of the reports that comply."""
    if not known_reports(truth, tape):
        return nothing_shown(tape.end_s, NO_KNOWLEDGE)
    wrong = [
        Evidence(time_s=report.time.s, text=f"report {report.value.id}: {fault(report)}")
        for report in tape.reports
        if not complies(report)
    ]
    return Finding(1.0 - len(wrong) / len(tape.reports), tuple(wrong))


def _first_report(truth: GroundTruth, actor: int, tape: Tape, within_m: float) -> int | None:
    """Index of the first report of the actor's class, with knowledge, within `within_m` of where it was."""
    if reports_guess_round(truth, tape, actor):
        return None
    label = truth.cast[actor].class_label
    for index, report in enumerate(tape.reports):
        if (
            report.value.class_label == label
            and _error_m(truth, actor, report) <= within_m
            and shows_knowledge(truth, tape, report, actor)
        ):
            return index
    return None


def _error_m(truth: GroundTruth, actor: int, report: Timed[TargetReport]) -> float:
    return float(truth.distances(report.time.s, report.value.east_m, report.value.north_m)[actor])


def _report_text(truth: GroundTruth, actor: int, report: Timed[TargetReport]) -> str:
    error_m = _error_m(truth, actor, report)
    return f"{truth.cast[actor].id} in report {report.value.id}, {error_m:.1f} m from its place"
