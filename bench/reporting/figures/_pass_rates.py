"""The pass rate of one node over difficulty."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape

import plotly.graph_objects as go

from bench.statistics import Curve, CurveState

from .._campaign_data import Tally
from ..statistics._trials import NodeTrials
from ._style import AgentStyle, empty_figure


def curve_figure(
    shown: Sequence[AgentStyle], trials: Mapping[str, NodeTrials], tallies: Mapping[str, Tally]
) -> go.Figure:
    """One node's pass rate over difficulty: a disc for each difficulty flown, the logistic curve with its
    band where there is one.

    `trials` and `tallies` are by agent. Triangles on the lines of 50 and 90 % are competence, the line to
    their left reaches down to its lower bound.
    """
    figure = empty_figure(height=270, margin={"l": 48, "r": 14, "t": 10, "b": 42})
    difficulties = [hard for agent_trials in trials.values() for hard in agent_trials.difficulty]
    extent = [max(0.0, min(difficulties, default=0.0) - 8.0), max(difficulties, default=100.0) + 8.0]
    for style in shown:
        if style.name in trials:
            _curve(figure, style, trials[style.name].curve())
    for place, style in enumerate(shown):
        # Shifted sideways: discs of agents with the same difficulty and rate would hide each other.
        aside = (place - (len(shown) - 1) / 2) * 0.012 * (extent[1] - extent[0])
        if style.name in trials:
            _pass_rates(figure, style, trials[style.name], aside)
            _competences(figure, style, tallies.get(style.name), 4.0 * (place - (len(shown) - 1) / 2))
    figure.update_layout(
        xaxis={
            "title": {"text": "difficulty", "standoff": 4, "font": {"size": 12}},
            "range": extent,
            "gridcolor": "var(--grid)",
            "zeroline": False,
            "fixedrange": True,
        },
        yaxis={
            "title": {"text": "runs passed, %", "standoff": 4, "font": {"size": 12}},
            # Room for whole discs at 0 and 100 %.
            "range": [-9, 109],
            # ReportedCompetence is defined at pass rates of 50 and 90 %.
            "tickvals": [0, 50, 90, 100],
            "gridcolor": "var(--grid)",
            "zeroline": False,
            "fixedrange": True,
        },
        showlegend=False,
    )
    return figure


def _curve(figure: go.Figure, style: AgentStyle, curve: Curve) -> None:
    if not curve.drawn:
        return
    x, low, high = (
        [round(float(value) * scale, 3) for value in values]
        for values, scale in ((curve.difficulty, 1), (curve.low, 100), (curve.high, 100))
    )
    figure.add_scatter(
        x=[*x, *reversed(x)],
        y=[*high, *reversed(low)],
        fill="toself",
        fillcolor=style.fill,
        mode="lines",
        line={"width": 0},
        opacity=0.5,
        hoverinfo="skip",
    )
    figure.add_scatter(
        x=x,
        y=[round(100 * float(value), 3) for value in curve.probability],
        mode="lines",
        # Dotted where the runs do not fix the curve: all passed, none passed, or separated.
        line={
            "color": style.colour,
            "width": 2,
            "dash": "solid" if curve.state is CurveState.FITTED else "dot",
        },
        hovertext=f"{style.letter} {escape(style.name)}: logistic curve",
        hoverinfo="text",
    )


def _pass_rates(figure: go.Figure, style: AgentStyle, trials: NodeTrials, aside: float) -> None:
    # Equal to six decimals, as in difficulty configurations (docs/rulings.md 14).
    tried = Counter(round(hard, 6) for hard in trials.difficulty)
    passed = Counter(round(hard, 6) for hard, ok in zip(trials.difficulty, trials.passed, strict=True) if ok)
    cells = sorted(tried)
    figure.add_scatter(
        x=[hard + aside for hard in cells],
        y=[round(100 * passed[hard] / tried[hard], 3) for hard in cells],
        mode="markers",
        marker={
            "symbol": style.marker,
            "size": [min(22.0, 6.0 + 2.0 * math.sqrt(tried[hard])) for hard in cells],
            "color": style.fill,
            "line": {"color": style.colour, "width": 1.4},
        },
        hovertext=[
            f"{style.letter} {escape(style.name)}<br>difficulty {hard:.1f}: {passed[hard]} of {tried[hard]} runs passed"
            for hard in cells
        ],
        hoverinfo="text",
    )


def _competences(figure: go.Figure, style: AgentStyle, tally: Tally | None, aside: float) -> None:
    for rate, competence in (tally.competence if tally is not None else {}).items():
        # ReportedCompetence 0 means that the fit never reaches the rate, so there is no difficulty to draw it
        # at.
        if competence.value <= 0.0:
            continue
        figure.add_scatter(
            x=[competence.low, competence.value],
            y=[int(rate) + aside] * 2,
            mode="lines+markers",
            line={"color": style.colour, "width": 1.6},
            marker={
                "symbol": ["line-ns", "triangle-right" if competence.at_least else "line-ns"],
                "size": [7, 10],
                "color": style.colour,
                "line": {"color": style.colour, "width": 1.6},
            },
            hovertext=f"{style.letter} {escape(style.name)}<br>competence {rate}: {'at least ' if competence.at_least else ''}{competence.value:.1f}, "
            f"lower bound {competence.low:.1f}",
            hoverinfo="text",
        )
