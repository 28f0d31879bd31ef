"""The judge of sight, roads and patrol routes against a reference written from docs/placement.md: two of everything.

Two eyes to be hidden from, two roads, two walls, two routes. Places are drawn without regard to relations, so
about half of these are broken, and both judges must name the same ones. The other relations:
test_placement_constructed_scenes.py.
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
from yards import YARDS, points, written

from bench.realization import check_placement
from bench.simspec import ASSETS, SimSpec

Broken = set[tuple[str, str]]

# What the judge says, in the order in which the texts are tried, by relation.
KINDS = {
    "m apart": "separation",
    "road": "along",
    "must be hidden": "hidden_from",
    "must be visible": "visible_from",
    "blocks the patrol route": "route",
    "no straight way": "way",
}


# Sized so that each relation of `two of everything` holds for some random places and fails for others.
ROADS: dict[str, Any] = {
    "long": ((0.0, 40.0), (80.0, 40.0), 30.0),
    "slanted": ((0.0, 0.0), (80.0, 80.0), 24.0),
}
ROUTES = {"patrol-a": [(10.0, 10.0), (70.0, 10.0)], "patrol-b": [(10.0, 70.0), (40.0, 30.0), (70.0, 70.0)]}
GROUPS: list[dict[str, Any]] = [
    *written(YARDS["two of everything"]),
    *(
        yards.group(name, "soldier", 2)
        | {"motion": {"kind": "patrol", "route": points(*route), "speed_mps": 1.0}}
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
    roads = [
        {"id": name, "points": points(*ends), "width_m": width} for name, (*ends, width) in ROADS.items()
    ]
    home = {"home": {"east_m": -50.0, "north_m": -50.0}}
    realized = {"actors": actors, "reports": [], "method": "by hand"}
    return yards.scene(*GROUPS, seed=seed, size_m=80.0, roads=roads, vehicle=home, realized=realized)


class Reference:
    """Judges by the sentences of docs/placement.md, one relation after the other."""

    def __init__(self, simspec: SimSpec) -> None:
        assert simspec.realized is not None
        self.actors = {actor.id: actor for actor in simspec.realized.actors}
        group_of = {name: simspec.group(actor.group) for name, actor in self.actors.items()}
        self.assets = {name: ASSETS[group.asset] for name, group in group_of.items()}
        self.separation = {name: group.placement.separation_m for name, group in group_of.items()}
        self.groups = {one.id: [name for name in group_of if group_of[name] is one] for one in simspec.actors}

    def rectangle(self, actor: str, margin_m: float = 0.0) -> shapely.Polygon:
        """The footprint, grown along and across."""
        placed, asset = self.actors[actor], self.assets[actor]
        turn = math.radians(placed.heading_deg)
        ahead, right = np.array([math.sin(turn), math.cos(turn)]), np.array([math.cos(turn), -math.sin(turn)])
        long_m, wide_m = asset.length_m / 2 + margin_m, asset.width_m / 2 + margin_m
        middle = np.array(self.spot(actor))
        signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
        return shapely.Polygon([middle + a * long_m * ahead + b * wide_m * right for a, b in signs])

    def spot(self, actor: str) -> tuple[float, float]:
        return self.actors[actor].east_m, self.actors[actor].north_m

    def is_seen_from(self, eye: str, actor: str) -> bool:
        """Whether no point of the line of sight, in steps of some 1 cm, lies in a wall and below its top."""
        share = np.linspace(0.0, 1.0, 10_001)
        start, end = np.array(self.spot(eye)), np.array(self.spot(actor))
        x, y = (start + share[:, None] * (end - start)).T
        height = 1.7 + share * (self.assets[actor].height_m - 1.7)
        for wall in self.groups["walls"]:
            ground = self.rectangle(wall)
            below = shapely.contains_xy(ground, x, y) & (height < self.assets[wall].height_m)
            if below.any() and not ground.covers(shapely.Point(self.spot(eye))):
                return False
        return True

    def closed(self, start: tuple[float, float], end: tuple[float, float], walker: str) -> bool:
        """Whether a wall lies in the straight way."""
        grounds = []
        for wall in self.groups["walls"]:
            grown = self.rectangle(wall, self.assets[walker].width_m / 2)
            grounds.append(self.rectangle(wall) if grown.covers(shapely.Point(start)) else grown)
        return any(shapely.intersects(shapely.LineString([start, end]), ground) for ground in grounds)

    def verdicts(self) -> dict[tuple[str, str], bool]:
        """Of each actor with relations: whether it keeps each of them."""
        return {
            (actor, kind): holds
            for judge, group in ((self.first, "first"), (self.second, "second"))
            for actor in self.groups[group]
            for kind, holds in judge(actor).items()
        }

    def broken(self) -> Broken:
        unkept = {relation for relation, holds in self.verdicts().items() if not holds}
        return unkept | self.broken_pairs() | self.broken_routes()

    def broken_pairs(self) -> Broken:
        broken: Broken = set()
        for first, second in itertools.combinations(self.actors, 2):
            gap = shapely.distance(self.rectangle(first), self.rectangle(second))
            if gap < max(self.separation[first], self.separation[second]) or gap == 0.0:
                broken.add((f"{first} and {second}", "separation"))
        return broken

    def first(self, actor: str) -> dict[str, bool]:
        half_m = ROADS["long"][2] / 2
        x, y = shapely.get_coordinates(self.rectangle(actor)).T
        return {
            "hidden_from": not any(self.is_seen_from(eye, actor) for eye in self.groups["eyes"]),
            "along": bool((abs(y - 40.0) <= half_m).all() and x.min() >= 0.0 and x.max() <= 80.0),
        }

    def second(self, actor: str) -> dict[str, bool]:
        # The slanted road runs at 45 degrees through the origin, and no footprint lies beyond its ends by as
        # much as its gap.
        aside = abs(shapely.get_coordinates(self.rectangle(actor)) @ np.array([1.0, -1.0]) / math.sqrt(2.0))
        gap = aside.min() - ROADS["slanted"][2] / 2
        return {
            "visible_from": any(self.is_seen_from(eye, actor) for eye in self.groups["eyes"]),
            "along": bool(2.0 <= gap <= 25.0),
        }

    def broken_routes(self) -> Broken:
        broken: Broken = set()
        for group, route in ROUTES.items():
            for walker in self.groups[group]:
                legs = itertools.pairwise([*route, route[0]])
                for leg, wall in itertools.product(legs, self.groups["walls"]):
                    grown = self.rectangle(wall, self.assets[walker].width_m / 2)
                    if shapely.intersects(shapely.LineString(leg), grown):
                        broken.add((f"{wall} {group}", "route"))
                if all(self.closed(self.spot(walker), point, walker) for point in route):
                    broken.add((walker, "way"))
        return broken


def judged(simspec: SimSpec) -> Broken:
    broken: Broken = set()
    for fault in check_placement(simspec):
        kind = next((kind for text, kind in KINDS.items() if text in fault.what), fault.what)
        subject = fault.where.removeprefix("realized: ")
        broken.add((f"{subject} {fault.what.split(chr(39))[1]}" if kind == "route" else subject, kind))
    return broken


@pytest.mark.parametrize("block", range(2))
def test_judge_agrees_with_brute_force(block: int) -> None:
    """Over 50 random scenes both name the same broken relations of the same actors."""
    for seed in range(25 * block, 25 * block + 25):
        simspec = random_scene(seed)
        outside = {(subject, kind) for subject, kind in judged(simspec) if "region" in kind}
        assert judged(simspec) - outside == Reference(simspec).broken(), f"seed {seed}"


def test_every_relation_is_kept_and_broken() -> None:
    """The random scenes decide each relation both ways, so agreement means something."""
    scenes = [Reference(random_scene(seed)) for seed in range(25)]
    verdicts = {(kind, holds) for scene in scenes for (_, kind), holds in scene.verdicts().items()}

    assert verdicts == set(itertools.product(("along", "hidden_from", "visible_from"), (True, False)))
    assert {kind for scene in scenes for _, kind in scene.broken()} == set(KINDS.values())
