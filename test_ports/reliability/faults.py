"""Measures of faults: whether the aircraft survives them, and the agent announces them and recovers.

`kind` is that of a failure of the vehicle (`vehicle.failures`), of an outage (`outages`) or any. The measures are considered
when a fault of the kind begins before the time limit. A fault that is due after the session ended as completed is left
out. A fault that the run did not reach because it ended otherwise counts against the agent.
"""

from __future__ import annotations

import math

import numpy as np

from bench.contracts import Decision, Evidence, Tape, Timed
from bench.simspec import FAILURES, OUTAGES, SimSpec

from .._declaration import Finding, consider, measure, not_considered, nothing_shown, shown
from .._verdicts import Verdict, share_right
from ..ground_truth import (
    FaultKind,
    FlownTrack,
    GroundTruth,
    distance_beyond,
    faults_met,
    in_span,
    scheduled_faults,
)
from ..mission.search import first_reached_s
from ..reports.credibility import first_known_s

ANNOUNCED_AS = {kind: declared.subject for kind, declared in (FAILURES | OUTAGES).items()}
"""The word that a decision has as its subject or action when it is about a fault of that kind."""

FAULT_AFTERMATH_S = 30.0
"""So long after a fault its end and consequences may be announced. The reference agents' last word came 2 s after the end
of one; a failsafe may fly on for some ten seconds more.
"""

FAULT_WORDS = frozenset(ANNOUNCED_AS.values())

FLYAWAY_M = 150.0
"""Farther outside the area of interest than this, and farther from home, an aircraft has flown away.

Chosen.
"""


AT_HOME_M = 20.0
"""Down at most this far from home, its mission is over. More than what an order to return demands (15 m): a fault of the
GPS may have moved the landing. Chosen, not measured.
"""

DELIVERY_S = 1.0
"""A fault that ends so shortly before the order to land, or after it, leaves no mission that could go on."""


@measure
def fault_survived(tape: Tape, simspec: SimSpec, *, kind: FaultKind = "any") -> Finding:
    """1 when the vehicle neither crashed nor flew away after the onset of the first such fault.

    0 when it never went out (in the air, farther than 40 m from home, for 10 s): it survived nothing.

    It flew away when it was more than 150 m outside the area of interest, and its distance from home was more
    than that of the area plus 150 m.
    """
    due = faults_met(tape, simspec, kind)
    if not due:
        return _no_such_fault(kind)
    # The first onset: a crash after it counts whichever fault caused it, for the causes cannot be told apart.
    fault = due[0]
    onset_s = fault.at_s
    if onset_s > tape.end_s:
        return nothing_shown(tape.end_s, f"the run ended before {fault.kind} at {onset_s:g} s")
    crashed = next((state for state in tape.condition if state.value.crashed), None)
    if crashed is not None:
        return nothing_shown(crashed.time.s, f"crashed after {fault.kind} at {onset_s:g} s")
    track = FlownTrack.of(tape, simspec)
    if not track.went_out:
        return nothing_shown(onset_s, f"it was never out, so it survived no {fault.kind}")
    home = simspec.vehicle.home
    corners = simspec.world.area.corners
    # Home may lie outside the area of interest; the way between them is no flyaway.
    reach_m = (
        max(0.0, float(distance_beyond(np.array([[home.east_m, home.north_m]]), corners)[0])) + FLYAWAY_M
    )
    outside_m = distance_beyond(track.place_m, corners)
    away = (track.time_s >= onset_s) & (outside_m > FLYAWAY_M) & (track.from_home_m > reach_m)
    if away.any():
        row = int(away.argmax())
        text = f"{outside_m[row]:.0f} m outside the area of interest after {fault.kind} at {onset_s:g} s"
        return nothing_shown(float(track.time_s[row]), text)
    return shown(1.0, onset_s, f"whole and near its area from {fault.kind} on")


@measure
def fault_announced(
    tape: Tape,
    simspec: SimSpec,
    *,
    kind: FaultKind = "any",
    within_s: float = 10.0,
    after_s: float = FAULT_AFTERMATH_S,
) -> Finding:
    """Faults that the agent's decision log names in time, over all such faults and all false alarms.

    A decision names a fault when its `subject` or `action` is `gps` (for gps_off and gps_drift), `battery`
    (battery_drop), `motor` (motor_off), `link` (link_loss), `operator_link` or `detections`. It is in time
    within `within_s` of the onset. It is a false alarm when nothing that it names fails at that moment, or did
    in the `after_s` before. So a fault that is missed and a false alarm cost the same, and announcing
    everything always is worth next to nothing.
    """
    due = faults_met(tape, simspec, kind)
    if not due:
        return _no_such_fault(kind)
    verdicts = [
        Verdict(decision.time.s, False, f"false alarm: {', '.join(sorted(_named_faults(decision)))}")
        for decision in false_alarms(tape, simspec, after_s)
    ]
    for fault in due:
        word, text = ANNOUNCED_AS[fault.kind], f"{fault.kind} at {fault.at_s:g} s"
        named_s = (
            decision.time.s
            for decision in tape.decisions
            if word in (decision.value.subject, decision.value.action)
            and in_span(decision.time.s, fault.at_s, fault.at_s + within_s)
        )
        if (first_s := next(named_s, None)) is None:
            lacking = f"{text}: no decision on {word!r} within {within_s:g} s"
            verdicts.append(Verdict(fault.at_s, False, lacking))
        else:
            verdicts.append(Verdict(first_s, True, f"{text}: recorded after {first_s - fault.at_s:.1f} s"))
    return share_right(verdicts)


