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

from bench.scoring import Curve, CurveState
from bench.simspec import Role

from ._data import Configuration, ReportData, Tally
from ._map import MapActor, MapReport, RunMap, Track
from ._pairs import Pairing
from ._told import Trials

MARKERS = ("circle", "square", "diamond", "triangle-up", "cross", "hexagon")
HATCHES = ("", "/", "x", ".", "-", "|")
PALETTE = 6
VIOLIN_FROM = 8  # with fewer scores a density would show what is not there
VIOLIN_SPREAD = 0.25  # equal scores have no density; below this the scores themselves say all
FLIGHT_COLOURS = ((0.0, "#4a74d9"), (0.5, "#b35fa0"), (1.0, "#e0912f"))  # seen on white and on black
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
    figure = _figure(height=300, margin={"l": 44, "r": 48, "t": 10, "b": 30})
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
    figure = _figure(height=70 + 52 * max(1, len(pairings)), margin={"l": 70, "r": 24, "t": 10, "b": 46})
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
    figure = _figure(height=270, margin={"l": 48, "r": 14, "t": 10, "b": 42})
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


ROLE_MARKERS = {Role.ADVERSARY: "triangle-up", Role.BYSTANDER: "circle", Role.CLUTTER: "square"}
ROLE_NAMES = {Role.ADVERSARY: "adversary", Role.BYSTANDER: "bystander", Role.CLUTTER: "clutter"}


def map_figure(chart: RunMap) -> go.Figure:
    """One run from above: east to the right, north up, metres, the same scale on both axes."""
    figure = _figure(height=620, margin={"l": 54, "r": 10, "t": 64, "b": 44})
    _outline(figure, chart.area_enu_m, "area of interest", {"color": "var(--ink-soft)", "width": 1.2, "dash": "dash"})
    if chart.geofence_enu_m:
        _outline(figure, chart.geofence_enu_m, "geofence", {"color": "var(--warn)", "width": 1.8})
    for one in chart.no_fly:
        label = f"no-fly {escape(one.id)}{'' if one.always else f', {one.span}'}"
        _outline(
            figure,
            one.corners_enu_m,
            label,
            {"color": "var(--forbidden)", "width": 1.4, "dash": "longdashdot"},
            fill="var(--no-fly)",
        )
    for name, east_m, north_m, radius_m, priority in chart.circles:
        label = f"intelligence {name}, priority {priority}"
        _outline(figure, _circle(east_m, north_m, radius_m), label, {"color": "var(--intelligence)", "width": 1.6, "dash": "dot"})
    for role in (Role.CLUTTER, Role.BYSTANDER):
        _draw_actors(figure, role, [actor for actor in chart.actors if actor.role is role])
    _draw_flight(figure, chart)
    for place, report in enumerate(chart.reports):
        _draw_report(figure, chart, report, first=report.mark not in {one.mark for one in chart.reports[:place]})
    # Last, so that a target is not hidden by the report on it.
    _draw_actors(figure, Role.ADVERSARY, [actor for actor in chart.actors if actor.role is Role.ADVERSARY])
    figure.add_scatter(
        x=[chart.home_enu_m[0]],
        y=[chart.home_enu_m[1]],
        mode="markers+text",
        marker={"symbol": "star", "size": 14, "color": "var(--ink)", "line": {"color": "var(--paper)", "width": 1}},
        text=["home"],
        textposition="bottom center",
        textfont={"color": "var(--ink)"},
        name="home",
        hoverinfo="name",
    )
    axis = {"gridcolor": "var(--grid)", "zeroline": False}
    figure.update_layout(
        xaxis={**axis, "title": {"text": "east, m", "font": {"size": 12}}},
        yaxis={**axis, "title": {"text": "north, m", "font": {"size": 12}}, "scaleanchor": "x", "scaleratio": 1},
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0, "font": {"size": 11}},
        dragmode="pan",
    )
    return figure


def _draw_actors(figure: go.Figure, role: Role, actors: Sequence[MapActor]) -> None:
    if not actors:
        return
    colour = f"var(--{role.value})"
    moving = [actor for actor in actors if len(actor.path_enu_m) > 1]
    if moving:
        figure.add_scatter(
            x=_joined([[point[0] for point in actor.path_enu_m] for actor in moving]),
            y=_joined([[point[1] for point in actor.path_enu_m] for actor in moving]),
            mode="lines",
            line={"color": colour, "width": 1},
            opacity=0.55,
            hoverinfo="skip",
            showlegend=False,
        )
    figure.add_scatter(
        x=[actor.path_enu_m[0][0] for actor in actors],
        y=[actor.path_enu_m[0][1] for actor in actors],
        mode="markers",
        marker={
            "symbol": ROLE_MARKERS[role],
            "size": 12 if role is Role.ADVERSARY else 7,
            "color": colour,
            "opacity": 0.5 if role is Role.CLUTTER else 0.9,
            "line": {"color": "var(--paper)", "width": 0.8},
        },
        hovertext=[f"{actor.id} ({escape(actor.class_label)}), {ROLE_NAMES[role]}, at the start" for actor in actors],
        hoverinfo="text",
        name=ROLE_NAMES[role],
    )


