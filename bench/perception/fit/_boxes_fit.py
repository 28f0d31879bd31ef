"""Displacement of boxes: the part of each edge and frame, and the part that lasts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from bench.arrays import Floats

from ._matching import MatchedFrame, MatchedRun

BORDER_PX = 10.0
"""Boxes nearer to the border of the picture may be clipped, which hides displacements."""

LEAST_SIDE_PX = 10.0
"""Edges of narrower boxes may swap, which hides displacements too."""

SIGNIFICANT = 5.0
"""Standard errors by which drift must differ from none; chosen, so that none is found where there is none."""

LONGEST_DRIFT_S = 60.0


@dataclass(frozen=True, slots=True)
class BoxFit:
    """Standard deviations in pixels, the correlation time (None: nothing lasts), and the counts behind them."""

    jitter_px: float | None
    drift_px: float
    drift_s: float | None
    boxes: int
    pairs: int


def fit_boxes(runs: Sequence[MatchedRun], longest_gap_s: float) -> BoxFit:
    """From two opposite edges: what they share is drift, what they do not is jitter."""
    edges, successive = [], []
    for run in runs:
        last: dict[int, tuple[float, Floats]] = {}
        for frame in run.frames:
            for actor, displaced in _displacements(run, frame):
                edges.append(displaced)
                previous = last.get(actor)
                if previous is not None and frame.exposed.s - previous[0] <= longest_gap_s:
                    successive.append((frame.exposed.s - previous[0], previous[1], displaced))
                last[actor] = (frame.exposed.s, displaced)
    if len(edges) < 2:
        return BoxFit(None, 0.0, None, len(edges), 0)
    table: Floats = np.array(edges)  # left, top, right, bottom
    leading, trailing = table[:, :2], table[:, 2:]
    jitter2 = float(((trailing - leading) ** 2).mean()) / 2.0
    drift2 = float((leading * trailing).mean())
    # Without drift the product of two edges has the deviation jitter^2, over two axes.
    if drift2 <= SIGNIFICANT * jitter2 / math.sqrt(2.0 * len(table)):
        return BoxFit(math.sqrt(jitter2 + max(0.0, drift2)), 0.0, None, len(table), len(successive))
    return BoxFit(
        math.sqrt(jitter2), math.sqrt(drift2), _drift_s(successive, drift2), len(table), len(successive)
    )


def _drift_s(successive: Sequence[tuple[float, Floats, Floats]], drift2: float) -> float | None:
    if not successive:
        return None
    span_s: Floats = np.array([row[0] for row in successive])
    first, second = (np.array([row[place] for row in successive]) for place in (1, 2))
    # Jitter is fresh in each frame, so only drift is left in the product of two frames' middles.
    middles = ((first[:, :2] + first[:, 2:]) / 2.0, (second[:, :2] + second[:, 2:]) / 2.0)
    shared = float((middles[0] * middles[1]).mean()) / drift2

    def excess(log_time: float) -> float:
        return float(np.exp(-span_s / math.exp(log_time)).mean()) - shared

    low, high = math.log(1e-3), math.log(LONGEST_DRIFT_S)
    if excess(low) >= 0.0:
        return math.exp(low)
    return LONGEST_DRIFT_S if excess(high) <= 0.0 else math.exp(float(brentq(excess, low, high, xtol=1e-4)))


def _displacements(run: MatchedRun, frame: MatchedFrame) -> Iterator[tuple[int, Floats]]:
    """Of the four edges of each detected actor that lies well inside the picture."""
    camera = run.simspec.vehicle.camera
    for matched in frame.sightings:
        box = matched.sighting.box
        inside = (
            min(box[:2]) >= BORDER_PX
            and box[2] <= camera.width_px - BORDER_PX
            and box[3] <= camera.height_px - BORDER_PX
        )
        wide = min(box[2] - box[0], box[3] - box[1]) >= LEAST_SIDE_PX
        if matched.detection is not None and inside and wide:
            yield matched.sighting.actor, np.subtract(matched.detection.box, box)
