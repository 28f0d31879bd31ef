"""The difference in confidence of two agents, scene by scene."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from markupsafe import Markup

from ..statistics._pairings import Pairing
from ._svg import Plot

ROW_PX = 52


def pairings_figure(pairings: Sequence[Pairing], label: str = "") -> Markup:
    """For every node, each scene's difference in confidence (second agent minus first) and their mean."""
    # The axis is wider than the possible 100 points, so that discs at the ends are whole.
    rows = max(1, len(pairings))
    plot = Plot(label, 1100, 50 + ROW_PX * rows, (-108, 108), (rows - 0.5, -0.5), (70, 14, 8, 42))
    ticks = [(value, f"{value:+d}" if value else "0") for value in range(-100, 101, 50)]
    plot.x_axis(ticks, "difference in confidence, percentage points")
    plot.line(((0, -0.5), (0, rows - 0.5)), "var(--ink-soft)")
    for place, pairing in enumerate(pairings):
        plot.text(-108, place, pairing.node, anchor="end", dx_px=-5)
        # One disc for each whole percentage point; most scenes share a few differences.
        counts = Counter(round(100 * value) for value in pairing.confidence_differences)
        for step, count in sorted(counts.items()):
            # The count is written inside, so no disc is smaller than 13 px; a row is 52 px high, so none exceeds 38.
            size = min(38.0, 13.0 + 3.5 * math.sqrt(count))
            title = f"{pairing.node}: {step:+d} points in {count} of {pairing.scenes} scenes"
            plot.mark("circle", (step, place), size, "var(--bar-edge)", title, fill="var(--bar)")
            plot.text(step, place, str(count))
        if pairing.mean_confidence_difference is not None:
            mean = 100 * pairing.mean_confidence_difference
            title = f"{pairing.node}: mean {mean:+.1f} points over {pairing.scenes} scenes"
            # Above the discs of its row: the axis runs downwards.
            plot.mark("triangle-down", (mean, place - 0.4), 12, "var(--accent)", title)
    return plot.markup()
