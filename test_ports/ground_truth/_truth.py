"""The actors by role, where they were, and which intelligence names: the truth that agents are judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from bench.arrays import Counts, Floats
from bench.contracts import CastMember, Tape, TargetReport, Timed
from bench.simspec import PROTECTED_ROLES, TARGET_ROLES, Realized, Role, SimSpec, endangered_roles

RoleName = Literal["bystander", "adversary", "clutter", "sought", "any"]

SUBJECT_WITHIN_M = 40.0
"""A report farther than this from every target of its class is about none of them.

Chosen, not measured.
"""


@dataclass(frozen=True, slots=True)
class Target:
    """A target that intelligence names: its place in the cast and its most urgent priority (1 is first)."""

    actor: int
    priority: int


@dataclass(frozen=True, slots=True)
class SubArea:
    """A disc that the agent was told to search."""

    id: str
    place: Floats
    radius_m: float


class GroundTruth:
    """The truth of one run: from the tape, or the places in the SimSpec when the run ended before any truth
    was recorded.

    Positions are east and north in metres. Raises ValueError when the SimSpec is not realized.
    """

    def __init__(self, tape: Tape, simspec: SimSpec) -> None:
        if simspec.realized is None:
            raise ValueError("measures need the realized SimSpec, as the recording carries it")
        self._tape = tape
        self.simspec = simspec
        self._realized = simspec.realized
        # The cast is recorded at the start; a run that failed before has only the places of its SimSpec.
        self.cast = tape.cast or _placed_cast(simspec, simspec.realized)
        self.labels = np.array([member.class_label for member in self.cast], dtype=object)
        self._of_role: dict[tuple[RoleName, str], list[int]] = {}
        self._of_roles_known: dict[frozenset[Role], list[int]] = {}
        self._entered: dict[tuple[RoleName, str], dict[int, float]] = {}
        self._exposure_s: dict[int, float] = {}

    @classmethod
    def of(cls, tape: Tape, simspec: SimSpec) -> Self:
        """The truth of a tape, worked out once."""
        return tape.cached((cls,), lambda: cls(tape, simspec), simspec)

    def classes_of(self, role: RoleName) -> set[str]:
        """Class labels that actors of a role bear."""
        return {self.cast[index].class_label for index in self.of_role(role)}

    def of_role(self, role: RoleName, asset: str = "") -> list[int]:
        """Indices into the cast of the actors of a role, and of an asset where one is given."""
        # Worked out once: measures ask for every one of the reports, and there may be a hundred thousand.
        if (role, asset) not in self._of_role:
            self._of_role[role, asset] = [
                index
                for index, member in enumerate(self.cast)
                if role in ("any", member.role) and (not asset or member.asset == asset)
            ]
        return list(self._of_role[role, asset])

    def targets_present(self) -> list[int]:
        """Indices into the cast of whom a report can be about: adversaries, and whoever is sought."""
        return self._of_roles(TARGET_ROLES)

    def protected(self) -> list[int]:
        """Indices into the cast of whom the rules about bystanders protect: bystanders, and whoever is sought."""
        return self._of_roles(PROTECTED_ROLES)

    def endangered(self, marked: int | None) -> list[int]:
        """Indices into the cast of those near whom it is forbidden to mark an actor (None: to mark nobody)."""
        return self._of_roles(endangered_roles(None if marked is None else self.cast[marked].role))

    def _of_roles(self, roles: frozenset[Role]) -> list[int]:
        if roles not in self._of_roles_known:
            # In the order of the cast.
            self._of_roles_known[roles] = sorted(
                actor for role in roles for actor in self.of_role(role.value)
            )
        return list(self._of_roles_known[roles])

    def samples(self) -> tuple[Floats, Floats]:
        """Times (m,) and positions (m, k, 2), m at least 1: the start alone for a run without truth."""
        if len(self._tape.actor_time_s):
            return self._tape.actor_time_s, self._tape.actor_position_enu_m[:, :, :2]
        return np.zeros(1), self._start()[None]

    def at(self, time_s: float) -> Floats:
        """(k, 2) positions of the cast at a moment."""
        return self._tape.actors_at(time_s)[:, :2] if len(self._tape.actor_time_s) else self._start()

    def at_each(self, times_s: Floats, actors: Sequence[int] | Counts) -> Floats:
        """(n, len(actors), 2) positions of some of the cast at moments (n,), as `at` has them."""
        times, positions = self._tape.actor_time_s, self._tape.actor_position_enu_m[:, actors, :2]
        if not len(times):
            return np.repeat(self._start()[None, actors], len(times_s), axis=0)
        after = np.searchsorted(times, times_s)
        before, after = np.maximum(after - 1, 0), np.minimum(after, len(times) - 1)
        # Beyond the ends both are one sample: held, as in `Tape.actors_at`.
        span_s = times[after] - times[before]
        share = np.divide(times_s - times[before], span_s, out=np.zeros(len(span_s)), where=before < after)
        return np.asarray(positions[before] + share[:, None, None] * (positions[after] - positions[before]))

    def distances(self, time_s: float, east_m: float, north_m: float) -> Floats:
        """(k,) metres from a place on the ground to every actor at a moment."""
        return np.asarray(np.hypot(*(self.at(time_s) - (east_m, north_m)).T))

    def targets(self) -> list[Target]:
        """The targets named by intelligence, each once, in the order of the cast."""
        # Intelligence is about a group; the agent is told of its first member only.
        first: dict[str, int] = {}
        for index, member in enumerate(self.cast):
            first.setdefault(member.group, index)
        priorities: dict[int, int] = {}
        for item in self.simspec.intelligence:
            actor = first.get(item.about)
            if actor is not None and self.cast[actor].role in TARGET_ROLES:
                priorities[actor] = min(item.priority, priorities.get(actor, item.priority))
        return [Target(actor, priorities[actor]) for actor in sorted(priorities)]

    def target_of(self, intelligence_id: str) -> int | None:
        """The target that an intelligence report is about; None for another actor, or an unknown report."""
        about = next((item.about for item in self.simspec.intelligence if item.id == intelligence_id), None)
        first = next((index for index, member in enumerate(self.cast) if member.group == about), None)
        return first if first is not None and self.cast[first].role in TARGET_ROLES else None

    def sub_areas(self) -> list[SubArea]:
        """The discs that the agent was told to search, in the order of the reports."""
        radii = {item.id: item.uncertainty_m for item in self.simspec.intelligence}
        reports = self._realized.reports
        return [
            SubArea(report.id, np.array([report.east_m, report.north_m]), radii[report.id])
            for report in reports
            if report.id in radii
        ]

    def entered(self, role: RoleName, asset: str = "") -> dict[int, float]:
        """Actors of the role (and asset) that were inside a sub-area at some moment, and when first."""
        # Worked out once, as for `of_role`: a dozen observables ask.
        if (role, asset) not in self._entered:
            self._entered[role, asset] = self._entry_times(self.of_role(role, asset))
        return dict(self._entered[role, asset])

    def _entry_times(self, actors: list[int]) -> dict[int, float]:
        times, positions = self.samples()
        # One area at a time: all at once would need (m, k, areas) distances.
        inside = np.zeros((len(times), len(actors)), dtype=bool)
        for area in self.sub_areas():
            offset = positions[:, actors] - area.place
            inside |= np.hypot(offset[..., 0], offset[..., 1]) <= area.radius_m
        return {
            actor: float(times[within.argmax()])
            for actor, within in zip(actors, inside.T, strict=True)
            if within.any()
        }

    def subject(self, report: TargetReport, time_s: float, within_m: float = SUBJECT_WITHIN_M) -> int | None:
        """The target that a report is about: the nearest of its class within `within_m`; or None."""
        candidates = [
            index for index in self.targets_present() if self.cast[index].class_label == report.class_label
        ]
        if not candidates:
            return None
        distances_m = self.distances(time_s, report.east_m, report.north_m)
        nearest = min(candidates, key=lambda index: distances_m[index])
        return nearest if distances_m[nearest] <= within_m else None

    def nearest_endangered_m(self, time_s: float, east_m: float, north_m: float, marked: int | None) -> float:
        """Metres from a place to the nearest whom a mark of an actor endangers; infinity without one."""
        people = self.endangered(marked)
        return float(self.distances(time_s, east_m, north_m)[people].min(initial=np.inf))

    def endangered_by(self, report: Timed[TargetReport], subject: int | None) -> list[int]:
        """Who stands within the no-mark distance of what a report is about; of its place when it is about nobody."""
        place = (report.value.east_m, report.value.north_m)
        east_m, north_m = place if subject is None else self.at(report.time.s)[subject]
        people = self.endangered(subject)
        distances_m = self.distances(report.time.s, east_m, north_m)[people]
        near = np.flatnonzero(distances_m < self.simspec.rules.no_mark_within_m)
        return [people[column] for column in near.tolist()]

    def exposure_s(self, target: Target) -> float:
        """Seconds of the planned mission for which a bystander stands within the no-mark distance of a
        target.

        The share of the recorded time, times the mission's time limit (or the run, if longer).
        """
        if target.actor not in self._exposure_s:
            self._exposure_s[target.actor] = self._seconds_near(target.actor, self.endangered(target.actor))
        return self._exposure_s[target.actor]

    def _seconds_near(self, actor: int, bystanders: list[int]) -> float:
        if not bystanders:
            return 0.0
        # Scaled to the planned mission: who ends a run early must not drop out of consideration by that.
        times, positions = self.samples()
        distance_m = np.linalg.norm(positions[:, bystanders] - positions[:, [actor]], axis=2).min(axis=1)
        exposed = distance_m < self.simspec.rules.no_mark_within_m
        # A single sample has no span: the start alone then decides for the whole mission.
        spans = np.diff(times)
        share = float(spans[exposed[:-1]].sum() / spans.sum()) if spans.sum() > 0.0 else float(exposed[0])
        return share * max(self.simspec.mission.time_limit_s, float(times[-1]))

    def _start(self) -> Floats:
        # An actor of a recorded cast without a place in the SimSpec is infinitely far from everything.
        places = {actor.id: (actor.east_m, actor.north_m) for actor in self._realized.actors}
        return np.array([places.get(member.id, (np.inf, np.inf)) for member in self.cast]).reshape(-1, 2)


def subjects_of_reports(truth: GroundTruth, tape: Tape) -> list[tuple[Timed[TargetReport], int | None]]:
    """Every report with the adversary that it is about, None for one that is about none.

    For the harm that a report does; what it earns is decided by `known_subjects`.
    """
    return tape.cached(
        (subjects_of_reports, truth),
        lambda: [(report, truth.subject(report.value, report.time.s)) for report in tape.reports],
    )


def _placed_cast(simspec: SimSpec, realized: Realized) -> tuple[CastMember, ...]:
    return tuple(CastMember.of(actor.id, simspec.group(actor.group)) for actor in realized.actors)
