"""The folder that a campaign is: what lies where, and how it gets there.

    campaign.yaml               what was asked
    decomposition.yaml          the decomposition, where the campaign named a file
    simspecs/<realization>.json each realized SimSpec
    journal.sqlite              state, attempts and outcome of every realization
    aside/                      results that were asked to be flown again
    runs/<realization>/         recording.mcap, and result.json once the session is over
    logs/                       what the workers said
    scores.parquet, report.html, manifest.json

Whatever is written here appears whole or not at all.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from bench.contracts import SessionResult
from bench.documents import Document, dump_json
from bench.errors import Fault, SetupError

RECORDING = "recording.mcap"
RESULT = "result.json"
_CHANGES = ("journal.sqlite", "journal.sqlite-wal", "journal.sqlite-shm", ".lock", "manifest.json")
"""Files whose bytes say nothing of the results, so the manifest leaves them out; so it does with logs/."""


@dataclass(frozen=True, slots=True)
class CampaignFolder:
    """Paths of one campaign folder; nothing is made until something is written."""

    path: Path

    @property
    def campaign(self) -> Path:
        return self.path / "campaign.yaml"

    @property
    def decomposition(self) -> Path:
        return self.path / "decomposition.yaml"

    @property
    def journal(self) -> Path:
        return self.path / "journal.sqlite"

    @property
    def scores(self) -> Path:
        return self.path / "scores.parquet"

    @property
    def report(self) -> Path:
        return self.path / "report.html"

    @property
    def manifest(self) -> Path:
        return self.path / "manifest.json"

    @property
    def logs(self) -> Path:
        return self.path / "logs"

    def simspec(self, realization: str) -> Path:
        return self.path / "simspecs" / f"{realization}.json"

    def run(self, realization: str) -> Path:
        return self.path / "runs" / realization

    def set_aside(self, realization: str, attempt: int) -> None:
        """Move a run's result out of the way, where it is kept but counts for nothing."""
        aside = self.path / "aside" / f"{realization}-{attempt}.json"
        aside.parent.mkdir(exist_ok=True)
        (self.run(realization) / RESULT).replace(aside)

    def fresh_run(self, realization: str) -> Path:
        """An empty run folder: what an attempt that came to nothing left there is gone."""
        run = self.run(realization)
        if run.exists():
            shutil.rmtree(run)
        run.mkdir(parents=True)
        return run


def write_whole(path: Path, content: bytes | str) -> str:
    """Write a file so that a crash at any moment leaves the old one or the new one; returns the SHA-256 of its bytes."""
    data = content.encode() if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
    return hashlib.sha256(data).hexdigest()


def digest_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_result(run: Path, result: SessionResult) -> str:
    """Write `result.json` into a run's folder, the last thing that happens there; returns its SHA-256."""
    return write_whole(run / RESULT, dump_json(result))


def read_result(run: Path, realization: str) -> SessionResult | None:
    """The result in a run's folder, None where there is none that is whole, its own, and of the recording beside it."""
    try:
        result = SessionResult.model_validate_json((run / RESULT).read_bytes())
    except (FileNotFoundError, ValidationError):
        return None
    recording = run / RECORDING
    if result.realization != realization:
        return None
    if result.recording_sha256 is not None and not (recording.is_file() and digest_of(recording) == result.recording_sha256):
        return None
    return result


@contextmanager
def open_lock(folder: Path) -> Iterator[None]:
    """Hold a campaign folder alone. Raises SetupError while another runner does.

    The lock is the kernel's, so it goes with the process that held it, however that ended.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            holder = file.read().strip() or "unknown"
            raise SetupError(
                Fault(str(folder), f"is in use by another run (process {holder})", "wait for it, end it, or name another folder")
            ) from None
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield


class Manifest(Document):
    """Digests of everything that a campaign left, and what made it."""

    format: Literal["rebar.manifest/1"] = "rebar.manifest/1"
    campaign: str
    decomposition_sha256: str
    outcomes: Annotated[dict[str, int], Field(description="Number of realizations by outcome.")]
    versions: dict[str, str]
    files: Annotated[dict[str, str], Field(description="SHA-256 of every file, by its path in the folder.")]


def write_manifest(
    folder: CampaignFolder, campaign: str, decomposition_sha256: str, outcomes: Mapping[str, int], versions: Mapping[str, str]
) -> None:
    """Write `manifest.json` over everything that lies in the folder now."""
    manifest = Manifest(
        campaign=campaign,
        decomposition_sha256=decomposition_sha256,
        outcomes=dict(sorted(outcomes.items())),
        versions=dict(versions),
        files={name: digest_of(folder.path / name) for name in _kept(folder.path)},
    )
    write_whole(folder.manifest, dump_json(manifest))


def verify_folder(path: Path) -> list[Fault]:
    """Everything in a campaign folder that is not what its manifest says. Raises SetupError without a readable manifest."""
    try:
        manifest = Manifest.model_validate(json.loads((path / "manifest.json").read_text()))
    except (FileNotFoundError, ValueError) as error:
        raise SetupError(
            Fault(str(path / "manifest.json"), f"cannot be read: {error}", "a campaign that ended has one; run it to its end")
        ) from None
    present = set(_kept(path))
    changed = [name for name, digest in manifest.files.items() if name in present and digest_of(path / name) != digest]
    return [
        *(Fault(name, "is missing") for name in sorted(manifest.files.keys() - present)),
        *(Fault(name, "has changed since the manifest was written") for name in changed),
        *(Fault(name, "is not in the manifest") for name in sorted(present - manifest.files.keys())),
    ]


def _kept(path: Path) -> list[str]:
    files = (one.relative_to(path) for one in path.rglob("*") if one.is_file())
    return sorted(str(one) for one in files if one.parts[0] != "logs" and one.name not in _CHANGES)
