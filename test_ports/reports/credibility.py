"""Which reports are right, which are false, and how far all reports of an agent are believed for it."""

from __future__ import annotations

import math

from bench.contracts import Tape, TargetReport, Timed

from .._declaration import credibility
from ..ground_truth import GroundTruth

NO_TARGETS = "intelligence names no adversary"
"""Reason for which most measures of reports are not considered."""

FALSE_BEYOND_M = 30.0
"""A report farther than this from every adversary of its class is false. Chosen, not measured."""

MAX_FALSE_PLACES = 500
"""False places that are told apart: with so many an agent has no credibility, and more would only cost
time.
"""


def report_credibility(truth: GroundTruth, tape: Tape) -> float:
    """How far the reports as a whole are believed, by the adversaries and the false places among them."""
    adversaries, false_reports = right_and_false(truth, tape, FALSE_BEYOND_M)
    return credibility(len(adversaries), len(false_reports))


def right_and_false(
    truth: GroundTruth, tape: Tape, within_m: float
) -> tuple[set[int], list[Timed[TargetReport]]]:
    """The adversaries that were reported, and the false reports: of those of one class within `within_m` only
    the first.
    """
    adversaries: set[int] = set()
    false_reports: list[Timed[TargetReport]] = []
    for report in tape.reports:
        subject = truth.subject(report.value, report.time.s, within_m)
        if subject is not None:
            adversaries.add(subject)
        elif len(false_reports) < MAX_FALSE_PLACES and not any(
            same_place(report.value, other.value, within_m) for other in false_reports
        ):
            false_reports.append(report)
    return adversaries, false_reports


def same_place(report: TargetReport, other: TargetReport, within_m: float) -> bool:
    """Whether two reports name one class at places at most `within_m` apart."""
    distance_m = math.hypot(report.east_m - other.east_m, report.north_m - other.north_m)
    return report.class_label == other.class_label and distance_m <= within_m


def subjects_of_reports(truth: GroundTruth, tape: Tape) -> list[tuple[Timed[TargetReport], int | None]]:
    """Every report with the adversary that it is about, None for one that is about none."""
    return tape.cached(
        (subjects_of_reports, truth),
        lambda: [(report, truth.subject(report.value, report.time.s)) for report in tape.reports],
    )
