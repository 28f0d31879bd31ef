"""Commands that look at documents: schema, difficulty, and those of the plan that are not there yet."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import BaseModel
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from bench.scoring import Difficulty, DifficultyGoal, DifficultyIncrease, FactorChange
    from decompositions import Decomposition

NOT_YET = 2


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(schema)
    app.command()(difficulty)
    app.command(name="view", help="Look into a campaign while it runs. (not there yet)")(_not_yet("view"))


def schema(
    name: Annotated[
        str, typer.Argument(help="simspec, campaign, decomposition, agent, score-report, or a document of the streams")
    ] = "simspec",
) -> None:
    """Print the JSON Schema of a document. Example: rebar schema simspec > simspec.schema.json"""
    from bench import contracts
    from bench.campaign import Campaign
    from bench.errors import Fault, SetupError
    from bench.instance_analysis import BaseSimSpec, ProposedResult, VocabularyDocument
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
        "prose": BaseSimSpec,
        "proposed": ProposedResult,
        "vocabulary": VocabularyDocument,
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
    node: Annotated[str | None, typer.Option(help="One node in full: every factor, and what to change to make it harder")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For a machine to read")] = False,
) -> None:
    """Difficulty of every node, which key factor rules it, and what would make it harder.

    Example: rebar difficulty examples/search.yaml

    Example: rebar difficulty examples/search.yaml --node KA-18
    """
    from bench.scoring import difficulty_of_values as rate_all
    from bench.simspec import FACTORS, factor_paths, factor_values, load_simspec
    from decompositions import DecompositionVocabulary, load_decomposition

    from ._scores import known_node

    units = {name: factor.unit for name, factor in FACTORS.items()}
    situation, asked = load_simspec(simspec), load_decomposition(decomposition, DecompositionVocabulary(units))
    if node is not None:
        known_node("--node", asked, node)
    found = _Rated(
        asked,
        rate_all(asked, factor_values(situation)),
        {factor: factor_paths(situation, factor) for factor in asked.factors()},
    )
    if as_json:
        print(json.dumps(found.as_json([node] if node else list(asked.nodes)), indent=2))
    elif node is not None:
        print("\n".join(found.in_full(node)))
    else:
        # Five columns that must not break take more than a narrow terminal has.
        Console(width=None if Console().is_terminal else 140).print(found.table(f"Difficulty of {simspec}"))


@dataclass(frozen=True, slots=True)
class _Rated:
    """A rated situation, as it is shown; `paths` are the SimSpec's fields of every key factor."""

    asked: Decomposition
    found: Difficulty
    paths: Mapping[str, tuple[str, ...]]

    def as_json(self, nodes: list[str]) -> dict[str, Any]:
        """Everything about some nodes: as `Difficulty.as_json`, with what would raise each, and where factors are read from."""
        from bench.scoring import difficulty_increase

        told = self.found.as_json()
        leaves = {leaf for node in nodes for leaf in self.asked.observables_under(node)}
        rated = {row.factor: row for leaf in leaves for row in self.found.observables[leaf].ratings}
        return {
            "decomposition": told["decomposition"],
            "nodes": [
                one | {"raise": dataclasses.asdict(difficulty_increase(self.asked, self.found, one["node"]))}
                for one in told["nodes"]
                if one["node"] in nodes
            ],
            "observables": [one for one in told["observables"] if one["observable"] in leaves],
            "factors": {
                name: {"value": rated[name].value, "unit": rated[name].unit, "paths": list(paths)}
                for name, paths in self.paths.items()
                if name in rated
            },
        }

    def table(self, title: str) -> Table:
        """One row for each node."""
        from bench.scoring import difficulty_increase

        table = Table(title=Text(title))
        for column in ("node", "level", "difficulty", "tension", "ruled by", "next", "to be harder"):
            table.add_column(column, justify="right" if column in ("difficulty", "tension") else "left")
        for one in self.found.nodes.values():
            rise = difficulty_increase(self.asked, self.found, one.node)
            following = "" if rise.margin is None else f"{', '.join(rise.following)} +{rise.margin:.1f}"
            goal = rise.takeover or rise.tension
            alone = goal is not None and [one.factor for one in goal.changes] == list(rise.ruled_by)[:1]
            change = "; ".join(map(_move if alone else _short, goal.changes)) if goal else ""
            row = (one.node, str(one.level), f"{one.difficulty:.1f}", str(one.tension), self._ruler(one.node, rise), following)
            table.add_row(*map(Text, (*row, change)))
        return table

    def _ruler(self, node: str, rise: DifficultyIncrease) -> str:
        if rise.ruled_by:
            return ", ".join(rise.ruled_by)
        return f"the mean of its ratings: {', '.join(self.found.nodes[node].ruled_by)}"

    def in_full(self, node: str) -> Iterator[str]:
        """One node, line by line."""
        from bench.scoring import difficulty_increase

        one, rise = self.found.nodes[node], difficulty_increase(self.asked, self.found, node)
        yield f"{node} {self.asked.nodes[node].title}: difficulty {one.difficulty:.4g}, tension {one.tension}"
        yield f"ruled by {self._ruler(node, rise)}, in {', '.join(one.ruled_by)}"
        if rise.margin is not None:
            yield f"next is {', '.join(rise.following)}, {rise.margin:.4g} points above"
        if rise.takeover:
            yield from self._goal(f"To {rise.takeover.difficulty:.4g}, where the next takes over:", rise.takeover)
        if rise.tension:
            yield from self._goal(f"To tension {one.tension + 1}, above {rise.tension.difficulty:g}:", rise.tension)
        yield "Its observables:"
        for leaf in self.asked.observables_under(node):
            rated = self.found.observables[leaf]
            yield f"  {leaf} {self.asked.nodes[leaf].title}: {rated.difficulty:.4g}"
            for row in rated.ratings:
                yield f"    {row.factor} = {row.value:g} {row.unit} rates {row.rating:.4g}"

    def _goal(self, title: str, goal: DifficultyGoal) -> Iterator[str]:
        yield title
        for one in goal.changes:
            yield f"  {_short(one)} ({', '.join(self.paths[one.factor])})"


def _short(one: FactorChange) -> str:
    return f"{one.factor} {_move(one)}"


def _move(one: FactorChange) -> str:
    """From the value that a factor has to the one that it needs."""
    if one.harder == "either way":
        return "cannot: its tables run in opposite directions"
    if one.to is None:
        return f"cannot: its tables end at {one.most:g}"
    unit = "" if one.unit == "1" else f" {one.unit}"
    return f"{one.value:g} -> {f'{one.harder} than ' if one.past else ''}{one.to:.6g}{unit}"


def _not_yet(name: str) -> Callable[[], None]:
    def command() -> None:
        print(f"rebar {name} is not there yet; docs/scope.md says what is.")
        raise typer.Exit(NOT_YET)

    return command
