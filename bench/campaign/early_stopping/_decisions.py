"""Design points whose question is settled: which replicates count, which were not needed, which were flown past the stop.

A design point of one agent is looked at in the order of its replicates, never in that in which sessions end. The replicates
from the first on that have a result, without a gap, are what is known; where the stopping rule settles on them, those up to
there count. So what counts follows from the results alone, whatever the number of workers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bench.contracts import Outcome, SessionResult
from bench.errors import Fault, SetupError

from .._document import Stopping
from ..storage._journal import Entry

if TYPE_CHECKING:
    from bench.statistics import StoppingRule
    from decompositions import Decomposition

FLOWN_PAST = "flown past the stop"
"""What is said of a run that was under way, or there, when the replicates before it settled the question."""

Key = tuple[str, str]
"""A design point and an agent."""


def check_stopping(stopping: Stopping, decomposition: Decomposition) -> None:
    """Raises SetupError when the decomposition has no such node."""
    if stopping.node not in decomposition.nodes:
        remedy = f"name a node of the decomposition {decomposition.name}"
        raise SetupError(Fault("stopping.node", f"there is no node {stopping.node!r}", remedy))


def is_past(entry: Entry, stops: Mapping[Key, int]) -> bool:
    """Whether a realization lies behind the replicate on which its design point was settled."""
    last = stops.get((entry.design_point, entry.agent))
    return last is not None and entry.replicate > last


def outcome_name(entry: Entry, outcome: Outcome, stops: Mapping[Key, int]) -> str:
    """How a realization ended, or that it does not count any more."""
    return FLOWN_PAST if outcome.counts and is_past(entry, stops) else str(outcome)


@dataclass(frozen=True, slots=True)
class SettledPoint:
    """`replicate` is the last that counts, the `after`-th of `planned`; the pass rate lies on the side `verdict`."""

    replicate: int
    after: int
    planned: int
    verdict: str

    def reason(self, stopping: Stopping) -> str:
        """Why a replicate behind it is not flown."""
        side = "more" if self.verdict == "above" else "less"
        found = f"{stopping.node} is passed in {side} than {100 * stopping.threshold:g} % of such runs"
        return f"not flown: settled after {self.after} of {self.planned} replicates ({found})"


@dataclass(slots=True)
class _Point:
    """One design point of one agent: its realizations by replicate, and what those with a result say."""

    order: list[tuple[int, str]]
    said: dict[str, bool | None] = field(default_factory=dict)
    unneeded: set[str] = field(default_factory=set)


class Question:
    """The question of a campaign with `stopping`, over the entries of its journal."""

    def __init__(self, stopping: Stopping, decomposition: Decomposition, entries: Iterable[Entry]) -> None:
        self._rule = _rule(stopping)
        self._thresholds = _thresholds(decomposition, stopping.node)
        self._points: dict[Key, _Point] = {}
        self._key: dict[str, Key] = {}
        for entry in entries:
            self._key[entry.id] = key = (entry.design_point, entry.agent)
            self._points.setdefault(key, _Point([])).order.append((entry.replicate, entry.id))
        for point in self._points.values():
            point.order.sort()

    @property
    def keys(self) -> Iterable[Key]:
        return self._points.keys()

    def key(self, realization: str) -> Key:
        """Design point and agent of a realization."""
        return self._key[realization]

    def hear(self, result: SessionResult) -> None:
        """Take up a result; one that says `settled` is remembered as not needed."""
        point = self._points[self._key[result.realization]]
        if result.outcome is Outcome.SETTLED:
            point.unneeded.add(result.realization)
        else:
            point.unneeded.discard(result.realization)
            point.said[result.realization] = _passed(result, self._thresholds)

    def forget(self, realization: str) -> None:
        """The realization has no result any more."""
        point = self._points[self._key[realization]]
        point.said.pop(realization, None)
        point.unneeded.discard(realization)

    def settled(self, key: Key) -> SettledPoint | None:
        """Where the question of this design point is settled, None while it is open."""
        point = self._points[key]
        trials: list[bool] = []
        tried_at: list[int] = []
        for place, (_, realization) in enumerate(point.order):
            if realization not in point.said:
                break
            passed = point.said[realization]
            if passed is not None:
                trials.append(passed)
                tried_at.append(place)
        after = self._rule.settled_after(trials) if trials else None
        if after is None:
            return None
        place = tried_at[after - 1]
        verdict = self._rule.verdict(trials)
        return SettledPoint(point.order[place][0], place + 1, len(point.order), str(verdict))

    def behind(self, key: Key, settled: SettledPoint) -> list[str]:
        """Realizations behind the stop that have no result and are not yet remembered as not needed."""
        point = self._points[key]
        later = (name for replicate, name in point.order if replicate > settled.replicate)
        return [name for name in later if name not in point.said and name not in point.unneeded]

    def reopened(self, key: Key) -> list[str]:
        """Realizations that were taken for unneeded, where all before them are known and settle nothing."""
        point = self._points[key]
        if not point.unneeded or self.settled(key) is not None:
            return []
        first = next(name for _, name in point.order if name not in point.said)
        return [name for _, name in point.order if name in point.unneeded] if first in point.unneeded else []

    def may_begin(self, realization: str) -> bool:
        """Whether nothing before it in its design point was taken for unneeded: that is cleared up first."""
        point = self._points[self._key[realization]]
        before = next(place for place, (_, name) in enumerate(point.order) if name == realization)
        return not any(name in point.unneeded for _, name in point.order[:before])


def _rule(stopping: Stopping) -> StoppingRule:
    # Half a second to import: only a campaign with a stopping rule pays for it.
    from bench.statistics import StoppingRule

    return StoppingRule(stopping.threshold, stopping.level)


def _thresholds(decomposition: Decomposition, node: str) -> dict[str, float]:
    return {name: decomposition.observables[name].threshold for name in decomposition.observables_under(node)}


def _passed(result: SessionResult, thresholds: Mapping[str, float]) -> bool | None:
    """Whether every considered observable was achieved; None where that is no trial."""
    if not result.outcome.counts:
        return None
    found = [
        (one.x, thresholds[one.observable]) for one in result.observations if one.considered and one.observable in thresholds
    ]
    return all(x is not None and x >= threshold for x, threshold in found) if found else None
