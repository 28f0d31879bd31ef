"""`rebar camera`: what the rendered camera can draw, and what it drew in runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import SetupError

if TYPE_CHECKING:
    from bench.contracts import Pixels

SUFFIXES = (".png", ".jpg", ".webp")
# Small enough for a page of documentation, and labels of 12 pixels can still be read.
_QUALITY = 50


def sheet(
    out: Annotated[Path, typer.Option(help=f"The picture to write: {', '.join(SUFFIXES)}")] = Path(
        "camera-sheet.webp"
    ),
    renderer: Annotated[str, typer.Option(help="What draws: an entry point of rebar.renderers")] = "opencv",
) -> None:
    """Draw every asset, and one scene under every condition, on one sheet to look at.

    Example: rebar camera sheet --out out/sheet.png
    """
    _prepare(out)
    from bench.contracts import load_plugin
    from bench.simulation import renderer_faults

    if faults := renderer_faults("--renderer", renderer):
        raise SetupError(faults)
    from bench.camera.sheet import draw_sheet

    _write(draw_sheet(load_plugin("rebar.renderers", renderer)), out)


def frames(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs")],
    at: Annotated[
        list[float] | None,
        typer.Option(min=0.0, help="Simulated seconds; repeatable. Default: where the detector erred most"),
    ] = None,
    out: Annotated[Path, typer.Option(help=f"The picture to write: {', '.join(SUFFIXES)}")] = Path(
        "frames.webp"
    ),
) -> None:
    """Draw frames of runs with true and detected boxes: a row for each run, or single frames side by side.

    Example: rebar camera frames out/demo/runs/p001-r1-* --at 30 --at 60 --out frames.png
    """
    from bench.reporting import boxed_frames

    _prepare(out)
    _write(boxed_frames([folder / "recording.mcap" for folder in runs], at or ()), out)


def _prepare(out: Path) -> None:
    if out.suffix not in SUFFIXES:
        what = f"cannot write pictures as {out.suffix or 'a file without suffix'}"
        raise SetupError("--out", what, f"use {', '.join(SUFFIXES)}")
    # Before anything is drawn, which takes long.
    out.parent.mkdir(parents=True, exist_ok=True)


def _write(picture: Pixels, out: Path) -> None:
    # OpenCV takes a tenth of a second to import, which no other command needs.
    import cv2

    options = {
        ".png": [],
        ".jpg": [cv2.IMWRITE_JPEG_QUALITY, _QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1],
        ".webp": [cv2.IMWRITE_WEBP_QUALITY, _QUALITY],
    }
    # Encoded in memory, because cv2.imwrite tells no more than that a file could not be written.
    _, encoded = cv2.imencode(out.suffix, picture, options[out.suffix])
    out.write_bytes(encoded.tobytes())
    print(out)
