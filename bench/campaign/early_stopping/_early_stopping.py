"""Early stopping in journal and folder: realizations closed without a flight, and reopened if needed."""

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


class EarlyStopping(StoppingDecisions):
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
        super().__init__(stopping, decomposition, entries)
        self._stops: dict[PointKey, int] = {}
        for entry in entries:
            if stopping is not None and entry.outcome is not None:
                content = (folder.run(entry.id) / RESULT).read_bytes()
                self.record(SessionResult.model_validate_json(content))
            elif entry.outcome is Outcome.SETTLED:
                journal.forget(entry.id)
        # Threshold or replicates may differ from the run before, so every stop is decided anew from the results.
        journal.set_stops({})

    def reopen(self, key: PointKey) -> list[str]:
        """Plan the realizations again that turn out to be needed after all, and return their ids."""
        reopened = self.needed_again(key)
        for realization in reopened:
            self.forget(realization)
            self._journal.forget(realization)
        return reopened

    def stop(self, key: PointKey, waiting: Collection[str]) -> list[SessionResult]:
        """If the design point stops early, write and note results for the realizations in `waiting` that are not needed."""
        early_stop = self.early_stop(key)
        if early_stop is None or self._stopping is None:
            return []
        if self._stops.get(key) != early_stop.replicate:
            self._stops[key] = early_stop.replicate
            self._journal.set_stops(self._stops)
        reason = early_stop.reason(self._stopping)
        # Replicates that are under way are not in `waiting`: their sessions end, are kept, and do not count.
        not_needed = [name for name in self.newly_not_needed(key, early_stop) if name in waiting]
        results = [
            SessionResult(realization=name, outcome=Outcome.SETTLED, reason=reason) for name in not_needed
        ]
        for result in results:
            self._journal.finish(result, write_result(self._folder.fresh_run(result.realization), result))
        return results
