"""Decides where a design point stops early: which replicates count, which are not needed, which were flown
after the stop.

The replicates of a design point, for each agent, are considered in their order, never in the order in which
sessions end. The results from the first replicate on, without a gap, are the known ones; where the stopping
rule decides on them, the replicates up to there count. So what counts follows from the results alone,
whatever the number of workers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bench.contracts import Outcome, SessionResult
from bench.errors import SetupError

from .._document import Stopping
from ..storage._journal import JournalEntry

if TYPE_CHECKING:
    from bench.statistics import StoppingRule
    from decompositions import Decomposition

# The text is a key of `outcomes` in manifest.json, so it cannot be reworded.
FLOWN_AFTER_STOP = "flown past the stop"
"""The outcome shown for a run that was under way, or finished, when the replicates before it decided the pass rate."""


PointKey = tuple[str, str]
"""A design point and an agent."""


def check_stopping(stopping: Stopping, decomposition: Decomposition) -> None:
    """Raises SetupError if the decomposition has no such node."""
    if stopping.node not in decomposition.nodes:
        remedy = f"name a node of the decomposition {decomposition.name}"
        raise SetupError("stopping.node", f"there is no node {stopping.node!r}", remedy)


def is_after_stop(entry: JournalEntry, stops: Mapping[PointKey, int]) -> bool:
    """Whether a realization comes after the replicate at which its design point stopped early."""
    last = stops.get((entry.design_point, entry.agent))
    return last is not None and entry.replicate > last


def outcome_name(entry: JournalEntry, outcome: Outcome, stops: Mapping[PointKey, int]) -> str:
    """The name under which a realization is counted: its outcome, or that it was flown after the stop."""
    return FLOWN_AFTER_STOP if outcome.counts and is_after_stop(entry, stops) else str(outcome)


@dataclass(frozen=True, slots=True)
class EarlyStop:
    """Where a design point stopped early for an agent.

    `replicate` is the last that counts, the `after`-th of `planned`. `verdict` is the side of the threshold
    that the pass rate is on, "above" or "below".
    """

    replicate: int
    after: int
    planned: int
    verdict: str

    def reason(self, stopping: Stopping) -> str:
        """Why the replicates after it are not flown."""
        side = "more" if self.verdict == "above" else "less"
        decision = f"{stopping.node} is passed in {side} than {100 * stopping.threshold:g} % of such runs"
        return f"not flown: stopped early after {self.after} of {self.planned} replicates ({decision})"


@dataclass(slots=True)
class _Replicates:
    """The replicates of one design point and agent: realizations in order, and whether those with a result passed.

    `passed` has None for a result that is no trial of the studied node.
    """

    order: list[tuple[int, str]]
    passed: dict[str, bool | None] = field(default_factory=dict)
    not_needed: set[str] = field(default_factory=set)


class StoppingDecisions:
    """The stopping rule of a campaign, None for none, applied to the results that are known so far.

    Only `entries` can be stopped: whatever else the campaign holds is passed over.
    """

    def __init__(
        self, stopping: Stopping | None, decomposition: Decomposition, entries: Iterable[JournalEntry]
    ) -> None:
        self._points: dict[PointKey, _Replicates] = {}
        self._keys: dict[str, PointKey] = {}
        if stopping is None:
            return
        self._rule = _rule(stopping)
        self._thresholds = _thresholds(decomposition, stopping.node)
        for entry in entries:
            self._keys[entry.id] = key = (entry.design_point, entry.agent)
            self._points.setdefault(key, _Replicates([])).order.append((entry.replicate, entry.id))
        for replicates in self._points.values():
            replicates.order.sort()

    @property
    def keys(self) -> list[PointKey]:
        """Every design point and agent; empty without a stopping rule."""
        return list(self._points)

    def key(self, realization: str) -> PointKey | None:
        """Design point and agent of a realization; None for one that cannot be stopped."""
        return self._keys.get(realization)

    def record(self, result: SessionResult) -> None:
        """Take up a result. A realization with the outcome SETTLED is remembered as not needed."""
        if (key := self.key(result.realization)) is None:
            return
        replicates = self._points[key]
        if result.outcome is Outcome.SETTLED:
            replicates.not_needed.add(result.realization)
        else:
            replicates.not_needed.discard(result.realization)
            replicates.passed[result.realization] = _passed(result, self._thresholds)

    def forget(self, realization: str) -> None:
        """Drop the result of a realization."""
        if (key := self.key(realization)) is not None:
            self._points[key].passed.pop(realization, None)
            self._points[key].not_needed.discard(realization)

    def early_stop(self, key: PointKey) -> EarlyStop | None:
        """Where this design point stops early, None while its pass rate is undecided."""
        replicates = self._points[key]
        trials: list[bool] = []
        trial_positions: list[int] = []
        for position, (_, realization) in enumerate(replicates.order):
            if realization not in replicates.passed:
                break
            passed = replicates.passed[realization]
            if passed is not None:
                trials.append(passed)
                trial_positions.append(position)
        after = self._rule.decided_after(trials) if trials else None
        if after is None:
            return None
        position = trial_positions[after - 1]
        verdict = self._rule.verdict(trials)
        return EarlyStop(replicates.order[position][0], position + 1, len(replicates.order), str(verdict))

    def newly_not_needed(self, key: PointKey, stop: EarlyStop) -> list[str]:
        """Realizations after the stop that have no result and are not yet remembered as not needed."""
        replicates = self._points[key]
        later = (name for replicate, name in replicates.order if replicate > stop.replicate)
        return [name for name in later if name not in replicates.passed and name not in replicates.not_needed]

    def needed_again(self, key: PointKey) -> list[str]:
        """Realizations remembered as not needed, if all replicates before them have a result and do not stop the point.

        That happens when replicates or the rule changed since, or when a result before the stop was lost and
        rerun.
        """
        replicates = self._points[key]
        if not replicates.not_needed or self.early_stop(key) is not None:
            return []
        first_open = next(name for _, name in replicates.order if name not in replicates.passed)
        # With a gap before it, the missing result may still stop the point: nothing is flown again until it
        # is there.
        if first_open not in replicates.not_needed:
            return []
        return [name for _, name in replicates.order if name in replicates.not_needed]

    def may_start(self, realization: str) -> bool:
        """Whether no earlier replicate of its design point is remembered as not needed: those are decided first."""
        if (key := self.key(realization)) is None:
            return True
        replicates = self._points[key]
        names = [name for _, name in replicates.order]
        return replicates.not_needed.isdisjoint(names[: names.index(realization)])


def _rule(stopping: Stopping) -> StoppingRule:
    # Half a second to import: only a campaign with a stopping rule pays for it.
    from bench.statistics import StoppingRule

    return StoppingRule(stopping.threshold, stopping.level)


def _thresholds(decomposition: Decomposition, node: str) -> dict[str, float]:
    return {name: decomposition.observables[name].threshold for name in decomposition.observables_under(node)}


def _passed(result: SessionResult, thresholds: Mapping[str, float]) -> bool | None:
    """Whether every considered observable of the node was achieved.

    None if the result is no trial of the node.
    """
    if not result.outcome.counts:
        return None
    considered = [
        (observation.x, thresholds[observation.observable])
        for observation in result.observations
        if observation.considered and observation.observable in thresholds
    ]
    return all(x is not None and x >= threshold for x, threshold in considered) if considered else None
