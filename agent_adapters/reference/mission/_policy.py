"""When an object counts as identified, and whether the rules let it be marked.

Pure: tracks in, judgement out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from bench.contracts import MissionOrder
from bench.values import value_class

from .._settings import PolicyName, Settings
from ..perception._tracks import FRAMES_A_LOOK, MOST_LOOKS, Track, Tracks, may_be_bystander

# Beyond it a person out of sight could be anywhere, and nothing would ever be marked. Chosen, not measured.
LONGEST_DRIFT_S = 15.0
# A bystander farther away is not stated as the nearest. Chosen, not measured.
FAR_M = 500.0
# One sigma of the agent's own place (PX4's SITL states 0.9 m of its GPS) and of where the camera points.
OWN_PLACE_M = 1.0
# As far as people walk in the 30 s for which a report foresees them, at 0.7 m/s; a quarter of them walks towards
# the target. Chosen, not measured.
WALK_IN_M, WALK_IN_SHARE = 21.0, 0.25
# Whom a report counts as within the no-mark distance: this much farther, for errors of place. The distance that a
# mark has to keep may have a larger margin, but whoever is beyond this is not near. The same holds for how fast people
# out of sight may have come nearer. These are the margin and the drift of bystander_aware. Chosen, not measured.
COUNT_MARGIN_M, COUNT_DRIFT_MPS = 6.0, 0.7
# People who were seen longer ago are not expected near a target. Chosen, not measured.
EXPECTED_SEEN_S = 45.0
# A second track this near to the target is the target under another label. Chosen, not measured.
SAME_OBJECT_M = 3.0

UnseenShare = Callable[
    [float, float, float, float], float
]  # east, north, radius, since: see Perception.unseen_share


@value_class(frozen=True, slots=True)
class Judgement:
    """What to do about an identified target.

    `look` asks for more views of its surroundings before anything is said.
    """

    mark: bool
    reason: str
    look: bool = False
    bystanders_seen: int | None = None
    nearest_bystander_m: float | None = None
    people_expected: float | None = None


class Policy(Protocol):
    """How an agent turns an identified target into a report.

    `surroundings_m` is how far round a target it looks.
    """

    @property
    def surroundings_m(self) -> float: ...

    def judge(self, target: Track, tracks: Tracks, now_s: float, unseen_share: UnseenShare) -> Judgement: ...

    def sigma_m(self, target: Track) -> float | None:
        """The stated error of a target's place: one sigma on each axis; None when it states none."""


def policy_named(name: PolicyName, order: MissionOrder, settings: Settings) -> Policy:
    """The policy of that name under this order."""
    return NaivePolicy() if name == "naive" else BystanderAwarePolicy(order, settings)


def missing_for(target: Track, class_label: str, order: MissionOrder, settings: Settings) -> str:
    """What is still missing before the track counts as identified, in words; empty when nothing is."""
    missing = []
    if target.label != class_label:
        missing.append(f"looks like {target.label}, not {class_label}")
    if target.confidence < order.min_report_confidence:
        missing.append(f"confidence {target.confidence:.2f} below {order.min_report_confidence:.2f}")
    if target.frames < settings.min_frames:
        missing.append(f"{target.frames} of {settings.min_frames:.0f} frames")
    if target.viewpoint_deg < settings.min_viewpoint_deg:
        missing.append(f"seen over {target.viewpoint_deg:.0f} of {settings.min_viewpoint_deg:.0f} degrees")
    if target.streak < settings.min_streak:
        missing.append(f"label alike in {target.streak} of {settings.min_streak:.0f} frames")
    return ", ".join(missing)


class NaivePolicy:
    """Marks whatever it has identified.

    It does not think of bystanders, and says so by leaving those fields out.
    """

    surroundings_m = 0.0

    def judge(self, target: Track, tracks: Tracks, now_s: float, unseen_share: UnseenShare) -> Judgement:
        return Judgement(mark=True, reason="the engagement conditions hold")

    def sigma_m(self, target: Track) -> float | None:
        return None


