"""`rebar export`: a recording in a form that other programs show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._tables import print_lines

if TYPE_CHECKING:
    from bench.contracts import Observation


def export(
    recording: Annotated[Path, typer.Argument(help="recording.mcap of a run, or the folder that holds it")],
    out: Annotated[Path, typer.Option(help="File to write. Nothing is overwritten")],
    rerun: Annotated[
        bool, typer.Option("--rerun", help="As .rrd for the viewer of Rerun (the only form so far)")
    ] = False,
) -> None:
    """Write what the viewer of Rerun shows of a recording: the scene, the pictures with boxes, the log, and plots. Needs the
    extra `rerun`. The recording itself stays as it is.

    Example: rebar export out/demo/runs/p001-r1-reference-naive --rerun --out run.rrd
    """
    from bench.errors import SetupError
    from bench.recording import export_for_rerun

    if not rerun:
        raise SetupError("rebar export", "no form is named", "add --rerun")
    file = recording / "recording.mcap" if recording.is_dir() else recording
    malformed = export_for_rerun(file, out, _observations(file.with_name("result.json"), file))
    lines = [f"not shown: {topic} ({count})" for topic, count in malformed.items()]
    if lines:
        lines.append("It cannot be decoded, or lies behind the place where the recording is cut off.")
    print_lines(*lines, f"export: {out}", "docs/viewers.md says what opens it.")


def _observations(file: Path, recording: Path) -> tuple[Observation, ...]:
    """What a result holds of a recording; nothing where it is missing, damaged or another recording's."""
    from bench.campaign import digest_of
    from bench.contracts import SessionResult, parse_document

    result = parse_document(SessionResult, file.read_bytes()) if file.is_file() else None
    return result.observations if result and result.recording_sha256 == digest_of(recording) else ()
