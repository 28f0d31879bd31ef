"""The figures: pure functions from data to Plotly figures.

Colours are CSS variables (`var(--agent-1)`), which the page resolves for light, dark and print; nothing is told by colour
alone: agents also differ in letter, marker and hatching, roles in marker.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from statistics import stdev

import plotly.graph_objects as go
import polars as pl

from bench.statistics import Curve, CurveState

from ._data import Configuration, ReportData, Tally
from ._pairs import Pairing
from ._told import Trials

MARKERS = ("circle", "square", "diamond", "triangle-up", "cross", "hexagon")
HATCHES = ("", "/", "x", ".", "-", "|")
PALETTE = 6
VIOLIN_FROM = 8  # with fewer scores a density would show what is not there
VIOLIN_SPREAD = 0.25  # equal scores have no density; below this the scores themselves say all
Values = dict[tuple[str, str], list[float]]


@dataclass(frozen=True, slots=True)
class AgentLook:
    """How one agent looks in every figure and in the key beside it."""

    name: str
    letter: str
    colour: str
    fill: str
    marker: str
    hatch: str


def looks(agents: Sequence[str]) -> tuple[AgentLook, ...]:
    """A look for each agent, by its place; after six the colours come round again and the letter tells."""
    return tuple(
        AgentLook(
            name=name,
            letter=chr(ord("A") + place % 26),
            colour=f"var(--agent-{place % PALETTE + 1})",
            fill=f"var(--agent-{place % PALETTE + 1}-soft)",
            marker=MARKERS[place % len(MARKERS)],
            hatch=HATCHES[place % len(HATCHES)],
        )
        for place, name in enumerate(agents)
    )


def configuration_figure(data: ReportData, configuration: Configuration) -> go.Figure:
    """The paper's panel: difficulty as a red dot, scores as violins (left axis), confidence as grey bars (right axis)."""
    figure = empty_figure(height=300, margin={"l": 44, "r": 48, "t": 10, "b": 30})
    shown = tuple(look for look in looks(data.agents) if configuration.runs.get(look.name))
    scores = _scores_of(data.scores, configuration)
    slot = 0.84 / max(1, len(shown))
    for place, look in enumerate(shown):
        offset = (place - (len(shown) - 1) / 2) * slot
        _confidence_bars(figure, data, configuration, look, offset, slot * 0.9)
    for place, look in enumerate(shown):
        offset = (place - (len(shown) - 1) / 2) * slot
        _score_shapes(figure, data.study, look, scores, offset, slot * 0.78)
    _difficulty_dots(figure, data.study, configuration)
    top = max([100.0, *(v for values in scores.values() for v in values)])
    bottom = min([0.0, *(v for values in scores.values() for v in values)])
    extent = [bottom - 12.0, top + 6.0]
    figure.update_layout(
        xaxis={"tickvals": list(range(len(data.study))), "ticktext": list(data.study), "range": [-0.5, len(data.study) - 0.5]},
        # Bars are drawn on the first axis so that violins, on the overlaid one, stand before them.
        yaxis=_axis("confidence, %", extent, side="right", showgrid=False),
        yaxis2=_axis("score and difficulty", extent, side="left", overlaying="y", showgrid=True),
        barmode="overlay",
        showlegend=False,
    )
    figure.update_xaxes(showgrid=False, zeroline=False, fixedrange=True)
    return figure


def _axis(title: str, extent: Sequence[float], **more: object) -> dict[str, object]:
    ticks = [value for value in range(-100, 201, 20) if extent[0] <= value <= extent[1]]
    return {
        "title": {"text": title, "standoff": 4, "font": {"size": 12}},
        "range": list(extent),
        "tickvals": ticks,
        "gridcolor": "var(--grid)",
        "zeroline": False,
        "fixedrange": True,
        **more,
    }


def _scores_of(scores: pl.DataFrame, configuration: Configuration) -> Values:
    rows = scores.filter(pl.col("configuration") == configuration.key).drop_nulls("score").sort("realization")
    found: Values = {}
    for row in rows.select("agent", "node", "score").iter_rows():
        found.setdefault((row[0], row[1]), []).append(row[2])
    return found


def _confidence_bars(
    figure: go.Figure, data: ReportData, configuration: Configuration, look: AgentLook, offset: float, width: float
) -> None:
    tallies = [data.tally(look.name, node, configuration.key) for node in data.study]
    heights = [None if one is None or one.confidence is None else round(100 * one.confidence, 4) for one in tallies]
    texts = [
        f"{look.letter} {escape(look.name)}<br>{node}: confidence "
        + ("none: never considered" if one is None or one.confidence is None else f"{100 * one.confidence:.1f} %")
        + ("" if one is None else f"<br>considered in {one.considered} of {one.runs} runs")
        for node, one in zip(data.study, tallies, strict=True)
    ]
    figure.add_bar(
        x=[place + offset for place in range(len(data.study))],
        y=heights,
        width=width,
        marker={
            "color": "var(--bar)",
            "line": {"color": "var(--bar-edge)", "width": 1},
            "pattern": {"shape": look.hatch, "fgcolor": "var(--bar-edge)", "size": 6, "solidity": 0.2},
        },
        hovertext=texts,
        hoverinfo="text",
    )
    figure.add_scatter(
        x=[place + offset for place in range(len(data.study))],
        y=[-6.0] * len(data.study),
        mode="text",
        text=[look.letter if height is not None else f"{look.letter} –" for height in heights],
        textfont={"size": 11, "color": look.colour},
        hoverinfo="skip",
    )


