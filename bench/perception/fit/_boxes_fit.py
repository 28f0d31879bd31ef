"""Displacement of boxes: the part of each edge and frame, and the part that lasts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from bench.arrays import Floats

from ._matching import MatchedFrame, MatchedRun, successive

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
    """Standard deviations in pixels, the correlation time (None: nothing lasts), and the counts behind them."""

    jitter_px: float | None
    jitter_share: float  # of the sides, beside jitter_px; 0 where size makes no difference
    drift_px: float
    drift_s: float | None
    boxes: int
    pairs: int


def fit_boxes(runs: Sequence[MatchedRun], longest_gap_s: float) -> BoxFit:
    """From two opposite edges: what they share is drift, what they do not is jitter."""
    displacements = [
        ((number, actor), frame.exposed.s, displaced, side_px)
        for number, run in enumerate(runs)
        for frame in run.frames
        for actor, displaced, side_px in _displacements(run, frame)
    ]
    edges = [displaced for *_, displaced, _ in displacements]
    sides = [side_px for *_, side_px in displacements]
    pairs = list(successive(((key, time_s, edge) for key, time_s, edge, _ in displacements), longest_gap_s))
    if len(edges) < 2:
        return BoxFit(None, 0.0, 0.0, None, len(edges), 0)
    table: Floats = np.array(edges)  # left, top, right, bottom
    leading, trailing = table[:, :2], table[:, 2:]
    jitter2 = float(((trailing - leading) ** 2).mean()) / 2.0
    drift2 = float((leading * trailing).mean())
    # Without drift the product of two edges has the deviation jitter^2, over two axes.
    if drift2 <= SIGNIFICANT * jitter2 / math.sqrt(2.0 * len(table)):
        jitter_px, share = _by_size(((leading**2 + trailing**2) / 2.0).ravel(), np.array(sides).ravel())
        return BoxFit(jitter_px, share, 0.0, None, len(table), len(pairs))
    jitter_px, share = _by_size(((trailing - leading) ** 2).ravel() / 2.0, np.array(sides).ravel())
    return BoxFit(jitter_px, share, math.sqrt(drift2), _drift_s(pairs, drift2), len(table), len(pairs))


def _by_size(squares: Floats, side_px: Floats) -> tuple[float, float]:
    """Deviations in pixels and as a share of the side, whose squares add up to these squares of displacements."""
    mean = float(squares.mean())
    areas: Floats = side_px**2
    spread = float(((areas - areas.mean()) ** 2).sum())
    if spread <= 0.0 or len(squares) < MIN_EDGES:
        return math.sqrt(mean), 0.0
    slope = float(((areas - areas.mean()) * (squares - mean)).sum()) / spread
    # The square of a normal has the deviation sqrt(2) of its mean.
    error = math.sqrt(2.0) * mean / math.sqrt(spread)
    if slope <= SIGNIFICANT * error:
        return math.sqrt(mean), 0.0
    rest = mean - slope * float(areas.mean())
    # No part in pixels: the share alone explains the mean.
    if rest <= 0.0:
        return 0.0, math.sqrt(mean / float(areas.mean()))
    return math.sqrt(rest), math.sqrt(slope)


def _drift_s(pairs: Sequence[tuple[float, Floats, Floats]], drift2: float) -> float | None:
    if not pairs:
        return None
    span_s: Floats = np.array([row[0] for row in pairs])
    first, second = (np.array([row[place] for row in pairs]) for place in (1, 2))
    # Jitter is fresh in each frame, so only drift is left in the product of two frames' middles.
    middles = ((first[:, :2] + first[:, 2:]) / 2.0, (second[:, :2] + second[:, 2:]) / 2.0)
    shared = float((middles[0] * middles[1]).mean()) / drift2

    def excess(log_time: float) -> float:
        return float(np.exp(-span_s / math.exp(log_time)).mean()) - shared

    low, high = math.log(1e-3), math.log(LONGEST_DRIFT_S)
    if excess(low) >= 0.0:
        return math.exp(low)
    return LONGEST_DRIFT_S if excess(high) <= 0.0 else math.exp(float(brentq(excess, low, high, xtol=1e-4)))


def _displacements(run: MatchedRun, frame: MatchedFrame) -> Iterator[tuple[int, Floats, Floats]]:
    """Of the four edges of each detected actor that lies well inside the picture, and its width and height."""
    camera = run.camera
    for matched in frame.sightings:
        box = matched.sighting.box
        inside = (
            min(box[:2]) >= BORDER_PX
            and box[2] <= camera.width_px - BORDER_PX
            and box[3] <= camera.height_px - BORDER_PX
        )
        wide = min(box[2] - box[0], box[3] - box[1]) >= LEAST_SIDE_PX
        if matched.detection is not None and inside and wide:
            sides = np.array((box[2] - box[0], box[3] - box[1]))
            yield matched.sighting.actor, np.subtract(matched.detection.box, box), sides
