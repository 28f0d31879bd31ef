"""The results of a campaign, read from its folder one at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from bench.contracts import Outcome, OverheadFidelity, ReportStatements, SessionResult, TruthSightings
from bench.errors import SetupError

from ..early_stopping._decisions import PointKey, outcome_name
from ..planning._evidence_check import evidence_faults
from ..storage._completeness import NOT_FINISHED, Completeness, accepted_realizations, completeness_of
from ..storage._files import digest_of
from ..storage._firmware_ends import drawn_out_realizations
from ..storage._folder import RESULT, CampaignFolder, writing_process
from ..storage._journal import JournalEntry
from ..storage._journal_file import open_journal_to_read
from ..storage._results import read_result


@dataclass(slots=True)
class CampaignResults:
    """The realizations of a journal, where design points stopped early, and how the realizations ended.

    `outcomes`, `completeness`, `failed_measures` (runs by what the failure of a measure says), `saw_truth` (the
    realizations whose agents reported a honeypot) and `silent` (agents that reported nothing in any flight) are about the results
    that `ends` has read. Results themselves are not kept: of a large campaign they would not fit into memory.
    """

    folder: CampaignFolder
    entries: Sequence[JournalEntry]
    stops: Mapping[PointKey, int]
    accepted: frozenset[str]
    drawn_out: frozenset[str]
    writer: str | None
    saw_truth: list[str] = field(default_factory=list)
    failed_measures: Counter[str] = field(default_factory=Counter)
    _has_reported: dict[str, bool] = field(default_factory=dict)
    _ends: list[Outcome | None] = field(default_factory=list)

    @classmethod
    def read(cls, folder: CampaignFolder, *, check: bool = False) -> CampaignResults:
        """Read the journal. With `check`, raises SetupError if something in the folder was changed since it was
        written; beside a process that is writing, nothing is checked.
        """
        writer = writing_process(folder.path)
        with open_journal_to_read(folder.journal) as journal:
            # Beside a writer, files are newer than the chain that was read a moment ago.
            if check and writer is None and (faults := evidence_faults(folder, journal)):
                raise SetupError(faults)
            return cls(
                folder,
                journal.entries(),
                journal.stops(),
                accepted_realizations(journal),
                drawn_out_realizations(journal),
                writer,
            )

    def ends(self) -> Iterator[tuple[JournalEntry, SessionResult | None]]:
        """Every realization with its result, None without one."""
        self._ends, self.saw_truth, self.failed_measures, self._has_reported = [], [], Counter(), {}
        for entry in self.entries:
            result = self._result(entry)
            self._ends.append(result.outcome if result else None)
            if result and result.fact(TruthSightings):
                self.saw_truth.append(entry.id)
            if result:
                self.failed_measures.update(
                    {observation.failure for observation in result.observations} - {""}
                )
                # A surrogate has no recording of what it reports.
                if result.observations and not result.fact(OverheadFidelity):
                    reports = result.fact(ReportStatements) is not None
                    self._has_reported[entry.agent] = reports or self._has_reported.get(entry.agent, False)
            yield entry, result

    @property
    def silent(self) -> tuple[str, ...]:
        """The agents that reported nothing in any of their runs."""
        return tuple(sorted(agent for agent, reports in self._has_reported.items() if not reports))

    @property
    def outcomes(self) -> dict[str, int]:
        """The number of realizations by outcome."""
        return dict(
            Counter(
                outcome_name(entry, outcome, self.stops) if outcome else NOT_FINISHED
                for entry, outcome in zip(self.entries, self._ends, strict=True)
            )
        )

    @property
    def completeness(self) -> Completeness:
        """Which runs are missing."""
        ends = zip(self.entries, self._ends, strict=True)
        completeness = completeness_of(ends, self.accepted, self.drawn_out)
        return replace(completeness, writer=self.writer, failed_measures=dict(self.failed_measures))

    def _result(self, entry: JournalEntry) -> SessionResult | None:
        """The result that the journal noted. None if the file was changed since."""
        run = self.folder.run(entry.id)
        result = read_result(run, entry.id)
        changed = entry.result_sha256 is not None and digest_of(run / RESULT) != entry.result_sha256
        return None if result is not None and changed else result
