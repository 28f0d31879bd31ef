"""When it can start and land at home, and which way, with nobody near."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import repeat

import numpy as np

from bench.arrays import Floats
from bench.values import value_class

from ..reference.flight._paths import Place, ring
from ._perception import Truth

STEP_S = 0.5
# What the measures ask for while it is low: nobody so near. Then a margin for its own error of place. Chosen.
LOW_M, NEAR_M, MARGIN_M = 40.0, 10.0, 0.5
# Where there is a choice: for a start or a landing that is a second early or late. Chosen, not measured.
WIDE_MARGIN_M = 2.0
# Seconds after the lift-off, and metres up and away at each, as flights of campaign full show them.
CLIMB_S = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 8.0])
CLIMB_UP_M = np.array([0.0, 0.3, 1.4, 3.2, 5.8, 8.6, 11.5, 17.4, 29.3, 41.0])
CLIMB_AWAY_M = np.array([0.0, 0.3, 1.4, 3.3, 5.8, 8.1, 9.9, 12.5, 14.5, 15.0])
# Seconds before the autopilot says that it has landed, some 0.9 s after the touch, and metres up: the speeds of a landing
# that the pilot sets, with the stop before it.
DESCENT_S = np.array([0.0, 0.9, 1.9, 2.8, 3.8, 6.8, 7.8, 16.2])
DESCENT_UP_M = np.array([0.0, 0.0, 0.7, 2.1, 4.2, 13.0, 15.7, 41.0])
# Over home before that, at any height: a stay near somebody there is a stay over them.
OVER_HOME_S, STAY_M, LONGEST_STAY_S = 24.0, 16.0, 12.0
# How far from home it climbs away, and how far it touches down at most: the measures allow 3 m.
START_AWAY_M, BESIDE_M = 15.0, (1.0, 2.0)
DIRECTIONS = 12


@value_class(frozen=True, slots=True)
class Passage:
    """A start or a landing: when it leaves or touches the ground, and the place that it climbs or sinks to."""

    at_s: float
    place: Place
    near_s: float
    """For how long somebody is within 10 m of it while it is low."""
    breach_s: float
    """For how long somebody is nearer than the stand-off."""
    close_s: float
    """For how long somebody is nearer than the stand-off with a wide margin."""
    over_s: float
    """By how much a stay near one person is too long."""


@dataclass(frozen=True)
class Clearance:
    """Home, the rule about distance from people, and where these people will be."""

    truth: Truth
    home: Place
    standoff_m: float

    def start(self, from_s: float, until_s: float) -> Passage:
        """The clearest start in a span, and of equally clear ones the first."""
        spans_s = np.arange(0.0, CLIMB_S[-1] + STEP_S, STEP_S)
        away_m, up_m = np.interp(spans_s, CLIMB_S, CLIMB_AWAY_M), np.interp(spans_s, CLIMB_S, CLIMB_UP_M)
        goals, home = self._round((START_AWAY_M,)), np.array(self.home)
        paths = [home + (away_m / START_AWAY_M)[:, None] * (np.array(goal) - home) for goal in goals]
        return self._clearest(goals, paths, spans_s, up_m, (from_s, until_s), self.standoff_m)

    def landing(self, from_s: float, until_s: float) -> Passage:
        """The clearest landing whose touchdown lies in a span, and of equally clear ones the first."""
        spans_s = -np.arange(0.0, OVER_HOME_S, STEP_S)
        up_m = np.where(-spans_s > DESCENT_S[-1], np.inf, np.interp(-spans_s, DESCENT_S, DESCENT_UP_M))
        goals = [self.home, *self._round(BESIDE_M)]
        paths = [np.repeat([goal], len(spans_s), axis=0) for goal in goals]
        standoff_m = 0.0 if self._is_never_clear else self.standoff_m
        return self._clearest(goals, paths, spans_s, up_m, (from_s, until_s), standoff_m)

    @cached_property
    def _is_never_clear(self) -> bool:
        """Whether somebody is always nearer to home than the stand-off: no landing there is better than another."""
        moments_s = np.arange(0.0, self.truth.simspec.mission.time_limit_s, STEP_S).tolist()
        people = (self.truth.people_m(at_s) - np.array(self.home) for at_s in moments_s)
        return all(np.linalg.norm(each, axis=1).min(initial=np.inf) < self.standoff_m for each in people)

    def _round(self, radii_m: tuple[float, ...]) -> list[Place]:
        return [place for radius_m in radii_m for place in ring(self.home, radius_m, 0.0, DIRECTIONS)[:-1]]

    def landings(self, until_s: float) -> list[float]:
        """The moments, a second apart, at which a touchdown breaks no rule about people."""
        moments_s = np.arange(DESCENT_S[-1], until_s, 1.0).tolist()
        return [
            at_s for at_s in moments_s if (best := self.landing(at_s, at_s)).near_s + best.breach_s == 0.0
        ]

    def _clearest(
        self,
        goals: list[Place],
        paths: list[Floats],
        spans_s: Floats,
        up_m: Floats,
        window_s: tuple[float, float],
        standoff_m: float,
    ) -> Passage:
        """The best of all goals and moments; `paths` hold a place for each of `spans_s` from the moment."""
        passages, (from_s, until_s) = list[Passage](), window_s
        for at_s in np.arange(from_s, max(until_s, from_s) + STEP_S / 2, STEP_S).tolist():
            people = np.array([self.truth.people_m(at_s + span_s) for span_s in spans_s.tolist()])
            each_m = np.linalg.norm(people[None] - np.array(paths)[:, :, None], axis=3)
            stay_s = STEP_S * (each_m <= STAY_M).sum(axis=1).max(axis=1, initial=0)
            apart_m = each_m.min(axis=2, initial=np.inf)
            is_near = (apart_m < NEAR_M + MARGIN_M) & (up_m < LOW_M)
            space_m = np.hypot(apart_m, up_m) - standoff_m
            spans = (
                STEP_S * mask.sum(axis=1) for mask in (is_near, space_m < MARGIN_M, space_m < WIDE_MARGIN_M)
            )
            values = (*spans, np.maximum(stay_s - LONGEST_STAY_S, 0.0))
            passages += map(Passage, repeat(at_s), goals, *(each.tolist() for each in values))
        return min(passages, key=lambda way: (way.near_s, way.breach_s + way.over_s, way.close_s, way.at_s))
