"""Looks: the sightings from which an agent could know of an actor. All that is said about knowledge rests on them."""

from __future__ import annotations

import math

from bench.arrays import Bools
from bench.contracts import Tape

from ..ground_truth import GroundTruth
from .answers import Answers
from .clear_views import DetectionCriteria
from .sightings import SIGHT_PX, Sightings


def are_looks(truth: GroundTruth, tape: Tape, min_px: float = SIGHT_PX) -> Bools:
    """(s,) which sightings are looks: the actor is in sight, or the agent was given a right detection of it."""
    return Sightings.of(tape).in_sight(min_px) | rightly_detected(truth, tape)


def first_look_s(truth: GroundTruth, tape: Tape, actor: int) -> float:
    """When there was the first look at an actor; infinity if never."""
    return min(first_s.get(actor, math.inf) for first_s in _firsts(truth, tape).values())


def no_look_by(truth: GroundTruth, tape: Tape, actor: int, time_s: float) -> str:
    """What a look at an actor lacked up to a moment; empty when there was one."""
    if first_look_s(truth, tape, actor) <= time_s:
        return ""
    missing = [
        f"{way} ({f'first at {first_s[actor]:.1f} s' if actor in first_s else 'it never was'})"
        for way, first_s in _firsts(truth, tape).items()
    ]
    return f"{truth.cast[actor].id} had not been {' or '.join(missing)}"


def _firsts(truth: GroundTruth, tape: Tape) -> dict[str, dict[int, float]]:
    """When each actor first was looked at, in each of the ways; without those that never were."""

    def search() -> dict[str, dict[int, float]]:
        sightings = Sightings.of(tape)
        ways = {"in sight": sightings.in_sight()}
        if truth.simspec.perception.by_bench:
            ways["rightly detected"] = rightly_detected(truth, tape)
        return {way: sightings.first_s(rows) for way, rows in ways.items()}

    return tape.cached((_firsts, truth), search)


def rightly_detected(truth: GroundTruth, tape: Tape) -> Bools:
    """(s,) whether a detection that the agent was given is right for the actor of a sighting."""
    # An agent with a perception of its own was given none, whatever it publishes.
    given = truth.simspec.perception.by_bench
    answers = Answers.of(tape, truth.simspec)
    return tape.cached(
        (rightly_detected, truth), lambda: DetectionCriteria().are_detected(answers, truth) & given
    )
