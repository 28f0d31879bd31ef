"""Recordings that a campaign does not keep: what stands in their place, so that their results still count.

`recording.dropped` in a run's folder names the digest of the recording that was there; a line of the chain of evidence
says the same. In lockstep the session can be flown again, and must give that digest (`rebar verify --refly`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from bench.documents import Document, dump_json

from ._files import write_whole
from ._folder import RECORDING

DROPPED = "recording.dropped"


class DroppedRecording(Document):
    """A recording that was deleted when its session was over."""

    format: Literal["rebar.dropped-recording/1"] = "rebar.dropped-recording/1"
    recording_sha256: str
    bytes: int
    policy: str
    versions: dict[str, str] = Field(
        description="Of the software that flew it: another one need not give the same recording again."
    )


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
    note = run / DROPPED
    if (run / RECORDING).is_file() or not note.is_file():
        return None
    try:
        return DroppedRecording.model_validate_json(note.read_bytes())
    except ValidationError:
        return None