def _joined(parts: Sequence[Sequence[float]]) -> list[float | None]:
    """Lines in one trace: a gap of None between any two."""
    return [value for part in parts for value in (*part, None)][:-1]


def _draw_flight(figure: go.Figure, chart: RunMap) -> None:
    if not chart.flight:
        return
    times, east, north, height = zip(*chart.flight, strict=True)
    figure.add_scatter(
        x=list(east),
        y=list(north),
        mode="lines",
        line={"color": "var(--ink-soft)", "width": 1},
        hoverinfo="skip",
        showlegend=False,
    )
    figure.add_scatter(
        x=list(east),
        y=list(north),
        mode="markers",
        marker={
            "size": 4,
            "color": list(times),
            "colorscale": [list(stop) for stop in FLIGHT_COLOURS],
            "colorbar": {"title": {"text": "time, s", "side": "right"}, "thickness": 10, "len": 0.7, "outlinewidth": 0},
        },
        hovertext=[f"{t:.1f} s, {h:.0f} m high" for t, h in zip(times, height, strict=True)],
        hoverinfo="text",
        name="flight, by time",
    )


def _draw_report(figure: go.Figure, chart: RunMap, report: MapReport, first: bool) -> None:
    kind = "marked" if report.mark else "withheld mark"
    colour = "var(--forbidden)" if report.forbidden else "var(--report)"
    _outline(
        figure,
        _circle(*report.target_enu_m, chart.no_mark_within_m),
        f"no-mark distance, {chart.no_mark_within_m:g} m",
        {"color": colour, "width": 1.2, "dash": "solid" if report.mark else "dash"},
        show=False,
    )
    if report.bystanders_enu_m:
        figure.add_scatter(
            x=[east for east, _ in report.bystanders_enu_m],
            y=[north for _, north in report.bystanders_enu_m],
            mode="markers",
            marker={"symbol": "circle-open", "size": 13, "color": colour, "line": {"width": 2, "color": colour}},
            hovertext=f"bystander within {chart.no_mark_within_m:g} m at {report.time_s:.1f} s",
            hoverinfo="text",
            showlegend=False,
        )
    figure.add_scatter(
        x=[report.east_m],
        y=[report.north_m],
        mode="markers",
        marker={"symbol": "x" if report.mark else "x-open", "size": 19, "color": colour, "line": {"color": colour, "width": 1.5}},
        hovertext=f"{kind} at {report.time_s:.1f} s, confidence {report.confidence:.2f}",
        hoverinfo="text",
        name=f"report, {kind}",
        showlegend=first,
    )
    figure.add_annotation(
        x=report.east_m,
        y=report.north_m,
        text=f"{kind}, {report.time_s:.0f} s" + ("<br>too near a bystander" if report.forbidden else ""),
        showarrow=True,
        arrowhead=0,
        arrowwidth=1,
        arrowcolor=colour,
        ax=0,
        ay=-70,
        standoff=10,
        font={"size": 12, "color": colour},
        bgcolor="var(--paper)",
        bordercolor=colour,
        borderwidth=1,
        borderpad=3,
        opacity=0.92,
    )


def _outline(
    figure: go.Figure, track: Track, name: str, line: dict[str, object], show: bool = True, fill: str | None = None
) -> None:
    figure.add_scatter(
        x=[point[0] for point in track], y=[point[1] for point in track], mode="lines", line=line, name=name, hoverinfo="name",
        showlegend=show, fill="toself" if fill else None, fillcolor=fill,
    )  # fmt: skip


def _circle(east_m: float, north_m: float, radius_m: float, corners: int = 48) -> Track:
    turns = [2 * math.pi * k / corners for k in range(corners + 1)]
    return tuple((round(east_m + radius_m * math.cos(a), 1), round(north_m + radius_m * math.sin(a), 1)) for a in turns)


def _figure(height: int, margin: dict[str, int]) -> go.Figure:
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
