"""A measure from outside the bench: how soon a most urgent target first comes into view."""

from __future__ import annotations

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec
from test_ports import Finding, measure, not_considered


@measure
def seen_soon(
    tape: Tape, simspec: SimSpec, *, limit_s: float = 120.0, min_height_px: float = 12.0
) -> Finding:
    """1 - time of the first view of a most urgent target / `limit_s`, by the truth; 0 where none ever came
    into view.
    """
    urgent = {report.about for report in simspec.intelligence if report.priority == 1}
    if not urgent:
        return not_considered("no intelligence is of priority 1")
    for frame in tape.frames:
        for sighting in frame.sightings:
            member = tape.cast[sighting.actor]
            if member.group in urgent and sighting.height_px >= min_height_px:
                first_view = Evidence(time_s=frame.exposed.s, text=f"{member.id} comes into view")
                return Finding(max(0.0, 1.0 - frame.exposed.s / limit_s), (first_view,))
    return Finding(
        0.0, (Evidence(time_s=tape.end_s, text=f"{', '.join(sorted(urgent))} never came into view"),)
    )
