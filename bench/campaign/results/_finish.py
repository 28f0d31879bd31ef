"""From the results of a campaign to what a person reads: score table, manifest, report."""

from __future__ import annotations

import io
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import polars as pl

from bench.contracts import Outcome, SessionResult, truth_sightings_of
from bench.documents import dump_yaml, load_document, load_json_document
from bench.errors import Fault, SetupError
from bench.reporting import write_report
from bench.scoring import (
    Difficulty,
    NodeFloor,
    ScoredRun,
    difficulty_of,
    node_floors,
    score_table,
    studied_key_attributes,
    summary_frame,
)
from bench.simspec import SimSpec
from decompositions import Decomposition

from .._document import Campaign
from .._versions import versions
from ..early_stopping._decisions import PointKey, is_after_stop, outcome_name
from ..execution._parallel import OnDone, map_in_processes
from ..storage._completeness import NOT_FINISHED, Completeness, accepted_realizations, completeness_of
from ..storage._dropped import dropped_recording
from ..storage._elsewhere import drop_again, recordings_elsewhere
from ..storage._evidence_check import changed_tables, check_evidence, evidence_faults
from ..storage._files import digest_of, write_whole
from ..storage._firmware_ends import drawn_out_realizations
from ..storage._folder import RECORDING, RESULT, CampaignFolder, open_lock, writing_process
from ..storage._inputs import write_input
from ..storage._journal import JournalEntry, open_journal
from ..storage._manifest import write_manifest
from ..storage._results import read_result, write_result
from ._measures import load_measurable_decomposition
from ._rescore import recording_faults, rescore

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


def finish_campaign(path: Path, other_decomposition: str | None = None) -> FinishedCampaign:
    """Write scores.parquet, manifest.json and report.html from the results in a campaign folder.

    A realization without a result has no row. Raises SetupError if the folder is not a campaign, if another
    process is writing in it, and if something in it was changed since it was written.
    """
    with open_lock(path, reentrant=True) as was_free:
        if was_free:
            paths, _, _ = read_campaign_folder(path, other_decomposition)
            with open_journal(paths.journal) as journal:
                check_evidence(paths, journal)
        # Else the runner of this process checked the folder before it flew.
        return _finish_campaign(path, other_decomposition)


def _finish_campaign(path: Path, other_decomposition: str | None) -> FinishedCampaign:
    folder, campaign, decomposition = read_campaign_folder(path, other_decomposition)
    rewritten = tuple(changed_tables(folder))
    results = _read_results(folder)
    all_runs = _scored_runs(folder, campaign, decomposition, results)
    runs, floor_runs = _split(all_runs, campaign)
    with open_journal(folder.journal) as journal:
        write_input(folder.decomposition, dump_yaml(decomposition.document), journal)
    scores = score_table(decomposition, runs, campaign.study)
    _write_table(folder.scores, scores)
    # A table of its own: whatever reads scores.parquet is about the agents under test.
    floor_scores = score_table(decomposition, floor_runs, campaign.study)
    if campaign.floor is not None:
        _write_table(folder.floor, floor_scores)

    def seal() -> None:
        write_manifest(
            folder,
            campaign.name,
            decomposition.digest,
            results.outcomes,
            versions(),
            results.completeness,
            campaign.pace,
        )

    # Twice: the report shows the manifest, and the manifest holds the digest of the report, which the report
    # leaves out.
    seal()
    report = write_report(folder.path)
    seal()
    return FinishedCampaign(
        summary_frame(scores, decomposition),
        studied_key_attributes(decomposition, campaign.study),
        results.outcomes,
        results.completeness,
        report,
        rewritten,
        node_floors(floor_scores, campaign.oracle_label),
        results.saw_truth,
    )


def _split(runs: Sequence[ScoredRun], campaign: Campaign) -> tuple[list[ScoredRun], list[ScoredRun]]:
    """The runs of the agents under test, and those of the floor."""
    tested = [run for run in runs if run.agent not in campaign.floor_labels]
    return tested, [run for run in runs if run.agent in campaign.floor_labels]


