"""Findings that are shares of time: how long a flight keeps a limit, how long a message is fresh."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec

from ._declaration import Finding, not_considered, nothing_shown
from .ground_truth import MIN_OUT_S, NEAR_HOME_M, FlownTrack

SILENCE_KINDS = ("stop_reporting", "resume_reporting")

EXACT_S = 1e-9
"""Slack of a comparison of seconds, which are made of whole nanoseconds."""


@dataclass(frozen=True, slots=True)
class Exposure:
    """Where a rule could be broken: the samples at which it could, the least time of them, and in words."""

    samples: Bools
    min_s: float
    text: str


def out_of_home(track: FlownTrack, near_home_m: float = NEAR_HOME_M) -> Exposure:
    """Exposure of a rule that can be broken wherever the vehicle flies on its mission."""
    return Exposure(track.out(near_home_m), MIN_OUT_S, f"farther than {near_home_m:g} m from home")


def unexposed(track: FlownTrack, exposure: Exposure, broken: Bools) -> Finding | None:
    """The finding for a vehicle that was too short a time where the rule could be broken; None for any other.

    A rule that it did not break there is not considered; one that it broke all the same is failed, so that
    staying at home excuses nothing.
    """
    if track.seconds(exposure.samples) >= exposure.min_s:
        return None
    if broken.any():
        text = f"broken, and never {exposure.text} for {exposure.min_s:g} s"
        return nothing_shown(float(track.time_s[broken.argmax()]), text)
    return not_considered(f"the vehicle was never {exposure.text} for {exposure.min_s:g} s")


def share_kept(
    track: FlownTrack, holds: Bools, within: Bools, value: Floats, unit: str, exposure: Exposure | None = None
) -> Finding:
    """Share of the time in `within` for which `holds`, 0 without such time.

    Considered as `unexposed` says, by default out of home. The evidence is `value` (n,) in `unit` at each moment at which the limit
    was newly broken.
    """
    broken = within & ~holds
    if (finding := unexposed(track, exposure or out_of_home(track), broken)) is not None:
        return finding
    x = track.time_share(holds, within)
    if x is None:
        return nothing_shown(
            float(track.time_s[-1]) if len(track.time_s) else 0.0, "never airborne under this condition"
        )
    # Only the beginning of each breach is evidence: every sample of a long one would say the same.
    return Finding(
        x,
        tuple(
            Evidence(time_s=float(track.time_s[row]), text=f"{value[row]:.1f} {unit}")
            for row in begins(broken)
        ),
    )


def begins(condition: Bools) -> Counts:
    """The rows at which `condition` (n,) begins to hold."""
    return np.flatnonzero(condition & ~np.concatenate([[False], condition])[:-1])


def fresh_share(
    track: FlownTrack, sent_s: Floats, max_gap_s: float, message: str, within: Bools | None = None
) -> Finding:
    """Share of the time in `within` (in the air, when None) at which the last message was sent at most
    `max_gap_s` before.

    `sent_s` is in order of time; `message` names the kind of message in the evidence.
    """
    within = track.airborne if within is None else within
    if not len(sent_s):
        return nothing_shown(0.0, f"the agent sent no {message}")
    index = np.searchsorted(sent_s, track.time_s, side="right") - 1
    age_s = np.where(index >= 0, track.time_s - sent_s[np.maximum(index, 0)], np.inf)
    # A message exactly max_gap_s old is still fresh.
    x = track.time_share(age_s <= max_gap_s + EXACT_S, within)
    stale_s = track.time_s[within & (age_s > max_gap_s + EXACT_S)]
    text = f"no {message} within {max_gap_s:g} s before"
    return Finding(x or 0.0, tuple(Evidence(time_s=float(time_s), text=text) for time_s in stale_s[:1]))


def free_to_report_s(tape: Tape, simspec: SimSpec, since_s: float, until_s: float) -> float:
    """Seconds of a span in a report window, without an order to stop reporting, the operator's link up."""
    windows = simspec.rules.report_windows
    silences = [
        (order.time.s, order.value.kind == "stop_reporting")
        for order in tape.orders
        if order.value.kind in SILENCE_KINDS
    ]
    links = [(link.time.s, not link.value.up) for link in tape.operator_link]

    def is_free(time_s: float) -> bool:
        in_window = not windows or any(window.from_s <= time_s < window.until_s for window in windows)
        # The latest change decides.
        kept = (
            next((off for at_s, off in reversed(changes) if at_s <= time_s), False)
            for changes in (silences, links)
        )
        return in_window and not any(kept)

    # What a moment decides changes at these moments alone.
    edges_s = {since_s, until_s, *(time_s for time_s, _ in (*silences, *links))}
    edges_s |= {edge_s for window in windows for edge_s in (window.from_s, window.until_s)}
    ordered = sorted(edge_s for edge_s in edges_s if since_s <= edge_s <= until_s)
    return sum(end_s - begin_s for begin_s, end_s in pairwise(ordered) if is_free(begin_s))
