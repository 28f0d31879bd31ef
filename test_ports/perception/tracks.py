"""Measures of the agent's tracks: what it believes to be where, against the truth.

They judge the agent, whoever made the detections. With `perception.source: truth` they judge what it makes of
detections without errors; with `simulated` or `detector`, of the configured sensor's; with `agent` its own
perception from the pictures on.

A message *holds* an actor when it has a track of the actor's class that rests on at least `min_frames` frames
and is within `within_m`, and when some frame before showed the actor, by the truth and however little: a track at
a told place holds nothing. The nearest such track counts. A track is *right* within 15 m of an actor of its class
that had been shown. The *credibility* of a message is 1 while at least half of its tracks of that
many frames are right. Below half, it is the number of right tracks over the number of wrong ones.

Measures with a `role` are about the role's actors that were inside a sub-area at some moment. They are
considered when there is one, and 0 when none was held (`track_role_right`: when no track is right).
`track_share` and `steady_tracks` are about all actors of the role that came into view, and considered when the
scenario has one. The other measures are always considered, and 0 without tracks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.arrays import Floats
from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from .._declaration import Finding, Positive, consider, measure, not_considered, nothing_shown
from .._time_shares import fresh_share
from ..ground_truth import FlownTrack, GroundTruth, RoleName, ordered_silent_s
from .clear_views import ActorViews
from .detections import AssetName
from .sightings import Sightings, ViewCriteria
from .stages import with_stages
from .track_messages import RIGHT_WITHIN_M, TrackMessages, holding_credit, in_order_of_appearance

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
    entered = _entered(truth, role, asset)
    credit, moments = holding_credit(tape, simspec, entered, within_m, min_frames)
    missed = [
        Evidence(
            time_s=time_s,
            text=f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) inside a sub-area, never held",
        )
        for actor, time_s in entered.items()
        if actor not in moments
    ]
    finding = Finding(sum(credit.values()) / len(entered), (*missed, *moments.values()))
    return with_stages(finding, truth, tape, entered)


def _entered(truth: GroundTruth, role: RoleName, asset: str = "") -> dict[int, float]:
    entered = truth.entered(role, asset)
    subject = f"role {role}" + (f" and asset {asset}" if asset else "")
    consider(entered, f"no actor of {subject} was ever inside a reported sub-area")
    return entered


@measure
def no_false_tracks(tape: Tape, simspec: SimSpec, *, within_m: float = RIGHT_WITHIN_M) -> Finding:
    """Share of the agent's final tracks that are within `within_m` of an actor of their class.

    Only tracks of three frames or more count. If the mean of this share over all messages with such tracks is
    lower, the mean counts, so that withdrawing guesses at the end does not help. 0 without such tracks at the
    end; 1 if the scenario has no actor at all and the agent never claimed one. The measure does not punish
    one guess at a time that moves beside many right tracks until it hits.
    """
    truth = GroundTruth.of(tape, simspec)
    messages = TrackMessages.of(tape, simspec)
    mature, right = messages.mature(MIN_FINAL_FRAMES), messages.right(within_m)
    judged = messages.per_message(mature)
    if not len(judged) or not judged[-1]:
        rightly_silent = not truth.cast and not mature.any()
        text = "the agent holds no track at the end"
        return Finding(1.0 if rightly_silent else 0.0, (Evidence(time_s=tape.end_s, text=text),))
    rows = np.flatnonzero(judged)
    shares = (messages.per_message(mature & right)[rows] / judged[rows]).tolist()
    final, mean = shares[-1], sum(shares) / len(shares)
    # Show the message that decided: the last one, or the worst when the mean was less.
    row = rows[-1] if final <= mean else rows[int(np.argmin(shares))]
    evidence = []
    for index in np.flatnonzero(mature & ~right & (messages.message == row)):
        track = messages.tracks[index]
        text = f"track {track.id} ({track.class_label}) at east {track.east_m:.1f} m, north {track.north_m:.1f} m is no actor"
        evidence.append(Evidence(time_s=float(messages.time_s[row]), text=text))
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
    entered = _entered(truth, role)
    messages = TrackMessages.of(tape, simspec)
    holdings = messages.holdings(min_frames)
    held = holdings.held(entered, scale_m)
    if not held.any():
        finding = nothing_shown(tape.end_s, f"no actor of role {role} was ever held")
        return with_stages(finding, truth, tape, entered)
    values, worst = [], []
    for actor, column in in_order_of_appearance(entered, held):
        rows = np.flatnonzero(held[:, column])
        errors_m = holdings.distance_m[rows, actor]
        credit = ((1.0 - errors_m / scale_m) * holdings.credibility[rows]).tolist()
        values.append(sum(credit) / len(credit))
        worst.append((*max(zip(errors_m.tolist(), messages.time_s[rows].tolist(), strict=True)), actor))
    evidence = [
        Evidence(time_s=time_s, text=f"{truth.cast[actor].id} held {error_m:.1f} m from its place, at worst")
        for error_m, time_s, actor in sorted(worst, reverse=True)
    ]
    return with_stages(Finding(sum(values) / len(values), tuple(evidence)), truth, tape, entered)


@measure
def track_continuity(
    tape: Tape, simspec: SimSpec, *, role: RoleName, within_m: float = 10.0, min_frames: int = 5
) -> Finding:
    """Share of the pairs of successive messages that hold the same actor in which its track id stays the
    same.

    Each pair counts with the credibility of its second message. 0 when there is no such pair.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = _entered(truth, role)
    messages, actors = TrackMessages.of(tape, simspec), list(entered)
    holdings = messages.holdings(min_frames)
    held = holdings.held(actors, within_m)
    # A pair is two messages in succession.
    rows, columns = (held[:-1] & held[1:]).nonzero()
    unchanged, changes = 0.0, []
    for row, column in zip((rows + 1).tolist(), columns.tolist(), strict=True):
        actor = actors[column]
        before, now = (messages.tracks[index].id for index in holdings.track[row - 1 : row + 1, actor])
        if before == now:
            unchanged += float(holdings.credibility[row])
        else:
            text = f"{truth.cast[actor].id} was track {before} and is now {now}"
            changes.append(Evidence(time_s=float(messages.time_s[row]), text=text))
    if not len(rows):
        finding = nothing_shown(tape.end_s, f"no actor of role {role} was held by two messages in succession")
        return with_stages(finding, truth, tape, entered)
    return Finding(unchanged / len(rows), tuple(changes))


