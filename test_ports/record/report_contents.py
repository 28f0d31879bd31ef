"""Measures of what the reports state about themselves: their fields, evidence, links, uncertainty and
confidence.

These measures are considered when intelligence names an adversary. They are 0 without reports, and multiplied
by the credibility of the reports: a record of guesses is worth no more than the guesses. Where a measure is
about reports on an adversary or a target, these must show knowledge of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np

from bench.contracts import Evidence, Tape, TargetReport, Timed
from bench.simspec import SimSpec

from .._declaration import Finding, Limit, measure, not_considered
from ..ground_truth import EXACT_S, GroundTruth, scheduled_faults
from ..perception.looks import are_looks
from ..perception.sightings import Sightings
from ..reports.credibility import NO_TARGETS, believed, known_subjects, report_credibility
from .verdicts import Verdict, share_of_reports, share_right

AFTERMATH_S = 30.0
"""How long after a navigation fault reports still count as made under it. Chosen, not measured."""

IS_FILLED: dict[str, Callable[[TargetReport], bool]] = {
    "intelligence_id": lambda report: bool(report.intelligence_id),
    "bystanders_seen": lambda report: report.bystanders_seen is not None,
    "nearest_bystander_m": lambda report: report.nearest_bystander_m is not None,
    "evidence": lambda report: bool(report.evidence),
    "reason": lambda report: bool(report.reason.strip()),
    "position_sigma_m": lambda report: report.position_sigma_m is not None,
}


def _field_names(fields: str) -> list[str]:
    return [name.strip() for name in fields.split(",")]


FieldNames = Annotated[
    str,
    Limit(
        lambda fields: all(name in IS_FILLED for name in _field_names(fields)),
        f"names separated by commas, of {', '.join(IS_FILLED)}",
    ),
]


@measure
def report_fields(tape: Tape, simspec: SimSpec, *, fields: FieldNames = "evidence") -> Finding:
    """Mean share of the named fields that the reports fill.

    `fields` is a list, separated by commas, of intelligence_id, bystanders_seen, nearest_bystander_m,
    evidence, reason, position_sigma_m.
    """
    truth = GroundTruth.of(tape, simspec)
    if not truth.targets():
        return not_considered(NO_TARGETS)
    verdicts = []
    for report in tape.reports:
        for name in _field_names(fields):
            filled = IS_FILLED[name](report.value)
            text = f"report {report.value.id}: {name}{'' if filled else ' is missing'}"
            verdicts.append(Verdict(report.time.s, filled, text))
    return share_right(verdicts, report_credibility(truth, tape))


@measure
def evidence_count(tape: Tape, simspec: SimSpec, *, min_frames: int = 3) -> Finding:
    """Share of the reports that cite at least `min_frames` different exposures."""

    def judge(report: Timed[TargetReport]) -> Verdict:
        count = len(set(report.value.evidence))
        return Verdict(
            report.time.s, count >= min_frames, f"report {report.value.id} cites {count} exposures"
        )

    return share_of_reports(tape, simspec, judge)


@measure
def evidence_true(
    tape: Tape, simspec: SimSpec, *, min_height_px: float = 8.0, slack_s: float = 0.15
) -> Finding:
    """Share of the exposures cited by reports about an adversary that are looks at it.

    `min_height_px` is asked of what shows. The look is at most `slack_s` from the cited time, which must not be
    later than the report.
    """
    truth = GroundTruth.of(tape, simspec)
    if not truth.targets():
        return not_considered(NO_TARGETS)
    sightings = Sightings.of(tape)
    looks = are_looks(truth, tape, min_height_px)
    looks_s = {
        target: sightings.time_s[looks & sightings.are_of([target])] for target in truth.targets_present()
    }
    verdicts = []
    for report, subject in known_subjects(truth, tape):
        if subject is None:
            continue
        # Keys of a dict: an exposure cited twice counts once, and the order of the report stays.
        for cited_s in dict.fromkeys(report.value.evidence):
            off_s = _nearest_s(looks_s.get(subject), cited_s)
            right = off_s <= slack_s + EXACT_S and cited_s <= report.time.s + EXACT_S
            name = truth.cast[subject].id
            text = f"report {report.value.id}: {'' if right else 'no '}look at {name} at {cited_s:.2f} s"
            verdicts.append(Verdict(cited_s, right, text))
    return share_right(verdicts, report_credibility(truth, tape))


def _nearest_s(times: np.ndarray | None, time_s: float) -> float:
    """Seconds from a moment to the nearest of the times, which are in order; infinite when there are none."""
    if times is None or not math.isfinite(time_s):
        return math.inf
    after = int(np.searchsorted(times, time_s))
    return float(np.abs(times[max(0, after - 1) : after + 1] - time_s).min())


@measure
def intelligence_linked(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the reports about a target that name intelligence about that target."""
    truth = GroundTruth.of(tape, simspec)
    targets = {target.actor for target in truth.targets()}
    if not targets:
        return not_considered(NO_TARGETS)
    verdicts = []
    for report, subject in known_subjects(truth, tape):
        if subject in targets:
            named = report.value.intelligence_id
            right = named is not None and truth.target_of(named) == subject
            verdicts.append(
                Verdict(report.time.s, right, f"report {report.value.id} names {named or 'no intelligence'}")
            )
    return share_right(verdicts, report_credibility(truth, tape))


