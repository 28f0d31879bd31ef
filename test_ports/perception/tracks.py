"""Measures of the agent's tracks: what it believes to be where, against the truth.

A message *holds* an actor when it has a track of the actor's class that rests on at least `min_frames` frames
and is within `within_m`; the nearest such track counts. The *credibility* of a message is 1 while at least
half of its tracks of that many frames are within 15 m of an actor of their class. Below half, it is the
number of right tracks over the number of wrong ones.

Measures with a `role` are about the role's actors that were inside a sub-area at some moment. They are
considered when there is one, and 0 when none was held (`track_role_right`: when there is no track). The other
measures are always considered, and 0 without tracks.
"""

from __future__ import annotations

import numpy as np

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import Finding, Positive, measure, not_considered, nothing_shown
from .._time_shares import fresh_share
from ..ground_truth import FlownTrack, GroundTruth, RoleName
from .detections import AssetName
from .track_messages import RIGHT_WITHIN_M, TrackMessage, holding_credit, track_messages

MIN_FINAL_FRAMES = 3
"""A track of fewer frames is a guess that the agent may still drop. Chosen, not measured."""


@measure
def classified_share(
    tape: Tape,
    simspec: SimSpec,
    *,
    role: RoleName,
    asset: AssetName = "",
    within_m: float = 10.0,
    min_frames: int = 5,
) -> Finding:
    """Share of the role's actors that some message held.

    An actor counts with the credibility of the most credible message that held it.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = truth.entered(role, asset)
    if not entered:
        return _none_entered(role, asset)
    credit, moments = holding_credit(tape, simspec, entered, within_m, min_frames)
    missed = [
        Evidence(
            time_s=time_s,
            text=f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) inside a sub-area, never held",
        )
        for actor, time_s in entered.items()
        if actor not in moments
    ]
    return Finding(sum(credit.values()) / len(entered), (*missed, *moments.values()))


def _none_entered(role: str, asset: str = "") -> Finding:
    subject = f"role {role}" + (f" and asset {asset}" if asset else "")
    return not_considered(f"no actor of {subject} was ever inside a reported sub-area")


@measure
def no_false_tracks(tape: Tape, simspec: SimSpec, *, within_m: float = RIGHT_WITHIN_M) -> Finding:
    """Share of the agent's final tracks that are within `within_m` of an actor of their class.

    Only tracks of three frames or more count. If the mean of this share over all messages with such tracks is
    lower, the mean counts, so that withdrawing guesses at the end does not help. 0 without such tracks at the
    end; 1 if the scenario has no actor at all and the agent never claimed one. The measure does not punish
    one guess at a time that moves beside many right tracks until it hits.
    """
    truth = GroundTruth.of(tape, simspec)
    messages = track_messages(tape, simspec)
    judged = [(message, message.mature(MIN_FINAL_FRAMES)) for message in messages]
    if not judged or not judged[-1][1].any():
        rightly_silent = not truth.cast and not any(mature.any() for _, mature in judged)
        text = "the agent holds no track at the end"
        return Finding(1.0 if rightly_silent else 0.0, (Evidence(time_s=tape.end_s, text=text),))
    with_right = [
        (message, mature, message.right(mature, within_m)) for message, mature in judged if mature.any()
    ]
    shares = [float(right.sum() / mature.sum()) for _, mature, right in with_right]
    final, mean = shares[-1], sum(shares) / len(shares)
    # Show the message that decided: the last one, or the worst when the mean was less.
    message, mature, right = with_right[-1] if final <= mean else with_right[int(np.argmin(shares))]
    evidence = [
        Evidence(
            time_s=message.time_s,
            text=f"track {track.id} ({track.class_label}) at east {track.east_m:.1f} m, north {track.north_m:.1f} m is no actor",
        )
        for track, is_wrong in zip(message.tracks, mature & ~right, strict=True)
        if is_wrong
    ]
    return Finding(min(final, mean), tuple(evidence))


@measure
def track_accuracy(
    tape: Tape, simspec: SimSpec, *, role: RoleName, scale_m: Positive = 15.0, min_frames: int = 5
) -> Finding:
    """Mean of 1 - error / `scale_m` over the role's actors that were held within `scale_m`.

    The value of an actor is the mean over the messages that hold it, each multiplied by the credibility of
    the message.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = truth.entered(role)
    if not entered:
        return _none_entered(role)
    credit_of: dict[int, list[float]] = {}
    errors: dict[int, list[tuple[float, float]]] = {}
    for message in track_messages(tape, simspec):
        held = message.holding(entered, scale_m, min_frames)
        belief = message.credibility(min_frames) if held else 0.0
        for actor, track in held.items():
            error_m = float(message.distance_m[track, actor])
            credit_of.setdefault(actor, []).append((1.0 - error_m / scale_m) * belief)
            errors.setdefault(actor, []).append((error_m, message.time_s))
    if not credit_of:
        return nothing_shown(tape.end_s, f"no actor of role {role} was ever held")
    worst = sorted((max(errors[actor]), actor) for actor in errors)
    evidence = [
        Evidence(time_s=time_s, text=f"{truth.cast[actor].id} held {error_m:.1f} m from its place, at worst")
        for (error_m, time_s), actor in reversed(worst)
    ]
    return Finding(
        sum(sum(credit) / len(credit) for credit in credit_of.values()) / len(credit_of), tuple(evidence)
    )


