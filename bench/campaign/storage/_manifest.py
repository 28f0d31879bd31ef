"""`manifest.json`: digests of everything that a campaign left, and the check against them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from bench.documents import Document, dump_json
from bench.errors import Fault, SetupError

from ._completeness import Completeness
from ._evidence import EvidenceLog
from ._files import digest_of, is_half_written, write_whole
from ._folder import EVIDENCE, CampaignFolder

# The journal and the lock change while nothing of the results does, the chain of evidence has its own entry, and a
# manifest cannot hold its own digest.
_UNLISTED_FILES = frozenset(
    {"journal.sqlite", "journal.sqlite-wal", "journal.sqlite-shm", ".lock", "manifest.json", EVIDENCE}
)
# Logs hold process ids and times, so they differ between two runs with the same results.
_UNLISTED_FOLDER = "logs"


class EvidenceHead(Document):
    """How long the chain of evidence was, and the digest of its last line."""

    lines: int
    head: str


class Manifest(Document):
    """Digests of everything that a campaign left, and what made it."""

    format: Literal["rebar.manifest/1"] = "rebar.manifest/1"
    campaign: str
    decomposition_sha256: str
    outcomes: Annotated[dict[str, int], Field(description="Number of realizations by outcome.")]
    missing: Annotated[
        dict[str, int], Field(description="Number of runs that the campaign lacks, by outcome.")
    ] = {}
    accepted: Annotated[
        tuple[str, ...], Field(description="Realizations without a run that a person took as they are.")
    ] = ()
    pace: Annotated[
        str | None,
        Field(
            description="Pace of all runs, where campaign or command line set it in place of the situations'."
        ),
    ] = None
    evidence: Annotated[
        EvidenceHead | None, Field(description="The chain in evidence.jsonl when this was written.")
    ] = None
    versions: dict[str, str]
    files: Annotated[dict[str, str], Field(description="SHA-256 of every file, by its path in the folder.")]


def write_manifest(
    folder: CampaignFolder,
    campaign: str,
    decomposition_sha256: str,
    outcomes: Mapping[str, int],
    versions: Mapping[str, str],
    completeness: Completeness,
    pace: str | None,
) -> None:
    """Write `manifest.json` over everything that is in the folder now."""
    evidence = EvidenceLog(folder.evidence)
    manifest = Manifest(
        campaign=campaign,
        decomposition_sha256=decomposition_sha256,
        outcomes=dict(sorted(outcomes.items())),
        missing=dict(sorted(completeness.missing.items())),
        accepted=completeness.accepted,
        pace=pace,
        evidence=EvidenceHead(lines=len(evidence.entries), head=evidence.head),
        versions=dict(versions),
        files={name: digest_of(folder.path / name) for name in _listed_files(folder.path)},
    )
    write_whole(folder.manifest, dump_json(manifest))


def read_manifest(path: Path) -> Manifest | None:
    """The manifest in a file; None if the file is missing or holds none."""
    try:
        return Manifest.model_validate(json.loads(path.read_text()))
    except (FileNotFoundError, ValueError):
        return None


def manifest_differences(path: Path) -> list[Fault]:
    """Every file of a campaign folder that differs from its manifest.

    Raises SetupError without a readable manifest.
    """
    manifest = read_manifest(path / "manifest.json")
    if manifest is None:
        raise SetupError(
            Fault(
                str(path / "manifest.json"),
                "cannot be read: it is missing or holds no manifest",
                "only a complete campaign has a manifest: run the campaign to its end",
            )
        )
    present = set(_listed_files(path))
    changed = [
        name
        for name, digest in manifest.files.items()
        if name in present and digest_of(path / name) != digest
    ]
    return [
        *(Fault(name, "is missing") for name in sorted(manifest.files.keys() - present)),
        *(Fault(name, "has changed since the manifest was written") for name in changed),
        *(Fault(name, "is not in the manifest") for name in sorted(present - manifest.files.keys())),
    ]


def _listed_files(path: Path) -> list[str]:
    # A runner that was killed may have left half of a file. The next write of that file takes its place, so a
    # manifest that listed it would soon miss it; and nothing reads it.
    files = (
        file.relative_to(path) for file in path.rglob("*") if file.is_file() and not is_half_written(file)
    )
    return sorted(
        str(file) for file in files if file.parts[0] != _UNLISTED_FOLDER and file.name not in _UNLISTED_FILES
    )
