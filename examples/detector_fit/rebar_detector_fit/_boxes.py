"""Displacement of boxes: the part of each edge and frame, and the part that lasts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Floats

from ._curves import crossing
from ._matching import MatchedRun, successive

BORDER_PX = 10.0
"""Boxes nearer to the border of the picture may be clipped, which hides displacements."""

LEAST_SIDE_PX = 10.0
"""Edges of narrower boxes may swap, which hides displacements too."""

SIGNIFICANT = 5.0
"""Standard errors by which drift must differ from none; chosen, so that none is found where there is none."""

MIN_EDGES = 100
"""Fewer edges show no share of the size; chosen."""

LONGEST_DRIFT_S = 60.0


@dataclass(frozen=True, slots=True)
class BoxFit:
    """The parameters of boxes that were seen to differ from the defaults, and the counts behind them."""

    parameters: dict[str, float]
    boxes: int = 0
    pairs: int = 0


def fit_boxes(runs: Sequence[MatchedRun]) -> BoxFit:
    """From two opposite edges: what they share is drift, what they do not is jitter."""
    displacements = list(_displacements(runs))
    if len(displacements) < 2:
        return BoxFit({}, len(displacements))
    edges: Floats = np.array([displaced for _, _, displaced, _ in displacements])  # left, top, right, bottom
    sides: Floats = np.array([side_px for *_, side_px in displacements])
    pairs = list(successive((key, time_s, edge) for key, time_s, edge, _ in displacements))
    leading, trailing = edges[:, :2], edges[:, 2:]
    apart2: Floats = (trailing - leading) ** 2 / 2.0
    drift2 = float((leading * trailing).mean())
    # Without drift the product of two edges has the deviation jitter^2, over two axes.
    if drift2 <= SIGNIFICANT * float(apart2.mean()) / math.sqrt(2.0 * len(edges)):
        jitter_px, share = _by_size(((leading**2 + trailing**2) / 2.0).ravel(), sides.ravel())
        return BoxFit({"jitter_px": jitter_px, "jitter_share": share}, len(edges), len(pairs))
    jitter_px, share = _by_size(apart2.ravel(), sides.ravel())
    parameters = {"jitter_px": jitter_px, "jitter_share": share, "drift_px": math.sqrt(drift2)}
    if pairs:
        parameters["drift_s"] = _drift_s(pairs, drift2)
    return BoxFit(parameters, len(edges), len(pairs))


def _by_size(squares: Floats, side_px: Floats) -> tuple[float, float]:
    """Deviations in pixels and as a share of the side, whose squares add up to these squares of displacements."""
    mean, areas = float(squares.mean()), side_px**2
    spread = float(((areas - areas.mean()) ** 2).sum())
    if spread <= 0.0 or len(squares) < MIN_EDGES:
        return math.sqrt(mean), 0.0
    slope = float(((areas - areas.mean()) * (squares - mean)).sum()) / spread
    # The square of a normal has the deviation sqrt(2) of its mean.
    if slope <= SIGNIFICANT * math.sqrt(2.0) * mean / math.sqrt(spread):
        return math.sqrt(mean), 0.0
    rest = mean - slope * float(areas.mean())
    # No part in pixels: the share alone explains the mean.
    if rest <= 0.0:
        return 0.0, math.sqrt(mean / float(areas.mean()))
    return math.sqrt(rest), math.sqrt(slope)


def _drift_s(pairs: Sequence[tuple[float, Floats, Floats]], drift2: float) -> float:
    span_s, first, second = (np.array(column) for column in zip(*pairs, strict=True))
    # Jitter is fresh in each frame, so only drift is left in the product of two frames' middles.
    middles = (first[:, :2] + first[:, 2:]) / 2.0 * (second[:, :2] + second[:, 2:]) / 2.0
    shared = float(middles.mean()) / drift2
    return crossing(lambda time_s: float(np.exp(-span_s / time_s).mean()) - shared, 1e-3, LONGEST_DRIFT_S)


def _displacements(runs: Sequence[MatchedRun]) -> Iterator[tuple[tuple[int, int], float, Floats, Floats]]:
    """Actor, time, displacement of the four edges, and sides, of each detected actor well inside the picture."""
    for number, run in enumerate(runs):
        limit = np.array((run.camera.width_px, run.camera.height_px)) - BORDER_PX
        for frame in run.frames:
            for sighting, detection in frame.sightings:
                box = np.array(sighting.box)
                sides = box[2:] - box[:2]
                inside = box[:2].min() >= BORDER_PX and (box[2:] <= limit).all()
                if detection is not None and inside and sides.min() >= LEAST_SIDE_PX:
                    yield (number, sighting.actor), frame.exposed.s, np.subtract(detection.box, box), sides
