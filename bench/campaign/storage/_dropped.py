"""Recordings that a campaign does not keep: what stands in their place, so that their results still count.

`recording.dropped` in a run's folder names the digest of the recording that was there; a line of the chain of evidence
says the same. In lockstep the session can be flown again, and must give that digest (`rebar verify --refly`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from bench.documents import Document, dump_json, is_default

from ._files import write_whole
from ._folder import RECORDING

DROPPED = "recording.dropped"
# Until the chain of evidence has its line: a note that the chain does not know is taken for a forgery.
_PENDING = ".recording.dropped"


class DroppedRecording(Document):
    """A recording that is not in the run's folder: deleted when its session was over, or kept at a URL."""

    format: Literal["rebar.dropped-recording/1"] = "rebar.dropped-recording/1"
    recording_sha256: str
    bytes: int
    policy: str
    versions: Annotated[
        dict[str, str],
        Field(
            description="Of the software that flew it: another one need not give the same recording again."
        ),
    ]
    kept_at: Annotated[
        str | None,
        Field(exclude_if=is_default(None), description="URL at which it lies; absent: it was deleted."),
    ] = None


def note_pending(run: Path, note: DroppedRecording) -> None:
    """Put the note of a recording that lies elsewhere into a run's folder, without effect as yet."""
    write_whole(run / _PENDING, dump_json(note))


def pending_note(run: Path) -> DroppedRecording | None:
    """The note that waits for its line in the chain, if one does."""
    return _read_note(run / _PENDING)


def settle_note(run: Path) -> None:
    """Let the waiting note stand for the recording. Its line in the chain must have been written before."""
    (run / _PENDING).rename(run / DROPPED)


def drop_recording(run: Path, recording_sha256: str, policy: str, versions: Mapping[str, str]) -> None:
    """Put a note in the place of a recording. Its line in the chain must have been written before."""
    recording = run / RECORDING
    note = DroppedRecording(
        recording_sha256=recording_sha256,
        bytes=recording.stat().st_size,
        policy=policy,
        versions=dict(versions),
    )
    # The note first: after a kill in between, both are there, and neither is an edit.
    write_whole(run / DROPPED, dump_json(note))
    recording.unlink()


def dropped_recording(run: Path) -> DroppedRecording | None:
    """The note in a run's folder whose recording is gone; None without one, and for one that is damaged."""
    return None if (run / RECORDING).is_file() else _read_note(run / DROPPED)


def _read_note(path: Path) -> DroppedRecording | None:
    try:
        return DroppedRecording.model_validate_json(path.read_bytes()) if path.is_file() else None
    except ValidationError:
        return None
