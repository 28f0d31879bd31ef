"""`rebar graph`: a decomposition as a drawing and as a page, coloured by the results of a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from bench.errors import SetupError

PAGE, DRAWING = ".html", ".svg"


def graph(
    decomposition: Annotated[str, typer.Argument(help="Name or file of a decomposition")],
    campaign: Annotated[
        Path | None, typer.Option(help="Folder of a campaign whose results colour the nodes")
    ] = None,
    agent: Annotated[
        str | None,
        typer.Option(help="Agent whose results are shown. Default: the first agent of the campaign"),
    ] = None,
    node: Annotated[
        str | None, typer.Option(help="Draw this node alone, with what it serves and what is below it")
    ] = None,
    by: Annotated[
        Literal["confidence", "score", "competence"],
        typer.Option(help="The number that colours the nodes. The page can switch it"),
    ] = "confidence",
    out: Annotated[
        Path | None,
        typer.Option(
            help="A .html or .svg file, or a name without suffix for both. Default: the decomposition's name"
        ),
    ] = None,
) -> None:
    """Draw a decomposition as an interactive page and as a drawing to print.

    Example: rebar graph search-and-report --out out/graph.html

    Example: rebar graph search-and-report --campaign out/demo --by score

    Example: rebar graph search-and-report --node KA-18 --out ka-18.svg
    """
    from bench.reporting import graph_page, graph_svg, load_report_data
    from decompositions import excerpt, load_decomposition

    from ._scores import check_node

    if campaign is None and agent is not None:
        raise SetupError("--agent", "there is no campaign to take results from", "give --campaign as well")
    drawn = load_decomposition(decomposition)
    if node is not None:
        check_node("--node", drawn, node)
        drawn = excerpt(drawn, node)
    data = load_report_data(campaign) if campaign is not None else None
    makers = {PAGE: graph_page, DRAWING: graph_svg}
    for path in _files(out or Path(drawn.name)):
        text = makers[path.suffix](drawn, data, agent, by)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(path)


def _files(out: Path) -> tuple[Path, ...]:
    if out.suffix in (PAGE, DRAWING):
        return (out,)
    if out.suffix:
        raise SetupError(
            "--out", f"{out.name} has an unknown suffix", f"use {PAGE}, {DRAWING}, or no suffix to write both"
        )
    if not out.name:
        raise SetupError("--out", f"{out} is a folder", "name a file in it")
    return (out.with_suffix(PAGE), out.with_suffix(DRAWING))
