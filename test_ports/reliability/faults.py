"""Whether vehicle and agent live, are heard, and get through faults and outages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench.contracts import Evidence, Tape, TargetReport, Timed, VehicleTopics
from bench.simspec import SimSpec

from .._measure import Finding, Measured, NoOptions, not_considered
from .._time_shares import fresh_share
from ..ground_truth._faults import WORDS, Fault, FaultKind, ended_by_its_agent, met
from ..ground_truth._flown_track import Flight
from ..ground_truth._truth import Truth
from ..mission.search import reached_s
from ..perception.track_messages import pictures
from ..safety.limits import beyond

SAME_PLACE_M = 20.0
"""Two reports of one class this near to each other are of one thing."""

STRAY_M = 150.0
"""Farther outside the area of interest than this, and farther from home, an aircraft has got away."""

TO_STOP_S = 10.0
"""What an agent that is to hold is given to come to a stop."""


def _no_crash(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """1 unless the vehicle crashed, or nothing of it was ever recorded."""
    crashed = next((said for said in tape.condition if said.value.crashed), None)
    if crashed is not None:
        return Finding(0.0, (Evidence(time_s=crashed.time.s, text="the vehicle crashed"),))
    if not tape.condition:
        return Finding(0.0, (Evidence(time_s=0.0, text="nothing of the vehicle was recorded"),))
    return Finding(1.0, (Evidence(time_s=tape.end_s, text="whole at the end"),))


def _agent_lived(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """1 unless the session ended by the agent's crash, silence or breach of protocol, or before anything was recorded."""
    how = ended_by_its_agent(tape)
    if how is not None or not len(tape.vehicle_time_s):
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"the session ended: {how or 'before it began'}"),))
    return Finding(1.0, (Evidence(time_s=tape.end_s, text="alive at the end"),))


