"""`rebar graph`: a decomposition as a drawing and as a page, coloured by what a campaign showed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from bench.errors import Fault, SetupError

PAGE, DRAWING = ".html", ".svg"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(graph)


def graph(
    decomposition: Annotated[str, typer.Argument(help="Name or file of a decomposition")],
    campaign: Annotated[Path | None, typer.Option(help="Folder of a campaign, to colour the nodes by what it showed")] = None,
    agent: Annotated[str | None, typer.Option(help="Whose numbers; the campaign's first agent when not given")] = None,
    by: Annotated[
        Literal["confidence", "score", "competence"], typer.Option(help="What colours the drawing; the page can change it")
    ] = "confidence",
    out: Annotated[
        Path | None,
        typer.Option(help="A file .html or .svg, or a name without an end for both; the decomposition's when not given"),
    ] = None,
) -> None:
    """Draw a decomposition: a page to look into, and a drawing to print.

    Example: rebar graph search-and-report --out out/graph.html

    Example: rebar graph search-and-report --campaign out/demo --by score
    """
    from bench.reporting import graph_page, graph_svg, load_report_data
    from decompositions import load_decomposition

    if campaign is None and agent is not None:
        raise SetupError(Fault("--agent", "there is no campaign to take numbers from", "give --campaign too"))
    asked = load_decomposition(decomposition)
    data = load_report_data(campaign) if campaign is not None else None
    makers = {PAGE: graph_page, DRAWING: graph_svg}
    for path in _files(out or Path(asked.name)):
        text = makers[path.suffix](asked, data, agent, by)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(path)


def _files(out: Path) -> tuple[Path, ...]:
    if out.suffix in (PAGE, DRAWING):
        return (out,)
    if out.suffix:
        raise SetupError(
            Fault(
                "--out", f"{out.name} is neither a page nor a drawing", f"end it in {PAGE} or {DRAWING}, or in nothing for both"
            )
        )
    return (out.with_suffix(PAGE), out.with_suffix(DRAWING))
