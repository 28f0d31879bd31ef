"""The judge against a reference written from docs/placement.md: random places, two of everything.

Two eyes to be hidden from, two areas, two roads, two walls, two routes, and two groups related to the same
third. Places are drawn without regard to relations, so about half of these are broken, and both judges must
name the same ones.
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

# What the judge says, in the order in which the texts are tried, by relation.
KINDS = {
    "m apart": "separation",
    "stand closer than spread_m": "spread",
    "is not inside": "inside",
    "is not between": "between",
    "is not near": "near",
    "does not keep away": "away",
    "does not keep its distance": "distances",
    "road": "along",
    "stands at": "bearing",
    "off what it faces": "facing",
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
        self.separation = {
            actor.id: simspec.group(actor.group).placement.separation_m for actor in simspec.realized.actors
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

    def distance(self, first: str, second: str) -> float:
        return math.dist(self.spot(first), self.spot(second))

    def distances(self, actor: str, group: str) -> list[float]:
        return [self.distance(actor, other) for other in self.groups[group]]

    def bearing(self, start: str, end: str) -> float:
        (x, y), (u, v) = self.spot(start), self.spot(end)
        return math.degrees(math.atan2(u - x, v - y)) % 360.0

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

    def broken(self) -> Broken:
        return {
            *self.broken_pairs(),
            *(
                (actor, kind)
                for actor in self.groups["first"]
                for kind, holds in self.first(actor).items()
                if not holds
            ),
            *(
                (actor, kind)
                for actor in self.groups["second"]
                for kind, holds in self.second(actor).items()
                if not holds
            ),
            *(
                (actor, kind)
                for actor in self.groups["third"]
                for kind, holds in self.third(actor).items()
                if not holds
            ),
            *self.broken_routes(),
        }

    def broken_pairs(self) -> Broken:
        broken: Broken = set()
        for first, second in itertools.combinations(self.actors, 2):
            gap = shapely.distance(self.rectangle(first), self.rectangle(second))
            if gap < max(self.separation[first], self.separation[second]) or gap == 0.0:
                broken.add((f"{first} and {second}", "separation"))
        for first, second in itertools.combinations(self.groups["first"], 2):
            if self.distance(first, second) < 20.0:
                broken.add((f"{first} and {second}", "spread"))
        return broken

    def first(self, actor: str) -> dict[str, bool]:
        half_m = ROADS["long"][2] / 2
        x, y = shapely.get_coordinates(self.rectangle(actor)).T
        return {
            "inside": shapely.box(*AREAS["west"]).covers(self.rectangle(actor)),
            "near": any(5.0 <= distance <= 35.0 for distance in self.distances(actor, "posts")),
            "hidden_from": not any(self.is_seen_from(eye, actor) for eye in self.groups["eyes"]),
            "along": bool((abs(y - 40.0) <= half_m).all() and x.min() >= 0.0 and x.max() <= 80.0),
        }

    def second(self, actor: str) -> dict[str, bool]:
        # The slanted road runs at 45 degrees through the origin, and no footprint lies beyond its ends by as
        # much as its gap.
        aside = abs(shapely.get_coordinates(self.rectangle(actor)) @ np.array([1.0, -1.0]) / math.sqrt(2.0))
        gap = aside.min() - ROADS["slanted"][2] / 2
        return {
            "inside": shapely.box(*AREAS["south"]).covers(self.rectangle(actor)),
            "away": all(15.0 <= distance <= 70.0 for distance in self.distances(actor, "posts")),
            "visible_from": any(self.is_seen_from(eye, actor) for eye in self.groups["eyes"]),
            "along": bool(2.0 <= gap <= 25.0),
        }

    def third(self, actor: str) -> dict[str, bool]:
        start, end, spot = (np.array(self.spot(name)) for name in ("eyes-1", "eyes-2", actor))
        forward = (end - start) / np.linalg.norm(end - start)
        along, aside = (spot - start) @ forward, (spot - start) @ np.array([forward[1], -forward[0]])
        turn = (self.actors[actor].heading_deg - self.bearing(actor, "posts-1") + 180.0) % 360.0 - 180.0
        seen_at = self.bearing("posts-1", actor)
        distances = self.distances(actor, "posts")
        return {
            "between": bool(0.0 < along < np.linalg.norm(end - start) and abs(aside) <= 15.0),
            "bearing": seen_at >= 300.0 or seen_at <= 100.0,
            "facing": abs(turn) <= 80.0,
            "distances": all(10.0 <= d <= 60.0 for d in distances) and any(d <= 30.0 for d in distances),
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
        kind = next((kind for text, kind in KINDS.items() if text in fault.what), fault.what)
        subject = fault.where.removeprefix("realized: ")
        broken.add((f"{subject} {fault.what.split(chr(39))[1]}" if kind == "route" else subject, kind))
    return broken


@pytest.mark.parametrize("block", range(4))
def test_judge_agrees_with_brute_force(block: int) -> None:
    """Over 100 random scenes both name the same broken relations of the same actors."""
    for seed in range(25 * block, 25 * block + 25):
        simspec = random_scene(seed)
        outside = {(subject, kind) for subject, kind in judged(simspec) if "region" in kind}
        assert judged(simspec) - outside == Reference(simspec).broken(), f"seed {seed}"


def test_every_relation_is_kept_and_broken() -> None:
    """The random scenes decide each relation both ways, so agreement means something."""
    scenes = [Reference(random_scene(seed)) for seed in range(50)]
    verdicts = [
        (kind, holds)
        for reference in scenes
        for judge, group in (
            (reference.first, "first"),
            (reference.second, "second"),
            (reference.third, "third"),
        )
        for actor in reference.groups[group]
        for kind, holds in judge(actor).items()
    ]
    both = {kind for kind, holds in verdicts if holds} & {kind for kind, holds in verdicts if not holds}

    assert both == {kind for kind, _ in verdicts}
    assert {kind for reference in scenes for _, kind in reference.broken()} == set(KINDS.values())
