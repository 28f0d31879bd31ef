"""Measures of positive identification: whether a report rests on a second look at its target.

Only looks count whose exposures the report cites.
"""

from __future__ import annotations

import math

import numpy as np

from bench.arrays import Floats
from bench.contracts import Tape, TargetReport, Timed
from bench.simspec import SimSpec

from .._declaration import Finding, consider, measure, nothing_shown
from .._verdicts import Verdict, wrong_first
from ..ground_truth import GroundTruth
from ..perception.looks import are_looks
from ..perception.sightings import Sightings
from .credibility import FALSE_BEYOND_M, NO_KNOWLEDGE, NO_TARGETS, shows_knowledge

CITED_WITHIN_S = 0.01
"""A cited time is that of the nearest exposure within this. Cameras expose ten times a second and state when: a time
between two exposures was made up.
"""


@measure
def second_look(tape: Tape, simspec: SimSpec, *, min_angle_deg: float = 20.0) -> Finding:
    """Share of the reported adversaries whose first report, and every mark, rests on looks from two sides.

    Two looks are from two sides when the directions from the target to the vehicle differ by `min_angle_deg`
    on the ground. Agreement with intelligence is no second source: every target has it. Only reports that show
    knowledge count; 0 without any. Considered when intelligence names an adversary.
    """
    truth = GroundTruth.of(tape, simspec)
    consider(truth.targets(), NO_TARGETS)
    reported: dict[int, bool] = {}
    verdicts = []
    for report in tape.reports:
        subject = truth.subject(report.value, report.time.s, FALSE_BEYOND_M)
        if subject is None or not shows_knowledge(truth, tape, report, subject):
            continue
        # Later reports without a mark change no harm: the first one told the operator, and marks act.
        if subject in reported and not report.value.mark:
            continue
        angle_deg = _widest_angle_deg(truth, tape, report, subject)
        sound = angle_deg >= min_angle_deg
        reported[subject] = reported.get(subject, True) and sound
        text = f"report {report.value.id} rests on looks at {truth.cast[subject].id} that differ by {angle_deg:.0f} degrees"
        verdicts.append(Verdict(report.time.s, sound, text))
    if not reported:
        return nothing_shown(tape.end_s, NO_KNOWLEDGE)
    return Finding(sum(reported.values()) / len(reported), wrong_first(verdicts))


def _widest_angle_deg(truth: GroundTruth, tape: Tape, report: Timed[TargetReport], actor: int) -> float:
    """The largest difference between the directions of two looks that the report cites; 0 with fewer."""
    _, bearings = looks_cited(truth, tape, report, actor)
    apart = np.abs((bearings[:, None] - bearings[None] + math.pi) % (2.0 * math.pi) - math.pi)
    return float(np.degrees(apart.max(initial=0.0)))


def looks_cited(
    truth: GroundTruth, tape: Tape, report: Timed[TargetReport], actor: int
) -> tuple[Floats, Floats]:
    """Times (l,) of the looks at an actor that a report cites, each once, and the bearings (l,) as in `looks_at`."""
    looks_s, bearings_rad = looks_at(truth, tape, actor)
    if not len(looks_s):
        return looks_s, bearings_rad
    # Sorted look-ups, because an agent may flood the bench with marks that cite hundreds of frames.
    cited_s = np.array(
        [time_s for time_s in report.value.evidence if time_s <= report.time.s + CITED_WITHIN_S]
    )
    after = np.clip(np.searchsorted(looks_s, cited_s), 0, len(looks_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(looks_s[before] - cited_s) < np.abs(looks_s[after] - cited_s), before, after)
    looks = np.unique(nearest[np.abs(looks_s[nearest] - cited_s) <= CITED_WITHIN_S])
    return looks_s[looks], bearings_rad[looks]


def looks_at(truth: GroundTruth, tape: Tape, actor: int) -> tuple[Floats, Floats]:
    """Times (l,) of the looks at an actor, and the bearings (l,) from it to the vehicle then."""

    def search() -> tuple[Floats, Floats]:
        sightings = Sightings.of(tape)
        looks_s = sightings.time_s[sightings.are_of([actor]) & are_looks(truth, tape)]
        if not len(looks_s) or not len(tape.vehicle_time_s):
            return looks_s, np.zeros(len(looks_s))
        places = truth.at_each(looks_s, [actor])[:, 0]
        offsets = [
            np.interp(looks_s, tape.vehicle_time_s, tape.vehicle_position_enu_m[:, axis]) - places[:, axis]
            for axis in (0, 1)
        ]
        return looks_s, np.arctan2(offsets[1], offsets[0])

    return tape.cached((looks_at, truth, actor), search)
