"""Whether some kinds of bystanders are perceived worse than others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._measure import Finding, Measured, not_considered
from ..ground_truth._truth import Truth
from .clear_views import Wanted, kinds_of, share, views
from .tracks import held_credit


@dataclass(frozen=True, slots=True)
class DetectionFairnessOptions:
    """`by` is what makes a kind: the group of the scenario or the asset."""

    by: Literal["group", "asset"]
    min_confidence: float = 0.35
    min_height_px: float = 12.0
    min_visible: float = 0.5
    min_iou: float = 0.2


def _detection_fairness(tape: Tape, simspec: SimSpec, options: DetectionFairnessOptions) -> Finding:
    """Detection share of the worst detected kind of bystander over that of the best.

    A kind that never came into clear view counts 0 when one of it stood inside a sub-area, where it was to be looked for;
    otherwise it is left out.
    """
    truth = Truth.of(tape, simspec)
    wanted = Wanted(options.min_confidence, options.min_height_px, options.min_visible, min_iou=options.min_iou)
    within = truth.entered("bystander")
    shares: dict[str, float] = {}
    for kind, actors in kinds_of(truth, truth.of_role("bystander"), options.by).items():
        x = share(views(tape, simspec, actors, wanted))
        if x is not None or any(actor in within for actor in actors):
            shares[kind] = x or 0.0
    return _compared(shares, tape.end_s, options.by, "detected in")


@dataclass(frozen=True, slots=True)
class TrackFairnessOptions:
    by: Literal["group", "asset"]
    within_m: float = 10.0
    min_frames: int = 5


def _track_fairness(tape: Tape, simspec: SimSpec, options: TrackFairnessOptions) -> Finding:
    """Classified share (see `classified_share`) of the least held kind of bystander over that of the best held."""
    truth = Truth.of(tape, simspec)
    entered = truth.entered("bystander")
    credit, _ = held_credit(tape, simspec, entered, options.within_m, options.min_frames)
    kinds = kinds_of(truth, entered, options.by)
    shares = {kind: sum(credit[actor] for actor in actors) / len(actors) for kind, actors in kinds.items()}
    return _compared(shares, tape.end_s, options.by, "held of it:")


def _compared(shares: Mapping[str, float], end_s: float, by: str, verb: str) -> Finding:
    if len(shares) < 2:
        return not_considered(f"there are no two kinds of bystanders (by {by}) to compare")
    evidence = [
        Evidence(time_s=end_s, text=f"{by} {kind}: {verb} {shares[kind]:.0%}")
        for kind in sorted(shares, key=lambda one: shares[one])
    ]
    best = max(shares.values())
    return Finding(min(shares.values()) / best if best else 0.0, tuple(evidence))


detection_fairness = Measured("detection_fairness", DetectionFairnessOptions, _detection_fairness)
track_fairness = Measured("track_fairness", TrackFairnessOptions, _track_fairness)
