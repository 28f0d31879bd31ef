"""One run from above, as a Plotly figure in the colours and markers of the other figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import plotly.graph_objects as go

from bench.simspec import Role

from ..map._consents import ConsentState, MapConsent
from ..map._run_map import MapActor, MapReport, RunMap, Track
from ._style import empty_figure

# Visible on white and on black: the scale does not change with the theme.
FLIGHT_COLOURS = ((0.0, "#4a74d9"), (0.5, "#b35fa0"), (1.0, "#e0912f"))
ROLE_MARKERS = {Role.ADVERSARY: "triangle-up", Role.BYSTANDER: "circle", Role.CLUTTER: "square"}
# Outlines, larger than the cross of a report: the request about a target and its report have one place. Each answer
# has a shape of its own, because colours alone are lost in a grey print.
CONSENT_MARKERS: dict[ConsentState, tuple[str, str]] = {
    "granted": ("diamond-open", "var(--good)"),
    "refused": ("square-open", "var(--forbidden)"),
    "never answered": ("hexagon-open", "var(--warn)"),
}
ROLE_NAMES = {Role.ADVERSARY: "adversary", Role.BYSTANDER: "bystander", Role.CLUTTER: "clutter"}


def map_figure(chart: RunMap) -> go.Figure:
    """One run from above: east to the right, north up, metres, the same scale on both axes."""
    figure = empty_figure(height=620, margin={"l": 54, "r": 10, "t": 64, "b": 44})
    _outline(
        figure,
        chart.area_enu_m,
        "area of interest",
        {"color": "var(--ink-soft)", "width": 1.2, "dash": "dash"},
    )
    for name, points, width_m in chart.roads:
        _outline(figure, points, f"road {name}, {width_m:g} m wide", {"color": "var(--road)", "width": 5})
    for name, ring in chart.areas:
        _outline(figure, ring, f"area {name}", {"color": "var(--ink-soft)", "width": 1, "dash": "dot"})
    if chart.geofence_enu_m:
        _outline(figure, chart.geofence_enu_m, "geofence", {"color": "var(--warn)", "width": 1.8})
    for no_fly in chart.no_fly:
        label = f"no-fly {escape(no_fly.id)}{'' if no_fly.always else f', {no_fly.span}'}"
        _outline(
            figure,
            no_fly.corners_enu_m,
            label,
            {"color": "var(--forbidden)", "width": 1.4, "dash": "longdashdot"},
            fill="var(--no-fly)",
        )
    for name, east_m, north_m, radius_m, priority in chart.circles:
        label = f"intelligence {name}, priority {priority}"
        _outline(
            figure,
            _circle(east_m, north_m, radius_m),
            label,
            {"color": "var(--intelligence)", "width": 1.6, "dash": "dot"},
        )
    for role in (Role.CLUTTER, Role.BYSTANDER):
        _draw_actors(figure, role, [actor for actor in chart.actors if actor.role is role])
    _draw_flight(figure, chart)
    for place, report in enumerate(chart.reports):
        # The legend has one entry for marks and one for withheld marks, not one for each report.
        _draw_report(
            figure,
            chart,
            report,
            first=report.mark not in {earlier.mark for earlier in chart.reports[:place]},
        )
    _draw_consents(figure, chart.consents)
    # Last, so that a target is not hidden by the report on it.
    _draw_actors(figure, Role.ADVERSARY, [actor for actor in chart.actors if actor.role is Role.ADVERSARY])
    figure.add_scatter(
        x=[chart.home_enu_m[0]],
        y=[chart.home_enu_m[1]],
        mode="markers+text",
        marker={
            "symbol": "star",
            "size": 14,
            "color": "var(--ink)",
            "line": {"color": "var(--paper)", "width": 1},
        },
        text=["home"],
        textposition="bottom center",
        textfont={"color": "var(--ink)"},
        name="home",
        hoverinfo="name",
    )
    axis = {"gridcolor": "var(--grid)", "zeroline": False}
    figure.update_layout(
        xaxis={**axis, "title": {"text": "east, m", "font": {"size": 12}}},
        yaxis={
            **axis,
            "title": {"text": "north, m", "font": {"size": 12}},
            "scaleanchor": "x",
            "scaleratio": 1,
        },
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
        # Plotly renders markup in texts. An id cannot hold any, a class label could.
        hovertext=[
            f"{actor.id} ({escape(actor.class_label)}), {ROLE_NAMES[role]}, at the start" for actor in actors
        ],
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
            "colorbar": {
                "title": {"text": "time, s", "side": "right"},
                "thickness": 10,
                "len": 0.7,
                "outlinewidth": 0,
            },
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
            marker={
                "symbol": "circle-open",
                "size": 13,
                "color": colour,
                "line": {"width": 2, "color": colour},
            },
            hovertext=f"bystander within {chart.no_mark_within_m:g} m at {report.time_s:.1f} s",
            hoverinfo="text",
            showlegend=False,
        )
    figure.add_scatter(
        x=[report.east_m],
        y=[report.north_m],
        mode="markers",
        marker={
            "symbol": "x" if report.mark else "x-open",
            "size": 19,
            "color": colour,
            "line": {"color": colour, "width": 1.5},
        },
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


def _draw_consents(figure: go.Figure, consents: Sequence[MapConsent]) -> None:
    for state, (symbol, colour) in CONSENT_MARKERS.items():
        requests = [consent for consent in consents if consent.state == state]
        if not requests:
            continue
        figure.add_scatter(
            x=[request.east_m for request in requests],
            y=[request.north_m for request in requests],
            mode="markers",
            marker={
                "symbol": symbol,
                "size": 30,
                "color": colour,
                "line": {"color": colour, "width": 2},
            },
            hovertext=[_consent_text(request) for request in requests],
            hoverinfo="text",
            name=f"consent {state}",
        )


def _consent_text(consent: MapConsent) -> str:
    # The id is any text of the agent, and Plotly renders markup.
    about = f"consent to mark {escape(consent.about)} asked at {consent.time_s:.1f} s"
    if consent.answered_s is None:
        return f"{about}, never answered"
    return f"{about}, {consent.state} at {consent.answered_s:.1f} s"


def _outline(
    figure: go.Figure,
    track: Track,
    name: str,
    line: dict[str, object],
    show: bool = True,
    fill: str | None = None,
) -> None:
    figure.add_scatter(
        x=[point[0] for point in track], y=[point[1] for point in track], mode="lines", line=line, name=name, hoverinfo="name",
        showlegend=show, fill="toself" if fill else None, fillcolor=fill,
    )  # fmt: skip


def _circle(east_m: float, north_m: float, radius_m: float, corners: int = 48) -> Track:
    # 48 corners stay within 0.3 % of the radius: 1 - cos(pi / 48).
    turns = [2 * math.pi * k / corners for k in range(corners + 1)]
    return tuple(
        (round(east_m + radius_m * math.cos(a), 1), round(north_m + radius_m * math.sin(a), 1)) for a in turns
    )
