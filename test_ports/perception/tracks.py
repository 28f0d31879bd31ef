"""Measures of the agent's tracks: what it believes to be where, against the truth.

They judge the agent, whoever made the detections. With `perception.source: truth` they judge what it makes of
detections without errors; with `simulated` or `detector`, of the configured sensor's; with `agent` its own
perception from the pictures on.

A message *holds* an actor when it has a track of the actor's class that rests on at least `min_frames` frames
and is within `within_m`, and when some frame before had the actor in sight, by the truth and however little: a
track at a told place holds nothing. The nearest such track counts. A track is *right* within 15 m of an actor of
its class that had been in sight. The *credibility* of a message is 1 while at least half of its tracks of that
many frames are right. Below half, it is the number of right tracks over the number of wrong ones.

Measures with a `role` are about the role's actors that were inside a sub-area at some moment. They are
considered when there is one, and 0 when none was held (`track_role_right`: when no track is right).
`track_share` and `steady_tracks` are about all actors of the role that came into view, and considered when the
scenario has one. The other measures are always considered, and 0 without tracks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import Finding, Positive, measure, not_considered, nothing_shown
from .._time_shares import fresh_share
from ..ground_truth import FlownTrack, GroundTruth, RoleName, ordered_silent_s
from .clear_views import ViewCriteria, evenness
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
    if not any(message.right(message.mature(min_frames)).any() for message in messages):
        return nothing_shown(tape.end_s, "the agent holds no track that is right")
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
def track_share(
    tape: Tape,
    simspec: SimSpec,
    *,
    role: RoleName,
    asset: AssetName = "",
    min_height_px: float = 12.0,
    min_visible: float = 0.5,
    max_visible: float = 1.0,
    min_range_m: float = 0.0,
    max_range_m: float = 100_000.0,
    within_m: float = 10.0,
    min_frames: int = 3,
    within_s: float = 2.0,
) -> Finding:
    """Share of the views of the role's actors at which the agent's picture holds the actor.

    What `detection_share` asks of the detector, asked of the agent: a view is an actor in one camera frame, as
    the options say, and some message sent up to `within_s` after the frame must hold the actor. A view counts
    with the credibility of the most credible such message. `max_visible` and the ranges select views, for
    example poor ones. 0 when no actor came into such a view. From an order to deactivate on, nothing counts.
    """
    truth = GroundTruth.of(tape, simspec)
    actors = truth.of_role(role, asset)
    subject = f"role {role}" + (f" and asset {asset}" if asset else "")
    if not actors:
        return not_considered(f"the scenario has no actor of {subject}")
    criteria = ViewCriteria(
        min_height_px=min_height_px,
        min_visible=min_visible,
        max_visible=max_visible,
        min_range_m=min_range_m,
        max_range_m=max_range_m,
    )
    views = _held_views(tape, simspec, actors, criteria, within_m, min_frames, within_s)
    if not views:
        return nothing_shown(tape.end_s, f"no actor of {subject} ever came into such a view")
    credits_of: dict[int, list[tuple[float, float]]] = {}
    for actor, time_s, credit in views:
        credits_of.setdefault(actor, []).append((credit, time_s))
    shares = {actor: sum(credit for credit, _ in held) / len(held) for actor, held in credits_of.items()}
    evidence = [
        Evidence(
            time_s=min(credits_of[actor])[1],
            text=f"{truth.cast[actor].id}: held in {shares[actor]:.0%} of {len(credits_of[actor])} views, least here",
        )
        for actor in sorted(shares, key=lambda actor: (shares[actor], actor))
    ]
    return Finding(sum(credit for _, _, credit in views) / len(views), tuple(evidence))


@measure
def steady_tracks(
    tape: Tape,
    simspec: SimSpec,
    *,
    role: RoleName,
    min_height_px: float = 12.0,
    min_visible: float = 0.5,
    within_m: float = 10.0,
    min_frames: int = 3,
    within_s: float = 2.0,
) -> Finding:
    """`track_share` of the worse half of the views, divided by that of the better half.

    The views are split in order of time, into halves of equal number. 0 with fewer than two views. From an order to
    deactivate on, nothing counts.
    """
    actors = GroundTruth.of(tape, simspec).of_role(role)
    if not actors:
        return not_considered(f"the scenario has no actor of role {role}")
    criteria = ViewCriteria(min_height_px=min_height_px, min_visible=min_visible)
    views = _held_views(tape, simspec, actors, criteria, within_m, min_frames, within_s)
    if len(views) < 2:
        return nothing_shown(tape.end_s, f"role {role} was in clear view {len(views)} times")
    # Halves by count, as for detections: an aircraft may see most of the actors in a few seconds.
    middle = len(views) // 2
    early, late = (
        sum(credit for _, _, credit in half) / len(half) for half in (views[:middle], views[middle:])
    )
    text = f"held in {early:.0%} of the clear views before this moment, in {late:.0%} from it on"
    return Finding(evenness(early, late), (Evidence(time_s=views[middle][1], text=text),))


def _held_views(
    tape: Tape,
    simspec: SimSpec,
    actors: Sequence[int],
    criteria: ViewCriteria,
    within_m: float,
    min_frames: int,
    within_s: float,
) -> list[tuple[int, float, float]]:
    """Actor, moment and credit of every view that meets the criteria, in order of time.

    Up to an order to deactivate: from then on the agent sends nothing more.
    """
    messages = track_messages(tape, simspec)
    sent_s = np.array([message.time_s for message in messages])
    held = [message.holding(actors, within_m, min_frames) for message in messages]
    credibility = [
        message.credibility(min_frames) if held_by else 0.0
        for message, held_by in zip(messages, held, strict=True)
    ]
    wanted = set(actors)
    silent_s = ordered_silent_s(tape)
    views = []
    for frame in tape.frames:
        if frame.exposed.s >= silent_s:
            break
        # Messages that were sent after the frame and soon: a session that ends before has none.
        first, last = np.searchsorted(sent_s, [frame.exposed.s, frame.exposed.s + within_s])
        for sighting in frame.sightings:
            if sighting.actor in wanted and criteria.is_clear(sighting):
                credit = max(
                    (credibility[index] for index in range(first, last) if sighting.actor in held[index]),
                    default=0.0,
                )
                views.append((sighting.actor, frame.exposed.s, credit))
    return views


FRESH_FRAMES = 3
"""Frames on which a track must rest for its message to be believed or not, as for the final tracks."""


@measure
def track_freshness(tape: Tape, simspec: SimSpec, *, max_gap_s: float = 2.0) -> Finding:
    """Share of the time in the air at which the last message of tracks is at most `max_gap_s` old.

    Multiplied by the mean credibility of the messages that have a track of three frames or more: a picture of what
    intelligence told is not fresh. 0 without such a message, and without a flight. From an order to deactivate on,
    after which an agent is silent, nothing counts.
    """
    track = FlownTrack.of(tape, simspec)
    sent_s = np.array([message.time.s for message in tape.tracks])
    fresh = fresh_share(track, sent_s, max_gap_s, "tracks", track.free)
    beliefs = [
        message.credibility(FRESH_FRAMES)
        for message in track_messages(tape, simspec)
        if message.mature(FRESH_FRAMES).any()
    ]
    belief = sum(beliefs) / len(beliefs) if beliefs else 0.0
    if not fresh.x or belief >= 1.0:
        return fresh
    doubt = Evidence(
        time_s=tape.end_s, text=f"too few of the tracks are right, so this counts {belief:.2f} of it"
    )
    return Finding(fresh.x * belief, (*fresh.evidence, doubt))


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
