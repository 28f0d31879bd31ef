"""`manifest.json`: digests of everything that a campaign left, and the check against them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field

from bench.documents import Document, dump_json
from bench.errors import Fault, SetupError

from ._completeness import Completeness
from ._evidence_log import EvidenceLog
from ._files import FileDigests, digest_of, is_deleted_over_nfs, is_half_written, write_whole
from ._folder import EVIDENCE, LOCK, SIGNATURE, CampaignFolder
from ._journal_file import settled_journal_sha256
from ._pause import PAUSE, RETRY

JOURNAL = "journal.sqlite"
# SQLite's file of changes that are not in the journal's own file yet.
JOURNAL_CHANGES = f"{JOURNAL}-wal"
_LOGS = "logs"
# The chain of evidence has its own entry, since it goes on after the manifest; a manifest cannot hold its own digest;
# the signature follows it; the others are gone when no process is at work.
_UNLISTED_FILES = frozenset(
    {EVIDENCE, "manifest.json", SIGNATURE, LOCK, PAUSE, RETRY, JOURNAL_CHANGES, f"{JOURNAL}-shm"}
)
_UNLISTED_FOLDER = ".scratch"
_NO_SHA256 = b"0" * 64


class EvidenceHead(Document):
    """How long the chain of evidence was, and the digest of its last line."""

    lines: int
    head: str


class Manifest(Document):
    """Digests of everything that a campaign left, and what made it."""

    format: Literal["rebar.manifest/1"] = "rebar.manifest/1"
    campaign: str
    decomposition_sha256: str
    outcomes: dict[str, int] = Field(description="Number of realizations by outcome.")
    missing: dict[str, int] = Field({}, description="Number of runs that the campaign lacks, by outcome.")
    accepted: tuple[str, ...] = Field(
        (), description="Realizations without a run that a person took as they are."
    )
    pace: str | None = Field(
        None,
        description="Pace of all runs, where campaign or command line set it in place of the situations'; campaign.yaml has "
        "those of single agents.",
    )
    evidence: EvidenceHead = Field(description="The chain in evidence.jsonl when this was written.")
    versions: dict[str, str]
    files: dict[str, str] = Field(
        description="SHA-256 of every file but those of `host_files`, by its path in the folder."
    )
    host_files: dict[str, str] = Field(
        description="SHA-256 of journal and logs, which hold times and process ids: they differ between two "
        "folders with the same results."
    )
    self_sha256: str = Field(
        pattern="^[0-9a-f]{64}$",
        description="SHA-256 of this file with 64 zeros in the place of this digest.",
    )


def write_manifest(
    folder: CampaignFolder,
    campaign: str,
    decomposition_sha256: str,
    outcomes: Mapping[str, int],
    versions: Mapping[str, str],
    completeness: Completeness,
    pace: str | None,
    known: FileDigests | None = None,
) -> None:
    """Write `manifest.json` over everything that is in the folder now.

    Write nothing else afterwards, and nothing to the journal. `known` spares a second manifest what the first one read.
    """
    journal_sha256 = settled_journal_sha256(folder.journal)
    names = [name for name in _listed_files(folder.path) if name != JOURNAL]
    known = known or FileDigests()
    digests = {name: known.of(folder.path / name) for name in names}
    evidence = EvidenceLog(folder.evidence)
    manifest = Manifest(
        campaign=campaign,
        decomposition_sha256=decomposition_sha256,
        outcomes=dict(sorted(outcomes.items())),
        missing=dict(sorted(completeness.missing.items())),
        accepted=completeness.accepted,
        pace=pace,
        evidence=EvidenceHead(lines=len(evidence), head=evidence.head),
        versions=dict(versions),
        files={name: digest for name, digest in digests.items() if not _is_of_host(name)},
        host_files={name: digest for name, digest in digests.items() if _is_of_host(name)}
        | ({JOURNAL: journal_sha256} if journal_sha256 else {}),
        self_sha256=_NO_SHA256.decode(),
    )
    content = dump_json(manifest).encode()
    digest = hashlib.sha256(content).hexdigest().encode()
    # The last field, so the last place: a chain without lines has 64 zeros as its head.
    before, _, after = content.rpartition(_NO_SHA256)
    write_whole(folder.manifest, before + digest + after)


def read_manifest(path: Path) -> Manifest | None:
    """The manifest in a file; None if the file is missing, holds none, or was changed since it was written."""
    if not path.is_file():
        return None
    content = path.read_bytes()
    try:
        manifest = Manifest.model_validate(json.loads(content))
    except ValueError:
        return None
    before, digest, after = content.rpartition(manifest.self_sha256.encode())
    unsigned = hashlib.sha256(before + _NO_SHA256 + after).hexdigest()
    return manifest if digest and unsigned == manifest.self_sha256 else None


def manifest_differences(path: Path) -> list[Fault]:
    """Every file of a campaign folder that differs from its manifest. A manifest that was itself changed is the
    only difference.

    Raises SetupError without a manifest.
    """
    file = path / "manifest.json"
    manifest = read_manifest(file)
    if manifest is None and file.is_file():
        return [
            Fault(
                file.name,
                "was edited or damaged after it was written, so it vouches for nothing",
                "restore it from a copy; `rebar report` writes another one, with another digest",
            )
        ]
    if manifest is None:
        raise SetupError(
            file,
            "cannot be read: it is missing or holds no manifest",
            "only a complete campaign has a manifest: run the campaign to its end",
        )
    listed = manifest.files | manifest.host_files
    present = set(_listed_files(path))
    changed = [
        name for name, digest in listed.items() if name in present and digest_of(path / name) != digest
    ]
    # None lists a journal that another process held open.
    unlisted = present - listed.keys() - {JOURNAL}
    return [
        *(Fault(name, "is missing") for name in sorted(listed.keys() - present)),
        *(Fault(name, "has changed since the manifest was written") for name in changed),
        *(Fault(name, "is not in the manifest") for name in sorted(unlisted)),
        *_changes_of_journal(path, manifest),
        *_chain_differences(path, manifest),
    ]


def chain_fault(log: EvidenceLog, manifest: Manifest) -> Fault | None:
    """A fault if the chain of evidence does not begin with the lines that the manifest stands for."""
    stated = manifest.evidence
    if log.digest_at(stated.lines) == stated.head:
        return None
    return Fault(
        str(log.path),
        f"is not the chain of the manifest: its first {stated.lines} lines are missing or others",
        "restore it from a copy; `rebar verify` lists everything that disagrees",
    )


def _chain_differences(path: Path, manifest: Manifest) -> list[Fault]:
    # By its name alone, as every file of the folder.
    fault = chain_fault(EvidenceLog(path / EVIDENCE), manifest)
    return [] if fault is None else [Fault(EVIDENCE, fault.what, fault.remedy)]


def _changes_of_journal(path: Path, manifest: Manifest) -> list[Fault]:
    """A fault for changes beside the journal's file, which the next process would put into it."""
    changes = path / JOURNAL_CHANGES
    if JOURNAL in manifest.host_files and changes.is_file() and changes.stat().st_size:
        return [Fault(changes.name, "holds changes of the journal since the manifest was written")]
    return []


def _is_of_host(name: str) -> bool:
    return name == JOURNAL or Path(name).parts[0] == _LOGS


def _listed_files(path: Path) -> list[str]:
    # A runner that was killed may have left half of a file. The next write of that file takes its place, so a
    # manifest that listed it would soon miss it; and nothing reads it.
    files = (
        file.relative_to(path)
        for file in path.rglob("*")
        if file.is_file() and not is_half_written(file) and not is_deleted_over_nfs(file)
    )
    return sorted(
        str(file) for file in files if file.parts[0] != _UNLISTED_FOLDER and str(file) not in _UNLISTED_FILES
    )
