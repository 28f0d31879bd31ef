"""Runs whose real autopilot failed in flight: each is flown once more, and marked however that goes.

An agent talks to the firmware, so it may have found a message on which it fails, and could draw another session for one
that goes badly. Nobody can tell that from a firmware that fails by itself, so the draws are limited, and shown.
"""

from __future__ import annotations

from bench.contracts import FIRMWARE_ENDS, FIRMWARE_FAILED, Outcome, SessionResult

MAX_RERUNS = 1
"""Further flights of a realization in one run of a campaign after its firmware has failed in flight."""
_REASON_CHARACTERS = 300


class FirmwareWatch:
    """Follows the attempts at every realization in one run of a campaign."""

    def __init__(self) -> None:
        self._ends: dict[str, list[str]] = {}

    def record(self, result: SessionResult) -> None:
        """An attempt has ended."""
        if failed_in_flight(result):
            text = f"after {result.simulated_s:.1f} s: {result.reason}"
            self._ends.setdefault(result.realization, []).append(text[:_REASON_CHARACTERS])

    def is_exhausted(self, result: SessionResult) -> bool:
        """Whether a failed attempt was the last one of this run of the campaign."""
        return failed_in_flight(result) and len(self._ends[result.realization]) > MAX_RERUNS

    def marked(self, result: SessionResult) -> SessionResult:
        """The result with how its firmware failed in earlier attempts; also one that went well in the end."""
        ends = self._ends.get(result.realization)
        details = {**result.details, FIRMWARE_ENDS: ends}
        return result.model_copy(update={"details": details}) if ends else result


def failed_in_flight(result: SessionResult) -> bool:
    """Whether the firmware failed while an agent could talk to it."""
    return (
        result.outcome is Outcome.BENCH_ERROR
        and result.reason.startswith(FIRMWARE_FAILED)
        and result.simulated_s > 0.0
    )
