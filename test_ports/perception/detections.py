"""Detections against the truth of each camera frame."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from bench.contracts import CameraFrame, Detection, Evidence, Sighting, Tape
from bench.simspec import ASSETS, SimSpec

from .._measure import Finding, Measured, not_considered
from ..ground_truth._truth import RoleName, Truth
from .clear_views import View, Wanted, answered, iou, share, views


@dataclass(frozen=True, slots=True)
class DetectionShareOptions:
    """`class_` is the label that counts as right: the actor's own when empty, whatever it says when `any`.

    `asset` narrows the role to one kind of actor; `max_visible` and the ranges narrow the views, to poor ones say.
    """

    role: RoleName
    class_: str = ""
    asset: str = ""
    min_confidence: float = 0.35
    min_height_px: float = 12.0
    min_visible: float = 0.5
    max_visible: float = 1.0
    min_range_m: float = 0.0
    max_range_m: float = 100_000.0
    min_iou: float = 0.2

    def __post_init__(self) -> None:
        known_asset(self.asset)

    @property
    def wanted(self) -> Wanted:
        """The same as the views take it."""
        return Wanted(
            min_confidence=self.min_confidence,
            min_height_px=self.min_height_px,
            min_visible=self.min_visible,
            max_visible=self.max_visible,
            min_range_m=self.min_range_m,
            max_range_m=self.max_range_m,
            min_iou=self.min_iou,
            label=self.class_,
        )


def known_asset(asset: str) -> None:
    """Raises ValueError for an asset that the catalogue does not have."""
    if asset and asset not in ASSETS:
        raise ValueError(f"option 'asset' is {asset!r}; known: {', '.join(ASSETS)}")


def _detection_share(tape: Tape, simspec: SimSpec, options: DetectionShareOptions) -> Finding:
    """Share of (frame, actor in clear view) pairs that have a right detection in the result of the same exposure."""
    truth = Truth.of(tape, simspec)
    actors = [one for one in truth.of_role(options.role) if not options.asset or truth.cast[one].asset == options.asset]
    named = f"role {options.role}" + (f" and asset {options.asset}" if options.asset else "")
    if not actors:
        return not_considered(f"the scenario has no actor of {named}")
    seen = views(tape, simspec, actors, options.wanted)
    x = share(seen)
    if x is None:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"no actor of {named} ever came into such a view"),))
    return Finding(x, _worst_first(truth, seen))


def _worst_first(truth: Truth, seen: Iterable[View]) -> tuple[Evidence, ...]:
    of: dict[int, list[View]] = defaultdict(list)
    for view in seen:
        of[view.actor].append(view)
    evidence = []
    for actor in sorted(of, key=lambda actor: (share(of[actor]) or 0.0, actor)):
        missed = [view.time_s for view in of[actor] if not view.detected]
        member, count = truth.cast[actor], len(of[actor])
        text = f"{member.id} ({member.class_label}): detected in {count - len(missed)} of {count} clear frames"
        time_s = missed[0] if missed else of[actor][0].time_s
        evidence.append(Evidence(time_s=time_s, text=f"{text}, first missed here" if missed else text))
    return tuple(evidence)


@dataclass(frozen=True, slots=True)
class DetectionPrecisionOptions:
    role: RoleName
    min_confidence: float = 0.35
    min_iou: float = 0.2


def _detection_precision(tape: Tape, simspec: SimSpec, options: DetectionPrecisionOptions) -> Finding:
    """Share of the detections with a class of the role's that lie on an actor of that class, whatever hides it.

    0 without such detections: who says nothing has shown nothing.
    """
    truth = Truth.of(tape, simspec)
    labels = truth.classes_of(options.role)
    if not labels:
        return not_considered(f"the scenario has no actor of role {options.role}")
    right, astray = 0, []
    for frame, answer in answered(tape, simspec):
        for one in answer.detections if answer else ():
            if one.score < options.min_confidence or (options.role != "any" and one.class_label not in labels):
                continue
            if _lies_on_its_class(truth, frame, one, options.min_iou):
                right += 1
            else:
                astray.append(
                    Evidence(time_s=frame.exposed.s, text=f"{one.class_label} detected ({one.score:.2f}) where none is")
                )
    if not right and not astray:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="no such detection was made"),))
    return Finding(right / (right + len(astray)), tuple(astray))


def _lies_on_its_class(truth: Truth, frame: CameraFrame, detection: Detection, min_iou: float) -> bool:
    return any(
        truth.cast[one.actor].class_label == detection.class_label and iou(detection.box, one.box) >= min_iou
        for one in frame.sightings
    )


@dataclass(frozen=True, slots=True)
class RoleRightOptions:
    role: RoleName
    as_role: RoleName
    min_confidence: float = 0.35
    min_height_px: float = 12.0
    min_visible: float = 0.5
    min_iou: float = 0.2


def _detection_role_right(tape: Tape, simspec: SimSpec, options: RoleRightOptions) -> Finding:
    """Of the detections that lie on the role's actors in clear view, share that do not bear a class of the other role.

    A detection lies on the actor whose box it overlaps most. 0 when none of them was ever detected.
    """
    truth = Truth.of(tape, simspec)
    own, other = truth.classes_of(options.role), truth.classes_of(options.as_role)
    if not own or not other - own:
        return not_considered(
            f"the scenario has no actors of roles {options.role} and {options.as_role} with classes of their own"
        )
    actors = set(truth.of_role(options.role))
    wanted = Wanted(min_height_px=options.min_height_px, min_visible=options.min_visible)
    mistaken, right = [], 0
    for time_s, one, on, overlap in _lying(tape, simspec):
        if one.score < options.min_confidence or overlap < options.min_iou or on.actor not in actors or not wanted.clear(on):
            continue
        if one.class_label in other - own:
            text = f"{truth.cast[on.actor].id} ({truth.cast[on.actor].class_label}) detected as {one.class_label}"
            mistaken.append(Evidence(time_s=time_s, text=text))
        else:
            right += 1
    if not right and not mistaken:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"no actor of role {options.role} was detected in clear view"),))
    return Finding(right / (right + len(mistaken)), tuple(mistaken))


def _lying(tape: Tape, simspec: SimSpec) -> list[tuple[float, Detection, Sighting, float]]:
    """Every detection in a frame with actors in sight: when, the sighting whose box it overlaps most, and by how much."""

    def work_out() -> list[tuple[float, Detection, Sighting, float]]:
        found = []
        for frame, answer in answered(tape, simspec):
            for one in answer.detections if answer and frame.sightings else ():
                overlaps = [iou(one.box, sighting.box) for sighting in frame.sightings]
                most = max(overlaps)
                found.append((frame.exposed.s, one, frame.sightings[overlaps.index(most)], most))
        return found

    return tape.cached((_lying, id(simspec)), work_out)


@dataclass(frozen=True, slots=True)
class SteadyDetectionOptions:
    role: RoleName
    min_confidence: float = 0.35
    min_height_px: float = 12.0
    min_visible: float = 0.5
    min_iou: float = 0.2


def _steady_detection(tape: Tape, simspec: SimSpec, options: SteadyDetectionOptions) -> Finding:
    """Detection share of the worse half of the clear views over that of the better; the halves in order of time."""
    actors = Truth.of(tape, simspec).of_role(options.role)
    if not actors:
        return not_considered(f"the scenario has no actor of role {options.role}")
    wanted = Wanted(options.min_confidence, options.min_height_px, options.min_visible, min_iou=options.min_iou)
    seen = views(tape, simspec, actors, wanted)
    if len(seen) < 2:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"role {options.role} was in clear view {len(seen)} times"),))
    middle = len(seen) // 2
    early, late = share(seen[:middle]) or 0.0, share(seen[middle:]) or 0.0
    text = f"detected in {early:.0%} of the clear views before this moment, in {late:.0%} from it on"
    worse, better = sorted((early, late))
    return Finding(worse / better if better else 0.0, (Evidence(time_s=seen[middle].time_s, text=text),))


detection_share = Measured("detection_share", DetectionShareOptions, _detection_share)
detection_precision = Measured("detection_precision", DetectionPrecisionOptions, _detection_precision)
detection_role_right = Measured("detection_role_right", RoleRightOptions, _detection_role_right)
steady_detection = Measured("steady_detection", SteadyDetectionOptions, _steady_detection)
