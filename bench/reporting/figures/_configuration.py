"""Scores, confidence and difficulty in one difficulty configuration."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from statistics import stdev

import numpy as np
import polars as pl

from .._campaign_data import Configuration, ReportData
from ._style import AgentStyle, agent_styles
from ._svg import Plot

# Chosen: a density of fewer scores would show shapes that are not in them.
MIN_VIOLIN_SCORES = 8

# Chosen: a violin of scores that spread less is a stroke, and a stroke shows less than dots do.
MIN_VIOLIN_SPREAD = 2.0

# Scores by agent and node.
Values = dict[tuple[str, str], list[float]]


def configuration_figure(data: ReportData, configuration: Configuration, label: str = "") -> Plot:
    """The paper's panel: difficulty as a red dot, scores as violins (left axis), confidence as grey bars
    (right axis), and words where nothing was achieved.
    """
    shown = tuple(style for style in agent_styles(data.agents) if configuration.runs.get(style.name))
    scores = _scores_of(data.scores, configuration)
    # Scores are not clipped: partial credit exceeds 100 and a near miss may fall below 0 (docs/rulings.md 7
    # and 8).
    top = max([100.0, *(v for values in scores.values() for v in values)])
    bottom = min([0.0, *(v for values in scores.values() for v in values)])
    # Below the bars is room for the letters of the agents, at -6.
    extent = (bottom - 12.0, top + 6.0)
    plot = Plot(label, 500, 280, (-0.5, len(data.study) - 0.5), extent, (44, 48, 8, 22))
    ticks = [(value, str(value)) for value in range(-100, 201, 20) if extent[0] <= value <= extent[1]]
    plot.y_axis(ticks, "score and difficulty")
    plot.y_axis(ticks, "confidence, %", right=True)
    plot.x_axis([(place, node) for place, node in enumerate(data.study)], grid=False)
    # Nodes are 1 apart on the axis; the agents share 0.84 of it, so that a gap remains between nodes.
    slot = 0.84 / max(1, len(shown))
    for place, style in enumerate(shown):
        offset = (place - (len(shown) - 1) / 2) * slot
        _confidence_bars(plot, data, configuration, style, offset, slot * 0.9)
    for place, style in enumerate(shown):
        offset = (place - (len(shown) - 1) / 2) * slot
        _score_shapes(plot, data.study, style, scores, offset, slot * 0.78)
    # A node that no run of this configuration rated has no dot.
    for place, node in enumerate(data.study):
        if (level := configuration.difficulty.get(node)) is not None:
            plot.line(
                ((place - 0.45, level), (place + 0.45, level)), "var(--difficulty)", width=1.2, dash="2 3"
            )
            title = f"{node}: difficulty {level:.1f}"
            plot.mark(
                "circle", (place, level), 11, "var(--paper)", title, fill="var(--difficulty)", width=1.6
            )
    return plot


def _scores_of(scores: pl.DataFrame, configuration: Configuration) -> Values:
    rows = (
        scores.select("realization", "agent", "node", "score", "configuration")
        .filter(pl.col("configuration") == configuration.key, pl.col("score").is_not_null())
        .sort("realization", maintain_order=True)
    )
    values: Values = {}
    for row in rows.select("agent", "node", "score").iter_rows():
        values.setdefault((row[0], row[1]), []).append(row[2])
    return values


def _confidence_bars(
    plot: Plot, data: ReportData, configuration: Configuration, style: AgentStyle, offset: float, width: float
) -> None:
    for place, node in enumerate(data.study):
        x = place + offset
        tally = data.tally(style.name, node, configuration.key)
        if tally is None or tally.confidence is None:
            plot.text(x, -6, f"{style.letter} –", style.colour)
            continue
        counts = f"considered in {tally.considered} of {tally.runs} runs"
        title = f"{style.letter} {style.name}, {node}: confidence {100 * tally.confidence:.1f} %, {counts}"
        plot.rect(
            (x - width / 2, x + width / 2),
            (0, 100 * tally.confidence),
            "var(--bar)",
            "var(--bar-edge)",
            title,
        )
        plot.text(x, -6, style.letter, style.colour)
        if not tally.scored:
            plot.text(x, 3, "none", "var(--difficulty)", dy_px=0)


def _score_shapes(
    plot: Plot, study: Sequence[str], style: AgentStyle, scores: Values, offset: float, width: float
) -> None:
    for place, node in enumerate(study):
        values = scores.get((style.name, node), [])
        x = place + offset
        if len(values) >= MIN_VIOLIN_SCORES and max(values) - min(values) > MIN_VIOLIN_SPREAD:
            title = f"{style.letter} {style.name}, {node}: {len(values)} scores, mean {sum(values) / len(values):.1f}"
            plot.line(_violin(values, x, width), style.colour, title, width=1.4, fill=style.fill)
            continue
        # One disc for each value, larger where several runs share it.
        for value, count in sorted(Counter(round(value, 1) for value in values).items()):
            runs = f" in {count} runs" if count > 1 else ""
            title = f"{style.letter} {style.name}, {node}: score {value:.1f}{runs}"
            size = min(16.0, 5.0 + 2.0 * math.sqrt(count))
            plot.mark(style.marker, (x, value), size, "var(--paper)", title, fill=style.colour, width=0.5)


def _violin(values: Sequence[float], x: float, width: float) -> list[tuple[float, float]]:
    """The outline of a kernel density. It ends at the lowest and highest score: a tail would show scores that no run has."""
    # Half of Scott's rule, because scores form clumps; at least 0.4 points, or a clump of equal scores would be a needle.
    bandwidth = max(0.4, 0.5 * stdev(values) * math.pow(len(values), -0.2))
    levels = np.linspace(min(values), max(values), 41)
    density = np.exp(-0.5 * ((levels[:, None] - np.array(values)) / bandwidth) ** 2).sum(axis=1)
    halves = 0.5 * width * density / density.max()
    right = [(x + float(half), float(level)) for half, level in zip(halves, levels, strict=True)]
    return [*right, *((2 * x - east, level) for east, level in reversed(right))]
