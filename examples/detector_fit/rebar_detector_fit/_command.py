"""`rebar fit-detector`: the error model that behaves as the detections of some recordings did."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def fit_detector(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings of sessions with detections (.mcap)")],
    out: Annotated[
        Path | None, typer.Option(help="Write the fitted model and its counts to this YAML file")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Fit the error model of the simulated detector to recorded detections, with the counts behind each number.

    The part `perception` of the result can be copied into a SimSpec, which then detects as these recordings did.

    Example: rebar fit-detector out/pixels/runs/*/recording.mcap --out fitted.yaml
    """
    from bench.documents import dump_yaml
    from bench.recording import check_whole, read_simspec, read_tape

    from ._fit import fit_detector as fit_model

    for path in recordings:
        check_whole(path)
    simspecs = [read_simspec(path) for path in recordings]
    fit = fit_model(
        [(simspec, read_tape(path, simspec)) for path, simspec in zip(recordings, simspecs, strict=True)]
    )
    if out is not None:
        out.write_text(dump_yaml(fit), encoding="utf-8")
    print(fit.model_dump_json(indent=1, ensure_ascii=True) if as_json else dump_yaml(fit).rstrip())
