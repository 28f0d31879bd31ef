"""The folder of a campaign: where each file is, and the lock that keeps a second runner out.

    campaign.yaml               the campaign as it was run
    decomposition.yaml          the decomposition, if the campaign named a file
    simspecs/<realization>.json each realized SimSpec
    journal.sqlite              state, attempts and outcome of every realization
    evidence.jsonl              a line for everything that happened to a result, each with the digest of the last
    aside/                      earlier results of realizations that were rerun
    runs/<realization>/         recording.mcap, and result.json once the session is over
    logs/                       stdout and stderr of the workers
    scores.parquet, report.html, manifest.json
    scores.csv, runs.csv, card.md, junit.xml    the same for other programs
    manifest.json.sig           a signature of the manifest, if somebody signed it
    floor.parquet               scores of the null agents and the oracle, if they flew

In a campaign of more than `FLAT_RUNS` realizations, runs/ and simspecs/ hold 100 folders, 00 to 99, and each of these its
share.

Every file here is written whole or not at all.
"""

from __future__ import annotations

import errno
import fcntl
import os
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from bench.errors import SetupError
from bench.removal import remove_tree

from ._file_system import check_file_system

RECORDING = "recording.mcap"
RESULT = "result.json"
EVIDENCE = "evidence.jsonl"
SIGNATURE = "manifest.json.sig"
MADE_FROM_RESULTS = frozenset(
    {"scores.parquet", "floor.parquet", "report.html", "scores.csv", "runs.csv", "card.md", "junit.xml"}
)
"""Files that scoring and report write, and write again."""

FLAT_RUNS = 900
"""With the folders below, no folder has more than a thousand entries up to some 90,000 realizations."""
_SHARE_FOLDERS = 100


@dataclass(frozen=True, slots=True)
class CampaignFolder:
    """Paths of one campaign folder. Naming a path creates nothing."""

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
    def evidence(self) -> Path:
        return self.path / EVIDENCE

    @property
    def scores(self) -> Path:
        return self.path / "scores.parquet"

    @property
    def floor(self) -> Path:
        return self.path / "floor.parquet"

    @property
    def report(self) -> Path:
        return self.path / "report.html"

    @property
    def manifest(self) -> Path:
        return self.path / "manifest.json"

    @property
    def signature(self) -> Path:
        return self.path / SIGNATURE

    def simspec(self, realization: str) -> Path:
        return _placed(self.path / "simspecs", realization, f"{realization}.json")

    def run(self, realization: str) -> Path:
        return _placed(self.path / "runs", realization, realization)

    def lay_out(self, realizations: int) -> None:
        """Prepare the folder for so many realizations. What is there already stays where it is."""
        if realizations > FLAT_RUNS:
            for parent in ("runs", "simspecs"):
                for number in range(_SHARE_FOLDERS):
                    (self.path / parent / f"{number:02d}").mkdir(parents=True, exist_ok=True)

    def set_aside(self, realization: str, attempt: int) -> None:
        """Move a run's result to aside/, where it is kept for inspection and ignored by scoring."""
        aside = self.path / "aside" / f"{realization}-{attempt}.json"
        aside.parent.mkdir(exist_ok=True)
        (self.run(realization) / RESULT).replace(aside)

    def fresh_run(self, realization: str) -> Path:
        """An empty run folder. Whatever an earlier attempt left there is deleted."""
        run = self.run(realization)
        # An unconfined agent may have left anything in there.
        remove_tree(run)
        run.mkdir(parents=True)
        return run


def is_campaign(path: Path) -> bool:
    """Whether a folder is the folder of a campaign."""
    folder = CampaignFolder(path)
    return folder.campaign.is_file() and folder.journal.is_file()


def existing_campaign(path: Path) -> CampaignFolder:
    """The folder of a campaign. Raises SetupError for any other path; nothing is made there."""
    if not is_campaign(path):
        raise SetupError(
            path, "is not the folder of a campaign", "name the folder that `rebar run --out` wrote"
        )
    return CampaignFolder(path)


def _placed(parent: Path, realization: str, name: str) -> Path:
    """Where a realization's file or folder is, or is to be: below the folder of its share, if there are such."""
    # By the id alone, so that nothing has to be looked up, and a campaign that grows moves nothing.
    share = parent / f"{zlib.crc32(realization.encode()) % _SHARE_FOLDERS:02d}"
    flat = parent / name
    return share / name if share.is_dir() and not flat.exists() else flat


def realization_in(parts: Sequence[str]) -> str:
    """The realization of a file in runs/ or simspecs/, by the parts of its path in the campaign's folder."""
    name = parts[2] if len(parts) > 2 and is_share_folder(parts[1]) else parts[1]
    return name.removesuffix(".json")


def is_share_folder(name: str) -> bool:
    """Whether a folder in runs/ or simspecs/ holds a share of the realizations, and is none itself."""
    return len(name) == 2 and name.isdecimal()


def campaign_of(run: Path) -> CampaignFolder | None:
    """The campaign in whose folder a run lies; None for a run elsewhere."""
    run = run.resolve()
    parent = run.parent.parent if is_share_folder(run.parent.name) else run.parent
    folder = CampaignFolder(parent.parent)
    in_campaign = run == folder.run(run.name) and (folder.journal.is_file() or folder.evidence.is_file())
    return folder if in_campaign else None


LOCK = ".lock"
_LOCK_TRIES, _LOCK_PAUSE_S = 5, 0.05


@contextmanager
def open_lock(folder: Path, *, reentrant: bool = False) -> Iterator[bool]:
    """Hold a campaign folder alone, and yield whether it was free. Raises SetupError while another runner holds
    it; with `reentrant`, this process may hold it already, and False is yielded.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / LOCK).exists() and not (folder / LOCK).is_file():
        raise SetupError(folder / LOCK, "is no file", "remove it")
    with _opened_lock(folder) as file:
        check_file_system(folder)
        if not _take_lock(file):
            file.seek(0)
            holder = file.read().strip() or "unknown"
            if reentrant and holder == str(os.getpid()):
                yield False
                return
            raise SetupError(
                folder,
                f"is in use by another run (process {holder})",
                "wait until it ends, stop it, or name another folder",
            )
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield True


def _opened_lock(folder: Path) -> IO[str]:
    try:
        return (folder / LOCK).open("a+", encoding="utf-8")
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise
        remedy = (
            "name another folder, or copy this one; the commands status, verify, compare, calibrate, next, "
            "score --explain and report --out read it as it is"
        )
        raise SetupError(folder, f"cannot be written ({error.strerror})", remedy) from error


def _take_lock(file: IO[str]) -> bool:
    # More than one try: a reader that looks who holds the lock holds it for a moment itself.
    for attempt in range(_LOCK_TRIES):
        if attempt:
            time.sleep(_LOCK_PAUSE_S)
        # A lock of the kernel, not the file's existence: it goes with its process, also after kill -9.
        with suppress(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
    return False


def writing_process(folder: Path) -> str | None:
    """The id of another process that is writing in a campaign folder now; None if there is none."""
    holder = lock_holder(folder)
    return None if holder == str(os.getpid()) else holder


def lock_holder(folder: Path) -> str | None:
    """The id of the process, perhaps this one, that is writing in a campaign folder now; None if there is none."""
    if not (folder / LOCK).is_file():
        return None
    try:
        with (folder / LOCK).open(encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return file.read().strip() or "unknown"
    except OSError:
        # None that this user may read, or no locks here: nobody who could be asked.
        return None
    return None
