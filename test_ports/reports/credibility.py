"""Which reports are right and which are false, and which show knowledge of whom they are about."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from bench.contracts import Evidence, Tape, TargetReport, Timed

from ..ground_truth import GroundTruth, subjects_of_reports
from ..perception.looks import first_look_s, no_look_by
from .places import PlaceGrid

NO_KNOWLEDGE = "no report shows knowledge of an adversary"

NO_TARGETS = "intelligence names no adversary"
"""Reason for which most measures of reports are not considered."""

FALSE_BEYOND_M = 30.0
"""A report farther than this from every adversary of its class is false. Chosen, not measured."""

ONE_PLACE_M = 10.0
"""False reports of one class this near to each other are one guess made again: two measurements of one thing agree
that well. Guesses that are spread round a place, so that one of them must hit, are as many false ones. Chosen.
"""

RESTATED_WITHIN_M = 1.0
"""A report this near to a position that intelligence stated repeats it. Intelligence is wrong by tens of metres, so a
measured position falls that near by chance once in some thousand reports.
"""

MEASURED_WITHIN_M = 10.0
"""A report this near to the adversary is believed wherever intelligence stated it: half of the 20 m that count as
placed, and twice the error of the reference agents' reports without drift. Chosen.
"""

MAX_FALSE_PLACES = 500
"""False places that are told apart: with so many nothing is right, and more would only cost time."""

GUESSED_WITHIN_M, MISSED_BEYOND_M, MOST_MISSES = 60.0, 20.0, 2
"""An agent that names more than two places of one class within 60 m of an adversary, each more than 20 m beside every
adversary of that class, has guessed round it. A first report and a correction may both miss. The null agent `everywhere`
names a place every 30 m. Chosen.
"""


def report_credibility(truth: GroundTruth, tape: Tape) -> float:
    """The number of adversaries reported with knowledge over that of the false places, at most 1."""
    adversaries, false_reports = right_and_false(truth, tape, FALSE_BEYOND_M)
    return min(1.0, len(adversaries) / max(len(false_reports), 1)) if adversaries else 0.0


def right_and_false(
    truth: GroundTruth, tape: Tape, within_m: float
) -> tuple[set[int], list[Timed[TargetReport]]]:
    """The adversaries that were reported with knowledge, and the false reports: of those of one class at one place
    only the first.

    A report without knowledge of its subject is a guess, and false, even where it happens to be right.
    """
    adversaries: set[int] = set()
    false_reports: list[Timed[TargetReport]] = []
    places = PlaceGrid(min(within_m, ONE_PLACE_M))
    for report in tape.reports:
        subject = truth.subject(report.value, report.time.s, within_m)
        if subject is not None and shows_knowledge(truth, tape, report, subject):
            adversaries.add(subject)
        elif len(places) < MAX_FALSE_PLACES and places.first_match(report.value) is None:
            places.add(report.value)
            false_reports.append(report)
    return adversaries, false_reports


def known_subjects(truth: GroundTruth, tape: Tape) -> list[tuple[Timed[TargetReport], int | None]]:
    """Every report with the adversary of which it shows knowledge, None for one that shows none."""
    return tape.cached(
        (known_subjects, truth),
        lambda: [
            (
                report,
                subject if subject is not None and shows_knowledge(truth, tape, report, subject) else None,
            )
            for report, subject in subjects_of_reports(truth, tape)
        ],
    )


def first_known_s(truth: GroundTruth, tape: Tape) -> dict[int, float]:
    """When each adversary was first reported with knowledge, in order of these reports; without those that never were."""
    first_s: dict[int, float] = {}
    for report, subject in known_subjects(truth, tape):
        if subject is not None:
            first_s.setdefault(subject, report.time.s)
    return first_s


def known_reports(truth: GroundTruth, tape: Tape) -> list[Timed[TargetReport]]:
    """The reports that show knowledge of an adversary."""
    return [report for report, subject in known_subjects(truth, tape) if subject is not None]


def shows_knowledge(truth: GroundTruth, tape: Tape, report: Timed[TargetReport], actor: int) -> bool:
    """Whether there was a look at this actor before the report, and the report neither repeats what intelligence
    stated nor is one of several guesses round the actor.

    The truth decides, whatever the report cites (docs/rulings.md, ruling 23).
    """
    if first_look_s(truth, tape, actor) > report.time.s:
        return False
    if reports_guess_round(truth, tape, actor):
        return False
    return not restates(truth, (report.value.east_m, report.value.north_m), actor, report.time.s)


def reports_guess_round(truth: GroundTruth, tape: Tape, actor: int) -> bool:
    """Whether the reports of a run are guesses round this actor."""
    return tape.cached((guessed_round, truth, actor), lambda: guessed_round(truth, actor, tape.reports))


def guessed_round(truth: GroundTruth, actor: int, messages: Iterable[Timed[Any]]) -> bool:
    """Whether messages that name a class at a place, such as reports, miss an actor at more than two places near it."""
    label = truth.cast[actor].class_label
    alike = [other for other in truth.targets_present() if truth.cast[other].class_label == label]
    misses = PlaceGrid(ONE_PLACE_M)
    for message in messages:
        if message.value.class_label != label:
            continue
        distances_m = truth.distances(message.time.s, message.value.east_m, message.value.north_m)
        is_miss = distances_m[actor] <= GUESSED_WITHIN_M and distances_m[alike].min() > MISSED_BEYOND_M
        if is_miss and misses.first_match(message.value) is None:
            misses.add(message.value)
        if len(misses) > MOST_MISSES:
            return True
    return False


def false_report(truth: GroundTruth, tape: Tape, report: Timed[TargetReport], within_m: float) -> Evidence:
    """What a false report lacks."""
    reason, actor = (
        f"no such adversary within {within_m:g} m",
        truth.subject(report.value, report.time.s, within_m),
    )
    if actor is not None:
        told = f"{truth.cast[actor].id} was placed as intelligence had it, or guessed at"
        reason = no_look_by(truth, tape, actor, report.time.s) or told
    text = f"report {report.value.id} ({report.value.class_label}): {reason}"
    return Evidence(time_s=report.time.s, text=text)


def restates(truth: GroundTruth, place: tuple[float, float], actor: int, time_s: float) -> bool:
    """Whether a position of an adversary adds nothing to intelligence: it is a stated one, or nearer to a stated
    one than to the adversary, and not measured well either.

    So some metres of noise do not turn a stated position into a find.
    """
    stated_m = min((math.dist(place, area.place) for area in truth.sub_areas()), default=math.inf)
    if stated_m <= RESTATED_WITHIN_M:
        return True
    error_m = float(truth.distances(time_s, *place)[actor])
    return error_m > max(stated_m, MEASURED_WITHIN_M)
