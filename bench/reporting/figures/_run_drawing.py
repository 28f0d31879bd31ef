"""One or two runs of a scene from above, as an SVG file that needs no page around it, still or as a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace

import numpy as np

from bench.arrays import Floats
from bench.contracts import Tape
from bench.errors import SetupError

from ..map._run_map import RunMap
from ._map import draw_ground, draw_reports, draw_targets, empty_map
from ._style import file_style
from ._svg import Plot

# Chosen: a film is short enough to be watched to its end, whatever the flight took.
FILM_S = 20.0
# Of the agents' colours in the report, those that no actor has come first.
COLOURS = (2, 4, 5, 6, 3, 1)
# Moments of a film, between which the viewer draws straight lines.
MOMENTS = 161


def run_drawing(runs: Sequence[tuple[RunMap, Tape]], *, film: bool = False) -> str:
    """An SVG drawing of one run, or of several runs of one scene, each flight in the colour of its agent.

    A `film` repeats; vehicles and people move, and a report appears when it is made.
    Raises SetupError where the runs are not of one scene: where their actors start at other places.
    """
    scene, scene_tape = runs[0]
    for chart, _ in runs:
        if _start(chart) != _start(scene):
            what = f"{chart.run.realization} and {scene.run.realization} are not of one scene"
            raise SetupError("rebar draw", what, "name runs of one scene, by different agents")
    label = "; ".join(chart.run.realization for chart, _ in runs)
    plot = empty_map([chart for chart, _ in runs], label)
    end_s = max((chart.flight[-1][0] for chart, _ in runs if chart.flight), default=0.0)
    moments_s = np.linspace(0.0, end_s, MOMENTS)
    film = film and end_s > 0.0
    # Who moves in a film does not stand at the start as well.
    standing = [actor for actor in scene.actors if not film or len(actor.path_enu_m) == 1]
    shown = replace(scene, actors=tuple(standing))
    draw_ground(plot, shown)
    for place, (chart, tape) in enumerate(runs):
        colour = f"var(--agent-{COLOURS[place % len(COLOURS)]})"
        path = [(east_m, north_m) for _, east_m, north_m, _ in chart.flight]
        plot.line(path, colour, chart.run.realization, width=2.5, opacity=0.35 if film else 0.9)
        plot.explain("line", colour, f"flight of {chart.run.realization}", fill="none")
        if film:
            draw_reports(plot, chart, _appearing(end_s), below=place % 2 == 1)
            _draw_moving(plot, tape.vehicle_time_s, tape.vehicle_position_enu_m, moments_s, colour, 12)
        else:
            draw_reports(plot, chart, below=place % 2 == 1)
    draw_targets(plot, shown)
    if film:
        _draw_walkers(plot, scene, scene_tape, moments_s)
        corner = (plot.x_range[1], plot.y_range[1])
        plot.text(*corner, f"{end_s / FILM_S:.0f} times as fast", anchor="end", dx_px=-4, dy_px=14)
    return plot.file(file_style())


def _draw_walkers(plot: Plot, scene: RunMap, tape: Tape, moments_s: Floats) -> None:
    for member, actor in enumerate(scene.actors):
        if len(actor.path_enu_m) > 1:
            colour = f"var(--{actor.role.value})"
            _draw_moving(plot, tape.actor_time_s, tape.actor_position_enu_m[:, member], moments_s, colour, 7)
            plot.explain("circle", colour, f"{actor.role.value}, moving")


def _start(chart: RunMap) -> list[tuple[str, tuple[float, float]]]:
    return [(actor.id, actor.path_enu_m[0]) for actor in chart.actors]


def _appearing(end_s: float) -> Callable[[Plot, float], AbstractContextManager[None]]:
    @contextmanager
    def since(plot: Plot, time_s: float) -> Iterator[None]:
        first = len(plot.parts)
        yield
        share = min(max(time_s / end_s, 0.0001), 0.9999)
        plot.parts.insert(first, "<g>")
        plot.parts.append(
            f'<animate attributeName="visibility" values="hidden;visible" keyTimes="0;{share:.4f}" calcMode="discrete" '
            f'dur="{FILM_S:g}s" repeatCount="indefinite"/></g>'
        )

    return since


def _draw_moving(
    plot: Plot,
    times_s: Floats,
    positions_enu_m: Floats,
    moments_s: Floats,
    colour: str,
    size: float,
) -> None:
    """A dot that is at `positions_enu_m` (n, 3) at `times_s` (n,), and where it ended from then on."""
    if len(times_s) == 0:
        return
    east_m, north_m = (np.interp(moments_s, times_s, positions_enu_m[:, axis]) for axis in (0, 1))
    values = ";".join(
        f"{plot.x_px(float(x)):.1f} {plot.y_px(float(y)):.1f}" for x, y in zip(east_m, north_m, strict=True)
    )
    plot.parts.append(
        f'<circle r="{size / 2:g}" fill="{colour}" stroke="var(--paper)" stroke-width="1.5">'
        f'<animateTransform attributeName="transform" type="translate" values="{values}" dur="{FILM_S:g}s" '
        'repeatCount="indefinite"/></circle>'
    )
