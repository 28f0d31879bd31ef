"""One run from above, in the colours and markers of the other figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from markupsafe import Markup

from bench.simspec import TARGET_ROLES, Role

from ..map._consents import ConsentState
from ..map._reports import MapReport, Track
from ..map._run_map import RunMap
from ._svg import Plot, round_ticks

# Visible on white and on black: the scale does not change with the theme.
FLIGHT_COLOURS = ("#4a74d9", "#7f6abd", "#b35fa0", "#ca7868", "#e0912f")
ROLE_MARKERS = {
    Role.ADVERSARY: "triangle-up",
    Role.BYSTANDER: "circle",
    Role.CLUTTER: "square",
    Role.SOUGHT: "pentagon",
}
# Outlines, larger than the cross of a report: the request about a target and its report have one place. Each answer
# has a shape of its own, because colours alone are lost in a grey print.
CONSENT_MARKERS: dict[ConsentState, tuple[str, str]] = {
    "granted": ("diamond", "var(--good)"),
    "refused": ("square", "var(--forbidden)"),
    "never answered": ("hexagon", "var(--warn)"),
}

# Chosen, not measured: more rings than this hide the map. The table beside the map has more reports.
MAX_RINGED_REPORTS = 40
# More labels hide the crosses. Width and height in pixels, of a label and of the plot.
MAX_LABELS = 12
LABEL_PX, PLOT_PX = (136.0, 42.0), (900.0, 500.0)
MARGINS_PX = (50.0, 10.0, 10.0, 40.0)


@dataclass(frozen=True, slots=True)
class ReportKind:
    """How reports of one kind look, and what they are called beside the map and in its key."""

    verdict: str
    legend: str
    colour: str
    fill: str
    ring_dash: str


MARKED = ReportKind("marked", "report, marked", "var(--report)", "var(--report)", "")
FORBIDDEN = ReportKind(
    "marked", "report, marked against the rule", "var(--forbidden)", "var(--forbidden)", ""
)
WITHHELD = ReportKind("withheld mark", "report, withheld mark", "var(--report)", "var(--paper)", "6 4")
# Marks against the rule are drawn last, over the others.
REPORT_KINDS = (WITHHELD, MARKED, FORBIDDEN)


@contextmanager
def _shown(plot: Plot, time_s: float) -> Iterator[None]:
    """From the start: a still drawing."""
    yield


def _kind(report: MapReport) -> ReportKind:
    return FORBIDDEN if report.forbidden else MARKED if report.mark else WITHHELD


def map_figure(chart: RunMap, label: str = "") -> Markup:
    """One run from above: east to the right, north up, metres, the same scale on both axes."""
    plot = empty_map([chart], label)
    draw_ground(plot, chart)
    _draw_flight(plot, chart)
    draw_reports(plot, chart)
    for request in chart.consents.drawn:
        symbol, colour = CONSENT_MARKERS[request.state]
        end = "" if request.answered_s is None else f" at {request.answered_s:.1f} s"
        title = f"consent to mark {request.about} asked at {request.time_s:.1f} s, {request.state}{end}"
        plot.mark(symbol, (request.east_m, request.north_m), 30, colour, title, fill="none", width=2)
        plot.explain(symbol, colour, f"consent {request.state}", fill="none")
    draw_targets(plot, chart)
    return plot.markup()


def draw_ground(plot: Plot, chart: RunMap) -> None:
    """What lies below the flight: areas, roads, closed ground, intelligence, and who is no target."""
    _outline(plot, chart.area_enu_m, "area of interest", "var(--ink-soft)", 1.2, "6 4")
    for name, points, width_m in chart.roads:
        _outline(plot, points, f"road {name}, {width_m:g} m wide", "var(--road)", 5)
    for name, ring in chart.areas:
        _outline(plot, ring, f"area {name}", "var(--ink-soft)", 1, "2 3")
    if chart.geofence_enu_m:
        _outline(plot, chart.geofence_enu_m, "geofence", "var(--warn)", 1.8)
    for no_fly in chart.no_fly:
        name = f"no-fly {no_fly.id}{'' if no_fly.always else f', {no_fly.span}'}"
        _outline(plot, no_fly.corners_enu_m, name, "var(--forbidden)", 1.4, "8 3 2 3", "var(--no-fly)")
    for name, east_m, north_m, radius_m, priority in chart.circles:
        ring = _circle(east_m, north_m, radius_m)
        _outline(plot, ring, f"intelligence {name}, priority {priority}", "var(--intelligence)", 1.6, "2 3")
    for role in (Role.CLUTTER, Role.BYSTANDER):
        _draw_actors(plot, role, chart)


def draw_targets(plot: Plot, chart: RunMap) -> None:
    """Targets and home. Last, so that a target is not hidden by the report on it."""
    for role in (Role.SOUGHT, Role.ADVERSARY):
        _draw_actors(plot, role, chart)
    plot.mark("star", chart.home_enu_m, 15, "var(--ink)", "home")
    plot.explain("star", "var(--ink)", "home")


def empty_map(charts: Sequence[RunMap], label: str) -> Plot:
    """Room for everything on the maps of runs of one scene, and the axes."""
    scene = charts[0]
    places = [
        *(*scene.area_enu_m, *scene.geofence_enu_m, scene.home_enu_m),
        *((east_m, north_m) for chart in charts for _, east_m, north_m, _ in chart.flight),
        *((report.east_m, report.north_m) for chart in charts for report in chart.reports.drawn),
        *(place for actor in scene.actors for place in actor.path_enu_m),
    ]
    (west, east), (south, north) = (
        (min(values) - 15.0, max(values) + 15.0) for values in zip(*places, strict=True)
    )
    m_per_px = max((east - west) / PLOT_PX[0], (north - south) / PLOT_PX[1])
    # A map that is higher than wide has room to its left and right.
    spare_m = max(0.0, m_per_px * PLOT_PX[0] - (east - west)) / 2.0
    left, right, top, bottom = MARGINS_PX
    height = (north - south) / m_per_px + top + bottom
    plot = Plot(
        label, PLOT_PX[0] + left + right, height, (west - spare_m, east + spare_m), (south, north), MARGINS_PX
    )
    plot.x_axis(round_ticks(*plot.x_range), "east, m")
    plot.y_axis(round_ticks(south, north, 5), "north, m")
    return plot


def _draw_actors(plot: Plot, role: Role, chart: RunMap) -> None:
    actors = [actor for actor in chart.actors if actor.role is role]
    if not actors:
        return
    colour, symbol = f"var(--{role.value})", ROLE_MARKERS[role]
    plot.explain(symbol, colour, role.value)
    plot.tracks((actor.path_enu_m for actor in actors if len(actor.path_enu_m) > 1), colour)
    if role not in TARGET_ROLES:
        plot.crowd(symbol, (actor.path_enu_m[0] for actor in actors), 7, colour)
        return
    for actor in actors:
        title = f"{actor.id} ({actor.class_label}), {role.value}, at the start"
        plot.mark(symbol, actor.path_enu_m[0], 12, "var(--paper)", title, fill=colour, width=0.8)


def _draw_flight(plot: Plot, chart: RunMap) -> None:
    """The path, in as many parts as there are colours for its time."""
    parts = 4 * len(FLIGHT_COLOURS)
    for number in range(parts):
        start, end = (round(edge * (len(chart.flight) - 1) / parts) for edge in (number, number + 1))
        if end <= start:
            continue
        points = chart.flight[start : end + 1]
        title = f"{points[0][0]:.0f} to {points[-1][0]:.0f} s, {points[-1][3]:.0f} m high"
        colour = FLIGHT_COLOURS[number * len(FLIGHT_COLOURS) // parts]
        plot.line([(east_m, north_m) for _, east_m, north_m, _ in points], colour, title, width=2.5)
    for share, words in ((0, "start"), (-1, "end")):
        if chart.flight:
            text = f"flight, {words} at {chart.flight[share][0]:.0f} s"
            plot.explain("line", FLIGHT_COLOURS[share], text, fill="none")


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


def draw_reports(
    plot: Plot,
    chart: RunMap,
    since: Callable[[Plot, float], AbstractContextManager[None]] = _shown,
    *,
    below: bool = False,
) -> None:
    """Every drawn report as a cross; rings and ringed bystanders for `ringed_reports`, labels for `labelled_reports`.

    What is drawn about a report is drawn inside `since(plot, time_s)`; labels stand `below` or above the cross.
    """
    ringed = ringed_reports(chart.reports.drawn)
    for kind in REPORT_KINDS:
        for report in ringed:
            if _kind(report) is not kind:
                continue
            with since(plot, report.time_s):
                ring = _circle(*report.target_enu_m, chart.no_mark_within_m)
                plot.line(ring, kind.colour, width=1.2, dash=kind.ring_dash)
                for place in report.bystanders_enu_m:
                    title = f"bystander within {chart.no_mark_within_m:g} m at {report.time_s:.1f} s"
                    plot.mark("circle", place, 13, kind.colour, title, fill="none", width=2)
    for kind in REPORT_KINDS:
        for report in chart.reports.drawn:
            if _kind(report) is kind:
                title = f"{kind.verdict} at {report.time_s:.1f} s, confidence {report.confidence:.2f}"
                place = (report.east_m, report.north_m)
                with since(plot, report.time_s):
                    plot.mark("x", place, 19, kind.colour, title, fill=kind.fill, width=1.5)
                plot.explain("x", kind.colour, kind.legend, fill=kind.fill)
    title_px, rule_px = (24.0, 37.0) if below else (-28.0, -15.0)
    for report in labelled_reports(chart):
        colour, east_m, north_m = _kind(report).colour, report.east_m, report.north_m
        with since(plot, report.time_s):
            text = f"{_kind(report).verdict}, {report.time_s:.0f} s"
            plot.text(east_m, north_m, text, colour, dy_px=title_px)
            if report.forbidden:
                plot.text(east_m, north_m, "too near a bystander", colour, dy_px=rule_px)


def _outline(
    plot: Plot, track: Track, name: str, colour: str, width: float, dash: str = "", fill: str = "none"
) -> None:
    plot.line(track, colour, name, width=width, dash=dash, fill=fill)
    plot.explain(f"line {dash}".strip(), colour, name, fill="none")


def _circle(east_m: float, north_m: float, radius_m: float, corners: int = 48) -> Track:
    # 48 corners stay within 0.3 % of the radius: 1 - cos(pi / 48).
    turns = [2 * math.pi * k / corners for k in range(corners + 1)]
    return tuple((east_m + radius_m * math.cos(a), north_m + radius_m * math.sin(a)) for a in turns)
