"""`rebar camera`: what the rendered camera can draw."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.errors import SetupError

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
    if out.suffix not in SUFFIXES:
        raise SetupError(
            "--out",
            f"cannot write pictures as {out.suffix or 'a file without suffix'}",
            f"use {', '.join(SUFFIXES)}",
        )
    from bench.contracts import load_plugin
    from bench.simulation import renderer_faults

    if faults := renderer_faults("--renderer", renderer):
        raise SetupError(faults)
    out.parent.mkdir(parents=True, exist_ok=True)
    # OpenCV takes a tenth of a second to import, which no other command needs.
    import cv2

    from bench.camera.sheet import draw_sheet

    options = {
        ".png": [],
        ".jpg": [cv2.IMWRITE_JPEG_QUALITY, _QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1],
        ".webp": [cv2.IMWRITE_WEBP_QUALITY, _QUALITY],
    }
    # Encoded in memory, because cv2.imwrite tells no more than that a file could not be written.
    _, encoded = cv2.imencode(
        out.suffix, draw_sheet(load_plugin("rebar.renderers", renderer)), options[out.suffix]
    )
    out.write_bytes(encoded.tobytes())
    print(out)
