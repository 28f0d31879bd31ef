"""A situation from above: as characters for a terminal, and as an SVG drawing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.polygons import is_inside

if TYPE_CHECKING:
    from bench.simspec import SimSpec

TEXT_COLUMNS = 72
CHARACTER_ASPECT = 2.0
"""A character of a terminal is about twice as high as wide."""
MARGIN = 0.05
"""Ground drawn beside what the situation has, as a share of its larger side."""
SVG_WIDTH = 800.0
ROLE_COLOURS = {"adversary": "#c0392b", "bystander": "#1f5fa8", "clutter": "#7a7a7a", "sought": "#b36b00"}
Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class SituationMap:
    """What is drawn, in metres east and north."""

    area: tuple[Place, ...]
    parts: tuple[tuple[str, tuple[Place, ...]], ...]
    no_fly: tuple[tuple[str, tuple[Place, ...]], ...]
    roads: tuple[tuple[Place, ...], ...]
    home: Place
    actors: tuple[tuple[str, str, Place], ...]
    """Group, role and place of every actor that has a place."""

    @property
    def box(self) -> tuple[float, float, float, float]:
        """West, south, east and north of all that is drawn, with a margin."""
        places = [self.home, *self.area, *(place for _, _, place in self.actors)]
        places += [place for _, corners in (*self.parts, *self.no_fly) for place in corners]
        places += [place for road in self.roads for place in road]
        east, north = [place[0] for place in places], [place[1] for place in places]
        margin = MARGIN * max(max(east) - min(east), max(north) - min(north), 1.0)
        return min(east) - margin, min(north) - margin, max(east) + margin, max(north) + margin


def situation_map(simspec: SimSpec) -> SituationMap:
    """The drawing of a SimSpec. Without a realization only what has coordinates is on it."""
    roles = {group.id: str(group.role) for group in simspec.actors}
    placed = [(actor.group, (actor.east_m, actor.north_m)) for actor in simspec.realized.actors] if simspec.realized else [
        (group.id, (group.placement.at.east_m, group.placement.at.north_m)) for group in simspec.actors if group.placement.at
    ]  # fmt: skip
    return SituationMap(
        area=tuple((point.east_m, point.north_m) for point in simspec.world.area.corners),
        parts=tuple(
            (area.id, tuple((point.east_m, point.north_m) for point in area.corners))
            for area in simspec.world.areas
        ),
        no_fly=tuple(
            (ground.id, tuple((point.east_m, point.north_m) for point in ground.area.corners))
            for ground in simspec.rules.no_fly
        ),
        roads=tuple(
            tuple((point.east_m, point.north_m) for point in road.points) for road in simspec.world.roads
        ),
        home=(simspec.vehicle.home.east_m, simspec.vehicle.home.north_m),
        actors=tuple((group, roles.get(group, ""), place) for group, place in placed),
    )


def situation_text(drawing: SituationMap, columns: int = TEXT_COLUMNS) -> Iterator[str]:
    """North is up. A letter stands for each group; the legend names them."""
    west, south, east, north = drawing.box
    metres = (east - west) / columns
    rows = max(1, round((north - south) / metres / CHARACTER_ASPECT))

    def cell(place: Place) -> tuple[int, int]:
        across = min(columns - 1, int((place[0] - west) / metres))
        return min(rows - 1, int((north - place[1]) / (metres * CHARACTER_ASPECT))), across

    grid = [[" "] * columns for _ in range(rows)]
    for row in range(rows):
        for column in range(columns):
            middle = (west + (column + 0.5) * metres, north - (row + 0.5) * metres * CHARACTER_ASPECT)
            if any(is_inside(middle, corners) for _, corners in drawing.no_fly):
                grid[row][column] = "x"
            elif is_inside(middle, drawing.area):
                grid[row][column] = "."
    for road in drawing.roads:
        for place in _along(road, metres):
            row, column = cell(place)
            grid[row][column] = "="
    letters = _letters(dict.fromkeys(group for group, _, _ in drawing.actors))
    for group, _, place in drawing.actors:
        row, column = cell(place)
        grid[row][column] = letters[group]
    row, column = cell(drawing.home)
    grid[row][column] = "@"
    yield from ("".join(line).rstrip() for line in grid)
    legend = [f"{letter} {group}" for group, letter in letters.items()]
    marks = [
        "@ home",
        *legend,
        *(["= road"] if drawing.roads else []),
        *(["x no-fly"] if drawing.no_fly else []),
    ]
    yield f"{', '.join(marks)}; one column is {metres:.3g} m, north is up"


def situation_svg(drawing: SituationMap) -> str:
    """The same as SVG, with the names of groups and areas as tooltips."""
    from jinja2 import Environment, PackageLoader

    from bench.visible_text import visible_values

    west, south, east, north = drawing.box
    scale = SVG_WIDTH / (east - west)

    def point(place: Place) -> str:
        return f"{(place[0] - west) * scale:.1f},{(north - place[1]) * scale:.1f}"

    loader = PackageLoader("bench.cli", "templates")
    environment = Environment(loader=loader, autoescape=True, finalize=visible_values)
    return environment.get_template("situation.svg").render(
        drawing=drawing,
        point=point,
        points=lambda places: " ".join(map(point, places)),
        colours=ROLE_COLOURS,
        width=SVG_WIDTH,
        height=f"{(north - south) * scale:.1f}",
        groups=dict.fromkeys((group, role) for group, role, _ in drawing.actors),
    )


def _letters(groups: dict[str, None]) -> dict[str, str]:
    """A letter for each group: the first of its name that is free."""
    letters: dict[str, str] = {}
    for group in groups:
        candidates = [letter.upper() for letter in group if letter.isalpha()] + list(
            "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
        )
        letters[group] = next((letter for letter in candidates if letter not in letters.values()), "?")
    return letters


def _along(road: Sequence[Place], step_m: float) -> Iterator[Place]:
    for (x1, y1), (x2, y2) in itertools.pairwise(road):
        steps = max(1, math.ceil(math.hypot(x2 - x1, y2 - y1) / step_m))
        for step in range(steps + 1):
            yield x1 + (x2 - x1) * step / steps, y1 + (y2 - y1) * step / steps
