"""Measures of detections, against the truth of each camera frame.

They judge the perception that the bench provides ([ruling 25](rulings.md)): with `perception.source: truth`,
`simulated` or `detector` its detections, whatever the agent makes of them. With `source: agent` there are none, and
no run is considered.

Frames of the main camera count, and of those in `perception.more_cameras`. A frame whose result was still pending when the session ended is left out. Any other frame without a result is
a miss. The measures are considered when the scenario has an actor of the role.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Annotated

from bench.contracts import CameraFrame, Detection, Evidence, Sighting, Tape
from bench.simspec import ASSETS, SimSpec

from .._declaration import Finding, Limit, measure, not_considered, nothing_shown
from ..ground_truth import GroundTruth, RoleName
from .clear_views import (
    ClearView,
    ViewCriteria,
    answered_frames,
    clear_views,
    detected_share,
    evenness,
    intersection_over_union,
    no_detections,
)

AssetName = Annotated[
    str, Limit(lambda asset: not asset or asset in ASSETS, f"empty or one of {', '.join(ASSETS)}")
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
    if reason := no_detections(simspec):
        return not_considered(reason)
    truth = GroundTruth.of(tape, simspec)
    actors = truth.of_role(role, asset)
    subject = f"role {role}" + (f" and asset {asset}" if asset else "")
    if not actors:
        return not_considered(f"the scenario has no actor of {subject}")
    criteria = ViewCriteria(
        min_confidence,
        min_height_px,
        min_visible,
        max_visible,
        min_range_m,
        max_range_m,
        min_iou,
        label=class_,
    )
    views = clear_views(tape, simspec, actors, criteria)
    x = detected_share(views)
    if x is None:
        return nothing_shown(tape.end_s, f"no actor of {subject} ever came into such a view")
    return Finding(x, _worst_first(truth, views))


def _worst_first(truth: GroundTruth, views: Iterable[ClearView]) -> tuple[Evidence, ...]:
    views_of: dict[int, list[ClearView]] = defaultdict(list)
    for view in views:
        views_of[view.actor].append(view)
    evidence = []
    for actor in sorted(views_of, key=lambda actor: (detected_share(views_of[actor]) or 0.0, actor)):
        missed_s = [view.time_s for view in views_of[actor] if not view.detected]
        member, count = truth.cast[actor], len(views_of[actor])
        text = (
            f"{member.id} ({member.class_label}): detected in {count - len(missed_s)} of {count} clear frames"
        )
        time_s = missed_s[0] if missed_s else views_of[actor][0].time_s
        evidence.append(Evidence(time_s=time_s, text=f"{text}, first missed here" if missed_s else text))
    return tuple(evidence)


@measure
def detection_precision(
    tape: Tape, simspec: SimSpec, *, role: RoleName, min_confidence: float = 0.35, min_iou: float = 0.2
) -> Finding:
    """Share of the detections with a class of the role that lie on an actor of that class, however hidden.

    `role: any` takes the detections of every class. 0 without such detections.
    """
    if reason := no_detections(simspec):
        return not_considered(reason)
    truth = GroundTruth.of(tape, simspec)
    labels = truth.classes_of(role)
    if not labels:
        return not_considered(f"the scenario has no actor of role {role}")
    right, wrong = 0, []
    for frame, answer in answered_frames(tape, simspec):
        for detection in answer.detections if answer else ():
            if detection.score < min_confidence or (role != "any" and detection.class_label not in labels):
                continue
            if _lies_on_its_class(truth, frame, detection, min_iou):
                right += 1
            else:
                text = f"{detection.class_label} detected ({detection.score:.2f}) where there is none"
                wrong.append(Evidence(time_s=frame.exposed.s, text=text))
    if not right and not wrong:
        return nothing_shown(tape.end_s, "no such detection was made")
    return Finding(right / (right + len(wrong)), tuple(wrong))


def _lies_on_its_class(truth: GroundTruth, frame: CameraFrame, detection: Detection, min_iou: float) -> bool:
    return any(
        truth.cast[sighting.actor].class_label == detection.class_label
        and intersection_over_union(detection.box, sighting.box) >= min_iou
        for sighting in frame.sightings
    )


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
    if reason := no_detections(simspec):
        return not_considered(reason)
    truth = GroundTruth.of(tape, simspec)
    right_classes = truth.classes_of(role)
    # A class that both roles have, such as a car, tells nothing about the role.
    wrong_classes = truth.classes_of(as_role) - right_classes
    if not right_classes or not wrong_classes:
        return not_considered(
            f"the scenario has no actors of roles {role} and {as_role} with different classes"
        )
    actors = set(truth.of_role(role))
    criteria = ViewCriteria(min_height_px=min_height_px, min_visible=min_visible)
    mistaken, right = [], 0
    for time_s, detection, sighting, overlap in _detections_on_actors(tape, simspec):
        if detection.score < min_confidence or overlap < min_iou:
            continue
        if sighting.actor not in actors or not criteria.is_clear(sighting):
            continue
        if detection.class_label in wrong_classes:
            member = truth.cast[sighting.actor]
            text = f"{member.id} ({member.class_label}) detected as {detection.class_label}"
            mistaken.append(Evidence(time_s=time_s, text=text))
        else:
            right += 1
    if not right and not mistaken:
        return nothing_shown(tape.end_s, f"no actor of role {role} was detected in clear view")
    return Finding(right / (right + len(mistaken)), tuple(mistaken))


def _detections_on_actors(tape: Tape, simspec: SimSpec) -> list[tuple[float, Detection, Sighting, float]]:
    """Every detection in a frame with actors in sight: when, the sighting whose box it overlaps most, and by
    how much.
    """

    def match_by_overlap() -> list[tuple[float, Detection, Sighting, float]]:
        matches = []
        for frame, answer in answered_frames(tape, simspec):
            for detection in answer.detections if answer and frame.sightings else ():
                overlaps = [
                    intersection_over_union(detection.box, sighting.box) for sighting in frame.sightings
                ]
                greatest = max(overlaps)
                matches.append(
                    (frame.exposed.s, detection, frame.sightings[overlaps.index(greatest)], greatest)
                )
        return matches

    return tape.cached((_detections_on_actors, id(simspec)), match_by_overlap)


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
    if reason := no_detections(simspec):
        return not_considered(reason)
    actors = GroundTruth.of(tape, simspec).of_role(role)
    if not actors:
        return not_considered(f"the scenario has no actor of role {role}")
    criteria = ViewCriteria(min_confidence, min_height_px, min_visible, min_iou=min_iou)
    views = clear_views(tape, simspec, actors, criteria)
    if len(views) < 2:
        return nothing_shown(tape.end_s, f"role {role} was in clear view {len(views)} times")
    # Halves by count and not by time: an aircraft may see most of the actors in a few seconds.
    middle = len(views) // 2
    early, late = detected_share(views[:middle]) or 0.0, detected_share(views[middle:]) or 0.0
    text = f"detected in {early:.0%} of the clear views before this moment, in {late:.0%} from it on"
    return Finding(evenness(early, late), (Evidence(time_s=views[middle].time_s, text=text),))
