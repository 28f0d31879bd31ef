"""`rebar draw`: runs from above, as a drawing to print or a film."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.errors import SetupError


def draw(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs of one scene, each by another agent")],
    out: Annotated[Path, typer.Option(help="SVG file to write")],
    film: Annotated[
        bool,
        typer.Option("--film", help="Let vehicles and people move, and reports appear when they are made"),
    ] = False,
) -> None:
    """Draw one run, or several runs of one scene, from above: the ground, who is there, the flights, the reports.

    Example: rebar draw out/demo/runs/p001-r1-reference-naive --out map.svg

    Example: rebar draw out/demo/runs/p001-r1-* --film --out film.svg
    """
    from bench.recording import read_simspec, read_tape
    from bench.reporting import Run, build_run_map, run_drawing

    if out.suffix != ".svg":
        raise SetupError("--out", f"{out.name} does not end with .svg", "name an SVG file")
    drawn = []
    for folder in runs:
        simspec = read_simspec(folder / "recording.mcap")
        tape = read_tape(folder / "recording.mcap", simspec)
        name = folder.resolve().name
        drawn.append(
            (build_run_map(Run(name, "", 0, simspec.agent.manifest, None, None), simspec, tape), tape)
        )
    text = run_drawing(drawn, film=film)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text, encoding="utf-8")
    print(out)
