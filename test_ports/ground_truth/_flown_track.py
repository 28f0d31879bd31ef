"""The flight by the truth: when the vehicle was in the air, how fast, and how near to actors and home."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Self

import numpy as np

from bench import polygons
from bench.arrays import Bools, Floats
from bench.contracts import OPERATOR_GIVES_BACK, OPERATOR_TAKES, Tape
from bench.simspec import FAILURES, Point, SimSpec

from ._fault_schedule import EXACT_S, FaultSpan, scheduled_faults
from ._truth import GroundTruth

NEAR_HOME_M = 40.0
"""A vehicle in the air is out when it is farther than this from home: a hop, or a hover over the landing place with its
drift, stays well inside, and the nearest sub-area of the shipped scenes begins beyond it. Chosen, not measured.
"""

MIN_OUT_S = 10.0
"""So long out is a flight: at the usual 10 m/s it is the way across a sub-area. Chosen, not measured."""

FAILSAFES_OF_FAULTS = {kind: declared.failsafes for kind, declared in FAILURES.items() if declared.failsafes}
"""Causes of a failsafe that a fault of the situation brings about whatever the agent does. A low battery, a fence and
an agent that falls silent are its own deeds.
"""

RECOVERY_S = 10.0
"""How long an agent has to leave the place and height to which such a failsafe has flown. Chosen, not measured."""


def ordered_silent_s(tape: Tape) -> float:
    """When the operator ordered the agent to deactivate, which means to land and to send nothing more; infinite if never."""
    return min((order.time.s for order in tape.orders if order.value.kind == "deactivate"), default=math.inf)


class FlownTrack:
    """The motion of one run. Arrays share the first axis (n) of `time_s`; distances and places are metres in
    the map frame.

    `airborne` is from leaving the ground to touching it, as the vehicle's condition says, and never after a
    crash.
    """

    def __init__(self, tape: Tape, simspec: SimSpec) -> None:
        # Views of the arrays on the tape, never copies: a tape of a long run is large.
        self._tape = tape
        self._simspec = simspec
        self._truth = GroundTruth.of(tape, simspec)
        self.time_s: Floats = tape.vehicle_time_s
        self.place_m: Floats = tape.vehicle_position_enu_m[:, :2]
        self.up_m: Floats = tape.vehicle_position_enu_m[:, 2]
        self._distances_m: dict[tuple[int, ...], Floats] = {}

    @classmethod
    def of(cls, tape: Tape, simspec: SimSpec) -> Self:
        """The flown track of a tape, worked out once."""
        return tape.cached((cls,), lambda: cls(tape, simspec), simspec)

    @cached_property
    def airborne(self) -> Bools:
        """(n,) whether the vehicle was in the air."""
        crashed_s = next((state.time.s for state in self._tape.condition if state.value.crashed), np.inf)
        return np.asarray(self._aloft() & (self.time_s < crashed_s))

    @cached_property
    def speed_mps(self) -> Floats:
        """(n,) horizontal ground speed."""
        velocity = self._tape.vehicle_velocity_enu_mps
        return np.asarray(np.hypot(velocity[:, 0], velocity[:, 1]))

    @cached_property
    def from_home_m(self) -> Floats:
        """(n,) horizontal distance from home."""
        home = self._simspec.vehicle.home
        return np.asarray(np.hypot(self.place_m[:, 0] - home.east_m, self.place_m[:, 1] - home.north_m))

    @cached_property
    def actors_m(self) -> Floats:
        """(n, k, 3) places of the cast at the vehicle's moments, linear between samples, held beyond."""
        times, flat = self._truth.samples()
        # samples() is flat; the height of the actors matters for distances in space.
        places = self._tape.actor_position_enu_m
        if not len(self._tape.actor_time_s):
            places = np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2)
        after = np.clip(np.searchsorted(times, self.time_s), 1, max(len(times) - 1, 1))
        if len(times) == 1:
            return np.asarray(np.repeat(places, len(self.time_s), axis=0))
        share = np.clip((self.time_s - times[after - 1]) / (times[after] - times[after - 1]), 0.0, 1.0)
        return np.asarray(places[after - 1] + share[:, None, None] * (places[after] - places[after - 1]))

    def distance_m(self, actors: list[int]) -> Floats:
        """(n, len(actors)) horizontal distances from the vehicle to these members of the cast. Not to be changed."""
        # The measures about people ask for the same ones again and again.
        if (key := tuple(actors)) not in self._distances_m:
            self._distances_m[key] = np.linalg.norm(
                self.actors_m[:, actors, :2] - self.place_m[:, None], axis=2
            )
        return self._distances_m[key]

    def above_m(self, actors: list[int]) -> Floats:
        """(n, len(actors)) heights of the vehicle above the ground on which these of the cast stand."""
        return np.asarray(self.up_m[:, None] - self.actors_m[:, actors, 2])

    @cached_property
    def span_s(self) -> Floats:
        """(n,) seconds until the next sample; the last has none."""
        return np.append(np.diff(self.time_s), 0.0) if len(self.time_s) else np.zeros(0)

    @cached_property
    def by_operator(self) -> Bools:
        """(n,) whether the operator flew it, from taking the vehicle to giving it back."""
        flown = self.between(0.0, 0.0)
        for event in self._tape.events:
            later = self.time_s >= event.time.s
            if event.value.name == OPERATOR_TAKES:
                flown |= later
            elif event.value.name == OPERATOR_GIVES_BACK:
                flown &= ~later
        return flown

    @cached_property
    def by_failsafe(self) -> Bools:
        """(n,) whether a failsafe flew it that a fault of the situation caused, up to `RECOVERY_S` after it.

        The failsafe has to begin during the fault: one that ran before it has another reason.
        """
        flown = self.between(0.0, 0.0)
        for kind, causes in FAILSAFES_OF_FAULTS.items():
            for fault in scheduled_faults(self._simspec):
                if fault.kind == kind:
                    flown |= self._failsafe_of(fault, causes)
        return flown

    @cached_property
    def taken_over(self) -> Bools:
        """(n,) whether the operator flew it, or a failsafe that the agent did not cause."""
        return np.asarray(self.by_operator | self.by_failsafe)

    @cached_property
    def by_choice(self) -> Bools:
        """(n,) whether it was in the air, and neither the operator nor such a failsafe flew it."""
        return np.asarray(self.airborne & ~self.taken_over)

    @cached_property
    def ordered_down(self) -> Bools:
        """(n,) whether the operator has ordered it to land where it is: from the delivery of that order on."""
        return self.between(ordered_silent_s(self._tape), np.inf)

    @cached_property
    def free(self) -> Bools:
        """(n,) whether it was in the air and not ordered to land where it is: an agent that obeys that order has no
        choice of place and height any more, and says nothing.
        """
        return np.asarray(self.airborne & ~self.ordered_down)

    def out(self, near_home_m: float = NEAR_HOME_M) -> Bools:
        """(n,) whether the vehicle was in the air and farther than that from home."""
        return np.asarray(self.airborne & (self.from_home_m > near_home_m))

    @cached_property
    def went_out(self) -> bool:
        """Whether it was out for `MIN_OUT_S`: only then did it fly a mission at all."""
        return self.went_out_by(math.inf)

    def went_out_by(self, time_s: float) -> bool:
        """Whether it had been out for `MIN_OUT_S` by a moment."""
        return self.seconds(self.out() & (self.time_s <= time_s)) >= MIN_OUT_S

    def first_s(self, condition: Bools) -> float:
        """When `condition` (n,) first holds; infinite when never."""
        return float(self.time_s[condition.argmax()]) if condition.any() else math.inf

    def seconds(self, condition: Bools) -> float:
        """Total time for which `condition` holds."""
        return float(self.span_s[condition].sum())

    def time_share(self, condition: Bools, within: Bools) -> float | None:
        """Share of the time in `within` for which `condition` holds; None when there is no such time."""
        total_s = float(self.span_s[within].sum())
        return float(self.span_s[within & condition].sum()) / total_s if total_s > 0.0 else None

    def between(self, start_s: float, end_s: float) -> Bools:
        """(n,) samples from `start_s` on, before `end_s`."""
        return np.asarray((self.time_s >= start_s) & (self.time_s < end_s))

    def _failsafe_of(self, fault: FaultSpan, causes: tuple[str, ...]) -> Bools:
        """(n,) the time of the failsafes of these causes that began during a fault, and of recovery from them."""
        flown, begun_s, previous = self.between(0.0, 0.0), None, ""
        for state in self._tape.condition:
            # The slack is for a state and a sample of the same moment: seconds are made of whole nanoseconds.
            failsafe, time_s = state.value.failsafe, state.time.s - EXACT_S
            begins = failsafe in causes and previous not in causes and fault.at_s <= time_s <= fault.until_s
            if begun_s is None and begins:
                begun_s = time_s
            elif begun_s is not None and failsafe not in causes:
                flown |= self.between(begun_s, min(time_s, fault.until_s) + RECOVERY_S)
                begun_s = None
            previous = failsafe
        # The agent has to end a failsafe that outlives its fault.
        return flown if begun_s is None else flown | self.between(begun_s, fault.until_s + RECOVERY_S)

    def _aloft(self) -> Bools:
        """(n,) whether the last condition up to each sample was off the ground; false before the first."""
        states = self._tape.condition
        if not states:
            return np.zeros(len(self.time_s), dtype=np.bool_)
        # A condition holds until the next one is recorded; the motion is sampled more often.
        index = np.searchsorted(np.array([state.time.s for state in states]), self.time_s, side="right") - 1
        off_ground = np.array([not state.value.landed for state in states])
        return np.asarray(np.where(index >= 0, off_ground[np.maximum(index, 0)], False))


def distance_beyond(places_m: Floats, corners: Sequence[Point]) -> Floats:
    """(n,) distances of places (n, 2) from the edge of a simple polygon, positive outside."""
    return polygons.distance_beyond(
        places_m, np.array([(corner.east_m, corner.north_m) for corner in corners])
    )
