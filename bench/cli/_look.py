"""Commands that look at documents: schema, difficulty, and those of the plan that are not there yet."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from pydantic import BaseModel
from rich.console import Console
from rich.table import Table

NOT_YET = 2


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(schema)
    app.command()(difficulty)
    for name, text in (
        ("prose", "Turn a description into a base SimSpec."),
        ("view", "Look into a campaign while it runs."),
        ("graph", "Draw a decomposition."),
    ):
        app.command(name=name, help=f"{text} (not there yet)")(_not_yet(name))


def schema(
    name: Annotated[
        str, typer.Argument(help="simspec, campaign, decomposition, agent, score-report, or a document of the streams")
    ] = "simspec",
) -> None:
    """Print the JSON Schema of a document. Example: rebar schema simspec > simspec.schema.json"""
    from bench import contracts
    from bench.campaign import Campaign
    from bench.errors import Fault, SetupError
    from bench.scoring import Explanation, ScoreReport
    from bench.simspec import SimSpec
    from decompositions import decomposition_schema

    kinds: dict[str, type[BaseModel]] = {
        "simspec": SimSpec,
        "campaign": Campaign,
        "agent": contracts.AgentManifest,
        "mission-order": contracts.MissionOrder,
        "intelligence": contracts.IntelligenceDocument,
        "order": contracts.OrderDocument,
        "operator-link": contracts.OperatorLinkDocument,
        "target-report": contracts.TargetReport,
        "decision": contracts.Decision,
        "agent-status": contracts.AgentStatus,
        "agent-tracks": contracts.AgentTracks,
        "order-answer": contracts.OrderAnswer,
        "session-result": contracts.SessionResult,
        "score-report": ScoreReport,
        "score-explanation": Explanation,
    }
    if name == "decomposition":
        print(json.dumps(decomposition_schema(), indent=2))
        return
    if name not in kinds:
        raise SetupError(
            Fault("schema", f"there is no document {name!r}", f"known: {', '.join(sorted([*kinds, 'decomposition']))}")
        )
    print(json.dumps(kinds[name].model_json_schema(), indent=2))


def difficulty(
    simspec: Annotated[Path, typer.Argument(help="A SimSpec, base or realized")],
    decomposition: Annotated[str, typer.Option(help="Name or file of a decomposition")] = "search-and-report",
    as_json: Annotated[bool, typer.Option("--json", help="For a machine to read")] = False,
) -> None:
    """Difficulty of every node, and which key factor rules it. Example: rebar difficulty examples/search.yaml"""
    from bench.scoring import difficulty as rate_all
    from bench.simspec import factor_values, load_simspec
    from decompositions import load_decomposition

    rated = rate_all(load_decomposition(decomposition), factor_values(load_simspec(simspec)))
    if as_json:
        print(json.dumps(rated.as_json(), indent=2))
        return
    table = Table(title=f"Difficulty of {simspec}")
    for column in ("node", "level", "difficulty", "tension", "ruled by"):
        table.add_column(column)
    for row in rated.rows():
        table.add_row(*row)
    Console().print(table)


def _not_yet(name: str) -> Callable[[], None]:
    def command() -> None:
        print(f"rebar {name} is not there yet; docs/scope.md says what is.")
        raise typer.Exit(NOT_YET)

    return command
