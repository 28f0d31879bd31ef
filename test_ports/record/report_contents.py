"""Measures of what the reports state about themselves: their evidence, links and uncertainty.

These measures are considered when intelligence names an adversary. They are about the reports that show knowledge of an
adversary, and 0 without any: the record of a guess is worth nothing.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from bench.contracts import Tape, TargetReport, Timed
from bench.simspec import SimSpec

from .._declaration import Finding, consider, measure, shown
from .._verdicts import Verdict, share_right
from ..ground_truth import EXACT_S, GroundTruth, scheduled_faults
from ..perception.looks import are_looks
from ..perception.sightings import Sightings
from ..reports.credibility import NO_TARGETS, known_subjects
from ..reports.second_look import CITED_WITHIN_S, looks_cited

AFTERMATH_S = 30.0
"""How long after a navigation fault reports still count as made under it. Chosen, not measured."""


@measure
def evidence_count(tape: Tape, simspec: SimSpec, *, min_frames: int = 3) -> Finding:
    """Share of the reports that cite at least `min_frames` different looks at the adversary that they are about."""
    truth = GroundTruth.of(tape, simspec)
    consider(truth.targets(), NO_TARGETS)
    verdicts = []
    for report, subject in known_subjects(truth, tape):
        if subject is not None:
            count = len(looks_cited(truth, tape, report, subject)[0])
            text = f"report {report.value.id} cites {count} looks at {truth.cast[subject].id}"
            verdicts.append(Verdict(report.time.s, count >= min_frames, text))
    return share_right(verdicts)


@measure
def evidence_true(
    tape: Tape, simspec: SimSpec, *, min_height_px: float = 8.0, slack_s: float = CITED_WITHIN_S
) -> Finding:
    """Share of the exposures cited by reports about an adversary that are looks at it.

    `min_height_px` is asked of what shows. The look is at most `slack_s` from the cited time, which must not be
    later than the report.
    """
    truth = GroundTruth.of(tape, simspec)
    consider(truth.targets(), NO_TARGETS)
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
    return share_right(verdicts)


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
    consider(targets, NO_TARGETS)
    verdicts = []
    for report, subject in known_subjects(truth, tape):
        if subject in targets:
            named = report.value.intelligence_id
            right = named is not None and truth.target_of(named) == subject
            verdicts.append(
                Verdict(report.time.s, right, f"report {report.value.id} names {named or 'no intelligence'}")
            )
    return share_right(verdicts)


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
    consider(truth.targets(), NO_TARGETS)
    faults = scheduled_faults(simspec, during) if during else []
    spans = [(fault.at_s, fault.until_s + AFTERMATH_S) for fault in faults]
    consider(spans or not during, f"there is no {during}")
    about = [(report, subject) for report, subject in known_subjects(truth, tape) if subject is not None]

    def judge(report: Timed[TargetReport], subject: int) -> Verdict:
        error_m = float(truth.distances(report.time.s, report.value.east_m, report.value.north_m)[subject])
        sigma_m = report.value.position_sigma_m
        right = sigma_m is not None and sigma_m <= max_sigma_m and error_m <= sigmas * sigma_m
        stated = "no sigma" if sigma_m is None else f"sigma {sigma_m:.1f} m"
        return Verdict(
            report.time.s, right, f"report {report.value.id}: {error_m:.1f} m off, {stated} stated"
        )

    verdicts = [
        judge(report, subject)
        for report, subject in about
        if not during or any(from_s <= report.time.s <= to_s for from_s, to_s in spans)
    ]
    # Holding reports back during a fault of navigation is honest.
    if about and not verdicts:
        return shown(1.0, spans[0][0], f"no report during {during}")
    return share_right(verdicts)