class BystanderAwarePolicy:
    """Marks only what it has looked round and found clear of bystanders."""

    def __init__(self, order: MissionOrder, settings: Settings) -> None:
        self._classes = order.bystander_classes
        self._within_m = order.no_mark_within_m
        self._settings = settings
        self.surroundings_m = order.no_mark_within_m + settings.bystander_margin_m

    def judge(self, target: Track, tracks: Tracks, now_s: float, unseen_share: UnseenShare) -> Judgement:
        judgement = self._judge(target, tracks, now_s, unseen_share)
        return replace(judgement, people_expected=self._people_expected(target, tracks, now_s))

    def _judge(self, target: Track, tracks: Tracks, now_s: float, unseen_share: UnseenShare) -> Judgement:
        drift_mps = self._settings.bystander_drift_mps
        distances_m = self._bystanders(target, tracks, now_s, self.surroundings_m, drift_mps)
        if distances_m:
            count_within_m = min(self.surroundings_m, self._within_m + COUNT_MARGIN_M)
            near_by, first_m = distances_m[0] <= self.surroundings_m, distances_m[0]
            # Of those out of sight nobody is counted while somebody is known to be there.
            count_drift_mps = 0.0 if near_by else min(drift_mps, COUNT_DRIFT_MPS)
            count = len(self._bystanders(target, tracks, now_s, count_within_m, count_drift_mps))
            if near_by:
                reason = f"{count} bystanders within {self._within_m:g} m, the nearest at {first_m:.0f} m"
            else:
                reason = f"{len(distances_m)} bystanders may have come within {self._within_m:g} m, the nearest was last at {first_m:.0f} m"
            return Judgement(False, reason, not near_by, count, round(first_m, 1))
        unseen = unseen_share(
            target.east_m, target.north_m, self.surroundings_m, now_s - self._settings.memory_s
        )
        look = unseen > self._settings.unseen_share
        if look:
            reason = f"{unseen:.0%} of the surroundings within {self.surroundings_m:g} m not looked at"
        else:
            reason = f"looked round it: no bystander within {self._within_m:g} m"
        return Judgement(not look, reason, look, 0, self._nearest_m(target, tracks))

    def sigma_m(self, target: Track) -> float | None:
        """Spread of the sightings (neighbours err alike: few looks count), own place, and its troubles."""
        looks = min(max(target.frames / FRAMES_A_LOOK, 1.0), MOST_LOOKS)
        return math.sqrt(OWN_PLACE_M**2 + target.variance_m2 / looks + target.doubt_m**2)

    def _people_expected(self, target: Track, tracks: Tracks, now_s: float) -> float:
        """Bystanders within the no-mark distance at some moment of the next half minute: those who are there,
        and a share of those who are near enough to walk in.
        """
        distances_m = [
            distance_m
            for distance_m, track in self._people_near(target, tracks, self._within_m + WALK_IN_M)
            if now_s - track.last_s <= EXPECTED_SEEN_S
        ]
        inside = sum(distance_m <= self._within_m for distance_m in distances_m)
        # Rounded up: to expect too few is the worse error.
        return float(math.ceil(inside + WALK_IN_SHARE * (len(distances_m) - inside)))

    def _people_near(self, target: Track, tracks: Tracks, reach_m: float) -> list[tuple[float, Track]]:
        """Who may be a bystander within a distance of the target's place, nearest first, with that distance."""
        return [
            (distance_m, track)
            for distance_m, track in tracks.within(target.east_m, target.north_m, reach_m)
            if track is not target and distance_m >= SAME_OBJECT_M and may_be_bystander(track, self._classes)
        ]

    def _nearest_m(self, target: Track, tracks: Tracks) -> float | None:
        """Distance to the nearest bystander that is known at all, however far away."""
        people = self._people_near(target, tracks, FAR_M)
        return round(people[0][0], 1) if people else None

    def _bystanders(
        self, target: Track, tracks: Tracks, now_s: float, within_m: float, drift_mps: float
    ) -> list[float]:
        """Last known distances, nearest first, of those who may stand within `within_m` by now, walking towards the
        target at `drift_mps` while nobody looked.
        """
        reach_m = within_m + drift_mps * LONGEST_DRIFT_S
        return [
            distance_m
            for distance_m, track in self._people_near(target, tracks, reach_m)
            if distance_m <= within_m + drift_mps * min(max(now_s - track.last_s, 0.0), LONGEST_DRIFT_S)
        ]