@measure
def track_continuity(
    tape: Tape, simspec: SimSpec, *, role: RoleName, within_m: float = 10.0, min_frames: int = 5
) -> Finding:
    """Share of the pairs of successive messages that hold the same actor in which its track id stays the
    same.

    Each pair counts with the credibility of its second message. 0 when there is no such pair.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = truth.entered(role)
    if not entered:
        return _none_entered(role)
    unchanged, pairs, changes = 0.0, 0, []
    previous: dict[int, str] = {}
    for message in track_messages(tape, simspec):
        held = {
            actor: message.tracks[track].id
            for actor, track in message.holding(entered, within_m, min_frames).items()
        }
        belief = message.credibility(min_frames) if held else 0.0
        for actor, track_id in held.items():
            if actor not in previous:
                continue
            pairs += 1
            if previous[actor] == track_id:
                unchanged += belief
            else:
                text = f"{truth.cast[actor].id} was track {previous[actor]} and is now {track_id}"
                changes.append(Evidence(time_s=message.time_s, text=text))
        # Replaced even when it is empty: a pair is two messages in succession.
        previous = held
    if not pairs:
        return nothing_shown(tape.end_s, f"no actor of role {role} was held by two messages in succession")
    return Finding(unchanged / pairs, tuple(changes))


@measure
def track_uniqueness(
    tape: Tape, simspec: SimSpec, *, role: RoleName, within_m: float = 5.0, min_frames: int = 5
) -> Finding:
    """Share of the held actors of the role that have a single track in the last message that holds them.

    A track belongs to the nearest actor of its class. An actor counts with the credibility of that last
    message.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = truth.entered(role)
    if not entered:
        return _none_entered(role)
    last: dict[int, tuple[int, TrackMessage]] = {}
    for message in track_messages(tape, simspec):
        for actor, count in _tracks_of(message, entered, within_m, min_frames).items():
            last[actor] = (count, message)
    if not last:
        return nothing_shown(tape.end_s, f"no actor of role {role} was ever held")
    unique = sum(message.credibility(min_frames) for count, message in last.values() if count == 1)
    doubles = [
        Evidence(time_s=message.time_s, text=f"{truth.cast[actor].id} is held by {count} tracks")
        for actor, (count, message) in last.items()
        if count > 1
    ]
    return Finding(unique / len(last), tuple(doubles))


