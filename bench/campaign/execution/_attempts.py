"""What becomes of the attempts at a realization: flown again after a pause, charged to the agent, or final; and when a
broken bench stops the campaign.

Pauses grow, so that a fault of a minute does not use up every attempt in its first second.
"""

from __future__ import annotations

import random
import signal
from collections import Counter
from collections.abc import Collection

from bench.contracts import FIRMWARE_FAILED, AgentExit, FirmwareEnds, Outcome, SessionResult

from ..storage._completeness import PROVISIONAL_OUTCOMES
from ..storage._firmware_ends import MAX_RERUNS, add_firmware_ends, firmware_ends
from ..storage._journal import Journal
from ._executor import BenchBroken, Jobs
from ._suspects import MAX_REASON_CHARACTERS, SuspectWatch

FAULTS_BEFORE_GIVING_UP = 5
"""Realizations that fail by the bench or the host before any succeeds, after which the bench counts as broken."""

# The pauses are chosen, not measured: attempts 0, 5, 15, 35 and 65 s after the first failure at the default
# `budgets.retry_s` of 60 s, which is a network drive that is remounted or a neighbour's job that ends.
FIRST_PAUSE_S = 5.0
MAX_PAUSE_S = 30.0
# More would make no pause longer, and a thousand are beyond a float.
_DOUBLINGS = 10
JITTER = 0.25
"""Share by which a pause is longer at most: sessions that failed together do not all come back at once."""


class Attempts:
    """The attempts at every realization in one run of a campaign. `now` is a reading of the campaign's clock."""

    def __init__(self, journal: Journal, suspects: SuspectWatch, jobs: Jobs, retry_s: float) -> None:
        self.retries = Retries(retry_s)
        self._suspects, self._jobs = suspects, jobs
        self._firmware, self._bench_faults = FirmwareWatch(journal), BenchFaultWatch()

    def job(self, realization: str) -> str | None:
        """The job of the next attempt, where it is not the campaign's own."""
        if self._suspects.is_forfeited(realization):
            return self._jobs.forfeit
        return self._suspects.confined_job(realization)

    def start(self, realization: str) -> None:
        """An attempt begins."""
        self._suspects.start(realization)

    def pause_s(self, result: SessionResult, now: float) -> float | None:
        """Take up the end of an attempt. Host seconds until the next one; None if the result is final."""
        self._suspects.record(result)
        self._firmware.record(result)
        pause_s = self.retries.pause_s(result, now)
        if self._firmware.is_exhausted(result):
            pause_s = None
        is_charged = (
            pause_s is None
            and self._jobs.forfeit
            and self._suspects.forfeits(result, self._bench_faults.succeeded)
        )
        return 0.0 if is_charged else pause_s

    def marked(self, result: SessionResult) -> SessionResult:
        """A final result with what its attempts are suspected of, and how its firmware failed."""
        return self._firmware.marked(self._suspects.marked(result))

    def check_bench(self, result: SessionResult) -> None:
        """Raises BenchBroken when the first sessions all failed because of the bench or the host."""
        self._bench_faults.record(result)


