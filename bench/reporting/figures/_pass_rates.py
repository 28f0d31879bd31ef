"""The pass rate of one node over difficulty."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape

import plotly.graph_objects as go

from bench.statistics import Curve, CurveState

from .._campaign_data import Tally
from ..statistics._trials import Trials
from ._style import AgentLook, empty_figure


def curve_figure(shown: Sequence[AgentLook], trials: Mapping[str, Trials], tallies: Mapping[str, Tally]) -> go.Figure:
    """One node's pass rate over difficulty: a disc for each difficulty flown, the logistic curve with its band where there is one.

    `trials` and `tallies` are by agent. Triangles on the lines of 50 and 90 % are competence, the line to their left reaches
    down to its lower bound.
    """
    figure = empty_figure(height=270, margin={"l": 48, "r": 14, "t": 10, "b": 42})
    flown = [hard for one in trials.values() for hard in one.difficulty]
    extent = [max(0.0, min(flown, default=0.0) - 8.0), max(flown, default=100.0) + 8.0]
    for look in shown:
        if look.name in trials:
            _curve(figure, look, trials[look.name].curve())
    for place, look in enumerate(shown):
        # Discs of agents at one place would hide each other.
        aside = (place - (len(shown) - 1) / 2) * 0.012 * (extent[1] - extent[0])
        if look.name in trials:
            _pass_rates(figure, look, trials[look.name], aside)
            _competences(figure, look, tallies.get(look.name), 4.0 * (place - (len(shown) - 1) / 2))
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
            "range": [-9, 109],
            "tickvals": [0, 50, 90, 100],
            "gridcolor": "var(--grid)",
            "zeroline": False,
            "fixedrange": True,
        },
        showlegend=False,
    )
    return figure


def _curve(figure: go.Figure, look: AgentLook, curve: Curve) -> None:
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
        fillcolor=look.fill,
        mode="lines",
        line={"width": 0},
        opacity=0.5,
        hoverinfo="skip",
    )
    figure.add_scatter(
        x=x,
        y=[round(100 * float(value), 3) for value in curve.probability],
        mode="lines",
        line={"color": look.colour, "width": 2, "dash": "solid" if curve.state is CurveState.FITTED else "dot"},
        hovertext=f"{look.letter} {escape(look.name)}: logistic curve",
        hoverinfo="text",
    )


def _pass_rates(figure: go.Figure, look: AgentLook, trials: Trials, aside: float) -> None:
    tried = Counter(round(hard, 6) for hard in trials.difficulty)
    passed = Counter(round(hard, 6) for hard, ok in zip(trials.difficulty, trials.passed, strict=True) if ok)
    cells = sorted(tried)
    figure.add_scatter(
        x=[hard + aside for hard in cells],
        y=[round(100 * passed[hard] / tried[hard], 3) for hard in cells],
        mode="markers",
        marker={
            "symbol": look.marker,
            "size": [min(22.0, 6.0 + 2.0 * math.sqrt(tried[hard])) for hard in cells],
            "color": look.fill,
            "line": {"color": look.colour, "width": 1.4},
        },
        hovertext=[
            f"{look.letter} {escape(look.name)}<br>difficulty {hard:.1f}: {passed[hard]} of {tried[hard]} runs passed"
            for hard in cells
        ],
        hoverinfo="text",
    )


def _competences(figure: go.Figure, look: AgentLook, tally: Tally | None, aside: float) -> None:
    for rate, found in (tally.competence if tally is not None else {}).items():
        if found.value <= 0.0:
            continue
        figure.add_scatter(
            x=[found.low, found.value],
            y=[int(rate) + aside] * 2,
            mode="lines+markers",
            line={"color": look.colour, "width": 1.6},
            marker={
                "symbol": ["line-ns", "triangle-right" if found.at_least else "line-ns"],
                "size": [7, 10],
                "color": look.colour,
                "line": {"color": look.colour, "width": 1.6},
            },
            hovertext=f"{look.letter} {escape(look.name)}<br>competence {rate}: {'at least ' if found.at_least else ''}{found.value:.1f}, "
            f"lower bound {found.low:.1f}",
            hoverinfo="text",
        )
