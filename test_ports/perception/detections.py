"""Measures of detections, against the truth of each camera frame.

They judge the perception that the bench provides ([ruling 25](rulings.md)): with `perception.source: truth`,
`simulated` or `detector` its detections, whatever the agent makes of them. With `source: agent` there are none, and
no run is considered.

Frames of the main camera count, and of those in `perception.more_cameras`. A frame whose result was still pending when the session ended is left out. Any other frame without a result is
a miss. The measures are considered when the scenario has an actor of the role.
"""

from __future__ import annotations

import re
from typing import Annotated

import numpy as np

from bench.contracts import Evidence, Tape
from bench.simspec import IDENTIFIER, SimSpec

from .._declaration import Finding, Limit, consider, measure, not_considered, nothing_shown
from ..ground_truth import GroundTruth, RoleName
from .answers import Answers
from .clear_views import NO_DETECTIONS, DetectionCriteria, clear_views
from .sightings import ViewCriteria
from .stages import with_stages

AssetName = Annotated[
    # Not one of the catalogue: a situation may have assets of its own.
    str, Limit(lambda asset: not asset or re.match(IDENTIFIER, asset), "empty or the name of an asset")
]


@measure
def detection_share(
    tape: Tape,
    simspec: SimSpec,
    *,
    role: RoleName,
    class_: str = "",
    asset: AssetName = "",
    min_confidence: float = 0.35,
    min_height_px: float = 12.0,
    min_visible: float = 0.5,
    max_visible: float = 1.0,
    min_range_m: float = 0.0,
    max_range_m: float = 100_000.0,
    min_iou: float = 0.2,
) -> Finding:
    """Share of the clear views in which the actor is detected with the right class.

    The result of the same exposure must hold a detection of the right class with a score of at least
    `min_confidence`, and its box must overlap the true box by at least `min_iou` (intersection over union).
    The right class is the actor's own; `class` sets another label, and `class: any` accepts every label. One
    box may cover several actors. `asset` selects the actors of one entry of the asset catalogue.
    `max_visible` and the ranges select views, for example poor ones. 0 when no actor came into such a view.
    """
    consider(simspec.perception.by_bench, NO_DETECTIONS)
    truth = GroundTruth.of(tape, simspec)
    actors = truth.of_role(role, asset)
    subject = f"role {role}" + (f" and asset {asset}" if asset else "")
    consider(actors, f"the scenario has no actor of {subject}")
    criteria = ViewCriteria(min_height_px, min_visible, max_visible, min_range_m, max_range_m)
    detection = DetectionCriteria(min_confidence, min_iou, class_)
    views = clear_views(tape, simspec, actors, criteria, detection)
    return with_stages(views.finding(truth, subject, tape.end_s, "detected"), truth, tape, actors)


@measure
def detection_precision(
    tape: Tape, simspec: SimSpec, *, role: RoleName, min_confidence: float = 0.35, min_iou: float = 0.2
) -> Finding:
    """Share of the detections with a class of the role that lie on an actor of that class, however hidden.

    `role: any` takes the detections of every class. 0 without such detections.
    """
    consider(simspec.perception.by_bench, NO_DETECTIONS)
    truth = GroundTruth.of(tape, simspec)
    labels = truth.classes_of(role)
    consider(labels, f"the scenario has no actor of role {role}")
    answers = Answers.of(tape, simspec)
    judged = answers.score >= min_confidence
    if role != "any":
        judged &= np.isin(answers.label, list(labels))
    if not judged.any():
        return nothing_shown(tape.end_s, "no such detection was made")
    pairs = answers.overlaps(min_iou)
    actors = answers.sightings.actor[pairs.sighting]
    on_its_class = np.zeros(len(judged), dtype=np.bool_)
    on_its_class[pairs.detection[answers.label[pairs.detection] == truth.labels[actors]]] = True
    wrong = tuple(
        Evidence(
            time_s=float(answers.time_s[row]),
            text=f"{answers.label[row]} detected ({answers.score[row]:.2f}) where there is none",
        )
        for row in np.flatnonzero(judged & ~on_its_class)
    )
    return Finding(int((judged & on_its_class).sum()) / int(judged.sum()), wrong)


@measure
def detection_role_right(
    tape: Tape,
    simspec: SimSpec,
    *,
    role: RoleName,
    as_role: RoleName,
    min_confidence: float = 0.35,
    min_height_px: float = 12.0,
    min_visible: float = 0.5,
    min_iou: float = 0.2,
) -> Finding:
    """Share of the detections on the role's actors in clear view that do not take the actor for one of
    `as_role`.

    A detection is on the actor whose box it overlaps most. It is wrong when its class occurs among the actors
    of `as_role` but not among those of `role`. Considered when both roles are in the scenario and have
    different classes. 0 when no actor of the role was detected.
    """
    consider(simspec.perception.by_bench, NO_DETECTIONS)
    truth = GroundTruth.of(tape, simspec)
    right_classes = truth.classes_of(role)
    # A class that both roles have, such as a car, tells nothing about the role.
    wrong_classes = truth.classes_of(as_role) - right_classes
    if not right_classes or not wrong_classes:
        return not_considered(
            f"the scenario has no actors of roles {role} and {as_role} with different classes"
        )
    answers = Answers.of(tape, simspec)
    criteria = ViewCriteria(min_height_px, min_visible)
    candidates = answers.sightings.are_of(truth.of_role(role)) & criteria.are_clear(answers.sightings)
    pairs = answers.overlaps(min_iou).largest()
    pairs = pairs.where(candidates[pairs.sighting] & (answers.score[pairs.detection] >= min_confidence))
    is_wrong = np.isin(answers.label[pairs.detection], list(wrong_classes))
    mistakes = pairs.where(is_wrong)
    mistaken = []
    for row, actor in zip(mistakes.detection, answers.sightings.actor[mistakes.sighting], strict=True):
        member = truth.cast[actor]
        text = f"{member.id} ({member.class_label}) detected as {answers.label[row]}"
        mistaken.append(Evidence(time_s=float(answers.time_s[row]), text=text))
    if not len(is_wrong):
        return nothing_shown(tape.end_s, f"no actor of role {role} was detected in clear view")
    return Finding(int((~is_wrong).sum()) / len(is_wrong), tuple(mistaken))


@measure
def steady_detection(
    tape: Tape,
    simspec: SimSpec,
    *,
    role: RoleName,
    min_confidence: float = 0.35,
    min_height_px: float = 12.0,
    min_visible: float = 0.5,
    min_iou: float = 0.2,
) -> Finding:
    """Detection share of the worse half of the clear views, divided by that of the better half.

    The views are split in order of time, into halves of equal number. 0 with fewer than two views.
    """
    consider(simspec.perception.by_bench, NO_DETECTIONS)
    truth = GroundTruth.of(tape, simspec)
    actors = truth.of_role(role)
    consider(actors, f"the scenario has no actor of role {role}")
    criteria = ViewCriteria(min_height_px, min_visible)
    detection = DetectionCriteria(min_confidence, min_iou)
    views = clear_views(tape, simspec, actors, criteria, detection)
    return with_stages(views.steadiness(role, tape.end_s, "detected"), truth, tape, actors)