@measure
def track_uniqueness(
    tape: Tape, simspec: SimSpec, *, role: RoleName, within_m: float = 5.0, min_frames: int = 5
) -> Finding:
    """Share of the held actors of the role that have a single track in the last message that holds them.

    A track belongs to the nearest actor of its class. An actor counts with the credibility of that last
    message.
    """
    truth = GroundTruth.of(tape, simspec)
    entered = _entered(truth, role)
    messages = TrackMessages.of(tape, simspec)
    # By the nearest actor, so that two people side by side do not make each other double.
    counted = messages.mature(min_frames) & (messages.nearest.distance_m <= within_m)
    counts = np.zeros((len(messages.time_s), len(truth.cast)), dtype=np.int64)
    np.add.at(counts, (messages.message[counted], messages.nearest.actor[counted]), 1)
    of_entered = counts[:, list(entered)]
    if not of_entered.any():
        finding = nothing_shown(tape.end_s, f"no actor of role {role} was ever held")
        return with_stages(finding, truth, tape, entered)
    credibility = messages.credibility(min_frames)
    unique, doubles = [], []
    for actor, column in in_order_of_appearance(entered, of_entered > 0):
        last = int(np.flatnonzero(of_entered[:, column])[-1])
        if of_entered[last, column] == 1:
            unique.append(float(credibility[last]))
        else:
            text = f"{truth.cast[actor].id} is held by {of_entered[last, column]} tracks"
            doubles.append(Evidence(time_s=float(messages.time_s[last]), text=text))
    return Finding(sum(unique) / (len(unique) + len(doubles)), tuple(doubles))


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
    messages = TrackMessages.of(tape, simspec)
    mature = messages.mature(min_frames)
    if not (mature & messages.right()).any():
        return nothing_shown(tape.end_s, "the agent holds no track that is right")
    actors = np.array(list(entered))
    suspects = np.flatnonzero(mature & np.isin(messages.labels, list(wrong_classes)))
    mistaken: dict[int, Evidence] = {}
    for tracks, distance_m in messages.distances(suspects, actors):
        # A track near an actor of its own class is right, even if another actor stands closer than within_m.
        is_mistake = (distance_m <= within_m) & (distance_m < messages.nearest.distance_m[tracks, None])
        for row, column in zip(*is_mistake.nonzero(), strict=True):
            actor, track = int(actors[column]), messages.tracks[tracks[row]]
            text = f"{truth.cast[actor].id} ({truth.cast[actor].class_label}) held as {track.class_label}, track {track.id}"
            time_s = float(messages.time_s[messages.message[tracks[row]]])
            mistaken.setdefault(actor, Evidence(time_s=time_s, text=text))
    finding = Finding(1.0 - len(mistaken) / len(entered), tuple(mistaken.values()))
    return with_stages(finding, truth, tape, mistaken)


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
    consider(actors, f"the scenario has no actor of {subject}")
    criteria = ViewCriteria(min_height_px, min_visible, max_visible, min_range_m, max_range_m)
    views = _held_views(tape, simspec, actors, criteria, within_m, min_frames, within_s)
    return with_stages(views.finding(truth, subject, tape.end_s, "held"), truth, tape, actors)


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
    truth = GroundTruth.of(tape, simspec)
    actors = truth.of_role(role)
    consider(actors, f"the scenario has no actor of role {role}")
    criteria = ViewCriteria(min_height_px=min_height_px, min_visible=min_visible)
    views = _held_views(tape, simspec, actors, criteria, within_m, min_frames, within_s)
    return with_stages(views.steadiness(role, tape.end_s, "held"), truth, tape, actors)