def _write_table(path: Path, table: pl.DataFrame) -> None:
    buffer = io.BytesIO()
    table.write_parquet(buffer)
    write_whole(path, buffer.getvalue())


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
        elsewhere = recordings_elsewhere(runs)
        if dropped := [
            name for name, run in runs.items() if name not in elsewhere and dropped_recording(run) is not None
        ]:
            what = f"{len(dropped)} of its recordings were dropped when they were flown (keep), so they cannot be measured"
            raise SetupError(
                Fault(str(path), what, "fly it with keep: {recordings: all} into another folder")
            )
        recorded = {
            name: run for name, run in runs.items() if (run / RECORDING).is_file() or name in elsewhere
        }
        digests = journal.recordings()
        faults = [
            fault
            for name, run in recorded.items()
            # Of one that lies elsewhere the digest is compared when it is fetched.
            if name not in elsewhere
            for fault in recording_faults(run, digests.get(name))
        ]
        # Before any result is written: otherwise a fault would leave half of the campaign measured in the new
        # way.
        if faults:
            raise SetupError(faults)
        # All before the first is written: an interruption leaves results, scores and report as they were.
        results = map_in_processes(
            partial(rescore, decomposition=decomposition),
            list(recorded.values()),
            _workers(workers, campaign, len(recorded)),
            on_measured,
        )
        for run, result in zip(recorded.values(), results, strict=True):
            journal.measure(result, write_result(run, result))
            drop_again(journal, run, result)
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
    results = _read_results(folder, check=True)
    runs = _scored_runs(folder, campaign, decomposition, results)
    recordings = {run.realization: folder.run(run.realization) / RECORDING for run in runs}
    recordings = {name: recording for name, recording in recordings.items() if recording.is_file()}
    if other_decomposition is not None:
        runs = [
            replace(run, observations=rescore(folder.run(run.realization), decomposition).observations)
            if run.realization in recordings
            else run
            for run in runs
        ]
    reasons = {entry.id: entry.reason for entry, _ in results.ends}
    tested, floor_runs = _split(runs, campaign)
    return CampaignRuns(
        decomposition,
        studied_key_attributes(decomposition, campaign.study),
        tuple(tested),
        recordings,
        reasons,
        results.completeness,
        campaign.fidelity,
        tuple(floor_runs),
        campaign.oracle_label,
    )


def campaign_completeness(path: Path) -> Completeness | None:
    """Which runs of a campaign are missing, and whether a process is writing in its folder. Checks nothing.

    None for a folder without a journal, such as results that were copied without it.
    """
    return _read_results(CampaignFolder(path)).completeness if is_campaign(path) else None


def read_campaign_folder(
    path: Path, other_decomposition: str | None = None
) -> tuple[CampaignFolder, Campaign, Decomposition]:
    """Paths, campaign and decomposition of a campaign folder.

    `other_decomposition` replaces the campaign's.
    """
    if not is_campaign(path):
        raise SetupError(
            Fault(str(path), "is not the folder of a campaign", "name a folder that `rebar run` wrote")
        )
    folder = CampaignFolder(path)
    campaign = load_document(folder.campaign, Campaign)
    default = folder.decomposition if folder.decomposition.is_file() else campaign.decomposition
    return folder, campaign, load_measurable_decomposition(other_decomposition or default)


def is_campaign(path: Path) -> bool:
    """Whether a folder is the folder of a campaign."""
    return (path / "campaign.yaml").is_file() and (path / "journal.sqlite").is_file()


@dataclass(frozen=True, slots=True)
class _Results:
    """Every realization of a journal with its result, None without one; and where design points stopped
    early.
    """

    ends: tuple[tuple[JournalEntry, SessionResult | None], ...]
    stops: Mapping[PointKey, int]
    completeness: Completeness

    @property
    def outcomes(self) -> dict[str, int]:
        """The number of realizations by outcome."""
        return dict(
            Counter(
                outcome_name(entry, result.outcome, self.stops) if result else NOT_FINISHED
                for entry, result in self.ends
            )
        )

    @property
    def saw_truth(self) -> tuple[str, ...]:
        """The realizations whose agents reported a honeypot."""
        return tuple(entry.id for entry, result in self.ends if result and truth_sightings_of(result.details))


def _read_results(folder: CampaignFolder, *, check: bool = False) -> _Results:
    writer = writing_process(folder.path)
    with open_journal(folder.journal) as journal:
        entries, stops, accepted = journal.entries(), journal.stops(), accepted_realizations(journal)
        drawn_out = drawn_out_realizations(journal)
        # Beside a writer, files are newer than the chain that was read a moment ago.
        if check and writer is None and (faults := evidence_faults(folder, journal)):
            raise SetupError(faults)
    ends = tuple((entry, _result(folder, entry)) for entry in entries)
    outcomes = ((entry, result.outcome if result else None) for entry, result in ends)
    return _Results(ends, stops, replace(completeness_of(outcomes, accepted, drawn_out), writer=writer))


def _scored_runs(
    folder: CampaignFolder, campaign: Campaign, decomposition: Decomposition, results: _Results
) -> list[ScoredRun]:
    """The runs that count. No run after a stop counts, flown or not."""
    runs = []
    stops = results.stops
    rated: dict[tuple[str, int], Difficulty] = {}
    for entry, result in results.ends:
        if result is not None and result.outcome is not Outcome.SETTLED and not is_after_stop(entry, stops):
            # Difficulty is a property of the scene, the same for every agent.
            scene = (entry.design_point, entry.replicate)
            if scene not in rated:
                rated[scene] = difficulty_of(
                    decomposition, load_json_document(folder.simspec(entry.id), SimSpec)
                )
            runs.append(_scored_run(entry, result, rated[scene], campaign.stopping is not None))
    return runs


def _result(folder: CampaignFolder, entry: JournalEntry) -> SessionResult | None:
    """The result that the journal noted. None if the file was changed since."""
    run = folder.run(entry.id)
    result = read_result(run, entry.id)
    if (
        result is not None
        and entry.result_sha256 is not None
        and digest_of(run / RESULT) != entry.result_sha256
    ):
        return None
    return result


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
    )