def false_alarms(tape: Tape, simspec: SimSpec, after_s: float) -> list[Timed[Decision]]:
    """The decisions that name a fault while nothing of that name fails, nor did in the `after_s` before."""
    faults = scheduled_faults(simspec)
    return [
        decision
        for decision in tape.decisions
        if (words := _named_faults(decision))
        and not any(
            ANNOUNCED_AS[fault.kind] in words
            and in_span(decision.time.s, fault.at_s, fault.until_s + after_s)
            for fault in faults
        )
    ]


def _named_faults(decision: Timed[Decision]) -> set[str]:
    return {decision.value.subject, decision.value.action} & FAULT_WORDS


@measure
def fault_recovered(
    tape: Tape, simspec: SimSpec, *, kind: FaultKind = "any", within_s: float = 60.0
) -> Finding:
    """Share of such faults after whose end the mission goes on within `within_s`.

    The mission goes on when a sub-area is reached for the first time, when an adversary is reported for the
    first time, or when the vehicle is down within 20 m of home after it had been out. Only faults that end `within_s` or more
    before the time limit count, and before an order to deactivate, which ends the mission. A fault by whose end every
    sub-area had been reached and every adversary reported is left out unless the vehicle comes down: no step was left.
    Considered when there is one.
    """
    # A fault that ends later leaves too little time to recover.
    latest_s = simspec.mission.time_limit_s - within_s
    track = FlownTrack.of(tape, simspec)
    # In the tick in which the link comes back, it delivers what was ordered meanwhile.
    ordered_s = track.first_s(track.ordered_down) - DELIVERY_S
    due = [
        fault
        for fault in faults_met(tape, simspec, kind)
        if fault.until_s <= latest_s and fault.until_s < ordered_s
    ]
    if not due:
        return not_considered(
            f"no fault of kind {kind} ends {within_s:g} s or more before the time limit, and before the order to land"
        )
    progress = mission_steps(tape, simspec)
    truth = GroundTruth.of(tape, simspec)
    every_step = len(truth.sub_areas()) + len(truth.targets_present())
    verdicts = []
    for fault in due:
        until_s, text = fault.until_s, f"{fault.kind} ended at {fault.until_s:g} s"
        steps = (step for step in progress if in_span(step.time_s, until_s, until_s + within_s))
        if (step := next(steps, None)) is not None:
            verdicts.append(Verdict(step.time_s, True, f"{text}; {step.text}"))
        elif down_at_home(tape, simspec, until_s + within_s):
            verdicts.append(Verdict(tape.end_s, True, f"{text}; down at home"))
        elif sum(step.time_s < until_s for step in progress) < every_step:
            stalled = f"{text}; the mission did not go on within {within_s:g} s"
            verdicts.append(Verdict(until_s, False, stalled))
    consider(verdicts, "no step of the mission was left when the fault ended")
    return share_right(verdicts)


def mission_steps(tape: Tape, simspec: SimSpec) -> list[Evidence]:
    """The steps of the mission in order of time: sub-areas first reached, targets first reported."""
    truth = GroundTruth.of(tape, simspec)
    reached = [(area.id, first_reached_s(tape, simspec, area)) for area in truth.sub_areas()]
    steps = [(time_s, f"{name} reached") for name, time_s in reached if math.isfinite(time_s)]
    steps += [
        (time_s, f"{truth.cast[subject].id} reported")
        for subject, time_s in first_known_s(truth, tape).items()
    ]
    # Stable: of one moment the areas first.
    return [Evidence(time_s=time_s, text=text) for time_s, text in sorted(steps, key=lambda step: step[0])]


def down_at_home(tape: Tape, simspec: SimSpec, at_s: float) -> bool:
    """Whether the vehicle stands near home at a moment, or at the end of the run if that comes first."""
    landed = [state.value.landed for state in tape.condition if state.time.s <= at_s]
    track = FlownTrack.of(tape, simspec)
    if not landed or not landed[-1] or not len(track.time_s):
        return False
    row = min(int(np.searchsorted(track.time_s, at_s)), len(track.time_s) - 1)
    return track.went_out_by(at_s) and bool(track.from_home_m[row] <= AT_HOME_M)


def _no_such_fault(kind: str) -> Finding:
    return not_considered("nothing fails" if kind == "any" else f"no {kind} happens during the mission")