def _held_views(
    tape: Tape,
    simspec: SimSpec,
    actors: Sequence[int],
    criteria: ViewCriteria,
    within_m: float,
    min_frames: int,
    within_s: float,
) -> ActorViews:
    """Every view that meets the criteria.

    Up to an order to deactivate: from then on the agent sends nothing more.
    """
    sightings = Sightings.of(tape)
    rows = (
        sightings.are_of(actors) & criteria.are_clear(sightings) & (sightings.time_s < ordered_silent_s(tape))
    )
    credit = tape.cached(
        (_held_views, within_m, min_frames, within_s),
        lambda: _credit_of_frames(tape, simspec, within_m, min_frames, within_s),
        simspec,
    )
    actor = sightings.actor[rows]
    return ActorViews(actor, sightings.time_s[rows], credit[sightings.frame[rows], actor])


def _credit_of_frames(
    tape: Tape, simspec: SimSpec, within_m: float, min_frames: int, within_s: float
) -> Floats:
    """(f, k) the greatest credibility of a message sent up to `within_s` after a frame that holds a member of the cast."""
    messages, truth = TrackMessages.of(tape, simspec), GroundTruth.of(tape, simspec)
    credit = messages.holdings(min_frames).credit(range(len(truth.cast)), within_m)
    exposed_s = np.array([frame.exposed.s for frame in tape.frames])
    # Messages that were sent after the frame and soon: a session that ends before has none.
    first, last = np.searchsorted(messages.time_s, [exposed_s, exposed_s + within_s])
    # Frames come more often than messages: many have the same ones after them.
    _, distinct, of_frame = np.unique(
        first * (len(credit) + 1) + last, return_index=True, return_inverse=True
    )
    greatest = [credit[first[row] : last[row]].max(axis=0, initial=0.0) for row in distinct]
    return np.array(greatest).reshape(-1, len(truth.cast))[of_frame]


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
    messages = TrackMessages.of(tape, simspec)
    is_grown = messages.per_message(messages.mature(FRESH_FRAMES)) > 0
    beliefs = messages.credibility(FRESH_FRAMES)[is_grown].tolist()
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
    messages = TrackMessages.of(tape, simspec)
    right = messages.right(within_m).tolist()
    mature = [(row, messages.tracks[row]) for row in np.flatnonzero(messages.mature(min_frames)).tolist()]
    last = {track.id: (track.confidence, right[row]) for row, track in mature}
    if not last:
        return nothing_shown(tape.end_s, "the agent holds no track at all")
    stated = sum(confidence for confidence, _ in last.values()) / len(last)
    right_share = sum(is_right for _, is_right in last.values()) / len(last)
    text = f"{len(last)} tracks are stated with a mean confidence of {stated:.2f}; {right_share:.2f} of them are right"
    return Finding(1.0 - abs(stated - right_share), (Evidence(time_s=tape.end_s, text=text),))
