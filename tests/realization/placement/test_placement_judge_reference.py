"""The judge's lines of sight and ways against a reference written from docs/placement.md: random places, two of everything.

Two eyes to be hidden from, two walls, two routes. Places are drawn without regard to relations, so about half of these are
broken, and both judges must name the same ones. All other relations: test_placement_constructed_scenes.py.
"""

from __future__ import annotations

import itertools
import math
import random
from typing import Any

import numpy as np
import pytest
import shapely
import yards
from yards import YARDS, corners, points, written

from bench.documents import validate_document
from bench.realization import check_placement
from bench.simspec import ASSETS, SimSpec

Broken = set[tuple[str, str]]

# What the judge says, by relation.
KINDS = {
    "must be hidden": "hidden_from",
    "must be visible": "visible_from",
    "blocks the patrol route": "route",
    "no straight way": "way",
}


# Sized so that each relation of `two of everything` holds for some random places and fails for others.
AREAS = {"west": (0.0, 0.0, 40.0, 80.0), "south": (0.0, 0.0, 80.0, 45.0)}
ROADS = {"long": ((0.0, 40.0), (80.0, 40.0), 30.0), "slanted": ((0.0, 0.0), (80.0, 80.0), 24.0)}
ROUTES = {"patrol-a": [(10.0, 10.0), (70.0, 10.0)], "patrol-b": [(10.0, 70.0), (40.0, 30.0), (70.0, 70.0)]}
GROUPS: list[dict[str, Any]] = [
    *written(YARDS["two of everything"]),
    *(
        {
            **yards.group(name, "soldier", 2),
            "motion": {"kind": "patrol", "route": points(*route), "speed_mps": 1.0},
        }
        for name, route in ROUTES.items()
    ),
]


def random_scene(seed: int) -> SimSpec:
    draws = random.Random(seed)
    actors = [
        {
            "id": f"{group['id']}-{number}",
            "group": group["id"],
            "east_m": round(draws.uniform(5.0, 75.0), 3),
            "north_m": round(draws.uniform(5.0, 75.0), 3),
            "heading_deg": round(draws.uniform(0.0, 359.0), 3),
        }
        for group in GROUPS
        for number in range(1, group["count"] + 1)
    ]
    document = {
        "name": "two-of-everything",
        "world": {
            "area": corners(0.0, 0.0, 80.0, 80.0),
            "areas": [{"id": name, **corners(*bounds)} for name, bounds in AREAS.items()],
            "roads": [
                {"id": name, "points": points(start, end), "width_m": width}
                for name, (start, end, width) in ROADS.items()
            ],
        },
        "vehicle": {"home": {"east_m": -50.0, "north_m": -50.0, "heading_deg": 0.0}},
        "actors": GROUPS,
        "seeds": {"root": seed},
        "realized": {"actors": actors, "reports": [], "method": "by hand"},
    }
    return validate_document(document, SimSpec)


class Reference:
    """Judges by the sentences of docs/placement.md, one relation after the other."""

    def __init__(self, simspec: SimSpec) -> None:
        assert simspec.realized is not None
        self.actors = {actor.id: actor for actor in simspec.realized.actors}
        self.assets = {
            actor.id: ASSETS[simspec.group(actor.group).asset] for actor in simspec.realized.actors
        }
        self.groups = {
            group["id"]: [a for a in self.actors if a.rpartition("-")[0] == group["id"]] for group in GROUPS
        }

    def rectangle(self, actor: str, margin_m: float = 0.0) -> shapely.Polygon:
        """The footprint, grown along and across."""
        placed, asset = self.actors[actor], self.assets[actor]
        turn = math.radians(placed.heading_deg)
        ahead, right = np.array([math.sin(turn), math.cos(turn)]), np.array([math.cos(turn), -math.sin(turn)])
        long_m, wide_m = asset.length_m / 2 + margin_m, asset.width_m / 2 + margin_m
        middle = np.array(self.spot(actor))
        return shapely.Polygon(
            [
                middle + a * long_m * ahead + b * wide_m * right
                for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
        )

    def spot(self, actor: str) -> tuple[float, float]:
        return self.actors[actor].east_m, self.actors[actor].north_m

    def is_seen_from(self, eye: str, actor: str) -> bool:
        """Whether no point of the line of sight, in steps of some 1 cm, lies in a wall and below its top."""
        share = np.linspace(0.0, 1.0, 10_001)
        x, y = (
            np.array(self.spot(eye))[:, None] + share * (np.array(self.spot(actor)) - self.spot(eye))[:, None]
        ).tolist()
        height = 1.7 + share * (self.assets[actor].height_m - 1.7)
        walls = [
            wall
            for wall in self.groups["walls"]
            if not self.rectangle(wall).covers(shapely.Point(self.spot(eye)))
        ]
        return not any(
            (shapely.contains_xy(self.rectangle(w), x, y) & (height < self.assets[w].height_m)).any()
            for w in walls
        )

    def blocked(self, start: tuple[float, float], end: tuple[float, float], wall: str, walker: str) -> bool:
        grown = self.rectangle(wall, self.assets[walker].width_m / 2)
        wall_ground = self.rectangle(wall) if grown.covers(shapely.Point(start)) else grown
        return bool(shapely.intersects(shapely.LineString([start, end]), wall_ground))

    def hidden(self, actor: str) -> bool:
        return not any(self.is_seen_from(eye, actor) for eye in self.groups["eyes"])

    def broken(self) -> Broken:
        return {
            *((actor, "hidden_from") for actor in self.groups["first"] if not self.hidden(actor)),
            *((actor, "visible_from") for actor in self.groups["second"] if self.hidden(actor)),
            *self.broken_routes(),
        }

    def broken_routes(self) -> Broken:
        broken: Broken = set()
        for group, route in ROUTES.items():
            for walker in self.groups[group]:
                legs = itertools.pairwise([*route, route[0]])
                for (start, end), wall in itertools.product(legs, self.groups["walls"]):
                    if shapely.intersects(
                        shapely.LineString([start, end]),
                        self.rectangle(wall, self.assets[walker].width_m / 2),
                    ):
                        broken.add((f"{wall} {group}", "route"))
                spot = self.spot(walker)
                if all(
                    any(self.blocked(spot, point, wall, walker) for wall in self.groups["walls"])
                    for point in route
                ):
                    broken.add((walker, "way"))
        return broken


def judged(simspec: SimSpec) -> Broken:
    broken: Broken = set()
    for fault in check_placement(simspec):
        if (kind := next((kind for text, kind in KINDS.items() if text in fault.what), None)) is None:
            continue
        subject = fault.where.removeprefix("realized: ")
        broken.add((f"{subject} {fault.what.split(chr(39))[1]}" if kind == "route" else subject, kind))
    return broken


@pytest.mark.parametrize("block", range(4))
def test_judge_agrees_with_brute_force(block: int) -> None:
    """Over 100 random scenes both name the same broken relations of the same actors."""
    for seed in range(25 * block, 25 * block + 25):
        simspec = random_scene(seed)
        assert judged(simspec) == Reference(simspec).broken(), f"seed {seed}"


def test_every_relation_is_kept_and_broken() -> None:
    """The random scenes decide each relation both ways, so agreement means something."""
    scenes = [Reference(random_scene(seed)) for seed in range(50)]
    for group in ("first", "second"):
        assert {reference.hidden(actor) for reference in scenes for actor in reference.groups[group]} == {
            True,
            False,
        }
    assert {kind for reference in scenes for _, kind in reference.broken()} == set(KINDS.values())
    assert any(not reference.broken_routes() for reference in scenes)
