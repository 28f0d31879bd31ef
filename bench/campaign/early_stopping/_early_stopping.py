"""What a question that is settled means for journal and folder: rows that are ended unflown, and rows that are opened again."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from bench.contracts import Outcome, SessionResult

from .._document import Stopping
from ..storage._folder import RESULT, CampaignFolder, write_result
from ..storage._journal import Journal
from ._decisions import Key, Question

if TYPE_CHECKING:
    from decompositions import Decomposition


class Settling:
    """Ends design points as their question is settled, and opens them again where it is not any more.

    Without a question nothing is settled, and what once was is open again.
    """

    def __init__(self, stopping: Stopping | None, decomposition: Decomposition, folder: CampaignFolder, journal: Journal) -> None:
        self._stopping, self._folder, self._journal = stopping, folder, journal
        entries = journal.entries()
        self._question = Question(stopping, decomposition, entries) if stopping else None
        self._stops: dict[Key, int] = {}
        for entry in entries:
            if entry.outcome is None:
                continue
            if self._question is not None:
                self._question.hear(SessionResult.model_validate_json((folder.run(entry.id) / RESULT).read_bytes()))
            elif entry.outcome is Outcome.SETTLED:
                journal.forget(entry.id)
        journal.stop({})

    @property
    def keys(self) -> list[Key]:
        """Design points and agents that are looked at."""
        return list(self._question.keys) if self._question else []

    def key(self, realization: str) -> Key | None:
        """Design point and agent of a realization, None where nothing is looked at."""
        return self._question.key(realization) if self._question else None

    def hear(self, result: SessionResult) -> None:
        """A result was written."""
        if self._question is not None:
            self._question.hear(result)

    def may_begin(self, realization: str) -> bool:
        """Whether all that it may hang on is known or under way."""
        return self._question is None or self._question.may_begin(realization)

    def reopen(self, key: Key) -> list[str]:
        """Realizations that have to be flown after all."""
        assert self._question is not None
        reopened = self._question.reopened(key)
        for realization in reopened:
            self._question.forget(realization)
            self._journal.forget(realization)
        return reopened

    def end(self, key: Key, waiting: Collection[str]) -> list[SessionResult]:
        """Results, written and noted, of those that wait behind a replicate on which the design point is settled."""
        assert self._question is not None
        assert self._stopping is not None
        settled = self._question.settled(key)
        if settled is None:
            return []
        if self._stops.get(key) != settled.replicate:
            self._stops[key] = settled.replicate
            self._journal.stop(self._stops)
        reason = settled.reason(self._stopping)
        behind = [name for name in self._question.behind(key, settled) if name in waiting]
        results = [SessionResult(realization=name, outcome=Outcome.SETTLED, reason=reason) for name in behind]
        for result in results:
            self._journal.finish(result, write_result(self._folder.fresh_run(result.realization), result))
        return results
