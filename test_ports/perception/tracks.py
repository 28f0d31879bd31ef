"""What the agent believes to be where, against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.contracts import AgentTrack, Evidence, Tape
from bench.simspec import SimSpec

from .._measure import Finding, Measured, not_considered
from .._time_shares import fresh_share
from ..ground_truth._flown_track import Flight
from ..ground_truth._truth import RoleName, Truth
from .detections import known_asset
from .track_messages import NEAR_M, Picture, pictures

MIN_FINAL_FRAMES = 3
"""A track of fewer frames is a guess that the agent has not yet made up its mind about."""


@dataclass(frozen=True, slots=True)
class ClassifiedShareOptions:
    role: RoleName
    asset: str = ""
    within_m: float = 10.0
    min_frames: int = 5

    def __post_init__(self) -> None:
        known_asset(self.asset)


def _classified_share(tape: Tape, simspec: SimSpec, options: ClassifiedShareOptions) -> Finding:
    """Share of the role's actors inside the reported sub-areas that some track held, at its place and with its class.

    A message is believed as far as its tracks are right: who fills the map with guesses holds nobody.
    """
    truth = Truth.of(tape, simspec)
    entered = truth.entered(options.role, options.asset)
    if not entered:
        return _none_entered(options.role, options.asset)
    credit, found = held_credit(tape, simspec, entered, options.within_m, options.min_frames)
    missed = [
        Evidence(time_s=time_s, text=f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) inside a sub-area, never held")
        for actor, time_s in entered.items()
        if actor not in found
    ]
    return Finding(sum(credit.values()) / len(entered), (*missed, *found.values()))


def held_credit(
    tape: Tape, simspec: SimSpec, actors: dict[int, float], within_m: float, min_frames: int
) -> tuple[dict[int, float], dict[int, Evidence]]:
    """For each actor how far some message that held it is believed, 0 where none did, and where to look."""
    truth = Truth.of(tape, simspec)
    credit = dict.fromkeys(actors, 0.0)
    found: dict[int, Evidence] = {}
    for picture in pictures(tape, simspec):
        held = picture.holding([one for one in actors if credit[one] < 1.0], within_m, min_frames)
        belief = picture.belief(min_frames) if held else 0.0
        for actor, track in held.items():
            if belief > credit[actor]:
                credit[actor] = belief
                found[actor] = _held_as(truth, actor, picture.tracks[track], picture.time_s, belief)
    return credit, found


def _none_entered(role: str, asset: str = "") -> Finding:
    named = f"role {role}" + (f" and asset {asset}" if asset else "")
    return not_considered(f"no actor of {named} was ever inside a reported sub-area")


def _held_as(truth: Truth, actor: int, track: AgentTrack, time_s: float, belief: float) -> Evidence:
    doubt = "" if belief >= 1.0 else f", one right track among so many wrong ones that {belief:.2f} is believed"
    return Evidence(time_s=time_s, text=f"{truth.cast[actor].id} held as track {track.id} ({track.class_label}){doubt}")


@dataclass(frozen=True, slots=True)
class NoFalseTracksOptions:
    within_m: float = NEAR_M


def _no_false_tracks(tape: Tape, simspec: SimSpec, options: NoFalseTracksOptions) -> Finding:
    """Share of the agent's tracks that stand near an actor of their class: of its last message, or the mean over all if less.

    An agent that says nothing, or takes everything back at the end, has shown nothing. In a scenario without anybody,
    saying nothing is right.
    """
    truth = Truth.of(tape, simspec)
    said = pictures(tape, simspec)
    ripe = [(picture, picture.ripe(MIN_FINAL_FRAMES)) for picture in said]
    if not ripe or not ripe[-1][1].any():
        empty = not truth.cast and not any(some.any() for _, some in ripe)
        return Finding(1.0 if empty else 0.0, (Evidence(time_s=tape.end_s, text="the agent holds no track at the end"),))
    near = [(picture, some, picture.right(some, options.within_m)) for picture, some in ripe if some.any()]
    shares = [float(right.sum() / some.sum()) for _, some, right in near]
    final, mean = shares[-1], sum(shares) / len(shares)
    picture, some, right = near[-1] if final <= mean else near[int(np.argmin(shares))]
    evidence = [
        Evidence(
            time_s=picture.time_s,
            text=f"track {track.id} ({track.class_label}) at east {track.east_m:.1f} m, north {track.north_m:.1f} m is nobody",
        )
        for track, wrong in zip(picture.tracks, some & ~right, strict=True)
        if wrong
    ]
    return Finding(min(final, mean), tuple(evidence))


@dataclass(frozen=True, slots=True)
class TrackAccuracyOptions:
    role: RoleName
    scale_m: float = 15.0
    min_frames: int = 5

    def __post_init__(self) -> None:
        if self.scale_m == 0.0:
            raise ValueError("option 'scale_m' is 0; it must be more")


def _track_accuracy(tape: Tape, simspec: SimSpec, options: TrackAccuracyOptions) -> Finding:
    """Mean over the role's actors inside sub-areas that were held of 1 - error / `scale_m`, each message as far as believed.

    An actor is held by the nearest track of its class within `scale_m`; its number is the mean over the messages that
    hold it. 0 when none was held.
    """
    truth = Truth.of(tape, simspec)
    entered = truth.entered(options.role)
    if not entered:
        return _none_entered(options.role)
    right: dict[int, list[float]] = {}
    errors: dict[int, list[tuple[float, float]]] = {}
    for picture in pictures(tape, simspec):
        held = picture.holding(entered, options.scale_m, options.min_frames)
        belief = picture.belief(options.min_frames) if held else 0.0
        for actor, track in held.items():
            error_m = float(picture.apart_m[track, actor])
            right.setdefault(actor, []).append((1.0 - error_m / options.scale_m) * belief)
            errors.setdefault(actor, []).append((error_m, picture.time_s))
    if not right:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"no actor of role {options.role} was ever held"),))
    worst = sorted((max(errors[actor]), actor) for actor in errors)
    evidence = [
        Evidence(time_s=time_s, text=f"{truth.cast[actor].id} held {error_m:.1f} m from its place, at worst")
        for (error_m, time_s), actor in reversed(worst)
    ]
    return Finding(sum(sum(one) / len(one) for one in right.values()) / len(right), tuple(evidence))


@dataclass(frozen=True, slots=True)
class TrackContinuityOptions:
    role: RoleName
    within_m: float = 10.0
    min_frames: int = 5


def _track_continuity(tape: Tape, simspec: SimSpec, options: TrackContinuityOptions) -> Finding:
    """Of successive messages that both hold an actor, share in which it bears the same track id; each as far as believed.

    Counted over the role's actors inside sub-areas; 0 when none was held twice running.
    """
    truth = Truth.of(tape, simspec)
    entered = truth.entered(options.role)
    if not entered:
        return _none_entered(options.role)
    kept, pairs, changes = 0.0, 0, []
    before: dict[int, str] = {}
    for picture in pictures(tape, simspec):
        held = {
            actor: picture.tracks[track].id
            for actor, track in picture.holding(entered, options.within_m, options.min_frames).items()
        }
        belief = picture.belief(options.min_frames) if held else 0.0
        for actor, name in held.items():
            if actor in before:
                pairs += 1
                kept += belief if before[actor] == name else 0.0
                if before[actor] != name:
                    text = f"{truth.cast[actor].id} was track {before[actor]} and is now {name}"
                    changes.append(Evidence(time_s=picture.time_s, text=text))
        before = held
    if not pairs:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"no actor of role {options.role} was held twice running"),))
    return Finding(kept / pairs, tuple(changes))


@dataclass(frozen=True, slots=True)
class TrackUniquenessOptions:
    role: RoleName
    within_m: float = 5.0
    min_frames: int = 5


def _track_uniqueness(tape: Tape, simspec: SimSpec, options: TrackUniquenessOptions) -> Finding:
    """Of the role's actors inside sub-areas that were held, share that one track alone held in the last such message.

    A track counts for the actor of its class that it is nearest to. As far as that message is believed; 0 when none was held.
    """
    truth = Truth.of(tape, simspec)
    entered = truth.entered(options.role)
    if not entered:
        return _none_entered(options.role)
    last: dict[int, tuple[int, Picture]] = {}
    for picture in pictures(tape, simspec):
        for actor, count in _counted(picture, entered, options).items():
            last[actor] = (count, picture)
    if not last:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"no actor of role {options.role} was ever held"),))
    once = sum(picture.belief(options.min_frames) for count, picture in last.values() if count == 1)
    doubles = [
        Evidence(time_s=picture.time_s, text=f"{truth.cast[actor].id} stands in the picture {count} times")
        for actor, (count, picture) in last.items()
        if count > 1
    ]
    return Finding(once / len(last), tuple(doubles))


def _counted(picture: Picture, actors: dict[int, float], options: TrackUniquenessOptions) -> dict[int, int]:
    """How many ripe tracks within reach are nearest to each of the actors, among all of their class."""
    if not picture.tracks:
        return {}
    away = np.where(picture.alike, picture.apart_m, np.inf)
    nearest = away.argmin(axis=1)
    close = (away[np.arange(len(nearest)), nearest] <= options.within_m) & picture.ripe(options.min_frames)
    counts = np.bincount(nearest[close], minlength=away.shape[1])
    return {actor: int(counts[actor]) for actor in actors if counts[actor]}


@dataclass(frozen=True, slots=True)
class TrackRoleRightOptions:
    role: RoleName
    as_role: RoleName
    within_m: float = 6.0
    min_frames: int = 5


def _track_role_right(tape: Tape, simspec: SimSpec, options: TrackRoleRightOptions) -> Finding:
    """Share of the role's actors inside sub-areas that were never held by a track with a class of the other role.

    A track holds one that is within `within_m` of it, unless an actor of the track's own class is nearer. 0 without tracks.
    """
    truth = Truth.of(tape, simspec)
    entered = truth.entered(options.role)
    other = truth.classes_of(options.as_role) - truth.classes_of(options.role)
    if not entered or not other:
        return not_considered(f"nobody of role {options.role} inside a sub-area could be taken for one of role {options.as_role}")
    said = pictures(tape, simspec)
    if not any(picture.ripe(options.min_frames).any() for picture in said):
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="the agent holds no track at all"),))
    among = list(entered)
    mistaken: dict[int, Evidence] = {}
    for picture in said:
        suspect = picture.ripe(options.min_frames) & np.isin(picture.labels, list(other))
        if not suspect.any():
            continue
        meant_m = np.where(picture.alike, picture.apart_m, np.inf).min(axis=1)
        apart_m = picture.apart_m[:, among]
        wrong = suspect[:, None] & (apart_m <= options.within_m) & (apart_m < meant_m[:, None])
        for track, column in zip(*wrong.nonzero(), strict=True):
            actor, held = among[column], picture.tracks[track]
            text = f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) held as {held.class_label}, track {held.id}"
            mistaken.setdefault(actor, Evidence(time_s=picture.time_s, text=text))
    return Finding(1.0 - len(mistaken) / len(entered), tuple(mistaken.values()))


@dataclass(frozen=True, slots=True)
class TrackFreshnessOptions:
    max_gap_s: float = 2.0


def _track_freshness(tape: Tape, simspec: SimSpec, options: TrackFreshnessOptions) -> Finding:
    """Share of the time in the air at which the last message of tracks is no older than `max_gap_s`; 0 when it never flew."""
    flight = Flight.of(tape, simspec)
    return fresh_share(flight, np.array([said.time.s for said in tape.tracks]), options.max_gap_s, "tracks")


@dataclass(frozen=True, slots=True)
class TrackConfidenceOptions:
    min_frames: int = 5
    within_m: float = NEAR_M


def _track_confidence_honest(tape: Tape, simspec: SimSpec, options: TrackConfidenceOptions) -> Finding:
    """1 - |mean stated confidence - share that is right| over the ripe tracks, each by the last message that has it."""
    last: dict[str, tuple[float, bool]] = {}
    for picture in pictures(tape, simspec):
        ripe = picture.ripe(options.min_frames)
        right = picture.right(ripe, options.within_m)
        last |= {track.id: (track.confidence, bool(right[index])) for index, track in enumerate(picture.tracks) if ripe[index]}
    if not last:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="the agent holds no track at all"),))
    stated = sum(confidence for confidence, _ in last.values()) / len(last)
    right_share = sum(right for _, right in last.values()) / len(last)
    text = f"{len(last)} tracks are stated with {stated:.2f} in the mean; {right_share:.2f} of them are right"
    return Finding(1.0 - abs(stated - right_share), (Evidence(time_s=tape.end_s, text=text),))


classified_share = Measured("classified_share", ClassifiedShareOptions, _classified_share)
no_false_tracks = Measured("no_false_tracks", NoFalseTracksOptions, _no_false_tracks)
track_accuracy = Measured("track_accuracy", TrackAccuracyOptions, _track_accuracy)
track_continuity = Measured("track_continuity", TrackContinuityOptions, _track_continuity)
track_uniqueness = Measured("track_uniqueness", TrackUniquenessOptions, _track_uniqueness)
track_role_right = Measured("track_role_right", TrackRoleRightOptions, _track_role_right)
track_freshness = Measured("track_freshness", TrackFreshnessOptions, _track_freshness)
track_confidence_honest = Measured("track_confidence_honest", TrackConfidenceOptions, _track_confidence_honest)
