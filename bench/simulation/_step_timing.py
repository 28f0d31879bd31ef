"""How punctually a session in real time made its steps: late ones counted, and the jitter of all."""

from __future__ import annotations

import math
from array import array

from bench.contracts import Outcome, StepTiming
from bench.simspec import Pace

from ._stop_session import StopSession

# A second of the default controller: agents load their libraries until then, and few steps are a share.
MIN_JUDGED_STEPS = 50
# The agent is charged for the larger part, of processor time or of what made steps late (wall budget too).
AGENT_CPU_SHARE = INPUT_SHARE = 0.5


class StepClock:
    """Keeps how late each step began after the moment at which it was due. `late_after_s` is the step's length.

    Beside it runs the same session without its agent's input: what the host was late by itself.
    """

    def __init__(self, late_after_s: float) -> None:
        self._late_after_s = late_after_s
        self._delays_s = array("d")
        self._late = self._late_without_input = 0
        self._last_s = self._last_without_input_s = 0.0
        # Host seconds between two steps of which the second was late, and those of the agent's input among them.
        self._lost_s = self._lost_to_input_s = 0.0

    def record(self, delay_s: float, input_s: float = 0.0) -> None:
        """A step begins `delay_s` host seconds after it was due; negative: before. Since the last one the agent's input
        delayed the session by `input_s`.
        """
        delay_s = max(delay_s, 0.0)
        # What was lost or made up since the last step stays so without the input.
        without_input_s = max(self._last_without_input_s + delay_s - self._last_s - input_s, 0.0)
        if delay_s > self._late_after_s:
            self._lost_s += delay_s - self._last_s + self._late_after_s
            self._lost_to_input_s += input_s
        self._last_s, self._last_without_input_s = delay_s, without_input_s
        self._late_without_input += without_input_s > self._late_after_s
        self._delays_s.append(delay_s)
        self._late += delay_s > self._late_after_s

    def summary(self) -> StepTiming:
        """The steps so far."""
        ordered = sorted(self._delays_s)
        half, most, nearly_all, largest = (_percentile(ordered, share) for share in (0.5, 0.95, 0.99, 1.0))
        return StepTiming(
            steps=len(ordered),
            late=self._late,
            late_after_s=self._late_after_s,
            delay_p50_s=half,
            delay_p95_s=most,
            delay_p99_s=nearly_all,
            delay_max_s=largest,
            late_without_input=self._late_without_input,
            late_input_share=self._lost_to_input_s / self._lost_s if self._lost_s > 0.0 else 0.0,
        )


def judged(end: StopSession, timing: StepTiming, pace: Pace, agent_cpu_share: float) -> StopSession:
    """The end as it was, or the one that a host earns which was too slow for real time.

    `agent_cpu_share` is the part of the host's processor time that the agent's processes and the bench's work on its input
    used. A run that ends as BENCH_TOO_SLOW is flown again, so an agent could drop one that goes badly by keeping every core
    busy, or the bench: then the late steps are its own.
    """
    if not end.outcome.counts or timing.steps < MIN_JUDGED_STEPS or timing.late_share <= pace.max_late_share:
        return end
    reason = (
        f"{timing}, and pace.max_late_share is {pace.max_late_share:.1%}; without that the session had ended as "
        f"{end.outcome}: {end.reason}"
    )
    if agent_cpu_share > AGENT_CPU_SHARE:
        used = (
            f"the agent's processes, and the bench's work on what they sent, used {agent_cpu_share:.0%} of the host's "
            "processor time, so that "
        )
        return StopSession(Outcome.AGENT_TIMEOUT, used + reason)
    if _late_by_input(timing, pace):
        flooded = f"the agent kept the bench busy: without what it sent {timing.late_without_input:,} steps had been late, but "
        return StopSession(Outcome.AGENT_FLOODED, flooded + reason)
    return StopSession(Outcome.BENCH_TOO_SLOW, reason)


def _late_by_input(timing: StepTiming, pace: Pace) -> bool:
    """Whether the session had been in time without the agent's input, which also took most of the time that was lost.

    Either alone would not do: ordinary messages of an agent may be the last straw on a slow host.
    """
    without, share = timing.late_without_input, timing.late_input_share
    if without is None or share is None:
        return False
    return without <= timing.steps * pace.max_late_share and share > INPUT_SHARE


def _percentile(ordered: list[float], share: float) -> float:
    """The smallest value that so large a share of the values does not exceed; 0 without values."""
    return ordered[max(math.ceil(share * len(ordered)), 1) - 1] if ordered else 0.0
