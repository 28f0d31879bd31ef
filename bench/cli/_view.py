"""`rebar view`: a campaign or a run in a browser."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.errors import SetupError


def view(
    path: Annotated[Path, typer.Argument(metavar="DIR|RUN", help="A campaign, a run or a recording")],
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the server; 0: a free one")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser")] = True,
    to_html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a run as one page")] = None,
) -> None:
    """Show a campaign, finished or flying, or one recording in a browser. Only this machine can reach it; it writes nothing.

    Example: rebar view out/demo

    Example: rebar view out/demo/runs/p001-r1-reference-naive --to-html run.html
    """
    from bench.campaign import write_whole
    from bench.view import CampaignContent, ViewServer, content_of, run_page

    content = content_of(path)
    if to_html is not None:
        if isinstance(content, CampaignContent):
            raise SetupError("--to-html", "is for one run", f"name a run: {path / 'runs' / 'RUN'}")
        write_whole(to_html, run_page(content, content.root.name))
        print(to_html)
        return
    try:
        server = ViewServer(content, port)
    except OSError as error:
        raise SetupError("--port", f"{port}: {error.strerror}", "give another or none") from error
    with server:
        print(f"{server.address}\nOnly this machine can open it. End it with Ctrl-C.", flush=True)
        # Without a display, `webbrowser` would start a text browser in this terminal.
        if browser and (sys.platform == "darwin" or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
            import webbrowser

            webbrowser.open(server.address)
        server.serve_forever()
