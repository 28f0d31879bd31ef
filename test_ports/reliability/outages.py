"""Measures of outages: what the agent does without the operator's link or without detections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.contracts import Tape, TargetReport, Timed
from bench.simspec import MOTION_ORDERS, SimSpec

from .._declaration import Finding, consider, measure, nothing_shown
from .._verdicts import Verdict, about_reports, share_right
from ..ground_truth import FaultSpan, FlownTrack, GroundTruth, faults_met, in_span
from ..perception.track_messages import TrackMessages
from ..reports.credibility import NO_KNOWLEDGE, known_reports
from ..reports.places import Place, has_same_place

SAME_PLACE_M = 20.0
"""Two reports of one class at most this far apart are about one thing. Chosen, not measured."""

HOLD_SETTLING_S = 10.0
"""The time that an agent which is to hold has to come to a stop."""

HOLD_MPS = 1.5
"""Slower than this, a vehicle holds: gusts push one that hovers to and fro. Chosen, not measured."""

HOLD_SHARE = 0.8
"""Share of the time for which it must be so slow: one gust does not end a hold. Chosen, not measured."""

CONTINUE_M = 10.0
"""A vehicle that has come this far during an outage goes on with its mission. Chosen, not measured."""


@measure
def link_lost_obeyed(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the long outages of the operator's link in which the vehicle did what `rules.link_lost` says.

    An outage is long when it lasts more than `rules.link_lost_after_s`. The rest of the outage after that
    time is judged. A vehicle that had not been out by the end of the outage (in the air, farther than 40 m from home,
    for 10 s) fails: to hover over home holds nothing. One that is on the ground for the whole rest obeys. Otherwise:

    - `hold`: slower than 1.5 m/s for four fifths of the rest in the air, not counting its first 10 s.
    - `return`: nearer home at the end of the rest than at its beginning, by more than 1 m, or down.
    - `continue`: moved by 10 m or more, or down.

    A vehicle that an order to hold keeps standing, and that stands, as above, may do so whatever the rule says: the
    order to go on cannot reach it. Such an outage is left out. Considered when there is another.
    """
    rules = simspec.rules
    outages = faults_met(tape, simspec, "operator_link")
    long_outages = [outage for outage in outages if outage.until_s - outage.at_s > rules.link_lost_after_s]
    consider(long_outages, f"the operator's link is never lost for more than {rules.link_lost_after_s:g} s")
    track = FlownTrack.of(tape, simspec)
    verdicts = []
    for outage in long_outages:
        obeyed = _obeyed(track, simspec, outage)
        if obeyed or not _kept_standing(tape, track, simspec, outage):
            text = f"link lost at {outage.at_s:g} s: {'did' if obeyed else 'did not'} {rules.link_lost}"
            verdicts.append(Verdict(min(outage.at_s, tape.end_s), obeyed, text))
    consider(verdicts, "an order to hold stood while the operator's link was lost")
    return share_right(verdicts)


def _obeyed(track: FlownTrack, simspec: SimSpec, outage: FaultSpan) -> bool:
    rules = simspec.rules
    rest = track.between(outage.at_s + rules.link_lost_after_s, outage.until_s)
    rows = np.flatnonzero(rest)
    if not len(rows):
        return False
    # One that never began its mission obeys nothing by standing or hovering at home.
    if not track.went_out_by(outage.until_s):
        return False
    # On the ground for the whole rest, it can neither go astray nor need a way home: its mission is over.
    if not track.airborne[rows].any():
        return True
    if rules.link_lost == "hold":
        # The settling time counts from the moment at which the rule begins to hold, not from the outage.
        still_share = _still_share(
            track, outage.at_s + rules.link_lost_after_s + HOLD_SETTLING_S, outage.until_s
        )
        return still_share is None or still_share >= HOLD_SHARE
    down_at_end = not track.airborne[rows[-1]]
    if rules.link_lost == "return":
        return bool(track.from_home_m[rows[-1]] < track.from_home_m[rows[0]] - 1.0) or down_at_end
    # The greatest distance from the start of the rest: a circle that ends where it began has moved.
    moved_m = np.hypot(*(track.place_m[rows] - track.place_m[rows[0]]).T).max()
    return bool(moved_m >= CONTINUE_M) or down_at_end


def _still_share(track: FlownTrack, since_s: float, until_s: float) -> float | None:
    """Share of the time in the air in a span for which the vehicle stands still; None without such time."""
    return track.time_share(track.speed_mps < HOLD_MPS, track.between(since_s, until_s) & track.airborne)


