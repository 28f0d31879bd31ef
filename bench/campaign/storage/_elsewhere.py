"""Recordings that lie elsewhere than in the campaign's folder: at a URL of any file system that fsspec knows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from bench.contracts import SessionResult
from bench.errors import Fault, SetupError
from bench.temporary_folders import temporary_folder

from ._dropped import DROPPED, DroppedRecording, dropped_recording
from ._files import digest_of
from ._folder import RECORDING, RESULT

if TYPE_CHECKING:
    from ._journal import Journal

_SHA256_CHARACTERS = 16
_REMEDY = "check the URL and this host's access to it; `pip install 'rebar-bench[dask]'` brings fsspec"


def check_store(option: str, url: str) -> None:
    """Raises SetupError for a URL at which no recording can be kept, naming the option that gave it."""
    fault = None
    try:
        parts = urlsplit(url)
    except ValueError:
        # Brackets that hold no IPv6 address.
        parts = urlsplit("")
    if not parts.scheme or "://" not in url:
        fault = Fault(
            option, f"{url!r} is no URL", "give one such as s3://bucket/folder or file:///shared/folder"
        )
    elif parts.scheme == "memory":
        fault = Fault(option, "memory:// ends with the worker's process", "give a store that stays")
    elif parts.password or (parts.username and parts.scheme != "abfs"):
        # It stands in the note of each recording, which the manifest lists and people publish.
        fault = Fault(
            option, "holds an account", "configure it for fsspec on runner and workers, outside of the URL"
        )
    if fault is not None:
        raise SetupError(fault)
    with _store_faults(option, url):
        _file_system(url)


def store_recording(recording: Path, url: str, realization: str, sha256: str) -> str:
    """Copy a recording below `url`, and return where it is. Raises whatever the file system raises."""
    # Named by its digest: a recording never takes another's place. 256 folders: one of 20,000 files is slow on disks.
    target = f"{url.rstrip('/')}/{sha256[:2]}/{realization}-{sha256[:_SHA256_CHARACTERS]}.mcap"
    system, path = _file_system(target)
    system.makedirs(system._parent(path), exist_ok=True)
    system.put_file(str(recording), path)
    written, size = system.info(path)["size"], recording.stat().st_size
    if written != size:
        raise OSError(f"{target} holds {written} of {size} bytes")
    return target


def runs_elsewhere(folder: Path) -> dict[str, Path]:
    """The runs of a campaign folder whose recording lies at a URL, by realization."""
    runs = {note.parent.name: note.parent for note in sorted(folder.glob(f"runs/**/{DROPPED}"))}
    return {name: runs[name] for name in recordings_elsewhere(runs)}


def recordings_elsewhere(runs: dict[str, Path]) -> dict[str, DroppedRecording]:
    """The notes of those runs whose recording lies at a URL, by realization."""
    notes = {name: recording_elsewhere(run) for name, run in runs.items()}
    return {name: note for name, note in notes.items() if note is not None}


def recording_elsewhere(run: Path) -> DroppedRecording | None:
    """The note of a run whose recording lies at a URL; None for one that is in the folder, or nowhere."""
    note = dropped_recording(run)
    return note if note is not None and note.kept_at is not None else None


@contextmanager
def open_fetched(run: Path, note: DroppedRecording) -> Iterator[Path]:
    """Yield a temporary folder of the run's name with the recording and the result. Raises SetupError for a recording
    that cannot be fetched, or is not the one that was flown.
    """
    assert note.kept_at is not None
    with temporary_folder("fetch") as temporary:
        copy = temporary / run.name
        copy.mkdir()
        with _store_faults(str(run), note.kept_at):
            system, path = _file_system(note.kept_at)
            system.get_file(path, str(copy / RECORDING))
        if digest_of(copy / RECORDING) != note.recording_sha256:
            raise SetupError(
                note.kept_at,
                "has changed since its session: its digest differs from the one in the campaign's folder",
                "restore it from a copy",
            )
        if (run / RESULT).is_file():
            (copy / RESULT).write_bytes((run / RESULT).read_bytes())
        yield copy


@contextmanager
def open_recorded(run: Path) -> Iterator[Path]:
    """Yield a folder that holds the run's recording: the run's own, or a temporary one for a recording at a URL."""
    if (note := recording_elsewhere(run)) is None:
        yield run
        return
    with open_fetched(run, note) as copy:
        yield copy


def store_faults(runs: dict[str, Path]) -> list[Fault]:
    """A fault for each recording that lies at a URL and is gone there, or is not the one that was flown. Reads them all."""
    faults: list[Fault] = []
    for name, note in recordings_elsewhere(runs).items():
        try:
            with open_fetched(runs[name], note):
                pass
        except SetupError as error:
            faults += error.faults
    return faults


def drop_again(journal: Journal, run: Path, result: SessionResult) -> None:
    """Note that a result which was measured again still has its recording elsewhere."""
    if (note := recording_elsewhere(run)) is not None:
        journal.drop(result.realization, note.policy)


def _file_system(url: str) -> tuple[Any, str]:
    import fsspec

    system, path = fsspec.core.url_to_fs(url)
    return system, path


@contextmanager
def _store_faults(where: str, url: str) -> Iterator[None]:
    """What a file system raises, whichever kind of error it uses, as a SetupError that names the URL."""
    try:
        yield
    except Exception as error:
        raise SetupError(where, f"cannot use {url}: {type(error).__name__}: {error}", _REMEDY) from error
