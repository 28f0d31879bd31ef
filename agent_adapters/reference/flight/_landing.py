"""Where to come down among people: when the place is clear, and which place beside it is the clearest."""

from __future__ import annotations

import math

from .._log import Log
from ..perception._perception import ObjectPerception
from ..perception._tracks import bystander_places
from ._paths import Place, ring

# Rotors injure people nearer than 10 m to a landing; more, for errors of place and a few steps. Chosen.
CLEAR_M = 13.0
# Whoever was seen longer ago may have gone, and others may have come. Chosen, not measured.
LOOK_AGE_S = 15.0
# Of the landing place that may have stayed out of view. Chosen, not measured.
UNSEEN_SHARE = 0.5
# Farther from home a landing is none at home: the measures allow 20 m. Chosen, not measured.
BESIDE_M = (5.0, 10.0, 15.0)
DIRECTIONS = 12


def room_m(place: Place, people: list[Place]) -> float:
    """Distance to the nearest person, at most `CLEAR_M`: more is no better."""
    return min([CLEAR_M, *(math.dist(place, person) for person in people)])


def clearest(home: Place, people: list[Place]) -> Place:
    """Home, or the place beside it with the most room; among equals the nearest to home."""
    beside = [place for away_m in BESIDE_M for place in ring(home, away_m, 0.0, DIRECTIONS)[:-1]]
    return min([home, *beside], key=lambda place: (-room_m(place, people), math.dist(home, place), place))


class LandingPlace:
    """Comes down with the landing place in view, waits for people there to go, and else lands beside them."""

    def __init__(
        self, home: Place, classes: tuple[str, ...], eyes: ObjectPerception, log: Log, wait_s: float
    ) -> None:
        self.goal = home
        self._home = home
        self._classes = classes
        self._eyes = eyes
        self._log = log
        self._left_s = wait_s
        self._since_s: float | None = None  # of the wait that goes on

    def aim(self, place: Place, height_m: float, *, low: bool, hurry: bool) -> Place:
        """Where to be next on the way to `goal`, which may change. `low`: it need not come down farther before
        it lands; `hurry`: there is no time to wait.
        """
        now_s = self._log.now_s
        if not low:
            return self.goal if hurry else self._lookout(place, height_m)
        people = bystander_places(self._eyes.tracks, self._classes, now_s, LOOK_AGE_S)
        crowded = room_m(self.goal, people) < CLEAR_M
        if not crowded and (hurry or self._left_s <= 0.0 or self._seen(now_s)):
            if self._since_s is not None:
                self._since_s = None
                self._log.decide("go_on", "", "nobody is seen at the landing place")
            return self.goal
        if hurry or self._left_s <= 0.0:
            self._land_beside(people)
            return self.goal
        if self._since_s is None:
            what = f"{len(people)} people are near it" if crowded else "it has not been looked at"
            self._log.decide("wait", "", f"the landing place is not known to be clear: {what}")
        else:
            self._left_s -= now_s - self._since_s
        self._since_s = now_s
        return self._lookout(place, height_m)

    def _seen(self, now_s: float) -> bool:
        # Without a camera that is known there is nothing to wait for.
        return (
            self._eyes.camera is None
            or self._eyes.unseen_share(*self.goal, CLEAR_M, now_s - LOOK_AGE_S) <= UNSEEN_SHARE
        )

    def _land_beside(self, people: list[Place]) -> None:
        goal = clearest(self._home, people)
        if room_m(goal, people) > room_m(self.goal, people) + 1.0:
            self.goal = goal
            away_m = math.dist(goal, self._home)
            self._log.decide(
                "land_beside", "", f"people stay at the landing place: it comes down {away_m:.0f} m off"
            )

    def _lookout(self, place: Place, height_m: float) -> Place:
        """Beside the goal, on the side where it is: there the middle of the image shows the goal."""
        camera = self._eyes.camera
        away_m = camera.ahead_m(height_m)[1] if camera else 0.0
        apart_m = math.dist(place, self.goal)
        east, north = (
            ((place[0] - self.goal[0]) / apart_m, (place[1] - self.goal[1]) / apart_m)
            if apart_m > 1.0
            else (0.0, -1.0)
        )
        return self.goal[0] + away_m * east, self.goal[1] + away_m * north
