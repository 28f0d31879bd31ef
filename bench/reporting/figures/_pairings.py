"""The difference in confidence of two agents, scene by scene."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from html import escape

import plotly.graph_objects as go

from ..statistics._pairings import Pairing
from ._style import empty_figure


def pairings_figure(pairings: Sequence[Pairing]) -> go.Figure:
    """For every node, each scene's difference in confidence (second agent minus first) and their mean."""
    figure = empty_figure(height=70 + 52 * max(1, len(pairings)), margin={"l": 70, "r": 24, "t": 10, "b": 46})
    for place, pairing in enumerate(pairings):
        # One disc for each whole percentage point; most scenes share a few differences.
        counts = Counter(round(100 * value) for value in pairing.confidence_differences)
        steps = sorted(counts)
        figure.add_scatter(
            x=steps,
            y=[place] * len(steps),
            mode="markers+text",
            marker={
                "symbol": "circle",
                # The count is written inside, so no disc is smaller than 13 px; a row is 52 px high, so none
                # exceeds 38.
                "size": [min(38.0, 13.0 + 3.5 * math.sqrt(counts[step])) for step in steps],
                "color": "var(--bar)",
                "line": {"color": "var(--bar-edge)", "width": 1},
            },
            text=[str(counts[step]) for step in steps],
            textfont={"size": 11, "color": "var(--ink)"},
            hovertext=[
                f"{escape(pairing.node)}: {step:+d} points in {counts[step]} of {pairing.scenes} scenes"
                for step in steps
            ],
            hoverinfo="text",
        )
        if pairing.mean_confidence_difference is not None:
            mean = 100 * pairing.mean_confidence_difference
            figure.add_scatter(
                x=[mean],
                # Above the discs of its row: the axis runs downwards.
                y=[place - 0.4],
                mode="markers",
                marker={"symbol": "triangle-down", "size": 12, "color": "var(--accent)"},
                hovertext=f"{escape(pairing.node)}: mean {mean:+.1f} points over {pairing.scenes} scenes",
                hoverinfo="text",
            )
    figure.update_layout(
        xaxis={
            "title": {"text": "difference in confidence, percentage points", "font": {"size": 12}},
            # Wider than the possible 100 points, so that discs at the ends are whole.
            "range": [-108, 108],
            "gridcolor": "var(--grid)",
            "zeroline": True,
            "zerolinecolor": "var(--ink-soft)",
            "fixedrange": True,
        },
        yaxis={
            "tickvals": list(range(len(pairings))),
            "ticktext": [escape(pairing.node) for pairing in pairings],
            "range": [len(pairings) - 0.5, -0.65],
            "showgrid": False,
            "zeroline": False,
            "fixedrange": True,
        },
        showlegend=False,
    )
    return figure
