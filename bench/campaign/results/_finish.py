"""From the results of a campaign to what a person reads: score table, manifest, report."""

from __future__ import annotations

import gc
import os
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

import polars as pl

from bench.contracts import Outcome, ReportStatements, SessionResult
from bench.documents import dump_yaml, load_document, load_json_document
from bench.errors import SetupError
from bench.reporting import load_page_parts, write_report
from bench.scoring import (
    Difficulty,
    NodeFloor,
    ScoredRun,
    ScoreTableWriter,
    difficulty_of,
    node_floors,
    read_score_table,
    score_table,
    studied_key_attributes,
    summary_frame,
)
from bench.simspec import SimSpec, factor_values
from decompositions import Decomposition

from .._document import Campaign
from .._parallel import OnDone, map_in_processes
from .._versions import arithmetic, versions
from ..early_stopping._decisions import is_after_stop
from ..planning._evidence_check import changed_tables, check_evidence
from ..planning._inputs import write_input
from ..planning._measures import load_measurable_decomposition
from ..storage._completeness import Completeness
from ..storage._dropped import dropped_recording
from ..storage._files import FileDigests, write_whole
from ..storage._folder import RECORDING, CampaignFolder, existing_campaign, is_campaign, open_lock
from ..storage._journal import JournalEntry
from ..storage._journal_file import open_journal
from ..storage._manifest import write_manifest
from ..storage._results import write_result
from ._campaign_results import CampaignResults
from ._rescore import pack_rescored, recording_faults, rescore, unpack_rescored

RATED_SITUATIONS = 256
"""Difficulties that are kept for other scenes with the same factors; each takes some 10 kB (measured on the demo's)."""

RECORDINGS_PER_WORKER = 8
"""With fewer recordings, a second process has not imported the measures before the first one is done."""


@dataclass(frozen=True, slots=True)
class FinishedCampaign:
    """Scores of a campaign. `summary` has the columns SUMMARY_COLUMNS of bench.scoring; `completeness` says
    which runs are missing in it, `rewritten` names files that had been changed and were written again.
    """

    summary: pl.DataFrame
    study: tuple[str, ...]
    outcomes: dict[str, int]
    completeness: Completeness
    report: Path
    rewritten: tuple[str, ...]
    floors: Mapping[str, NodeFloor]
    saw_truth: tuple[str, ...] = ()
    """Realizations whose agents reported a honeypot."""
    silent: tuple[str, ...] = ()
    """Agents under test that reported nothing in any of their runs."""


def finish_campaign(path: Path, other_decomposition: str | None = None) -> FinishedCampaign:
    """Write scores.parquet, report.html and then manifest.json from the results in a campaign folder.

    A realization without a result has no row. Raises SetupError if the folder is not a campaign, if another
    process is writing in it, and if something in it was changed since it was written.
    """
    existing_campaign(path)
    with open_lock(path, reentrant=True) as was_free:
        if was_free:
            paths, _, _ = read_campaign_folder(path, other_decomposition)
            with open_journal(paths.journal) as journal:
                check_evidence(paths, journal)
        # Else the runner of this process checked the folder before it flew.
        load_page_parts()
        with frozen_heap():
            return _finish_campaign(path, other_decomposition)


