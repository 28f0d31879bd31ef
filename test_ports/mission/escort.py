"""Measures of an escort: staying with a convoy, and warning it of who waits beside its road.

Considered only when the mission has an escort (`mission.escort`) that moves for `min_moving_s`.
"""

from __future__ import annotations

import math

import numpy as np

from bench.arrays import Bools, Floats
from bench.contracts import EscortDocument, Evidence, Tape, convoy_places_m, escort_document
from bench.simspec import ENDING_ORDERS, PAUSES, SimSpec

from .._declaration import Finding, consider, measure, not_considered, nothing_shown
from .._time_shares import begins
from .._verdicts import Verdict, share_right
from ..ground_truth import FlownTrack, GroundTruth
from ..reports.credibility import known_subjects, report_credibility

NO_ESCORT = "the mission escorts nobody"

Span = tuple[float, float]

CALLED_OFF_UNTIL = PAUSES | dict.fromkeys(ENDING_ORDERS, "")
"""Orders that call the vehicle away from the convoy, and the kind of order that ends this."""


@measure
def convoy_accompanied(tape: Tape, simspec: SimSpec, *, min_moving_s: float = 10.0) -> Finding:
    """Share of the time in which the convoy moves, once the vehicle is out, that the vehicle is with it.

    The vehicle is out when it is in the air and farther than 40 m from home. It is with the convoy when it is
    out and within `mission.escort.within_m` of one of its members, horizontally. The time runs to when the
    convoy is to stop, or to the time limit, also if the agent ends the run before. Left out is the time for
    which an order (`hold`, `hand_over`, `return`, `abort`, `deactivate`) or `rules.link_lost` calls the vehicle
    away. 0 for a vehicle that was never out while the convoy moved.
    """
    escort = escort_document(simspec)
    if escort is None:
        return not_considered(NO_ESCORT)
    moving = _moving(escort, simspec)
    away = _called_away(tape, simspec)
    long_enough = _length_s(moving, away) >= min_moving_s
    consider(long_enough, f"the convoy moves for less than {min_moving_s:g} s in which the agent is free")
    track, truth = FlownTrack.of(tape, simspec), GroundTruth.of(tape, simspec)
    out = track.out()
    span = (max(moving[0], track.first_s(out)), moving[1])
    planned_s = _length_s(span, away)
    if planned_s < min_moving_s:
        return nothing_shown(tape.end_s, "the vehicle was not out while the convoy moved")
    members = [index for index, member in enumerate(truth.cast) if member.group == _group(simspec)]
    distance_m = track.distance_m(members).min(axis=1)
    free = _within(track.time_s, span) & ~_any_within(track.time_s, away)
    with_it = out & free & (distance_m <= escort.within_m)
    share = min(1.0, track.seconds(with_it) / planned_s)
    evidence = [
        Evidence(time_s=float(track.time_s[row]), text=f"{distance_m[row]:.0f} m from the convoy")
        for row in begins(free & ~with_it)
    ]
    summary = Evidence(time_s=span[0], text=f"with the convoy for {share:.0%} of {planned_s:.0f} s")
    return Finding(share, (*evidence, summary))


@measure
def convoy_warned(tape: Tape, simspec: SimSpec, *, min_moving_s: float = 10.0) -> Finding:
    """Share of the adversaries beside the convoy's road that are reported before the convoy is near them.

    Beside the road are those to which the convoy, as planned, comes within `mission.escort.warn_before_m`, and
    was not so near at its start. The report must show knowledge of the adversary and arrive while the
    operator's link is up, before the first member of the convoy is that near. Weighted by credibility.
    Considered when there is such an adversary.
    """
    escort = escort_document(simspec)
    if escort is None:
        return not_considered(NO_ESCORT)
    moving, truth = _moving(escort, simspec), GroundTruth.of(tape, simspec)
    near_s = _near_s(escort, moving, truth) if _length_s(moving, []) >= min_moving_s else {}
    consider(near_s, "no adversary is beside the road that the convoy drives")
    down = [(outage.at_s, outage.until_s) for outage in simspec.outages if outage.kind == "operator_link"]
    heard_s: dict[int, float] = {}
    for report, subject in known_subjects(truth, tape):
        if subject in near_s and not any(begin <= report.time.s < end for begin, end in down):
            heard_s.setdefault(subject, report.time.s)
    verdicts = []
    for actor, arrival_s in near_s.items():
        name, report_s = truth.cast[actor].id, heard_s.get(actor, math.inf)
        stated = "never reported" if math.isinf(report_s) else f"reported at {report_s:.1f} s"
        text = f"{name}: {stated}; the convoy is near it at {arrival_s:.1f} s"
        verdicts.append(Verdict(arrival_s, report_s < arrival_s, text))
    return share_right(verdicts, belief=report_credibility(truth, tape))


def _group(simspec: SimSpec) -> str:
    assert simspec.mission.escort is not None
    return simspec.mission.escort.group


def _moving(escort: EscortDocument, simspec: SimSpec) -> Span:
    """When the convoy is planned to move, within the time limit."""
    limit_s = simspec.mission.time_limit_s
    return escort.depart_s, limit_s if escort.halt_s is None else min(escort.halt_s, limit_s)


def _near_s(escort: EscortDocument, moving: Span, truth: GroundTruth) -> dict[int, float]:
    """When the convoy is planned to be near each adversary beside its road for the first time."""
    # Half a second of driving is a few metres: less than the place of a report is worth.
    times_s = np.arange(moving[0], moving[1] + 0.5, 0.5)
    convoy_m = convoy_places_m(escort, times_s)
    arrivals: dict[int, float] = {}
    for actor in truth.of_role("adversary"):
        places_m = np.array([truth.at(float(time_s))[actor] for time_s in times_s])
        in_reach = (np.linalg.norm(convoy_m - places_m[:, None], axis=2) <= escort.warn_before_m).any(axis=1)
        if in_reach.any() and not in_reach[0]:
            arrivals[actor] = float(times_s[in_reach.argmax()])
    return arrivals


def _called_away(tape: Tape, simspec: SimSpec) -> list[Span]:
    """The spans in which an order, or what the rules say about a lost link, calls the vehicle away."""
    spans: list[Span] = []
    for number, order in enumerate(tape.orders):
        if order.value.kind in CALLED_OFF_UNTIL:
            end = CALLED_OFF_UNTIL[order.value.kind]
            later = (other.time.s for other in tape.orders[number + 1 :] if other.value.kind == end)
            spans.append((order.time.s, next(later, math.inf)))
    rules = simspec.rules
    if rules.link_lost != "continue":
        outages = (outage for outage in simspec.outages if outage.kind == "operator_link")
        spans += [(outage.at_s + rules.link_lost_after_s, outage.until_s) for outage in outages]
    return [span for span in spans if span[1] > span[0]]


def _length_s(span: Span, away: list[Span]) -> float:
    """Length of a span without those in `away`, which may overlap."""
    left_s, reached_s = 0.0, span[0]
    for begin_s, end_s in sorted(away):
        left_s += max(0.0, min(begin_s, span[1]) - reached_s)
        reached_s = max(reached_s, end_s)
    return left_s + max(0.0, span[1] - reached_s)


def _within(time_s: Floats, span: Span) -> Bools:
    return np.asarray((time_s >= span[0]) & (time_s < span[1]))


def _any_within(time_s: Floats, spans: list[Span]) -> Bools:
    within: Bools = np.zeros(len(time_s), dtype=np.bool_)
    for span in spans:
        within |= _within(time_s, span)
    return within
