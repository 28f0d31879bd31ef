"""Early stopping carried out in journal and folder: realizations closed without a flight, and reopened if
needed after all.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from bench.contracts import Outcome, SessionResult

from .._document import Stopping
from ..storage._folder import RESULT, CampaignFolder
from ..storage._journal import Journal
from ..storage._results import write_result
from ._decisions import PointKey, StoppingDecisions

if TYPE_CHECKING:
    from decompositions import Decomposition


class EarlyStopping:
    """Stops design points whose pass rate is decided, and reopens those where it is not any more.

    A campaign without a stopping rule stops nothing, and reopens whatever was stopped earlier.
    """

    def __init__(
        self,
        stopping: Stopping | None,
        decomposition: Decomposition,
        folder: CampaignFolder,
        journal: Journal,
        floor_agents: Collection[str] = (),
    ) -> None:
        self._stopping, self._folder, self._journal = stopping, folder, journal
        # No rule applies to the runs of the floor: they decide nothing, and none of them is left out.
        entries = [entry for entry in journal.entries() if entry.agent not in floor_agents]
        self._stoppable = {entry.id for entry in entries}
        self._decisions = StoppingDecisions(stopping, decomposition, entries) if stopping else None
        self._stops: dict[PointKey, int] = {}
        for entry in entries:
            if entry.outcome is None:
                continue
            if self._decisions is not None:
                self._decisions.record(
                    SessionResult.model_validate_json((folder.run(entry.id) / RESULT).read_bytes())
                )
            elif entry.outcome is Outcome.SETTLED:
                journal.forget(entry.id)
        # Threshold or replicates may differ from the run before, so every stop is decided anew from the
        # results.
        journal.set_stops({})

    @property
    def keys(self) -> list[PointKey]:
        """Every design point and agent; empty without a stopping rule."""
        return list(self._decisions.keys) if self._decisions else []

    def key(self, realization: str) -> PointKey | None:
        """Design point and agent of a realization, None without a stopping rule and for one of the floor."""
        if self._decisions is None or realization not in self._stoppable:
            return None
        return self._decisions.key(realization)

    def record(self, result: SessionResult) -> None:
        """Take up a result that was written and noted."""
        if self._decisions is not None and result.realization in self._stoppable:
            self._decisions.record(result)

    def forget(self, realization: str) -> None:
        """Drop the result of a realization that is flown again."""
        if self._decisions is not None and realization in self._stoppable:
            self._decisions.forget(realization)

    def may_start(self, realization: str) -> bool:
        """Whether the realization can be flown without waiting for a decision about an earlier replicate."""
        if self._decisions is None or realization not in self._stoppable:
            return True
        return self._decisions.may_start(realization)

    def reopen(self, key: PointKey) -> list[str]:
        """Plan the realizations again that turn out to be needed after all, and return their ids."""
        assert self._decisions is not None
        reopened = self._decisions.needed_again(key)
        for realization in reopened:
            self._decisions.forget(realization)
            self._journal.forget(realization)
        return reopened

    def stop(self, key: PointKey, waiting: Collection[str]) -> list[SessionResult]:
        """If the design point stops early, write and note results for the realizations in `waiting` that are
        not needed.
        """
        assert self._decisions is not None
        assert self._stopping is not None
        early_stop = self._decisions.early_stop(key)
        if early_stop is None:
            return []
        if self._stops.get(key) != early_stop.replicate:
            self._stops[key] = early_stop.replicate
            self._journal.set_stops(self._stops)
        reason = early_stop.reason(self._stopping)
        # Replicates that are under way are not in `waiting`: their sessions end, are kept, and do not count.
        not_needed = [name for name in self._decisions.newly_not_needed(key, early_stop) if name in waiting]
        results = [
            SessionResult(realization=name, outcome=Outcome.SETTLED, reason=reason) for name in not_needed
        ]
        for result in results:
            self._journal.finish(result, write_result(self._folder.fresh_run(result.realization), result))
        return results
