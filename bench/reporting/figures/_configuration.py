"""Scores, confidence and difficulty in one difficulty configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from statistics import stdev

import plotly.graph_objects as go
import polars as pl

from .._campaign_data import Configuration, ReportData
from ._style import AgentStyle, agent_styles, empty_figure

# Chosen: a density of fewer scores would show shapes that are not in them.
MIN_VIOLIN_SCORES = 8

# Chosen: equal scores have no density, and nearly equal ones give a violin that is a line.
MIN_VIOLIN_SPREAD = 0.25

# Scores by agent and node.
Values = dict[tuple[str, str], list[float]]


def configuration_figure(data: ReportData, configuration: Configuration) -> go.Figure:
    """The paper's panel: difficulty as a red dot, scores as violins (left axis), confidence as grey bars
    (right axis).
    """
    figure = empty_figure(height=300, margin={"l": 44, "r": 48, "t": 10, "b": 30})
    shown = tuple(style for style in agent_styles(data.agents) if configuration.runs.get(style.name))
    scores = _scores_of(data.scores, configuration)
    # Nodes are 1 apart on the axis; the agents share 0.84 of it, so that a gap remains between nodes.
    slot = 0.84 / max(1, len(shown))
    for place, style in enumerate(shown):
        offset = (place - (len(shown) - 1) / 2) * slot
        _confidence_bars(figure, data, configuration, style, offset, slot * 0.9)
    for place, style in enumerate(shown):
        offset = (place - (len(shown) - 1) / 2) * slot
        _score_shapes(figure, data.study, style, scores, offset, slot * 0.78)
    _difficulty_dots(figure, data.study, configuration)
    # Scores are not clipped: partial credit exceeds 100 and a near miss may fall below 0 (docs/rulings.md 7
    # and 8).
    top = max([100.0, *(v for values in scores.values() for v in values)])
    bottom = min([0.0, *(v for values in scores.values() for v in values)])
    # Below the bars is room for the letters of the agents, which `_confidence_bars` puts at -6.
    extent = [bottom - 12.0, top + 6.0]
    figure.update_layout(
        xaxis={
            "tickvals": list(range(len(data.study))),
            "ticktext": [escape(node) for node in data.study],
            "range": [-0.5, len(data.study) - 0.5],
        },
        # Bars are on the first axis, so that the violins, on the overlaid second one, are drawn over them.
        yaxis=_axis("confidence, %", extent, side="right", showgrid=False),
        yaxis2=_axis("score and difficulty", extent, side="left", overlaying="y", showgrid=True),
        barmode="overlay",
        showlegend=False,
    )
    figure.update_xaxes(showgrid=False, zeroline=False, fixedrange=True)
    return figure


def _axis(title: str, extent: Sequence[float], **fields: object) -> dict[str, object]:
    ticks = [value for value in range(-100, 201, 20) if extent[0] <= value <= extent[1]]
    return {
        "title": {"text": title, "standoff": 4, "font": {"size": 12}},
        "range": list(extent),
        "tickvals": ticks,
        "gridcolor": "var(--grid)",
        "zeroline": False,
        "fixedrange": True,
        **fields,
    }


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
    figure: go.Figure,
    data: ReportData,
    configuration: Configuration,
    style: AgentStyle,
    offset: float,
    width: float,
) -> None:
    tallies = [data.tally(style.name, node, configuration.key) for node in data.study]
    # Rounded, to keep the page small; a screen shows no more.
    heights = [
        None if tally is None or tally.confidence is None else round(100 * tally.confidence, 4)
        for tally in tallies
    ]
    texts = [
        f"{style.letter} {escape(style.name)}<br>{escape(node)}: confidence "
        + (
            "none: never considered"
            if tally is None or tally.confidence is None
            else f"{100 * tally.confidence:.1f} %"
        )
        + ("" if tally is None else f"<br>considered in {tally.considered} of {tally.runs} runs")
        for node, tally in zip(data.study, tallies, strict=True)
    ]
    figure.add_bar(
        x=[place + offset for place in range(len(data.study))],
        y=heights,
        width=width,
        marker={
            "color": "var(--bar)",
            "line": {"color": "var(--bar-edge)", "width": 1},
            "pattern": {"shape": style.hatch, "fgcolor": "var(--bar-edge)", "size": 6, "solidity": 0.2},
        },
        hovertext=texts,
        hoverinfo="text",
    )
    figure.add_scatter(
        x=[place + offset for place in range(len(data.study))],
        y=[-6.0] * len(data.study),
        mode="text",
        text=[style.letter if height is not None else f"{style.letter} –" for height in heights],
        textfont={"size": 11, "color": style.colour},
        hoverinfo="skip",
    )


def _score_shapes(
    figure: go.Figure, study: Sequence[str], style: AgentStyle, scores: Values, offset: float, width: float
) -> None:
    for place, node in enumerate(study):
        values = scores.get((style.name, node), [])
        if len(values) >= MIN_VIOLIN_SCORES and max(values) - min(values) > MIN_VIOLIN_SPREAD:
            figure.add_violin(
                y=values,
                x0=place + offset,
                width=width,
                yaxis="y2",
                # A violin ends at the lowest and highest score: a tail would show scores that no run has.
                spanmode="hard",
                bandwidth=_bandwidth(values),
                scalemode="width",
                line={"color": style.colour, "width": 1.4},
                fillcolor=style.fill,
                points=False,
                meanline={"visible": True, "color": style.colour, "width": 1.4},
                hoveron="violins",
                hoverinfo="y",
            )
        elif values:
            figure.add_scatter(
                x=[place + offset + shift * width for shift in _swarm(values)],
                y=values,
                yaxis="y2",
                mode="markers",
                marker={
                    "symbol": style.marker,
                    "size": 5.5,
                    "color": style.colour,
                    "opacity": 0.75,
                    "line": {"width": 0.5, "color": "var(--paper)"},
                },
                hovertext=[
                    f"{style.letter} {escape(style.name)}<br>{escape(node)}: score {value:.2f}"
                    for value in values
                ],
                hoverinfo="text",
            )


def _bandwidth(values: Sequence[float]) -> float:
    """Half of Scott's rule, because scores form clumps; at least 0.4 points, or a clump of equal scores would
    be a needle.
    """
    return max(0.4, 0.5 * stdev(values) * math.pow(len(values), -0.2))


def _swarm(values: Sequence[float]) -> list[float]:
    """Sideways shifts in [-0.4, 0.4] that keep equal values apart; the same for the same values."""
    count: dict[int, int] = {}
    ranks = []
    for value in values:
        # A point is some 2 px high in this figure, so dots of 5.5 px overlap within about 2 points.
        bin_ = round(value / 2.0)
        ranks.append((bin_, count.get(bin_, 0)))
        count[bin_] = count.get(bin_, 0) + 1
    return [
        0.0 if count[b] == 1 else (rank / (count[b] - 1) - 0.5) * min(0.8, 0.16 * (count[b] - 1))
        for b, rank in ranks
    ]


def _difficulty_dots(figure: go.Figure, study: Sequence[str], configuration: Configuration) -> None:
    # A node that no run of this configuration rated has no dot.
    rated = [(place, node) for place, node in enumerate(study) if node in configuration.difficulty]
    for place, node in rated:
        level = configuration.difficulty[node]
        figure.add_scatter(
            x=[place - 0.45, place + 0.45],
            y=[level, level],
            yaxis="y2",
            mode="lines",
            line={"color": "var(--difficulty)", "width": 1.2, "dash": "dot"},
            hoverinfo="skip",
        )
    figure.add_scatter(
        x=[place for place, _ in rated],
        y=[configuration.difficulty[node] for _, node in rated],
        yaxis="y2",
        mode="markers",
        marker={
            "symbol": "circle",
            "size": 11,
            "color": "var(--difficulty)",
            "line": {"color": "var(--paper)", "width": 1.6},
        },
        hovertext=[f"{escape(node)}: difficulty {configuration.difficulty[node]:.1f}" for _, node in rated],
        hoverinfo="text",
    )