@measure
def uncertainty_honest(
    tape: Tape,
    simspec: SimSpec,
    *,
    sigmas: float = 3.0,
    max_sigma_m: float = 30.0,
    during: Literal["", "gps_drift", "gps_off"] = "",
) -> Finding:
    """Share of the reports about an adversary whose error is at most `sigmas` times the stated
    `position_sigma_m`.

    The stated sigma must be at most `max_sigma_m`. `during` selects the reports made during such a fault or
    up to 30 s after it, and the measure is considered when the scenario has the fault. It is 1 when no report
    was made then, but others were.
    """
    truth = GroundTruth.of(tape, simspec)
    if not truth.targets():
        return not_considered(NO_TARGETS)
    faults = scheduled_faults(simspec, during) if during else []
    spans = [(fault.at_s, fault.until_s + AFTERMATH_S) for fault in faults]
    if during and not spans:
        return not_considered(f"there is no {during}")
    about = [(report, subject) for report, subject in known_subjects(truth, tape) if subject is not None]
    verdicts = []
    for report, subject in about:
        if during and not any(from_s <= report.time.s <= to_s for from_s, to_s in spans):
            continue
        error_m = float(truth.distances(report.time.s, report.value.east_m, report.value.north_m)[subject])
        sigma_m = report.value.position_sigma_m
        right = sigma_m is not None and sigma_m <= max_sigma_m and error_m <= sigmas * sigma_m
        stated = "no sigma" if sigma_m is None else f"sigma {sigma_m:.1f} m"
        verdicts.append(
            Verdict(report.time.s, right, f"report {report.value.id}: {error_m:.1f} m off, {stated} stated")
        )
    # Holding reports back during a fault of navigation is honest.
    if about and not verdicts:
        return believed(truth, tape, 1.0, (Evidence(time_s=spans[0][0], text=f"no report during {during}"),))
    return share_right(verdicts, report_credibility(truth, tape))


@measure
def confidence_honest(tape: Tape, simspec: SimSpec, *, within_m: float = 20.0) -> Finding:
    """1 - |mean stated confidence - share of the reports within `within_m` of an adversary of their
    class|.
    """
    truth = GroundTruth.of(tape, simspec)
    if not truth.targets():
        return not_considered(NO_TARGETS)
    if not tape.reports:
        return share_right([])
    right = [
        subject is not None and truth.subject(report.value, report.time.s, within_m) == subject
        for report, subject in known_subjects(truth, tape)
    ]
    right_share = sum(right) / len(right)
    # fsum: the mean must not depend on the order of the reports.
    stated = math.fsum(report.value.confidence for report in tape.reports) / len(tape.reports)
    text = f"confidence {stated:.2f} on average, {right_share:.2f} right"
    moment = Evidence(time_s=tape.reports[-1].time.s, text=text)
    return believed(truth, tape, max(0.0, 1.0 - abs(stated - right_share)), (moment,))


@measure
def ids_unique(tape: Tape, simspec: SimSpec) -> Finding:
    """Number of different ids divided by the number of reports."""
    earlier_ids: set[str] = set()

    def judge(report: Timed[TargetReport]) -> Verdict:
        is_new = report.value.id not in earlier_ids
        earlier_ids.add(report.value.id)
        return Verdict(
            report.time.s, is_new, f"report {report.value.id}{'' if is_new else ' repeats an earlier id'}"
        )

    return share_of_reports(tape, simspec, judge)
