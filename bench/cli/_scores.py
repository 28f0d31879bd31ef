"""`rebar score`: recordings to observations and scores, again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from bench.contracts import SessionResult
from decompositions import Decomposition


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(score)


def score(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or of whole campaigns")],
    decomposition: Annotated[str | None, typer.Option(help="Name or file; a campaign's own when not given")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For a machine to read")] = False,
) -> None:
    """Measure and score recordings again; nothing but the recording, its SimSpec and the decomposition decides.

    A run's folder is scored to the screen; a campaign's gets new result.json files, scores.parquet and report.html.
    Example: rebar score out/demo/runs/p000-r0-reference-naive
    """
    from bench.campaign import is_campaign, load_asked, rescore

    for folder in runs:
        if is_campaign(folder):
            _score_campaign(folder, decomposition, as_json)
        else:
            asked = load_asked(decomposition or "search-and-report")
            _show_run(rescore(folder, asked), asked, folder, as_json)


def _score_campaign(folder: Path, decomposition: str | None, as_json: bool) -> None:
    from bench.campaign import rescore_campaign
    from bench.reporting import score_table

    finished = rescore_campaign(folder, decomposition)
    if as_json:
        print(json.dumps(finished.summary.to_dicts(), indent=1))
        return
    Console().print(score_table(finished.summary, finished.study))
    missing = finished.outcomes.get("not finished", 0)
    if missing:
        print(f"{missing} realizations have no result, or none that fits its recording: `rebar run` flies them again")
    print(f"{finished.report}")


def _show_run(result: SessionResult, asked: Decomposition, folder: Path, as_json: bool) -> None:
    from bench.scoring import difficulty_of, score_run
    from test_ports import read_simspec

    difficulty = difficulty_of(asked, read_simspec(folder / "recording.mcap"))
    scores = score_run(asked, difficulty, result.observations)
    if as_json:
        nodes = {
            node: {
                "difficulty": difficulty.of(node),
                "score": one.score,
                "confidence": one.confidence,
                "achieved": one.achieved,
                "considered": one.considered,
            }
            for node in asked.nodes
            for one in (scores[node],)
        }
        print(json.dumps({"result": result.model_dump(mode="json"), "nodes": nodes}, indent=1))
        return
    table = Table(title=f"{folder}: {result.outcome}, {result.simulated_s:.1f} simulated s", title_justify="left")
    for column in ("node", "title", "difficulty", "score", "achieved", "considered", "confidence"):
        table.add_column(column, justify="left" if column in ("node", "title") else "right")
    for node in asked.nodes.values():
        one = scores[node.id]
        table.add_row(
            node.id,
            node.title,
            f"{difficulty.of(node.id):.1f}",
            "not scored" if one.score is None else f"{one.score:.1f}",
            str(one.achieved),
            str(one.considered),
            "" if one.confidence is None else f"{one.confidence:.0%}",
        )
    Console().print(table)
