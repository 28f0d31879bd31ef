"""A measure from outside the bench: how soon what is looked for first comes into view."""

from __future__ import annotations

from dataclasses import dataclass

from bench.contracts import Evidence, Tape
from bench.simspec import SimSpec
from test_ports.measures import Finding, Measured, not_considered


@dataclass(frozen=True, slots=True)
class SeenSoonOptions:
    limit_s: float = 120.0
    min_height_px: float = 12.0


def _seen_soon(tape: Tape, simspec: SimSpec, options: SeenSoonOptions) -> Finding:
    """1 - time of the first view of a most urgent target / `limit_s`, by the truth; 0 where none ever came into view."""
    urgent = {report.about for report in simspec.intelligence if report.priority == 1}
    if not urgent:
        return not_considered("no intelligence is of priority 1")
    for frame in tape.frames:
        for one in frame.sightings:
            if tape.cast[one.actor].group in urgent and one.height_px >= options.min_height_px:
                seen = Evidence(time_s=frame.exposed.s, text=f"{tape.cast[one.actor].id} comes into view")
                return Finding(max(0.0, 1.0 - frame.exposed.s / options.limit_s), (seen,))
    return Finding(0.0, (Evidence(time_s=tape.end_s, text=f"{', '.join(sorted(urgent))} never came into view"),))


seen_soon = Measured("seen_soon", SeenSoonOptions, _seen_soon)
