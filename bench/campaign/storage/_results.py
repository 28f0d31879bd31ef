"""`result.json` in a run's folder: written last, and read back only if it belongs to the run and to its
recording.
"""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from bench.contracts import SessionResult
from bench.documents import dump_json

from ._dropped import dropped_recording
from ._files import digest_of, write_whole
from ._folder import RECORDING, RESULT


def write_result(run: Path, result: SessionResult) -> str:
    """Write `result.json` into a run's folder and return its SHA-256.

    Nothing else is written there afterwards.
    """
    return write_whole(run / RESULT, dump_json(result))


def read_result(run: Path, realization: str) -> SessionResult | None:
    """The result in a run's folder.

    None if there is none, if it is damaged, if it is another realization's, or if the recording beside it is
    not the one that it was made from. A recording that was dropped is named by its digest.
    """
    if not (run / RESULT).is_file():
        return None
    try:
        result = SessionResult.model_validate_json((run / RESULT).read_bytes())
    except ValidationError:
        return None
    recording = run / RECORDING
    if result.realization != realization:
        return None
    dropped = dropped_recording(run)
    if dropped is not None and dropped.recording_sha256 == result.recording_sha256:
        return result
    if result.recording_sha256 is not None and not (
        recording.is_file() and digest_of(recording) == result.recording_sha256
    ):
        return None
    return result
