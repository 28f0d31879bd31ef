"""Runs whose real autopilot failed in flight: each is flown once more, and marked however that goes."""

from __future__ import annotations

from bench.contracts import FIRMWARE_FAILED, FirmwareEnds, Outcome, SessionResult

from ..storage._firmware_ends import MAX_RERUNS, add_firmware_ends, firmware_ends
from ..storage._journal import Journal

_REASON_CHARACTERS = 300


class FirmwareWatch:
    """Follows the attempts at every realization, those of earlier runs of the campaign too."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def record(self, result: SessionResult) -> None:
        """An attempt has ended."""
        if failed_in_flight(result):
            text = f"after {result.simulated_s:.1f} s: {result.reason}"
            # Before the attempt's own end: an agent that kills the runner between the two gains no draw.
            add_firmware_ends(self._journal, {result.realization: [text[:_REASON_CHARACTERS]]})

    def is_exhausted(self, result: SessionResult) -> bool:
        """Whether a failed attempt was the last one, unless a person asks for another."""
        return failed_in_flight(result) and len(self._ends(result)) > MAX_RERUNS

    def marked(self, result: SessionResult) -> SessionResult:
        """The result with how its firmware failed in earlier attempts; also one that went well in the end."""
        ends = self._ends(result)
        return result.with_facts(FirmwareEnds(texts=tuple(ends))) if ends else result

    def _ends(self, result: SessionResult) -> list[str]:
        return firmware_ends(self._journal).get(result.realization, [])


def failed_in_flight(result: SessionResult) -> bool:
    """Whether the firmware failed while an agent could talk to it."""
    return (
        result.outcome is Outcome.BENCH_ERROR
        and result.reason.startswith(FIRMWARE_FAILED)
        and result.simulated_s > 0.0
    )