def _kept_standing(tape: Tape, track: FlownTrack, simspec: SimSpec, outage: FaultSpan) -> bool:
    """Whether it was out, stood, and the last order about where to go before the outage was to hold."""
    orders = [
        order.value.kind
        for order in tape.orders
        if order.time.s <= outage.at_s and order.value.kind in MOTION_ORDERS
    ]
    since_s = outage.at_s + simspec.rules.link_lost_after_s
    still_share = _still_share(track, since_s, outage.until_s)
    stood = still_share is not None and still_share >= HOLD_SHARE
    return orders[-1:] == ["hold"] and track.went_out_by(outage.until_s) and stood


@measure
def reports_resent(tape: Tape, simspec: SimSpec, *, within_s: float = 30.0) -> Finding:
    """Share of the reports lost in an outage of the operator's link that were made again within `within_s`
    after it.

    A report is lost when it arrives during the outage and no earlier report about the same thing arrived
    while the link was up. Two reports of one class within 20 m of each other are about the same thing. Only reports that show
    knowledge count: 1 when none of these was lost, and 0 without any. Considered when the link is ever down and
    intelligence names an adversary.
    """
    outages, truth = faults_met(tape, simspec, "operator_link"), GroundTruth.of(tape, simspec)
    exercised = outages and truth.targets()
    consider(exercised, "the operator's link is never lost, or intelligence names no adversary")
    known = known_reports(truth, tape)
    if not known:
        return nothing_shown(tape.end_s, NO_KNOWLEDGE)
    # An outage at a time, because all that arrived in one compare with the same reports before and after it.
    unheard_count, lost = 0, []
    for outage in outages:
        unheard = _unheard(known, outages, outage)
        unheard_count += len(unheard)
        resent = [
            other.value
            for other in tape.reports
            if in_span(other.time.s, outage.until_s, outage.until_s + within_s)
        ]
        lost += _about_none_of(unheard, resent)
    share = 1.0 - len(lost) / unheard_count if unheard_count else 1.0
    return Finding(share, about_reports(lost, "was not received, and not repeated in time"))


def _unheard(
    reports: list[Timed[TargetReport]], outages: list[FaultSpan], outage: FaultSpan
) -> list[Timed[TargetReport]]:
    """Those of the reports that arrived in an outage, about things of which no report had been received before."""
    arrived = [report for report in reports if outage.at_s <= report.time.s < outage.until_s]
    # What came during the outage was not received either, so what is earlier than a report of it came before its onset.
    received = [
        other.value
        for other in reports
        if other.time.s < outage.at_s
        and not any(down.at_s <= other.time.s < down.until_s for down in outages)
    ]
    return _about_none_of(arrived, received)


def _about_none_of(reports: list[Timed[TargetReport]], places: Sequence[Place]) -> list[Timed[TargetReport]]:
    """The reports that are about the same thing as none of the others."""
    same = has_same_place([report.value for report in reports], places, SAME_PLACE_M)
    return [report for report, has_match in zip(reports, same, strict=True) if not has_match]


@measure
def blind_reports_withheld(tape: Tape, simspec: SimSpec, *, after_s: float = 3.0) -> Finding:
    """Share of the reports that were not made blindly.

    A report is blind when it arrives more than `after_s` into an outage of the detections, and until then the
    agent had neither shown a track of that class within 20 m nor made a report of that class there.
    0 without a report that shows knowledge. Considered when the detections ever fail.
    """
    outages = faults_met(tape, simspec, "detections")
    consider(outages, "the detections never fail")
    if not known_reports(GroundTruth.of(tape, simspec), tape):
        return nothing_shown(tape.end_s, NO_KNOWLEDGE)
    # Sorted, so that the evidence is in order of time where outages overlap.
    rows = sorted(
        row for outage in outages for row in _blind_rows(tape, simspec, outage.at_s + after_s, outage.until_s)
    )
    blind = about_reports(
        [tape.reports[row] for row in rows], "is about something that could not be detected"
    )
    return Finding(1.0 - len(blind) / len(tape.reports), blind)


def _blind_rows(tape: Tape, simspec: SimSpec, since_s: float, until_s: float) -> list[int]:
    """Rows of the reports after one moment and before another about things that nothing before that span had named."""
    rows = [row for row, report in enumerate(tape.reports) if since_s < report.time.s < until_s]
    reported_places: list[Place] = [report.value for report in tape.reports if report.time.s <= since_s]
    messages = TrackMessages.of(tape, simspec)
    # In order of arrival.
    reported_places += messages.tracks[: (messages.time_s[messages.message] <= since_s).sum()]
    same = has_same_place([tape.reports[row].value for row in rows], reported_places, SAME_PLACE_M)
    return [row for row, has_match in zip(rows, same, strict=True) if not has_match]
