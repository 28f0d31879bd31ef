"""Joins the shards of a campaign, flown in folders of their own, to the folder that one run would have left."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.errors import Fault, SetupError, command_line
from decompositions import Decomposition

from .._document import Campaign, parse_shard
from .._overhead import check_fidelity
from .._runner import CampaignSummary, Collaborators, Finish, RunOptions, run_campaign_sync
from ..planning._evidence_check import verify_folder
from ..planning._plan import plan_campaign
from ..storage._completeness import accepted_realizations, adopt_accepted
from ..storage._dropped import dropped_recording
from ..storage._files import digest_of
from ..storage._firmware_ends import add_firmware_ends, firmware_ends
from ..storage._folder import RESULT, CampaignFolder, open_lock
from ..storage._journal import Journal, JournalEntry
from ..storage._journal_file import open_journal, open_journal_to_read
from ..storage._manifest import Manifest, read_manifest
from ..storage._results import read_result
from ._finish import read_campaign_folder

SHARDS = "shards"
"""In the joined folder: manifest and chain of evidence of each shard, as they came."""


@dataclass(frozen=True, slots=True)
class _Shard:
    folder: CampaignFolder
    campaign: Campaign
    decomposition: Decomposition
    manifest: Manifest
    number: int
    count: int


def merge_shards(folders: Sequence[Path], out: Path, finish: Finish) -> CampaignSummary:
    """Join all shards of a campaign in a new folder. The shards stay as they are.

    Results and recordings are the same bytes, so scores are those of one run; journal and chain of evidence tell of the
    joining, and the chains of the shards are kept beside them. Recordings are hard links where the disk allows it.

    Raises SetupError if a shard is missing, twice there, incomplete, changed since it was written, flown by another
    version of the bench, or of another campaign, and if `out` exists.
    """
    shards = [_read(folder) for folder in folders]
    _check_together(shards)
    if out.exists() and any(out.iterdir()):
        raise SetupError(out, "exists already and is not empty", "name another folder with --out")
    campaign, decomposition = _whole(shards[0]), shards[0].decomposition
    paths = CampaignFolder(out)
    with open_lock(out), open_journal(paths.journal) as journal:
        check_fidelity(campaign, journal)
        # No look before take-off: nothing flies here, and the agents may be elsewhere.
        plan_campaign(campaign, paths, journal, decomposition, workers=len(os.sched_getaffinity(0)))
        planned = {entry.id: entry for entry in journal.entries()}
        stops: dict[tuple[str, str], int] = {}
        for shard in sorted(shards, key=lambda shard: shard.number):
            with open_journal_to_read(shard.folder.journal) as source:
                for entry in source.entries():
                    _adopt(entry, planned[entry.id], shard, paths, journal)
                adopt_accepted(journal, accepted_realizations(source))
                add_firmware_ends(journal, firmware_ends(source))
                stops |= source.stops()
            for file in (shard.folder.manifest, shard.folder.evidence, shard.folder.signature):
                if file.is_file():
                    _link(file, paths.path / SHARDS / str(shard.number) / file.name)
        journal.set_stops(stops)
    # Nothing is left to fly: this writes scores, report and manifest, as it does at the end of any run.
    return run_campaign_sync(campaign, out, RunOptions(decomposition), Collaborators(finish=finish))


def _whole(shard: _Shard) -> Campaign:
    """The campaign of which this is a shard."""
    copied = shard.campaign.decomposition == shard.folder.decomposition.name
    named = str(shard.folder.decomposition) if copied else shard.campaign.decomposition
    return shard.campaign.model_copy(update={"shard": None, "decomposition": named})


def _read(path: Path) -> _Shard:
    if faults := verify_folder(path):
        raise SetupError([Fault(f"{path}: {fault.where}", fault.what, fault.remedy) for fault in faults])
    folder, campaign, decomposition = read_campaign_folder(path, None)
    manifest = read_manifest(folder.manifest)
    if campaign.shard is None:
        raise SetupError(path, "is no shard", "name folders that were flown with --shard")
    if manifest is None or manifest.missing:
        raise SetupError(
            path,
            f"shard {campaign.shard} lacks runs",
            "run it to its end: " + command_line("rebar", "run", folder.campaign, "--out", path),
        )
    return _Shard(folder, campaign, decomposition, manifest, *parse_shard(campaign.shard))


def _check_together(shards: Sequence[_Shard]) -> None:
    """Raise SetupError unless these are all shards of one campaign, each once."""
    first = shards[0]
    faults = []
    for shard in shards[1:]:
        where = str(shard.folder.path)
        if shard.campaign.model_copy(update={"shard": first.campaign.shard}) != first.campaign:
            faults.append(Fault(where, f"is of another campaign than {first.folder.path}", "leave it out"))
        elif shard.count != first.count:
            faults.append(
                Fault(where, f"is one of {shard.count} shards, not of {first.count}", "leave it out")
            )
        elif shard.manifest.decomposition_sha256 != first.manifest.decomposition_sha256:
            faults.append(
                Fault(where, "was measured with another decomposition", "apply one with `rebar score`")
            )
        elif differing := _differing(first.manifest.versions, shard.manifest.versions):
            faults.append(
                Fault(where, f"was flown with other versions: {differing}", "fly it with the same ones again")
            )
    numbers = [shard.number for shard in shards]
    faults += [
        Fault(
            "rebar merge",
            f"shard {number}/{first.count} is there {numbers.count(number)} times",
            "name each once",
        )
        for number in sorted(set(numbers))
        if numbers.count(number) > 1
    ]
    missing = [f"{number}/{first.count}" for number in range(1, first.count + 1) if number not in numbers]
    if missing and not faults:
        faults.append(Fault("rebar merge", f"shards are missing: {', '.join(missing)}", "name all folders"))
    if faults:
        raise SetupError(faults)


def _differing(one: dict[str, str], other: dict[str, str]) -> str:
    names = [name for name in sorted({*one, *other}) if one.get(name) != other.get(name)]
    return ", ".join(f"{name} {other.get(name)} instead of {one.get(name)}" for name in names)


def _adopt(
    entry: JournalEntry, planned: JournalEntry, shard: _Shard, folder: CampaignFolder, journal: Journal
) -> None:
    """Take a result over: its files, and what the journal says of it."""
    if (entry.intent_sha256, entry.simspec_sha256) != (planned.intent_sha256, planned.simspec_sha256):
        raise SetupError(
            shard.folder.simspec(entry.id),
            "is not the scene that this host places for it",
            "join the shards where they were flown, with the same versions",
        )
    source = shard.folder.run(entry.id)
    result = read_result(source, entry.id)
    # The check of the shard's folder found every result.
    assert result is not None
    run = folder.fresh_run(entry.id)
    for file in _files(source):
        _link(file, run / file.relative_to(source))
    for attempt in range(entry.attempts):
        journal.start(entry.id, f"shard-{shard.number}")
        if attempt + 1 < entry.attempts:
            journal.retry(entry.id, "", "an earlier attempt in the shard")
    journal.finish(result, digest_of(run / RESULT))
    if (dropped := dropped_recording(run)) is not None:
        journal.drop(entry.id, dropped.policy)


def _files(folder: Path) -> Iterator[Path]:
    return (file for file in sorted(folder.rglob("*")) if file.is_file())


def _link(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:
        # Another disk, or one without links.
        shutil.copy2(source, target)
