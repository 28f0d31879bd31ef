"""`rebar export-rerun`: a recording in a form that the viewer of Rerun shows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bench.contracts import Observation


def export_rerun(
    recording: Annotated[Path, typer.Argument(help="recording.mcap of a run, or the folder that holds it")],
    out: Annotated[Path, typer.Option(help="File to write (.rrd). Nothing is overwritten")],
) -> None:
    """Write what the viewer of Rerun shows of a recording: the scene, the pictures with boxes, the log, and plots. The
    recording itself stays as it is.

    Example: rebar export-rerun out/demo/runs/p001-r1-reference-naive --out run.rrd
    """
    from bench.visible_text import visible

    from ._export import export_for_rerun

    file = recording / "recording.mcap" if recording.is_dir() else recording
    malformed = export_for_rerun(file, out, _observations(file.with_name("result.json"), file))
    for topic, count in malformed.items():
        print(f"not shown: {visible(topic)} ({count})")
    if malformed:
        print("It cannot be decoded, or lies behind the place where the recording is cut off.")
    print(f"export: {out}\ndocs/viewers.md says what opens it.")


def _observations(file: Path, recording: Path) -> tuple[Observation, ...]:
    """What a result holds of a recording; nothing where it is missing, damaged or another recording's."""
    from bench.campaign import digest_of
    from bench.contracts import SessionResult, parse_document

    result = parse_document(SessionResult, file.read_bytes()) if file.is_file() else None
    return result.observations if result and result.recording_sha256 == digest_of(recording) else ()
