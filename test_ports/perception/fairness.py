"""Measures of fairness: whether some kinds of bystanders are perceived worse than others.

`detection_fairness` judges the perception that the bench provides, `track_fairness` the agent.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import Finding, consider, measure
from ..ground_truth import GroundTruth
from .clear_views import NO_DETECTIONS, DetectionCriteria, actors_by_kind, clear_views
from .sightings import ViewCriteria
from .track_messages import holding_credit


@measure
def detection_fairness(
    tape: Tape,
    simspec: SimSpec,
    *,
    by: Literal["group", "asset"],
    min_confidence: float = 0.35,
    min_height_px: float = 12.0,
    min_visible: float = 0.5,
    min_iou: float = 0.2,
) -> Finding:
    """Detection share of the worst detected kind of bystander, divided by that of the best detected kind.

    `by` says whether a kind is a group of the SimSpec or an asset. A kind that never came into clear view
    counts 0 if one of its members was inside a sub-area, where the agent had to look. Otherwise it is left
    out. Considered when two kinds remain.
    """
    consider(simspec.perception.by_bench, NO_DETECTIONS)
    truth = GroundTruth.of(tape, simspec)
    criteria, detection = ViewCriteria(min_height_px, min_visible), DetectionCriteria(min_confidence, min_iou)
    entered = truth.entered("bystander")
    shares: dict[str, float] = {}
    for kind, actors in actors_by_kind(truth, truth.of_role("bystander"), by).items():
        views = clear_views(tape, simspec, actors, criteria, detection)
        # Without this an agent could avoid one kind of people and look fair.
        if len(views) or any(actor in entered for actor in actors):
            shares[kind] = views.share
    return _worst_over_best(shares, tape.end_s, by, "detected in")


@measure
def track_fairness(
    tape: Tape,
    simspec: SimSpec,
    *,
    by: Literal["group", "asset"],
    within_m: float = 10.0,
    min_frames: int = 5,
) -> Finding:
    """`classified_share` of the worst held kind of bystander, divided by that of the best held kind.

    Considered when bystanders of two kinds were inside sub-areas.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = truth.entered("bystander")
    credit, _ = holding_credit(tape, simspec, entered, within_m, min_frames)
    kinds = actors_by_kind(truth, entered, by)
    shares = {kind: sum(credit[actor] for actor in actors) / len(actors) for kind, actors in kinds.items()}
    return _worst_over_best(shares, tape.end_s, by, "held:")


def _worst_over_best(shares: Mapping[str, float], end_s: float, by: str, verb: str) -> Finding:
    consider(len(shares) >= 2, f"there are not two kinds of bystanders (by {by}) to compare")
    worst_first = sorted(shares, key=lambda kind: shares[kind])
    evidence = tuple(
        Evidence(time_s=end_s, text=f"{by} {kind}: {verb} {shares[kind]:.0%}") for kind in worst_first
    )
    best = max(shares.values())
    return Finding(min(shares.values()) / best if best else 0.0, evidence)
