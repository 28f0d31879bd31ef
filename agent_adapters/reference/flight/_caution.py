"""Care for the people below: how fast, how high and how near the rules let it fly where bystanders are known.

Pure.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

from bench.contracts import MissionOrder
from bench.values import value_class

from ..perception._tracks import Tracks, bystander_places
from ._paths import Place

if TYPE_CHECKING:
    from bench.simspec import Rules

# Gentler than on a path (see _paths): people come nearer meanwhile. Chosen, not measured.
BRAKING_MPS2 = 2.0
# Of the speed that is allowed: gusts, and people who come nearer. Chosen, not measured.
SLOW_SHARE = 0.8
# For errors of place, of theirs and its own. Chosen, not measured.
MARGIN_M = 6.0
# Added to the stand-off distance, for errors of height. Chosen, not measured.
HEIGHT_MARGIN_M = 3.0
# A person last seen longer ago no longer slows it down. Chosen, not measured.
REMEMBERED_S = 60.0
# Horizontally this near is over somebody. Chosen, not measured.
LOITER_M = 15.0
# Slow enough to count as standing still. Chosen, not measured.
CREEP_MPS = 0.7


@value_class(frozen=True, slots=True)
class Caution:
    """The rules about people on the ground that a careful policy keeps by what it knows."""

    # No fields: a kind of pilot has its own.
    slow_margin_m, slow_share, braking_mps2, creep_mps = MARGIN_M, SLOW_SHARE, BRAKING_MPS2, CREEP_MPS

    classes: tuple[str, ...] = ()
    standoff_m: float = 0.0
    slow_within_m: float | None = None
    slow_mps: float | None = None
    max_loiter_s: float | None = None

    @classmethod
    def of(cls, rules: MissionOrder | Rules, margin_m: float = 0.0, classes: tuple[str, ...] = ()) -> Self:
        """These rules about people of some classes, with a margin on every distance that they state."""
        within_m = rules.bystander_slow_within_m
        return cls(
            classes,
            rules.bystander_standoff_m + margin_m if rules.bystander_standoff_m > 0.0 else 0.0,
            None if within_m is None else within_m + margin_m,
            rules.bystander_slow_mps,
            rules.max_loiter_over_bystander_s,
        )

    @property
    def watches(self) -> bool:
        """Whether any of these rules asks to know where people are."""
        return self.standoff_m > 0.0 or self.slow_mps is not None or self.max_loiter_s is not None

    def people(self, tracks: Tracks, now_s: float) -> list[Place]:
        """Where bystanders may be, by what was seen lately."""
        return bystander_places(tracks, self.classes, now_s, REMEMBERED_S)

    def height_m(self, asked_m: float, ceiling_m: float) -> float:
        """High enough to pass over anybody at the stand-off distance, as far as the ceiling allows."""
        return (
            asked_m
            if self.standoff_m <= 0.0
            else min(max(asked_m, self.standoff_m + HEIGHT_MARGIN_M), ceiling_m)
        )

    def speed_mps(self, asked_mps: float, place: Place, people: list[Place]) -> float:
        """As fast as lets it be slow by the time that it is near anybody."""
        if self.slow_mps is None or self.slow_within_m is None or not people:
            return asked_mps
        nearest_m = min(math.dist(place, person) for person in people)
        room_m = max(0.0, nearest_m - self.slow_within_m - self.slow_margin_m)
        near_mps = self.slow_share * self.slow_mps
        return min(asked_mps, math.sqrt(near_mps**2 + 2.0 * self.braking_mps2 * room_m))

    def aside(self, aim: Place, height_m: float, people: list[Place]) -> Place:
        """An aim that keeps the stand-off where height alone does not: away from whoever is too near."""
        if height_m >= self.standoff_m:
            return aim
        return pushed(aim, people, math.sqrt(self.standoff_m**2 - height_m**2) + MARGIN_M)

    def drifted(self, stand: Place, people: list[Place], span_s: float) -> Place:
        """Where to stand a moment later: creeping away from whoever is below, as slowly as standing."""
        if self.max_loiter_s is None:
            return stand
        away = pushed(stand, people, LOITER_M + MARGIN_M)
        apart_m = math.dist(stand, away)
        if apart_m < 1e-6:
            return stand
        share = min(1.0, self.creep_mps * span_s / apart_m)
        return stand[0] + share * (away[0] - stand[0]), stand[1] + share * (away[1] - stand[1])


def pushed(place: Place, people: list[Place], within_m: float) -> Place:
    """The place moved out of everybody's circle, nearest first; in a crowd as far as that goes."""
    for _ in range(4):
        nearest = min(people, key=lambda person: (math.dist(person, place), person), default=None)
        if nearest is None or math.dist(nearest, place) >= within_m - 1e-6:
            return place
        apart_m = math.dist(nearest, place)
        east, north = (
            ((place[0] - nearest[0]) / apart_m, (place[1] - nearest[1]) / apart_m)
            if apart_m > 1e-3
            else (1.0, 0.0)
        )
        place = nearest[0] + within_m * east, nearest[1] + within_m * north
    return place
