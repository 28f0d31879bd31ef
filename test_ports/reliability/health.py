"""Measures of life: whether vehicle and agent get through the run and are heard.

Unless a measure says otherwise, it is always considered, and 0 when the vehicle never left the ground: what is
not used does not fail.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from bench.contracts import Evidence, Tape, VehicleTopics
from bench.simspec import SimSpec

from .._declaration import Finding, Positive, consider, measure, nothing_shown, shown
from .._time_shares import fresh_share, out_of_home, unexposed
from ..ground_truth import FlownTrack, outcome_by_agent_fault

NEVER_FLEW = "the vehicle never left the ground"


@measure
def no_crash(tape: Tape, simspec: SimSpec) -> Finding:
    """1 unless the vehicle crashed.

    Considered when the vehicle crashed, or was in the air farther than 40 m from home for at least 10 s.
    """
    crashed = next((state for state in tape.condition if state.value.crashed), None)
    if crashed is not None:
        return nothing_shown(crashed.time.s, "the vehicle crashed")
    track = FlownTrack.of(tape, simspec)
    nowhere = np.zeros(len(track.time_s), dtype=np.bool_)
    finding = unexposed(track, out_of_home(track), nowhere)
    return shown(1.0, tape.end_s, "whole at the end") if finding is None else finding


@measure
def agent_lived(tape: Tape, simspec: SimSpec) -> Finding:
    """1 unless the session ended as agent_crashed, agent_timeout, agent_never_connected, agent_protocol or agent_flooded."""
    outcome = outcome_by_agent_fault(tape)
    if outcome is not None:
        return nothing_shown(tape.end_s, f"the session ended: {outcome}")
    if not FlownTrack.of(tape, simspec).airborne.any():
        return nothing_shown(tape.end_s, NEVER_FLEW)
    return shown(1.0, tape.end_s, "alive at the end")


@measure
def documents_well_formed(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the agent's messages that are valid documents; 0 when none is.

    A vehicle that never left the ground counts as any other.
    """
    # Only topics of the agent: a malformed document of the bench is not its fault.
    topics = VehicleTopics(simspec.vehicle.name).from_agent
    malformed = {topic: tape.malformed[topic] for topic in topics if tape.malformed.get(topic)}
    streams = (tape.reports, tape.decisions, tape.status, tape.tracks, tape.answers, tape.consent_requests)
    valid = sum(map(len, streams))
    if not valid:
        return nothing_shown(tape.end_s, "the agent sent no valid document")
    evidence = tuple(
        Evidence(time_s=tape.end_s, text=f"{count} on {topic} are not valid documents")
        for topic, count in malformed.items()
    )
    return Finding(valid / (valid + sum(malformed.values())), evidence)


@measure
def status_alive(
    tape: Tape, simspec: SimSpec, *, of: Literal["status", "any"] = "status", max_gap_s: float = 10.0
) -> Finding:
    """Share of the recorded time at which the last status is at most `max_gap_s` old.

    `of: any` takes the last document of any kind instead.
    """
    sent_s = [message.time.s for message in tape.status]
    if of == "any":
        for stream in (tape.reports, tape.decisions, tape.tracks, tape.answers, tape.consent_requests):
            sent_s += [message.time.s for message in stream]
    track = FlownTrack.of(tape, simspec)
    if not track.airborne.any():
        return nothing_shown(tape.end_s, NEVER_FLEW)
    always = np.ones(len(track.time_s), dtype=np.bool_)
    return fresh_share(
        track, np.array(sorted(sent_s)), max_gap_s, "status" if of == "status" else "document", always
    )


@measure
def steady_reaction(tape: Tape, simspec: SimSpec, *, limit_s: Positive = 5.0) -> Finding:
    """1 - (slowest - fastest first answer to an order) / `limit_s`, at least 0.

    Considered when two orders are given. 0 when fewer
    than two were answered.
    """
    given = [order for order in simspec.orders if order.at_s < simspec.mission.time_limit_s]
    consider(len(given) >= 2, "fewer than two orders are given")
    reactions = []
    for order in tape.orders:
        answers = (a for a in tape.answers if a.value.order == order.value.id and a.time >= order.time)
        # A second answer to the same order is no reaction.
        if (first := next(answers, None)) is not None:
            reactions.append((first.time.s - order.time.s, first))
    if len(reactions) < 2:
        return nothing_shown(tape.end_s, f"{len(reactions)} orders were answered")
    slowest_s, slowest = max(reactions, key=lambda reaction: reaction[0])
    fastest_s, fastest = min(reactions, key=lambda reaction: reaction[0])
    text = f"order {slowest.value.order} answered after {slowest_s:.1f} s, {fastest.value.order} after {fastest_s:.1f} s"
    return shown(max(0.0, 1.0 - (slowest_s - fastest_s) / limit_s), slowest.time.s, text)
