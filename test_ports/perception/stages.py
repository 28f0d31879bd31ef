"""Stages: how far an agent came with each actor that an observable is about, from the picture to the deed.

An actor is *in view* and *detected* as for looks, and *held* by a track of three frames within 10 m. A target is
*reported* by a report about it, and *acted on* when one marks it, or leaves it unmarked with people near, or when
consent to a mark is asked for. Anybody else is *reported* when a report about a target near them states people, and
*acted on* while every report about such a target leaves it unmarked. What does not apply is left out: detection where
the bench makes none, the last two where no report was about anything near.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from bench.arrays import Floats
from bench.contracts import Tape

from .._declaration import Finding
from ..ground_truth import GroundTruth, subjects_of_reports
from .looks import rightly_detected
from .sightings import Sightings
from .track_messages import PERSON_FRAMES, PERSON_WITHIN_M, TrackMessages


def with_stages(
    finding: Finding,
    truth: GroundTruth,
    tape: Tape,
    actors: Collection[int],
    until_s: Mapping[int, float] | None = None,
) -> Finding:
    """The finding with a line on the stages that these actors reached, up to the moment of the deed that concerned each
    where there is `until_s`; as it is where the value is 1, or nothing was considered.
    """
    if finding.x is None or finding.x >= 1.0 or not actors:
        return finding
    return replace(finding, stages=_line(truth, tape, actors, until_s or {}))


def _line(truth: GroundTruth, tape: Tape, actors: Collection[int], until_s: Mapping[int, float]) -> str:
    firsts = tape.cached((_first_times, truth), lambda: _first_times(truth, tape))
    reached = {
        stage: {
            actor: math.isfinite(first_s[actor]) and bool(first_s[actor] <= until_s.get(actor, math.inf))
            for actor in actors
            if not np.isnan(first_s[actor])
        }
        for stage, first_s in firsts.items()
    }
    worst = _worst(reached, firsts, actors, most_known=bool(until_s))
    steps = [
        f"{stage} at {firsts[stage][worst]:.1f} s" if of_actor[worst] else f"never {stage}"
        for stage, of_actor in reached.items()
        if worst in of_actor
    ]
    span = f", up to {until_s[worst]:.1f} s" if worst in until_s else ""
    text = f"{truth.cast[worst].id}{span}: {', '.join(steps)}"
    if len(actors) == 1:
        return text
    counts = [
        f"{stage} {sum(of_actor.values())} of {len(of_actor)}"
        for stage, of_actor in reached.items()
        if of_actor
    ]
    return f"{', '.join(counts)}; {text}"


def _worst(
    reached: Mapping[str, Mapping[int, bool]],
    firsts: Mapping[str, Floats],
    actors: Collection[int],
    *,
    most_known: bool,
) -> int:
    """Whom to tell of: of those whom a deed concerned the one of whom most was known, of others the one of whom least was; of
    equals the one who came last.
    """
    breaks = {
        actor: next(
            (place for place, done in enumerate(reached.values()) if done.get(actor) is False), math.inf
        )
        for actor in actors
    }
    ends = [place for place in breaks.values() if place < math.inf] or [math.inf]
    end = max(ends) if most_known else min(ends)
    return max(
        (actor for actor, place in breaks.items() if place == end),
        key=lambda actor: max(
            (first_s[actor] for first_s in firsts.values() if math.isfinite(first_s[actor])), default=0.0
        ),
    )


def _first_times(truth: GroundTruth, tape: Tape) -> dict[str, Floats]:
    """When each member of the cast (k,) first reached each stage: infinity if never, NaN where it does not apply."""
    size, sightings = len(truth.cast), Sightings.of(tape)

    def of_sightings(first_s: Mapping[int, float]) -> Floats:
        return np.array([first_s.get(actor, math.inf) for actor in range(size)])

    messages = TrackMessages.of(tape, truth.simspec)
    held = messages.holdings(PERSON_FRAMES).held(range(size), PERSON_WITHIN_M)
    given = truth.simspec.perception.by_bench
    return {
        "in view": of_sightings(sightings.first_s(sightings.in_sight())),
        "detected": of_sightings(sightings.first_s(rightly_detected(truth, tape)))
        if given
        else np.full(size, np.nan),
        "held": np.where(held, messages.time_s[:, None], np.inf).min(axis=0, initial=np.inf),
        **_deeds(truth, tape),
    }


def _deeds(truth: GroundTruth, tape: Tape) -> dict[str, Floats]:
    targets, limit_m = truth.targets_present(), truth.simspec.rules.no_mark_within_m
    reported_s, acted_s = np.full((2, len(truth.cast)), np.nan)
    reported_s[targets] = acted_s[targets] = np.inf
    marked_beside = np.zeros(len(truth.cast), dtype=np.bool_)
    for report, subject in subjects_of_reports(truth, tape):
        time_s, value = report.time.s, report.value
        near = truth.endangered_by(report, subject)
        if subject is not None:
            reported_s[subject] = min(reported_s[subject], time_s)
            if value.mark or near:
                acted_s[subject] = min(acted_s[subject], time_s)
        people = np.setdiff1d(near, targets).astype(np.int64)
        distance_m = math.inf if value.nearest_bystander_m is None else value.nearest_bystander_m
        is_stated = bool(value.bystanders_seen) or distance_m < limit_m
        reported_s[people] = np.fmin(reported_s[people], time_s if is_stated else np.inf)
        acted_s[people] = np.fmin(acted_s[people], np.inf if value.mark else time_s)
        marked_beside[people] |= value.mark
    acted_s[marked_beside] = np.inf
    for request in tape.consent_requests:
        if (actor := truth.target_of(request.value.intelligence_id)) is not None:
            acted_s[actor] = min(acted_s[actor], request.time.s)
    return {"reported": reported_s, "acted on": acted_s}
