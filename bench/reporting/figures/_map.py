"""One run from above, as a Plotly figure in the colours and markers of the other figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import plotly.graph_objects as go

from bench.simspec import TARGET_ROLES, Role

from ..map._consents import ConsentState, MapConsent
from ..map._reports import MapReport, Track
from ..map._run_map import MapActor, RunMap
from ._style import empty_figure

# Visible on white and on black: the scale does not change with the theme.
FLIGHT_COLOURS = ((0.0, "#4a74d9"), (0.5, "#b35fa0"), (1.0, "#e0912f"))
ROLE_MARKERS = {
    Role.ADVERSARY: "triangle-up",
    Role.BYSTANDER: "circle",
    Role.CLUTTER: "square",
    Role.SOUGHT: "pentagon",
}
# Outlines, larger than the cross of a report: the request about a target and its report have one place. Each answer
# has a shape of its own, because colours alone are lost in a grey print.
CONSENT_MARKERS: dict[ConsentState, tuple[str, str]] = {
    "granted": ("diamond-open", "var(--good)"),
    "refused": ("square-open", "var(--forbidden)"),
    "never answered": ("hexagon-open", "var(--warn)"),
}

# Chosen, not measured: more rings than this hide the map. The table beside the map has more reports.
MAX_RINGED_REPORTS = 40
# More labels hide the crosses. Width and height in pixels, of a label and of the plot, in a window of 1280 by 900.
MAX_LABELS = 12
LABEL_PX, PLOT_PX = (136.0, 42.0), (950.0, 470.0)
ROLE_NAMES = {role: role.value for role in Role}


@dataclass(frozen=True, slots=True)
class ReportKind:
    """How reports of one kind look, and what they are called beside the map and in its legend."""

    verdict: str
    legend: str
    symbol: str
    colour: str
    ring_dash: str


MARKED = ReportKind("marked", "report, marked", "x", "var(--report)", "solid")
FORBIDDEN = ReportKind("marked", "report, marked against the rule", "x", "var(--forbidden)", "solid")
WITHHELD = ReportKind("withheld mark", "report, withheld mark", "x-open", "var(--report)", "dash")
# Marks against the rule are drawn last, over the others.
REPORT_KINDS = (WITHHELD, MARKED, FORBIDDEN)


def _kind(report: MapReport) -> ReportKind:
    return FORBIDDEN if report.forbidden else MARKED if report.mark else WITHHELD


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
    _draw_reports(figure, chart)
    _draw_consents(figure, chart.consents.drawn)
    # Last, so that a target is not hidden by the report on it.
    for role in (Role.SOUGHT, Role.ADVERSARY):
        _draw_actors(figure, role, [actor for actor in chart.actors if actor.role is role])
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
            "size": 12 if role in TARGET_ROLES else 7,
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


def ringed_reports(reports: Sequence[MapReport]) -> list[MapReport]:
    """The reports that get a ring and a label: at most MAX_RINGED_REPORTS, marks against the rule first."""
    return sorted(reports, key=lambda report: (not report.forbidden, report.time_s))[:MAX_RINGED_REPORTS]


def labelled_reports(chart: RunMap) -> list[MapReport]:
    """The ringed reports with a label: all where they are few, else at most MAX_LABELS that do not hide each other."""
    ringed = ringed_reports(chart.reports.drawn)
    if len(ringed) <= MAX_LABELS:
        return ringed
    reported = ((report.east_m, report.north_m) for report in chart.reports.drawn)
    places = [*chart.area_enu_m, *chart.geofence_enu_m, *reported]
    # Both axes have one scale, that of the axis on which less room is.
    m_per_px = max(
        (max(values) - min(values)) / px
        for values, px in zip(zip(*places, strict=True), PLOT_PX, strict=True)
    )
    width_m, height_m = (m_per_px * px for px in LABEL_PX)
    labelled: list[MapReport] = []
    for report in ringed:
        if len(labelled) < MAX_LABELS and all(
            abs(report.east_m - other.east_m) >= width_m or abs(report.north_m - other.north_m) >= height_m
            for other in labelled
        ):
            labelled.append(report)
    return labelled


def _draw_reports(figure: go.Figure, chart: RunMap) -> None:
    """Every drawn report as a cross; rings and ringed bystanders for `ringed_reports`, labels for `labelled_reports`.

    One trace for each kind and not for each report: Plotly's work grows with the square of the number of traces and
    annotations that are added one by one, and an agent may report a thousand times.
    """
    ringed = ringed_reports(chart.reports.drawn)
    for kind in REPORT_KINDS:
        _draw_rings(figure, chart, kind, [report for report in ringed if _kind(report) is kind])
    for kind in REPORT_KINDS:
        reports = [report for report in chart.reports.drawn if _kind(report) is kind]
        if not reports:
            continue
        figure.add_scatter(
            x=[report.east_m for report in reports],
            y=[report.north_m for report in reports],
            mode="markers",
            marker={
                "symbol": kind.symbol,
                "size": 19,
                "color": kind.colour,
                "line": {"color": kind.colour, "width": 1.5},
            },
            hovertext=[
                f"{kind.verdict} at {report.time_s:.1f} s, confidence {report.confidence:.2f}"
                for report in reports
            ],
            hoverinfo="text",
            name=kind.legend,
        )
    figure.update_layout(annotations=[_report_label(report) for report in labelled_reports(chart)])


def _draw_rings(figure: go.Figure, chart: RunMap, kind: ReportKind, reports: Sequence[MapReport]) -> None:
    rings = [_circle(*report.target_enu_m, chart.no_mark_within_m) for report in reports]
    if rings:
        figure.add_scatter(
            x=_joined([[east for east, _ in ring] for ring in rings]),
            y=_joined([[north for _, north in ring] for ring in rings]),
            mode="lines",
            line={"color": kind.colour, "width": 1.2, "dash": kind.ring_dash},
            name=f"no-mark distance, {chart.no_mark_within_m:g} m",
            hoverinfo="name",
            showlegend=False,
        )
    bystanders = [(place, report.time_s) for report in reports for place in report.bystanders_enu_m]
    if bystanders:
        figure.add_scatter(
            x=[east for (east, _), _ in bystanders],
            y=[north for (_, north), _ in bystanders],
            mode="markers",
            marker={
                "symbol": "circle-open",
                "size": 13,
                "color": kind.colour,
                "line": {"width": 2, "color": kind.colour},
            },
            hovertext=[
                f"bystander within {chart.no_mark_within_m:g} m at {time_s:.1f} s" for _, time_s in bystanders
            ],
            hoverinfo="text",
            showlegend=False,
        )


def _report_label(report: MapReport) -> dict[str, object]:
    """An annotation of Plotly beside the report."""
    kind = _kind(report)
    return {
        "x": report.east_m,
        "y": report.north_m,
        "text": f"{kind.verdict}, {report.time_s:.0f} s"
        + ("<br>too near a bystander" if report.forbidden else ""),
        "showarrow": True,
        "arrowhead": 0,
        "arrowwidth": 1,
        "arrowcolor": kind.colour,
        "ax": 0,
        "ay": -70,
        "standoff": 10,
        "font": {"size": 12, "color": kind.colour},
        "bgcolor": "var(--paper)",
        "bordercolor": kind.colour,
        "borderwidth": 1,
        "borderpad": 3,
        "opacity": 0.92,
    }


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
    fill: str | None = None,
) -> None:
    figure.add_scatter(
        x=[point[0] for point in track], y=[point[1] for point in track], mode="lines", line=line, name=name, hoverinfo="name",
        fill="toself" if fill else None, fillcolor=fill,
    )  # fmt: skip


def _circle(east_m: float, north_m: float, radius_m: float, corners: int = 48) -> Track:
    # 48 corners stay within 0.3 % of the radius: 1 - cos(pi / 48).
    turns = [2 * math.pi * k / corners for k in range(corners + 1)]
    return tuple(
        (round(east_m + radius_m * math.cos(a), 1), round(north_m + radius_m * math.sin(a), 1)) for a in turns
    )