@contextmanager
def frozen_heap() -> Iterator[None]:
    """Keep the garbage collector from what is there now: it looks only at what is made in the block.

    With statistics, figures and their libraries loaded, collections took 0.8 of the 4.1 s that scores and report of 215 runs
    took (with the collector off: 3.3 s). Does nothing where the caller froze objects: `gc` cannot tell them apart.
    """
    if gc.get_freeze_count():
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _finish_campaign(path: Path, other_decomposition: str | None) -> FinishedCampaign:
    folder, campaign, decomposition = read_campaign_folder(path, other_decomposition)
    rewritten = tuple(changed_tables(folder))
    results = CampaignResults.read(folder)
    tested, floor = (ScoreTableWriter(decomposition, campaign.study) for _ in range(2))
    # One result at a time: a table is a hundredth of what all of them would take.
    for run in _scored_runs(folder, campaign, decomposition, results):
        (floor if run.agent in campaign.floor_labels else tested).add(run)
    with open_journal(folder.journal) as journal:
        write_input(folder.decomposition, dump_yaml(decomposition.document), journal)
    scores, floor_scores = tested.content(), floor.content()
    write_whole(folder.scores, scores)
    # A table of its own: whatever reads scores.parquet is about the agents under test.
    if campaign.floor is not None:
        write_whole(folder.floor, floor_scores)
    # Before the report, which reads the table itself: it is in memory once.
    summary = summary_frame(read_score_table(scores), decomposition)
    floors = node_floors(read_score_table(floor_scores), campaign.oracle_label)
    del tested, floor, scores, floor_scores
    digests = FileDigests()

    def seal() -> None:
        write_manifest(
            folder,
            campaign.name,
            decomposition.digest,
            results.outcomes,
            versions() | arithmetic(),
            results.completeness,
            campaign.pace,
            digests,
        )

    # Twice: the report shows the manifest, and the manifest holds the digest of the report, which the report
    # leaves out.
    seal()
    report = write_report(folder.path)
    seal()
    return FinishedCampaign(
        summary,
        studied_key_attributes(decomposition, campaign.study),
        results.outcomes,
        results.completeness,
        report,
        rewritten,
        floors,
        tuple(results.saw_truth),
        tuple(agent for agent in results.silent if agent not in campaign.floor_labels),
    )


def rescore_campaign(
    path: Path,
    other_decomposition: str | None = None,
    *,
    workers: int | None = None,
    on_measured: OnDone = lambda done, total: None,
) -> FinishedCampaign:
    """Measure every recording of a campaign again, write the results, and finish the campaign.

    A run whose result.json is gone gets it back from its recording. `other_decomposition` replaces the
    campaign's. `workers` overrides the campaign's budget, which overrides the number of cores; the files are the
    same for any number. Nothing is written before every recording is measured.
    """
    folder, campaign, decomposition = read_campaign_folder(path, other_decomposition)
    with open_lock(path), open_journal(folder.journal) as journal:
        check_evidence(folder, journal)
        runs = {entry.id: folder.run(entry.id) for entry in journal.entries()}
        if dropped := sum(dropped_recording(run) is not None for run in runs.values()):
            what = f"{dropped} of its recordings were dropped when they were flown (keep), so they cannot be measured"
            raise SetupError(path, what, "fly it with keep: {recordings: all} into another folder")
        recorded = {name: run for name, run in runs.items() if (run / RECORDING).is_file()}
        digests = journal.recordings()
        faults = [
            fault for name, run in recorded.items() for fault in recording_faults(run, digests.get(name))
        ]
        # Before any result is written: otherwise a fault would leave half of the campaign measured in the new
        # way.
        if faults:
            raise SetupError(faults)
        # All before the first is written: an interruption leaves results, scores and report as they were.
        packed_results = map_in_processes(
            partial(pack_rescored, decomposition=decomposition),
            list(recorded.values()),
            _workers(workers, campaign, len(recorded)),
            on_measured,
        )
        for run, packed in zip(recorded.values(), packed_results, strict=True):
            result = unpack_rescored(packed)
            journal.measure(result, write_result(run, result))
    return finish_campaign(path, other_decomposition)