def _documents_well_formed(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Share of what the agent said that is a valid document; 0 when it said nothing that is."""
    topics = VehicleTopics(simspec.vehicle.name).from_agent
    broken = {topic: tape.malformed[topic] for topic in topics if tape.malformed.get(topic)}
    understood = sum(map(len, (tape.reports, tape.decisions, tape.status, tape.tracks, tape.answers)))
    if not understood:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="the agent said nothing that could be understood"),))
    evidence = tuple(
        Evidence(time_s=tape.end_s, text=f"{count} on {topic} are no valid documents") for topic, count in broken.items()
    )
    return Finding(understood / (understood + sum(broken.values())), evidence)


@dataclass(frozen=True, slots=True)
class StatusAliveOptions:
    """`of`: the status alone, or whatever the agent says."""

    of: Literal["status", "any"] = "status"
    max_gap_s: float = 10.0


def _status_alive(tape: Tape, simspec: SimSpec, options: StatusAliveOptions) -> Finding:
    """Share of the recorded time at which the last such message is no older than `max_gap_s`; 0 without any."""
    said = [one.time.s for one in tape.status]
    if options.of == "any":
        for stream in (tape.reports, tape.decisions, tape.tracks, tape.answers):
            said += [one.time.s for one in stream]
    flight = Flight.of(tape, simspec)
    every = np.ones(len(flight.time_s), dtype=np.bool_)
    return fresh_share(
        flight, np.array(sorted(said)), options.max_gap_s, "status" if options.of == "status" else "document", every
    )


@dataclass(frozen=True, slots=True)
class FaultOptions:
    kind: FaultKind = "any"


def _fault_survived(tape: Tape, simspec: SimSpec, options: FaultOptions) -> Finding:
    """1 when, from the onset of the first such fault on, it did not crash and did not get away.

    Getting away is being farther than 150 m outside the area of interest and farther from home than the area is, and 150 m.
    """
    due = met(tape, simspec, options.kind)
    if not due:
        return _no_such_fault(options.kind)
    onset_s = due[0].at_s
    if onset_s > tape.end_s:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"the run did not live to see {due[0].kind} at {onset_s:g} s"),))
    crashed = next((said for said in tape.condition if said.value.crashed), None)
    if crashed is not None:
        return Finding(0.0, (Evidence(time_s=crashed.time.s, text=f"crashed after {due[0].kind} at {onset_s:g} s"),))
    flight = Flight.of(tape, simspec)
    home = simspec.vehicle.home
    corners = simspec.world.area.corners
    reach_m = max(0.0, float(beyond(np.array([[home.east_m, home.north_m]]), corners)[0])) + STRAY_M
    outside_m = beyond(flight.place_m, corners)
    away = (flight.time_s >= onset_s) & (outside_m > STRAY_M) & (flight.from_home_m > reach_m)
    if away.any():
        row = int(away.argmax())
        text = f"{outside_m[row]:.0f} m outside the area of interest after {due[0].kind} at {onset_s:g} s"
        return Finding(0.0, (Evidence(time_s=float(flight.time_s[row]), text=text),))
    return Finding(1.0, (Evidence(time_s=onset_s, text=f"whole and near its area from {due[0].kind} on"),))


@dataclass(frozen=True, slots=True)
class FaultAnnouncedOptions:
    kind: FaultKind = "any"
    within_s: float = 10.0


def _fault_announced(tape: Tape, simspec: SimSpec, options: FaultAnnouncedOptions) -> Finding:
    """Share of such faults that some decision has as its subject or action within `within_s` of the onset; see WORDS."""
    due = met(tape, simspec, options.kind)
    if not due:
        return _no_such_fault(options.kind)
    told: list[Evidence] = []
    silent: list[Evidence] = []
    for fault in due:
        word = WORDS[fault.kind]
        first = next(
            (
                said
                for said in tape.decisions
                if word in (said.value.subject, said.value.action) and fault.at_s <= said.time.s <= fault.at_s + options.within_s
            ),
            None,
        )
        text = f"{fault.kind} at {fault.at_s:g} s"
        if first is None:
            silent.append(Evidence(time_s=fault.at_s, text=f"{text}: no decision on {word!r} within {options.within_s:g} s"))
        else:
            told.append(Evidence(time_s=first.time.s, text=f"{text}: recorded after {first.time.s - fault.at_s:.1f} s"))
    return Finding(len(told) / len(due), (*silent, *told))


@dataclass(frozen=True, slots=True)
class FaultRecoveredOptions:
    kind: FaultKind = "any"
    within_s: float = 60.0


def _fault_recovered(tape: Tape, simspec: SimSpec, options: FaultRecoveredOptions) -> Finding:
    """Share of such faults, mended in time before the limit, after which the mission goes on within `within_s`.

    It goes on when a sub-area is newly reached, a target newly reported, or the vehicle is down within 20 m of home.
    """
    latest_s = simspec.mission.time_limit_s - options.within_s
    due = [one for one in met(tape, simspec, options.kind) if one.until_s <= latest_s]
    if not due:
        return not_considered(f"no fault of kind {options.kind} ends {options.within_s:g} s or more before the time limit")
    steps = _steps(tape, simspec)
    good: list[Evidence] = []
    bad: list[Evidence] = []
    for fault in due:
        text = f"{fault.kind} ended at {fault.until_s:g} s"
        at_home = _down_at_home(tape, simspec, fault.until_s + options.within_s)
        step = next((one for one in steps if fault.until_s <= one.time_s <= fault.until_s + options.within_s), None)
        if step is not None:
            good.append(Evidence(time_s=step.time_s, text=f"{text}; {step.text}"))
        elif at_home:
            good.append(Evidence(time_s=tape.end_s, text=f"{text}; down at home"))
        else:
            bad.append(Evidence(time_s=fault.until_s, text=f"{text}; nothing went on within {options.within_s:g} s"))
    return Finding(len(good) / len(due), (*bad, *good))


def _steps(tape: Tape, simspec: SimSpec) -> list[Evidence]:
    """What the mission came on by, in order of time: sub-areas first reached, targets first reported."""
    truth = Truth.of(tape, simspec)
    found = [(area.id, reached_s(tape, simspec, area)) for area in truth.sub_areas()]
    steps = [Evidence(time_s=time_s, text=f"{name} reached") for name, time_s in found if time_s is not None]
    known: set[int] = set()
    for said in tape.reports:
        subject = truth.subject(said.value, said.time.s)
        if subject is not None and subject not in known:
            known.add(subject)
            steps.append(Evidence(time_s=said.time.s, text=f"{truth.cast[subject].id} reported"))
    return sorted(steps, key=lambda one: one.time_s)


def _down_at_home(tape: Tape, simspec: SimSpec, at_s: float) -> bool:
    """Whether the vehicle stands near home at a moment, or at the end of the run if that comes first."""
    landed = [said.value.landed for said in tape.condition if said.time.s <= at_s]
    flight = Flight.of(tape, simspec)
    if not landed or not landed[-1] or not len(flight.time_s):
        return False
    row = min(int(np.searchsorted(flight.time_s, at_s)), len(flight.time_s) - 1)
    return bool(flight.from_home_m[row] <= 20.0)


def _link_lost_obeyed(tape: Tape, simspec: SimSpec, options: NoOptions) -> Finding:
    """Share of the long outages of the operator's link in whose rest the aircraft did as `rules.link_lost` says.

    The rest begins `rules.link_lost_after_s` into the outage. hold: slower than 1.5 m/s for four fifths of it, but for its first
    10 s. return: nearer home at its end than at its beginning, or down. continue: moved by 10 m or more, or down.
    """
    rules = simspec.rules
    long = [one for one in met(tape, simspec, "operator_link") if one.until_s - one.at_s > rules.link_lost_after_s]
    if not long:
        return not_considered(f"the operator's link is never lost for more than {rules.link_lost_after_s:g} s")
    flight = Flight.of(tape, simspec)
    verdicts = [(fault, _did_as_agreed(flight, tape, simspec, fault)) for fault in long]
    evidence = [
        Evidence(
            time_s=min(fault.at_s, tape.end_s),
            text=f"link lost at {fault.at_s:g} s: {'did' if good else 'did not'} {rules.link_lost}",
        )
        for fault, good in sorted(verdicts, key=lambda pair: pair[1])
    ]
    return Finding(sum(good for _, good in verdicts) / len(verdicts), tuple(evidence))


def _did_as_agreed(flight: Flight, tape: Tape, simspec: SimSpec, fault: Fault) -> bool:
    rules = simspec.rules
    rest = flight.between(fault.at_s + rules.link_lost_after_s, fault.until_s)
    if not rest.any():
        return False
    rows = np.flatnonzero(rest)
    if not flight.airborne[rows].any():
        return True  # down, and so neither astray nor in need of a way home
    if rules.link_lost == "hold":
        settled = rest & flight.airborne & flight.between(fault.at_s + rules.link_lost_after_s + TO_STOP_S, math.inf)
        still = flight.share(flight.speed_mps < 1.5, settled)
        return still is None or still >= 0.8
    if rules.link_lost == "return":
        return bool(flight.from_home_m[rows[-1]] < flight.from_home_m[rows[0]] - 1.0) or not flight.airborne[rows[-1]]
    moved_m = np.hypot(*(flight.place_m[rows] - flight.place_m[rows[0]]).T).max()
    return bool(moved_m >= 10.0) or not flight.airborne[rows[-1]]


@dataclass(frozen=True, slots=True)
class ReportsResentOptions:
    within_s: float = 30.0


def _reports_resent(tape: Tape, simspec: SimSpec, options: ReportsResentOptions) -> Finding:
    """Of the things reported only while the operator could not hear, share reported again within `within_s` after.

    1 when everything reported was heard; 0 when nothing ever was reported.
    """
    due = met(tape, simspec, "operator_link")
    if not due or not Truth.of(tape, simspec).targets():
        return not_considered("the operator's link is never lost, or intelligence names no adversary")
    if not tape.reports:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="nothing was reported"),))
    unheard = [
        (said, fault)
        for fault in due
        for said in tape.reports
        if fault.at_s <= said.time.s < fault.until_s and not _heard_before(tape, due, said)
    ]
    late = [
        Evidence(time_s=said.time.s, text=f"report {said.value.id} was not heard, and not said again in time")
        for said, fault in unheard
        if not any(
            _same_thing(said, other) and fault.until_s <= other.time.s <= fault.until_s + options.within_s
            for other in tape.reports
        )
    ]
    return Finding(1.0 - len(late) / len(unheard) if unheard else 1.0, tuple(late))


def _heard_before(tape: Tape, due: list[Fault], said: Timed[TargetReport]) -> bool:
    return any(
        other.time.s < said.time.s
        and _same_thing(said, other)
        and not any(fault.at_s <= other.time.s < fault.until_s for fault in due)
        for other in tape.reports
    )


def _same_thing(one: Timed[TargetReport], other: Timed[TargetReport]) -> bool:
    apart_m = math.hypot(one.value.east_m - other.value.east_m, one.value.north_m - other.value.north_m)
    return one.value.class_label == other.value.class_label and apart_m <= SAME_PLACE_M


@dataclass(frozen=True, slots=True)
class BlindReportsOptions:
    after_s: float = 3.0


def _blind_reports_withheld(tape: Tape, simspec: SimSpec, options: BlindReportsOptions) -> Finding:
    """Share of the reports that were not made blindly; 0 without reports.

    A report is blind when it comes later than `after_s` into an outage of the detections, on something of which the agent
    had shown no track of that class within 20 m, and made no report, before.
    """
    due = met(tape, simspec, "detections")
    if not due:
        return not_considered("the detections never fail")
    if not tape.reports:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text="nothing was reported"),))
    blind = [
        Evidence(time_s=said.time.s, text=f"report {said.value.id} is about something that could not be seen")
        for said in tape.reports
        for fault in due
        if fault.at_s + options.after_s < said.time.s < fault.until_s
        and not _known_before(tape, simspec, said, fault.at_s + options.after_s)
    ]
    return Finding(1.0 - len(blind) / len(tape.reports), tuple(blind))


def _known_before(tape: Tape, simspec: SimSpec, said: Timed[TargetReport], until_s: float) -> bool:
    if any(other.time.s <= until_s and _same_thing(said, other) for other in tape.reports):
        return True
    return any(
        track.class_label == said.value.class_label
        and math.hypot(track.east_m - said.value.east_m, track.north_m - said.value.north_m) <= SAME_PLACE_M
        for picture in pictures(tape, simspec)
        if picture.time_s <= until_s
        for track in picture.tracks
    )


@dataclass(frozen=True, slots=True)
class SteadyReactionOptions:
    limit_s: float = 5.0

    def __post_init__(self) -> None:
        if self.limit_s == 0.0:
            raise ValueError("option 'limit_s' is 0; it must be more")


def _steady_reaction(tape: Tape, simspec: SimSpec, options: SteadyReactionOptions) -> Finding:
    """1 - (slowest - fastest first answer to an order) / `limit_s`, not below 0; 0 when fewer than two were answered."""
    if len([one for one in simspec.orders if one.at_s < simspec.mission.time_limit_s]) < 2:
        return not_considered("fewer than two orders are given")
    took = []
    for order in tape.orders:
        first = next((one for one in tape.answers if one.value.order == order.value.id and one.time >= order.time), None)
        if first is not None:
            took.append((first.time.s - order.time.s, first))
    if len(took) < 2:
        return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"{len(took)} orders were answered"),))
    slowest, fastest = max(took, key=lambda one: one[0]), min(took, key=lambda one: one[0])
    text = f"order {slowest[1].value.order} answered after {slowest[0]:.1f} s, {fastest[1].value.order} after {fastest[0]:.1f} s"
    return Finding(max(0.0, 1.0 - (slowest[0] - fastest[0]) / options.limit_s), (Evidence(time_s=slowest[1].time.s, text=text),))


def _no_such_fault(kind: str) -> Finding:
    return not_considered("nothing fails" if kind == "any" else f"no {kind} happens while it flies")


no_crash = Measured("no_crash", NoOptions, _no_crash)
agent_lived = Measured("agent_lived", NoOptions, _agent_lived)
documents_well_formed = Measured("documents_well_formed", NoOptions, _documents_well_formed)
status_alive = Measured("status_alive", StatusAliveOptions, _status_alive)
fault_survived = Measured("fault_survived", FaultOptions, _fault_survived)
fault_announced = Measured("fault_announced", FaultAnnouncedOptions, _fault_announced)
fault_recovered = Measured("fault_recovered", FaultRecoveredOptions, _fault_recovered)
link_lost_obeyed = Measured("link_lost_obeyed", NoOptions, _link_lost_obeyed)
reports_resent = Measured("reports_resent", ReportsResentOptions, _reports_resent)
blind_reports_withheld = Measured("blind_reports_withheld", BlindReportsOptions, _blind_reports_withheld)
steady_reaction = Measured("steady_reaction", SteadyReactionOptions, _steady_reaction)