def _score_shapes(figure: go.Figure, study: Sequence[str], look: AgentLook, scores: Values, offset: float, width: float) -> None:
    for place, node in enumerate(study):
        values = scores.get((look.name, node), [])
        if len(values) >= VIOLIN_FROM and max(values) - min(values) > VIOLIN_SPREAD:
            figure.add_violin(
                y=values,
                x0=place + offset,
                width=width,
                yaxis="y2",
                spanmode="hard",
                bandwidth=_bandwidth(values),
                scalemode="width",
                line={"color": look.colour, "width": 1.4},
                fillcolor=look.fill,
                points=False,
                meanline={"visible": True, "color": look.colour, "width": 1.4},
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
                    "symbol": look.marker,
                    "size": 5.5,
                    "color": look.colour,
                    "opacity": 0.75,
                    "line": {"width": 0.5, "color": "var(--paper)"},
                },
                hovertext=[f"{look.letter} {escape(look.name)}<br>{node}: score {value:.2f}" for value in values],
                hoverinfo="text",
            )


def _bandwidth(values: Sequence[float]) -> float:
    """Half of Scott's rule, since scores come in clumps; at least 0.4 points, or a clump of equal scores is a needle."""
    return max(0.4, 0.5 * stdev(values) * math.pow(len(values), -0.2))


def _swarm(values: Sequence[float]) -> list[float]:
    """Sideways shifts in [-0.4, 0.4] that keep equal values apart; the same for the same values."""
    count: dict[int, int] = {}
    ranks = []
    for value in values:
        bin_ = round(value / 2.0)
        ranks.append((bin_, count.get(bin_, 0)))
        count[bin_] = count.get(bin_, 0) + 1
    return [0.0 if count[b] == 1 else (rank / (count[b] - 1) - 0.5) * min(0.8, 0.16 * (count[b] - 1)) for b, rank in ranks]


def _difficulty_dots(figure: go.Figure, study: Sequence[str], configuration: Configuration) -> None:
    known = [(place, node) for place, node in enumerate(study) if node in configuration.difficulty]
    for place, node in known:
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
        x=[place for place, _ in known],
        y=[configuration.difficulty[node] for _, node in known],
        yaxis="y2",
        mode="markers",
        marker={"symbol": "circle", "size": 11, "color": "var(--difficulty)", "line": {"color": "var(--paper)", "width": 1.6}},
        hovertext=[f"{node}: difficulty {configuration.difficulty[node]:.1f}" for _, node in known],
        hoverinfo="text",
    )


def pairs_figure(pairings: Sequence[Pairing]) -> go.Figure:
    """For every node, each scene's difference in confidence (second agent minus first) and their mean."""
    figure = empty_figure(height=70 + 52 * max(1, len(pairings)), margin={"l": 70, "r": 24, "t": 10, "b": 46})
    for place, one in enumerate(pairings):
        counts = Counter(round(100 * value) for value in one.confidence_differences)
        steps = sorted(counts)
        figure.add_scatter(
            x=steps,
            y=[place] * len(steps),
            mode="markers+text",
            marker={
                "symbol": "circle",
                "size": [min(38.0, 13.0 + 3.5 * math.sqrt(counts[step])) for step in steps],
                "color": "var(--bar)",
                "line": {"color": "var(--bar-edge)", "width": 1},
            },
            text=[str(counts[step]) for step in steps],
            textfont={"size": 11, "color": "var(--ink)"},
            hovertext=[f"{one.node}: {step:+d} points in {counts[step]} of {one.scenes} scenes" for step in steps],
            hoverinfo="text",
        )
        if one.mean_confidence_difference is not None:
            mean = 100 * one.mean_confidence_difference
            figure.add_scatter(
                x=[mean],
                y=[place - 0.4],
                mode="markers",
                marker={"symbol": "triangle-down", "size": 12, "color": "var(--accent)"},
                hovertext=f"{one.node}: mean {mean:+.1f} points over {one.scenes} scenes",
                hoverinfo="text",
            )
    figure.update_layout(
        xaxis={
            "title": {"text": "difference in confidence, percentage points", "font": {"size": 12}},
            "range": [-108, 108],
            "gridcolor": "var(--grid)",
            "zeroline": True,
            "zerolinecolor": "var(--ink-soft)",
            "fixedrange": True,
        },
        yaxis={
            "tickvals": list(range(len(pairings))),
            "ticktext": [one.node for one in pairings],
            "range": [len(pairings) - 0.5, -0.65],
            "showgrid": False,
            "zeroline": False,
            "fixedrange": True,
        },
        showlegend=False,
    )
    return figure


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


def empty_figure(height: int, margin: dict[str, int]) -> go.Figure:
    """An empty figure in the page's clothes."""
    return go.Figure(
        layout={
            "template": go.layout.Template(),
            "height": height,
            "margin": margin,
            "paper_bgcolor": "var(--paper)",
            "plot_bgcolor": "var(--paper)",
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": "var(--ink)"},
            "hoverlabel": {"bgcolor": "var(--paper)", "bordercolor": "var(--line)", "font": {"color": "var(--ink)"}},
        }
    )