def _workers(wanted: int | None, campaign: Campaign, recordings: int) -> int:
    limit = wanted or campaign.budgets.workers or len(os.sched_getaffinity(0))
    return limit if wanted else min(limit, recordings // RECORDINGS_PER_WORKER)


@dataclass(frozen=True, slots=True)
class CampaignRuns:
    """The runs of a campaign that have a result, as scoring takes them.

    `recordings` and `reasons` (why each session ended) are by realization. `completeness` says which runs are
    missing, `fidelity` is the one of all runs.
    `floor_runs` are those of null agents and of the agent with the label `oracle`; they are not among `runs`.
    """

    decomposition: Decomposition
    study: tuple[str, ...]
    runs: tuple[ScoredRun, ...]
    recordings: Mapping[str, Path]
    reasons: Mapping[str, str]
    completeness: Completeness
    fidelity: Literal["full", "overhead"] = "full"
    floor_runs: tuple[ScoredRun, ...] = ()
    oracle: str | None = None

    def floors(self) -> dict[str, NodeFloor]:
        """Floor and ceiling of every node; empty where no null agent flew."""
        return node_floors(score_table(self.decomposition, self.floor_runs, self.study), self.oracle)


def read_runs(path: Path, other_decomposition: str | None = None) -> CampaignRuns:
    """The runs in a campaign folder. Writes nothing.

    With `other_decomposition`, their recordings are measured again. Raises SetupError if the folder
    is not a campaign, something in it was changed since it was written, or a recording cannot be measured.
    Beside a process that is writing, nothing is checked; `completeness` names it.
    """
    folder, campaign, decomposition = read_campaign_folder(path, other_decomposition)
    results = CampaignResults.read(folder, check=True)
    runs = list(_scored_runs(folder, campaign, decomposition, results))
    recordings = {run.realization: folder.run(run.realization) / RECORDING for run in runs}
    recordings = {name: recording for name, recording in recordings.items() if recording.is_file()}
    if other_decomposition is not None:
        runs = [
            replace(run, observations=rescore(folder.run(run.realization), decomposition).observations)
            if run.realization in recordings
            else run
            for run in runs
        ]
    reasons = {entry.id: entry.reason for entry in results.entries}
    return CampaignRuns(
        decomposition,
        studied_key_attributes(decomposition, campaign.study),
        tuple(run for run in runs if run.agent not in campaign.floor_labels),
        recordings,
        reasons,
        results.completeness,
        campaign.fidelity,
        tuple(run for run in runs if run.agent in campaign.floor_labels),
        campaign.oracle_label,
    )


def campaign_completeness(path: Path) -> Completeness | None:
    """Which runs of a campaign are missing, and whether a process is writing in its folder. Checks nothing.

    None for a folder without a journal, such as results that were copied without it.
    """
    if not is_campaign(path):
        return None
    results = CampaignResults.read(CampaignFolder(path))
    deque(results.ends(), maxlen=0)
    return results.completeness


def read_campaign_folder(
    path: Path, other_decomposition: str | None = None
) -> tuple[CampaignFolder, Campaign, Decomposition]:
    """Paths, campaign and decomposition of a campaign folder.

    `other_decomposition` replaces the campaign's.
    """
    folder = existing_campaign(path)
    campaign = load_document(folder.campaign, Campaign)
    default = folder.decomposition if folder.decomposition.is_file() else campaign.decomposition
    return folder, campaign, load_measurable_decomposition(other_decomposition or default)


def _scored_runs(
    folder: CampaignFolder, campaign: Campaign, decomposition: Decomposition, results: CampaignResults
) -> Iterator[ScoredRun]:
    """The runs that count. No run after a stop counts, flown or not."""
    scenes = _SceneDifficulty(folder, decomposition)
    for entry, result in results.ends():
        if (
            result is not None
            and result.outcome is not Outcome.SETTLED
            and not is_after_stop(entry, results.stops)
        ):
            yield _scored_run(entry, result, scenes.of(entry), campaign.stopping is not None)


@dataclass(slots=True)
class _SceneDifficulty:
    """The difficulty of one scene after another: a property of the scene, the same for every agent.

    Scenes with equal factors share one object, which scoring then looks at once.
    """

    folder: CampaignFolder
    decomposition: Decomposition
    _scene: tuple[str, int] | None = None
    _difficulty: Difficulty | None = None
    _rated: dict[tuple[object, ...], Difficulty] = field(default_factory=dict)

    def of(self, entry: JournalEntry) -> Difficulty:
        """The difficulty of the scene that a realization flies."""
        scene = (entry.design_point, entry.replicate)
        # Agents of a scene follow each other in the journal, so mostly the last one is asked for again.
        if self._difficulty is None or scene != self._scene:
            self._scene, self._difficulty = scene, self._rate(entry)
        return self._difficulty

    def _rate(self, entry: JournalEntry) -> Difficulty:
        simspec = load_json_document(self.folder.simspec(entry.id), SimSpec)
        values = factor_values(simspec)
        situation = (simspec.perception.source, *values.items())
        if situation not in self._rated:
            if len(self._rated) == RATED_SITUATIONS:
                self._rated.clear()
            self._rated[situation] = difficulty_of(self.decomposition, simspec)
        return self._rated[situation]


def _scored_run(
    entry: JournalEntry, result: SessionResult, difficulty: Difficulty, until_settled: bool
) -> ScoredRun:
    return ScoredRun(
        realization=entry.id,
        design_point=entry.design_point,
        replicate=entry.replicate,
        agent=entry.agent,
        outcome=result.outcome,
        difficulty=difficulty,
        observations=result.observations,
        until_settled=until_settled,
        statements=result.fact(ReportStatements),
    )
