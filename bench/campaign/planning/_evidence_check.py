"""Whether what a campaign folder holds is what its chain of evidence, its journal and its manifest say."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from bench.errors import Fault, SetupError

from ..storage._dropped import DROPPED
from ..storage._evidence_log import EvidenceEntry, EvidenceLog
from ..storage._files import digest_of
from ..storage._folder import (
    MADE_FROM_RESULTS,
    RECORDING,
    RESULT,
    CampaignFolder,
    campaign_of,
    realization_in,
)
from ..storage._journal import Journal, JournalEntry, RealizationState
from ..storage._journal_file import open_journal_to_read
from ..storage._manifest import Manifest, chain_fault, manifest_differences, read_manifest
from ..storage._recovery import is_unnoted
from ..storage._signature import signature_faults
from ._inputs import input_faults

_REMEDY = "restore it from a copy; `rebar verify` lists everything that disagrees"
# Digests of these are in the chain or in the journal, or are of no result.
_EVIDENCE_FOLDERS = frozenset({"runs", "simspecs", "aside"})


def evidence_faults(folder: CampaignFolder, journal: Journal) -> list[Fault]:
    """Everything in which files, journal, chain and manifest disagree. What is missing is no disagreement.

    Files are read: results and recordings once, and once more where the manifest lists them.
    """
    log = journal.evidence
    if log.faults:
        return log.faults
    manifest, faults = _manifest(folder)
    if not log.path.is_file() and any(entry.state is RealizationState.DONE for entry in journal.entries()):
        return [Fault(str(log.path), "is gone, so no result can be checked", "restore it from a copy")]
    if not journal.intact:
        remedy = (
            f"restore it from a copy, or move {folder.journal.name}* away and run again: it is made anew, with the "
            f"results in runs/ that {log.path.name} knows"
        )
        faults.append(Fault(str(folder.journal), "was edited after the bench wrote it", remedy))
    faults += input_faults(folder, journal, manifest)
    recordings = journal.recordings()
    for entry in journal.entries():
        faults += _faults_of(folder, journal, entry, recordings.get(entry.id))
    if manifest is not None:
        faults += _manifest_faults(folder, journal, manifest)
    return faults


def check_evidence(folder: CampaignFolder, journal: Journal) -> None:
    """Raises SetupError with everything in which a folder disagrees."""
    if faults := evidence_faults(folder, journal):
        raise SetupError(faults)


def check_run(run: Path) -> None:
    """Raises SetupError if a run's folder lies in a campaign folder and does not hold what was flown there. A
    recording whose result is gone is checked too. Any other folder passes.
    """
    run = run.resolve()
    folder = campaign_of(run)
    if folder is None or not folder.evidence.is_file():
        return
    log = EvidenceLog(folder.evidence)
    line = log.result_of(run.name)
    faults = [
        *log.faults,
        *(_changed_files(run, line, f"{log.path.name}:{line.number}") if line is not None else ()),
    ]
    # The result was withdrawn because it is gone; the journal keeps the digest of the recording behind it.
    if line is None and folder.journal.is_file() and (run / RECORDING).is_file():
        with open_journal_to_read(folder.journal) as journal:
            sha256 = journal.recordings().get(run.name)
        if sha256 not in (None, digest_of(run / RECORDING)):
            what = f"has changed since its session: its digest differs from the one in {folder.journal.name}"
            faults.append(Fault(str(run / RECORDING), what, _REMEDY))
    if faults:
        raise SetupError(faults)


def verify_folder(path: Path, digest: str | None = None, signed_by: Path | None = None) -> list[Fault]:
    """Everything in which a campaign folder disagrees with its manifest, its chain of evidence and its journal.

    `digest` is the SHA-256 of the manifest that was published, `signed_by` the public key that must have signed it. A campaign that is not complete has no
    manifest; its results are checked against chain and journal. Raises SetupError for any other folder
    without one, for a file, and for a `signed_by` that is no public key.
    """
    folder = CampaignFolder(path)
    _check_is_folder(folder)
    faults = []
    if (
        digest is not None
        and folder.manifest.is_file()
        and (actual := digest_of(folder.manifest)) != digest.lower()
    ):
        faults = [Fault(folder.manifest.name, f"has the digest {actual}, not the one given")]
    if folder.manifest.is_file() or not folder.journal.is_file():
        faults += manifest_differences(path)
    faults += signature_faults(path, signed_by)
    # Of the journal the manifest tells that it has changed, and only the journal itself what in it.
    listed = {str(path / fault.where) for fault in faults} - {str(folder.journal)}
    if folder.journal.is_file():
        try:
            with open_journal_to_read(folder.journal) as journal:
                faults += [fault for fault in evidence_faults(folder, journal) if fault.where not in listed]
                if not folder.manifest.is_file() and _is_finished(journal):
                    faults.append(
                        Fault(
                            folder.manifest.name,
                            "is missing, though every realization has a result",
                            "restore it from a copy, or run the campaign again if it was killed before it wrote one",
                        )
                    )
        except SetupError as error:
            faults += error.faults
    return faults


def _check_is_folder(folder: CampaignFolder) -> None:
    """Raises SetupError for what can be no campaign folder: nothing, a file, the folder of one run."""
    path = folder.path
    if not path.exists():
        raise SetupError(path, "does not exist", "give the folder that `rebar run` wrote")
    run = path if path.is_dir() else path.parent
    if path.is_dir() and (
        folder.manifest.is_file() or folder.journal.is_file() or not (run / RECORDING).is_file()
    ):
        return
    what = "is the folder of one run" if path.is_dir() else "is a file"
    campaign = campaign_of(run)
    remedy = "give the folder of a campaign" if campaign is None else f"give its campaign: {campaign.path}"
    if (run / RECORDING).is_file():
        remedy += f"; `rebar score {shlex.quote(str(run))}` checks one recording, against its result or by its own checksums"
    raise SetupError(path, what, remedy)


def changed_tables(folder: CampaignFolder) -> list[str]:
    """Files made from the results that differ from the manifest: to be written again, and told."""
    manifest = read_manifest(folder.manifest)
    return [
        name
        for name, sha256 in (manifest.files.items() if manifest else ())
        if name in MADE_FROM_RESULTS
        and (folder.path / name).is_file()
        and digest_of(folder.path / name) != sha256
    ]


def _is_finished(journal: Journal) -> bool:
    entries = journal.entries()
    return bool(entries) and all(entry.state is RealizationState.DONE for entry in entries)


def _manifest(folder: CampaignFolder) -> tuple[Manifest | None, list[Fault]]:
    if not folder.manifest.is_file():
        return None, []
    manifest = read_manifest(folder.manifest)
    if manifest is None:
        return None, [Fault(str(folder.manifest), "was edited or is damaged", _REMEDY)]
    return manifest, []


def _faults_of(
    folder: CampaignFolder, journal: Journal, entry: JournalEntry, recording_sha256: str | None
) -> Iterator[Fault]:
    simspec, run = folder.simspec(entry.id), folder.run(entry.id)
    if simspec.is_file() and digest_of(simspec) != entry.simspec_sha256:
        yield Fault(
            str(simspec), "is not the one in the journal", f"{_REMEDY}, or delete it: its seeds bring it back"
        )
    done = entry.state is RealizationState.DONE
    line = journal.evidence.result_of(entry.id)
    if line is None:
        if done:
            what = f"holds a result of {entry.id} that {journal.evidence.path.name} does not know"
            yield Fault(str(folder.journal), what, _REMEDY)
        elif (
            not done
            # Without a recording it is no evidence: what made it makes it again.
            and (run / RECORDING).is_file()
            and (run / RESULT).is_file()
            and not is_unnoted(journal, entry, run / RESULT)
        ):
            remedy = f"move {run} away, and run again"
            yield Fault(str(run / RESULT), "is a result of a session that never flew here", remedy)
        return
    where = f"{journal.evidence.path.name}:{line.number}"
    if done and (entry.result_sha256, recording_sha256) != (line.result_sha256, line.recording_sha256):
        yield Fault(str(folder.journal), f"has other digests for {entry.id} than {where}", _REMEDY)
    if (run / DROPPED).is_file() and line.kind != "dropped":
        what = f"says that the recording was dropped, and {where} does not"
        yield Fault(str(run / DROPPED), what, f"{_REMEDY}, or delete it to fly the session again")
    yield from _changed_files(run, line, where)


def _changed_files(run: Path, line: EvidenceEntry, where: str) -> Iterator[Fault]:
    """A fault for each file of a run that is not the one in the chain."""
    for path, sha256 in ((run / RESULT, line.result_sha256), (run / RECORDING, line.recording_sha256)):
        if sha256 is not None and path.is_file() and digest_of(path) != sha256:
            what = f"has changed since its session: its digest differs from the one in {where}"
            yield Fault(str(path), what, f"{_REMEDY}, or delete it to fly the session again")


def _manifest_faults(folder: CampaignFolder, journal: Journal, manifest: Manifest) -> Iterator[Fault]:
    log = journal.evidence
    if (fault := chain_fault(log, manifest)) is not None:
        yield fault
        return
    since = {line.realization for line in log.entries(manifest.evidence.lines)}
    for name, sha256 in manifest.files.items():
        parts = PurePosixPath(name).parts
        path = folder.path / name
        if parts[0] not in _EVIDENCE_FOLDERS or len(parts) < 2 or not path.is_file():
            continue
        # Flown or measured again since then, with a line in the chain: the next manifest has its new digests.
        if parts[0] == "runs" and realization_in(parts) in since:
            continue
        if digest_of(path) != sha256:
            yield Fault(str(path), f"has changed since {folder.manifest.name} was written", _REMEDY)
