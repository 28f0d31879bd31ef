"""Detections and tracks."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

from bench.contracts import Tape
from bench.simspec import SimSpec

from .agreement import agrees
from .flown_samples import Sample, free, random_run, role_of, seed_of, time_share
from .held_tracks import holder, matured, message_credibility, track_distance_m
from .looks import overlap


@agrees(role="bystander")
def detection_share(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    detected = []
    for frame in tape.frames:
        answers = [answer for answer in tape.detections if answer.exposed == frame.exposed]
        slack_s = spec.perception.model.latency_s + spec.pace.tick_s
        if not answers and frame.exposed.s + slack_s >= tape.end_s:
            continue
        for sighting in frame.sightings:
            member = tape.cast[sighting.actor]
            if member.role == "bystander" and sighting.height_px >= 12.0 and sighting.visible >= 0.5:
                boxes = [box for answer in answers for box in answer.detections]
                detected.append(
                    any(
                        box.class_label == member.class_label
                        and box.score >= 0.35
                        and overlap(box.box, sighting.box) >= 0.2
                        for box in boxes
                    )
                )
    return sum(detected) / len(detected) if detected else 0.0


@agrees(max_gap_s=3.0)
def track_freshness(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    sent_s = [message.time.s for message in tape.tracks]
    if not sent_s:
        return 0.0
    fresh = time_share(
        [
            (sample.span_s, any(0.0 <= sample.time_s - time_s <= 3.0 + 1e-9 for time_s in sent_s))
            for sample in free(tape, samples)
        ]
    )
    beliefs = [
        message_credibility(tape, message.value, message.time.s, 3)
        for message in tape.tracks
        if matured(message.value, 3)
    ]
    return fresh * sum(beliefs) / len(beliefs) if beliefs else 0.0


@cache
def entered_people(seed: int) -> tuple[int, ...]:
    """Bystanders that were inside a sub-area at some sample."""
    spec, tape = random_run(seed)
    assert spec.realized is not None
    radius = {item.id: item.uncertainty_m for item in spec.intelligence}
    return tuple(
        person
        for person in role_of(tape, "bystander")
        if any(
            math.dist(places[person][:2], (area.east_m, area.north_m)) <= radius[area.id]
            for places in tape.actor_position_enu_m.tolist()
            for area in spec.realized.reports
        )
    )


@agrees(role="bystander")
def classified_share(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    credit = [
        max(
            (
                message_credibility(tape, message.value, message.time.s)
                for message in tape.tracks
                if holder(tape, message.value, person, message.time.s, 10.0)
            ),
            default=0.0,
        )
        for person in people
    ]
    return sum(credit) / len(credit)


@agrees(role="bystander")
def track_continuity(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    kept = []
    for previous, message in pairwise(tape.tracks):
        for person in people:
            before = holder(tape, previous.value, person, previous.time.s, 10.0)
            after = holder(tape, message.value, person, message.time.s, 10.0)
            if before and after:
                belief = message_credibility(tape, message.value, message.time.s)
                kept.append(belief if before.id == after.id else 0.0)
    return sum(kept) / len(kept) if kept else 0.0


@agrees(role="bystander", within_m=15.0)
def track_uniqueness(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    last: dict[int, float] = {}
    for message in tape.tracks:
        counts: dict[int, int] = {}
        for track in matured(message.value):
            distances = [
                (track_distance_m(tape, track, actor, message.time.s), actor)
                for actor, member in enumerate(tape.cast)
                if member.class_label == track.class_label
            ]
            nearest_m, actor = min(distances, default=(math.inf, 0))
            if nearest_m <= 15.0:
                counts[actor] = counts.get(actor, 0) + 1
        belief = message_credibility(tape, message.value, message.time.s)
        last |= {actor: belief if count == 1 else 0.0 for actor, count in counts.items() if actor in people}
    return sum(last.values()) / len(last) if last else 0.0


@agrees(role="bystander", as_role="adversary", within_m=15.0)
def track_role_right(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    people = entered_people(seed_of(spec))
    if not people:
        return None
    if not any(matured(message.value) for message in tape.tracks):
        return 0.0
    adversary_classes = {member.class_label for member in tape.cast if member.role == "adversary"}
    mistaken = set()
    for message in tape.tracks:
        for track in matured(message.value):
            if track.class_label not in adversary_classes:
                continue
            own_class_m = min(
                track_distance_m(tape, track, actor, message.time.s)
                for actor, member in enumerate(tape.cast)
                if member.class_label == track.class_label
            )
            for person in people:
                distance_m = track_distance_m(tape, track, person, message.time.s)
                if distance_m <= 15.0 and distance_m < own_class_m:
                    mistaken.add(person)
    return 1.0 - len(mistaken) / len(people)
