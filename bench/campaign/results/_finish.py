"""From results to what a person reads: score table, manifest, report."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import polars as pl

from bench.contracts import Outcome, SessionResult
from bench.documents import dump_yaml, load_document
from bench.errors import Fault, SetupError
from bench.reporting import write_report
from bench.scoring import Difficulty, ScoredRun, difficulty_of, score_table, studied_key_attributes, summary_frame
from bench.simspec import SimSpec
from decompositions import Decomposition

from .._document import Campaign
from .._versions import versions
from ..early_stopping._decisions import Key, is_past, outcome_name
from ..storage._folder import (
    RECORDING,
    RESULT,
    CampaignFolder,
    digest_of,
    open_lock,
    read_result,
    write_manifest,
    write_result,
    write_whole,
)
from ..storage._journal import Entry, open_journal
from ._measures import load_asked
from ._rescore import changed_since, rescore


@dataclass(frozen=True, slots=True)
class Finished:
    """What a finished campaign says: `summary` has the columns SUMMARY_COLUMNS of bench.scoring."""

    summary: pl.DataFrame
    study: tuple[str, ...]
    outcomes: dict[str, int]
    report: Path


def finish_campaign(path: Path, decomposition: str | None = None) -> Finished:
    """Write scores.parquet, manifest.json and report.html over the results that lie in a campaign folder.

    May be called at any time; what has no result yet has no row. Raises SetupError when the folder is no campaign.
    """
    folder, campaign, asked = read_campaign_folder(path, decomposition)
    entries, stops = _noted(folder)
    runs, outcomes = _scored_runs(folder, campaign, asked, entries, stops)
    write_whole(folder.decomposition, dump_yaml(asked.document))
    scores = score_table(asked, runs, campaign.study)
    buffer = io.BytesIO()
    scores.write_parquet(buffer)
    write_whole(folder.scores, buffer.getvalue())

    def seal() -> None:
        write_manifest(folder, campaign.name, asked.digest, outcomes, versions())

    seal()  # the report shows the manifest ...
    report = write_report(folder.path)
    seal()  # ... and the manifest holds the report's digest, which the report leaves out
    return Finished(summary_frame(scores, asked), studied_key_attributes(asked, campaign.study), outcomes, report)


def rescore_campaign(path: Path, decomposition: str | None = None) -> Finished:
    """Measure every recording of a campaign anew, write the results, and finish it as at its end.

    A run whose result.json is gone gets it back from its recording. Another decomposition replaces the campaign's own.
    """
    folder, _, asked = read_campaign_folder(path, decomposition)
    with open_lock(path), open_journal(folder.journal) as journal:
        runs = {entry.id: folder.run(entry.id) for entry in journal.entries()}
        recorded = {name: run for name, run in runs.items() if (run / RECORDING).is_file()}
        digests = journal.recordings()
        faults = [fault for name, run in recorded.items() for fault in changed_since(run, digests.get(name))]
        if faults:  # all of them, before any result is written
            raise SetupError(faults)
        for name, run in recorded.items():
            result = rescore(run, asked)
            digest = write_result(run, result)
            journal.forget(name)
            journal.finish(result, digest)
    return finish_campaign(path, decomposition)


@dataclass(frozen=True, slots=True)
class CampaignRuns:
    """The runs of a campaign that have a result, as scoring takes them; recordings, and why each ended so, by realization.

    `fidelity` is the one at which they were flown.
    """

    decomposition: Decomposition
    study: tuple[str, ...]
    runs: tuple[ScoredRun, ...]
    recordings: Mapping[str, Path]
    reasons: Mapping[str, str]
    fidelity: Literal["full", "overhead"] = "full"


def read_runs(path: Path, decomposition: str | None = None) -> CampaignRuns:
    """The runs that lie in a campaign folder; nothing is written.

    With another decomposition than the campaign's own their recordings are measured anew. Raises SetupError when the
    folder is no campaign, or a recording cannot be measured.
    """
    folder, campaign, asked = read_campaign_folder(path, decomposition)
    entries, stops = _noted(folder)
    runs, _ = _scored_runs(folder, campaign, asked, entries, stops)
    recordings = {run.realization: folder.run(run.realization) / RECORDING for run in runs}
    recordings = {name: recording for name, recording in recordings.items() if recording.is_file()}
    if decomposition is not None:
        runs = [
            replace(run, observations=rescore(folder.run(run.realization), asked).observations)
            if run.realization in recordings
            else run
            for run in runs
        ]
    reasons = {entry.id: entry.reason for entry in entries}
    return CampaignRuns(asked, studied_key_attributes(asked, campaign.study), tuple(runs), recordings, reasons, campaign.fidelity)


def read_campaign_folder(path: Path, decomposition: str | None = None) -> tuple[CampaignFolder, Campaign, Decomposition]:
    """The parts of a campaign folder that say what was asked."""
    if not is_campaign(path):
        raise SetupError(Fault(str(path), "is not a campaign's folder", "name one that `rebar run` wrote"))
    folder = CampaignFolder(path)
    campaign = load_document(folder.campaign, Campaign)
    own = folder.decomposition if folder.decomposition.is_file() else campaign.decomposition
    return folder, campaign, load_asked(decomposition or own)


def is_campaign(path: Path) -> bool:
    """Whether a folder is a campaign's."""
    return (path / "campaign.yaml").is_file() and (path / "journal.sqlite").is_file()


def _noted(folder: CampaignFolder) -> tuple[list[Entry], dict[Key, int]]:
    """What the journal says of realizations, and where design points were settled."""
    with open_journal(folder.journal) as journal:
        return journal.entries(), journal.stops()


def _scored_runs(
    folder: CampaignFolder,
    campaign: Campaign,
    decomposition: Decomposition,
    entries: list[Entry],
    stops: Mapping[Key, int],
) -> tuple[list[ScoredRun], dict[str, int]]:
    """The runs that count, and how all realizations ended: nothing behind a stop counts, flown or not."""
    runs = []
    outcomes: Counter[str] = Counter()
    rated: dict[tuple[str, int], Difficulty] = {}
    for entry in entries:
        result = _result(folder, entry)
        outcomes[outcome_name(entry, result.outcome, stops) if result else "not finished"] += 1
        if result is not None and result.outcome is not Outcome.SETTLED and not is_past(entry, stops):
            scene = (entry.design_point, entry.replicate)
            if scene not in rated:
                rated[scene] = difficulty_of(decomposition, load_document(folder.simspec(entry.id), SimSpec))
            runs.append(_scored_run(entry, result, rated[scene], campaign.stopping is not None))
    return runs, dict(outcomes)


def _result(folder: CampaignFolder, entry: Entry) -> SessionResult | None:
    """The result as the journal noted it; one that somebody changed since is none."""
    run = folder.run(entry.id)
    result = read_result(run, entry.id)
    if result is not None and entry.result_sha256 is not None and digest_of(run / RESULT) != entry.result_sha256:
        return None
    return result


def _scored_run(entry: Entry, result: SessionResult, difficulty: Difficulty, until_settled: bool) -> ScoredRun:
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