class Retries:
    """Which realizations of one run of a campaign get another attempt, and when. At least one attempt follows the
    first failure; more follow until `span_s` host seconds have passed since then.

    A run on another day, on a repaired host, has attempts of its own. `now` is a reading of the campaign's clock, in
    host seconds.
    """

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._failures: Counter[str] = Counter()
        self._first_failure: dict[str, float] = {}
        self._due: dict[str, float] = {}

    def pause_s(self, result: SessionResult, now: float) -> float | None:
        """Take up the end of a session. Host seconds until its next attempt; None if the result is final."""
        if not is_worth_a_retry(result):
            return None
        realization = result.realization
        since_first_s = now - self._first_failure.setdefault(realization, now)
        self._failures[realization] += 1
        failures = self._failures[realization]
        # An agent that is killed or silent before its first tick gets one more attempt, however soon that fails: what
        # the host did once, it hardly does twice.
        limit_s = self._span_s if result.outcome in PROVISIONAL_OUTCOMES else 0.0
        if failures > 1 and since_first_s >= limit_s:
            return None
        nominal_s = min(FIRST_PAUSE_S * 2.0 ** min(failures - 1, _DOUBLINGS), MAX_PAUSE_S, self._span_s)
        # Seeded by what is retried: no run differs from its repetition by a draw.
        draw = random.Random(f"{realization} {failures}").random()
        pause_s = nominal_s * (1.0 + JITTER * draw)
        self._due[realization] = now + pause_s
        return pause_s

    def restart(self, realizations: Collection[str]) -> None:
        """Give these realizations attempts as if they had never failed, at once."""
        for realization in realizations:
            self._due.pop(realization, None)
            self._first_failure.pop(realization, None)
            self._failures.pop(realization, None)

    def is_due(self, realization: str, now: float) -> bool:
        """Whether a realization that waits may start: it never failed in this run, or its pause is over."""
        return realization not in self._due or self._due[realization] <= now

    def next_due_s(self, waiting: Collection[str], now: float) -> float | None:
        """Host seconds until the first pause of these realizations is over; None if none of them pauses."""
        pauses_s = [due - now for name, due in self._due.items() if due > now and name in waiting]
        return min(pauses_s, default=None)


def is_worth_a_retry(result: SessionResult) -> bool:
    """Whether the host may have caused this end, so that the session deserves another attempt.

    Of the ends of an agent, two before its first tick are among them: a signal that others send, and no hello in time,
    which a busy host may have held up. The agent has seen nothing of the situation, so it cannot use the second attempt
    to drop one that goes badly, and the second end is its own. An exit code is its program's decision, and the signals
    that the kernel sends for what a program does (SIGSEGV) are its program's fault: another attempt would only repeat
    them, or hide them where they fall by chance.
    """
    if result.outcome in PROVISIONAL_OUTCOMES:
        return True
    if result.simulated_s > 0.0:
        return False
    end = result.fact(AgentExit)
    return result.outcome is Outcome.AGENT_NEVER_CONNECTED or (
        result.outcome is Outcome.AGENT_CRASHED and end is not None and end.code in _ENDED_BY_OTHERS
    )


# Those by which a host ends programs: for want of memory, at the end of a service or a batch job, with a terminal.
_SENT_BY_OTHERS = (signal.SIGHUP, signal.SIGINT, signal.SIGKILL, signal.SIGTERM)
# Shells and container engines state the signal n that ended their program as the exit code 128 + n.
_ENDED_BY_OTHERS = frozenset(code for number in _SENT_BY_OTHERS for code in (-number, 128 + number))


class BenchFaultWatch:
    """Gives up on a bench on which no session succeeds, before a whole campaign fails the same way."""

    def __init__(self) -> None:
        # None once a session succeeded: faults after that are results of their own.
        self._faulty: set[str] | None = set()

    @property
    def succeeded(self) -> bool:
        """Whether any session ended otherwise than by a fault of the bench or the host."""
        return self._faulty is None

    def record(self, result: SessionResult) -> None:
        """Take up a result.

        Raises BenchBroken when the first FAULTS_BEFORE_GIVING_UP realizations all failed.
        """
        if self._faulty is None or result.outcome not in PROVISIONAL_OUTCOMES:
            self._faulty = None
            return
        # By realization, not by session: the second attempt of a faulty realization is no new evidence.
        self._faulty.add(result.realization)
        if len(self._faulty) >= FAULTS_BEFORE_GIVING_UP:
            raise BenchBroken(
                f"INCOMPLETE: the first {FAULTS_BEFORE_GIVING_UP} sessions all failed because of the bench or the host, "
                f"so no more are started. The last error: {result.outcome}: {result.reason}. "
                "Fix it, then run the same command again: it flies them again."
            )


class FirmwareWatch:
    """Follows the attempts at every realization, those of earlier runs of the campaign too."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def record(self, result: SessionResult) -> None:
        """An attempt has ended."""
        if failed_in_flight(result):
            text = f"after {result.simulated_s:.1f} s: {result.reason}"
            # Before the attempt's own end: an agent that kills the runner between the two gains no draw.
            add_firmware_ends(self._journal, {result.realization: [text[:MAX_REASON_CHARACTERS]]})

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
