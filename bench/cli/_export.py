"""`rebar export`: a recording in a form that other programs show."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._tables import plain_console, print_lines

if TYPE_CHECKING:
    from bench.contracts import Observation


def export(
    recording: Annotated[Path, typer.Argument(help="recording.mcap of a run, or the folder that holds it")],
    out: Annotated[Path, typer.Option(help="MCAP file to write. Nothing is overwritten")],
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="Add what Lichtblick and Foxglove show (the only form so far)")
    ] = False,
) -> None:
    """Write a copy of a recording that Lichtblick and Foxglove show without any set-up: the scene, the map, boxes over
    the pictures, and states to plot. The recording itself stays as it is.

    Example: rebar export out/demo/runs/p001-r1-reference-naive --foxglove --out viewer.mcap
    """
    from bench.campaign import open_recorded
    from bench.errors import SetupError
    from bench.recording.viewers import export_for_viewers

    if not foxglove:
        raise SetupError("rebar export", "no form is named", "add --foxglove")
    with open_recorded(recording) if recording.is_dir() else nullcontext(recording) as source:
        file = source / "recording.mcap" if source.is_dir() else source
        folder = recording if recording.is_dir() else recording.parent
        result = export_for_viewers(file, out, _observations(folder / "result.json", file))
    lines = [
        f"{result.copied} messages copied, {result.derived} added.",
        f"pictures: {'those of the recording' if result.pictures else 'none; boxes are drawn on grey frames'}",
    ]
    if result.cut is not None:
        lines.append(f"The recording {result.cut}: the export has what is before that.")
    if result.malformed:
        counts = ", ".join(f"{topic} {count}" for topic, count in result.malformed.items())
        lines.append(f"copied but not shown, because they cannot be decoded: {counts}")
    lines += [f"export: {out}", "Open it with the layout docs/foxglove-layout.json (docs/viewers.md)."]
    print_lines(plain_console(), lines)


def _observations(file: Path, recording: Path) -> tuple[Observation, ...]:
    """What a result holds of a recording; nothing where it is missing, damaged or another recording's."""
    from bench.campaign import digest_of
    from bench.contracts import SessionResult, parse_document

    result = parse_document(SessionResult, file.read_bytes()) if file.is_file() else None
    return result.observations if result and result.recording_sha256 == digest_of(recording) else ()