def _tracks_of(
    message: TrackMessage, actors: dict[int, float], within_m: float, min_frames: int
) -> dict[int, int]:
    """How many mature tracks within reach have each of the actors as their nearest, among all of their
    class.
    """
    if not message.tracks:
        return {}
    distance_m = np.where(message.same_class, message.distance_m, np.inf)
    # By the nearest actor, so that two people side by side do not make each other double.
    nearest = distance_m.argmin(axis=1)
    within_reach = distance_m[np.arange(len(nearest)), nearest] <= within_m
    counts = np.bincount(nearest[within_reach & message.mature(min_frames)], minlength=distance_m.shape[1])
    return {actor: int(counts[actor]) for actor in actors if counts[actor]}


@measure
def track_role_right(
    tape: Tape,
    simspec: SimSpec,
    *,
    role: RoleName,
    as_role: RoleName,
    within_m: float = 6.0,
    min_frames: int = 5,
) -> Finding:
    """Share of the role's actors that no track ever took for an actor of `as_role`.

    A track does so when its class occurs among the actors of `as_role` but not among those of `role`, when it
    is within `within_m` of the actor, and when no actor of the track's class is nearer. Considered only if
    the scenario has such a class.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = truth.entered(role)
    wrong_classes = truth.classes_of(as_role) - truth.classes_of(role)
    if not entered or not wrong_classes:
        return not_considered(
            f"no actor of role {role} inside a sub-area could be taken for one of role {as_role}"
        )
    messages = track_messages(tape, simspec)
    if not any(message.mature(min_frames).any() for message in messages):
        return nothing_shown(tape.end_s, "the agent holds no track at all")
    actors = list(entered)
    mistaken: dict[int, Evidence] = {}
    for message in messages:
        suspect = message.mature(min_frames) & np.isin(message.labels, list(wrong_classes))
        if not suspect.any():
            continue
        # A track near an actor of its own class is right, even if another actor stands closer than within_m.
        own_class_m = np.where(message.same_class, message.distance_m, np.inf).min(axis=1)
        distance_m = message.distance_m[:, actors]
        is_mistake = suspect[:, None] & (distance_m <= within_m) & (distance_m < own_class_m[:, None])
        for row, column in zip(*is_mistake.nonzero(), strict=True):
            actor, track = actors[column], message.tracks[row]
            text = f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) held as {track.class_label}, track {track.id}"
            mistaken.setdefault(actor, Evidence(time_s=message.time_s, text=text))
    return Finding(1.0 - len(mistaken) / len(entered), tuple(mistaken.values()))


@measure
def track_freshness(tape: Tape, simspec: SimSpec, *, max_gap_s: float = 2.0) -> Finding:
    """Share of the time in the air at which the last message of tracks is at most `max_gap_s` old.

    0 without a flight.
    """
    sent_s = np.array([message.time.s for message in tape.tracks])
    return fresh_share(FlownTrack.of(tape, simspec), sent_s, max_gap_s, "tracks")


@measure
def track_confidence_honest(
    tape: Tape, simspec: SimSpec, *, min_frames: int = 5, within_m: float = RIGHT_WITHIN_M
) -> Finding:
    """1 - |mean stated confidence - share of right tracks|, over all tracks.

    Each track is judged by the last message that contains it. It is right within `within_m` of an actor of
    its class.
    """
    last: dict[str, tuple[float, bool]] = {}
    for message in track_messages(tape, simspec):
        mature = message.mature(min_frames)
        right = message.right(mature, within_m)
        last |= {
            track.id: (track.confidence, bool(right[index]))
            for index, track in enumerate(message.tracks)
            if mature[index]
        }
    if not last:
        return nothing_shown(tape.end_s, "the agent holds no track at all")
    stated = sum(confidence for confidence, _ in last.values()) / len(last)
    right_share = sum(is_right for _, is_right in last.values()) / len(last)
    text = f"{len(last)} tracks are stated with a mean confidence of {stated:.2f}; {right_share:.2f} of them are right"
    return Finding(1.0 - abs(stated - right_share), (Evidence(time_s=tape.end_s, text=text),))
