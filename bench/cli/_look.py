"""Commands about documents: schema and difficulty."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from ._tables import add_plain_row, plain_console, plain_table, print_lines

if TYPE_CHECKING:
    from bench.difficulty import DifficultyScale, MeasuredDifficulty
    from bench.scoring import Difficulty
    from bench.simspec import SimSpec
    from decompositions import Decomposition

RULED_BY = "Ruled by"
# Of the sentences below the table: the hardest nodes.
EXPLAINED_NODES = 5


def schema(
    name: Annotated[
        str,
        typer.Argument(
            help="simspec, campaign, decomposition, agent, score-report, a message document, or a ROS 2 type"
        ),
    ] = "simspec",
    keys: Annotated[
        Path | None,
        typer.Option(
            help="Print the topics of the air network of a session of this SimSpec instead, with their Zenoh keys"
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="With --keys: print JSON")] = False,
) -> None:
    """Print the JSON Schema of a document, or the keys of the topics of a session.

    Example: rebar schema simspec > simspec.schema.json

    Example: rebar schema --keys examples/search.yaml
    """
    if keys is not None:
        _print_keys(keys, as_json)
        return
    from bench import contracts
    from bench.campaign import Campaign, CampaignState
    from bench.errors import SetupError
    from bench.instance_analysis import BaseSimSpec, Rewrite, RewrittenResult, VocabularyDocument
    from bench.laboratory import CampaignMessage, CampaignStatus, StandMessage
    from bench.reporting import AssuranceCase
    from bench.scoring import Explanation, ScoreReport
    from bench.simspec import AssetTable, SimSpec
    from bench.streams import json_schema, message_class
    from decompositions import decomposition_schema

    kinds: dict[str, type[object]] = {
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
        "consent-request": contracts.ConsentRequest,
        "consent-answer": contracts.ConsentAnswer,
        "session-result": contracts.SessionResult,
        "score-report": ScoreReport,
        "score-explanation": Explanation,
        "assurance-case": AssuranceCase,
        "campaign-state": CampaignState,
        "campaign-message": CampaignMessage,
        "campaign-status": CampaignStatus,
        "stand-message": StandMessage,
        "mqtt-ready": contracts.MqttReady,
        "mqtt-tick": contracts.MqttTick,
        "mqtt-ack": contracts.MqttAck,
        "mqtt-end": contracts.MqttEnd,
        "mavlink-message": contracts.MavlinkJson,
        "prose": BaseSimSpec,
        "rewrite": Rewrite,
        "rewritten": RewrittenResult,
        "assets": AssetTable,
        "vocabulary": VocabularyDocument,
    }
    if name == "decomposition":
        print(json.dumps(decomposition_schema(), indent=2))
        return
    if (message := message_class(name)) is not None:
        print(json.dumps(json_schema(message), indent=2))
        return
    outside = contracts.plugins("rebar.documents")
    if name not in kinds and name not in outside:
        raise SetupError(
            "schema",
            f"there is no document {name!r}",
            f"known: {', '.join(sorted({*kinds, *outside, 'decomposition'}))}, and types such as vision_msgs/msg/Detection2DArray",
        )
    kind = kinds[name] if name in kinds else contracts.load_plugin("rebar.documents", name)
    print(json.dumps(contracts.document_schema(kind), indent=2))


def _print_keys(simspec: Path, as_json: bool) -> None:
    from bench.agents import load_manifest
    from bench.errors import SetupError
    from bench.simspec import load_simspec
    from bench.simulation import air_topics
    from bench.streams import AP_PREFIX, PX4_PREFIX

    spec = load_simspec(simspec)
    # An agent without the autopilot's topics is shown what it would have.
    needs = (("px4", "px4_msgs", "1.17"), ("ardupilot", "ap_dds", "2025-12"))
    releases = {field: release for name, field, release in needs if spec.vehicle.autopilot == name}
    with suppress(SetupError):
        manifest = load_manifest(spec.agent.manifest)[0]
        releases = {field: getattr(manifest, field) or release for field, release in releases.items()}
    rows = [
        {
            "topic": topic.name,
            "type": topic.kind.TYPE,
            "key": topic.key,
            "direction": topic.direction,
            "reliable": topic.depth > 0 or topic.qos.reliable,
            "latched": topic.depth,
            **(releases if topic.name.startswith((PX4_PREFIX, AP_PREFIX)) else {}),
        }
        for topic in air_topics(spec, **releases)
    ]
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    # A key is longer than a line of the terminal, and is there to be copied: no table.
    for row in rows:
        kind = "reliable" if row["reliable"] else "best effort"
        latched = f", latched ({row['latched']})" if row["latched"] else ""
        need = "".join(
            f', with {field}: "{row[field]}" in the manifest' for field in releases if field in row
        )
        print(f"{row['topic']}  {row['type']}  {row['direction']}, {kind}{latched}{need}\n  {row['key']}")


def difficulty(
    simspec: Annotated[Path, typer.Argument(help="SimSpec file, base or realized")],
    decomposition: Annotated[str, typer.Option(help="Name or file of a decomposition")] = "search-and-report",
    node: Annotated[
        str | None,
        typer.Option(help="Show one node in full: every factor, and the fields that set it"),
    ] = None,
    scale: Annotated[
        Path | None, typer.Option(help="File of a scale of measured difficulty. Default: the shipped one")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Show the published rating of every node, the key factor that decides it and the next one; and the measured
    difficulty, with what makes it.

    Example: rebar difficulty examples/search.yaml

    Example: rebar difficulty examples/search.yaml --node KA-18
    """
    from bench.scoring import difficulty_of_values as rate_all
    from bench.simspec import factor_paths, factor_values, load_simspec

    from ._scores import check_node, rated_decomposition

    situation, tree = load_simspec(simspec), rated_decomposition(decomposition)
    if node is not None:
        check_node("--node", tree, node)
    # Every observable is rated for whoever looks into a table of factors; only what nothing can exercise is left out.
    perception = "elsewhere" if situation.perception.by_bench else situation.perception.source
    published = rate_all(tree, factor_values(situation), perception)
    rated = _RatedSituation(
        tree,
        published,
        {factor: factor_paths(situation, factor) for factor in tree.factors()},
        *_measure(situation, published, _scale_of(tree, scale)),
    )
    if as_json:
        print(json.dumps(rated.as_json([node] if node else list(tree.nodes)), indent=2))
    elif node is not None:
        print_lines(*rated.in_full(node))
    else:
        print_lines(f"Difficulty of {simspec}")
        plain_console().print(rated.table())
        print_lines(*rated.explanations())


def _scale_of(decomposition: Decomposition, path: Path | None) -> DifficultyScale | None:
    from bench.difficulty import load_scale, shipped_scale

    return shipped_scale(decomposition) if path is None else load_scale(path, decomposition)


def _measure(
    situation: SimSpec, published: Difficulty, scale: DifficultyScale | None
) -> tuple[Mapping[str, MeasuredDifficulty], str, Mapping[str, Mapping[str, MeasuredDifficulty]]]:
    """The measured difficulty of every node that the situation exercises and that has a scale, or why there is none; and what
    they would be with one thing changed, by what that is.

    A situation without places gets those of its seed.
    """
    from bench.difficulty import changed_situations, features_of
    from bench.realization import PlacementInfeasible, place

    if scale is None:
        return {}, "there is no scale for this decomposition (`rebar calibrate --fit`)", {}
    try:
        placed = situation if situation.realized else place(situation)
    except PlacementInfeasible:
        return {}, "the actors find no room; the published rating needs no places", {}
    nodes = [node for node in scale.nodes if published.of(node) is not None]

    def measured(simspec: SimSpec) -> dict[str, MeasuredDifficulty]:
        features = features_of(simspec)
        return {node: scale.measure(node, features) for node in nodes}

    changes = {words: measured(changed) for words, changed in changed_situations(placed)}
    return measured(placed), "" if nodes else "this situation exercises no node that has a scale", changes


@dataclass(frozen=True, slots=True)
class _RatedSituation:
    """A rated situation, to be shown. `paths` has the fields of the SimSpec for every key factor."""

    decomposition: Decomposition
    difficulty: Difficulty
    paths: Mapping[str, tuple[str, ...]]
    measured: Mapping[str, MeasuredDifficulty]
    unmeasured: str
    """Why there is no measured difficulty; empty where there is one."""
    changes: Mapping[str, Mapping[str, MeasuredDifficulty]]
    """The measured difficulties with one thing changed."""

    def explanations(self) -> list[str]:
        """Sentences about the hardest nodes on the measured scale; those that it was shown to hold for, if any."""
        if self.unmeasured:
            return [f"No measured difficulty: {self.unmeasured}"]
        proved = [measured for measured in self.measured.values() if not measured.unproved]
        hardest = sorted(proved or self.measured.values(), key=lambda measured: -measured.difficulty)
        return [self._explanation(measured) for measured in hardest[:EXPLAINED_NODES]]

    def _explanation(self, measured: MeasuredDifficulty, count: int = 4) -> str:
        """With what would change its tension."""
        others = {words: nodes[measured.node].tension for words, nodes in self.changes.items()}
        parts = [f"{tension} {words}" for words, tension in others.items() if tension != measured.tension]
        changed = f" It would be tension {', '.join(parts)}." if parts else ""
        return measured.sentence(count) + changed

    def as_json(self, nodes: list[str]) -> dict[str, Any]:
        """Some nodes as in `Difficulty.as_json`, with the fields behind each factor."""
        document = self.difficulty.as_json()
        leaves = {leaf for node in nodes for leaf in self.decomposition.observables_under(node)}
        rated = {row.factor: row for leaf in leaves for row in self.difficulty.observables[leaf].ratings}
        return {
            "decomposition": document["decomposition"],
            "nodes": [row for row in document["nodes"] if row["node"] in nodes],
            "measured": [
                dataclasses.asdict(measured) for node, measured in self.measured.items() if node in nodes
            ],
            "observables": [row for row in document["observables"] if row["observable"] in leaves],
            "factors": {
                name: {"value": rated[name].value, "unit": rated[name].unit, "paths": list(paths)}
                for name, paths in self.paths.items()
                if name in rated
            },
        }

    def table(self) -> Table:
        """A table with one row for each node. Its last column has all that is words, which wrap, so that names of
        factors stay whole.
        """
        table = plain_table(("Node", "Published", "Tension", "Measured", RULED_BY), texts=(RULED_BY,))
        for node in self.difficulty.nodes.values():
            words = [self._ruler(node.node)]
            if following := self._following(node.node):
                words.append(f"next {', '.join(following[0])} +{following[1]:.1f}")
            hard = "none" if node.difficulty is None else f"{node.difficulty:.1f}"
            measured = self.measured.get(node.node)
            # In brackets where nothing may be claimed on it.
            panel = "" if measured is None else f"{measured.difficulty:.0f}"
            panel = f"({panel})" if measured and measured.unproved else panel
            add_plain_row(table, (node.node, hard, str(node.tension or ""), panel, "; ".join(words)))
        return table

    def _ruler(self, node: str) -> str:
        if self.difficulty.of(node) is None:
            return "nothing: the situation does not exercise it"
        leaves = self.difficulty.nodes[node].ruled_by
        if self.decomposition.policies.factor_rule != "minimum":
            return f"the mean of its ratings: {', '.join(leaves)}"
        factors = (factor for leaf in leaves for factor in self.difficulty.observables[leaf].ruled_by)
        return ", ".join(sorted(set(factors)))

    def _following(self, node: str) -> tuple[list[str], float] | None:
        """The factors that rule the node next, and how many points above its difficulty; None where none do."""
        from bench.scoring import rated_observables

        if self.decomposition.policies.factor_rule != "minimum":
            return None
        leaves = rated_observables(self.decomposition, node, self.difficulty.observables)
        rows = [row for leaf in leaves for row in self.difficulty.observables[leaf].ratings]
        # A factor rules by the lowest of its ratings under the node.
        ratings = {row.factor: row.rating for row in sorted(rows, key=lambda row: -row.rating)}
        lowest = min(ratings.values(), default=0.0)
        if (
            following := min((rating for rating in ratings.values() if rating > lowest), default=None)
        ) is None:
            return None
        return sorted(factor for factor, rating in ratings.items() if rating == following), following - lowest

    def in_full(self, node: str) -> Iterator[str]:
        """One node with all its factors, line by line."""
        from bench.scoring import Standing, absence_of

        rating = self.difficulty.nodes[node]
        title = f"{node} {self.decomposition.nodes[node].title}"
        if rating.difficulty is None:
            yield f"{title}: no difficulty, because this situation exercises none of its observables"
        else:
            yield f"{title}: published rating {rating.difficulty:.4g}, tension {rating.tension}"
            yield f"ruled by {self._ruler(node)}, in {', '.join(rating.ruled_by)}"
        if following := self._following(node):
            yield f"next is {', '.join(following[0])}, {following[1]:.4g} points above"
        if node in self.measured:
            yield self._explanation(self.measured[node], len(self.measured[node].contributions))
        yield "Its observables:"
        for leaf in self.decomposition.observables_under(node):
            rated = self.difficulty.observables[leaf]
            title = f"  {leaf} {self.decomposition.nodes[leaf].title}"
            if rated.difficulty is None:
                yield f"{title}: not exercisable, because {absence_of(rated)}"
                continue
            about = " (the configured sensor)" if rated.standing is Standing.CONFIGURED_SENSOR else ""
            yield f"{title}: {rated.difficulty:.4g}{about}"
            for row in rated.ratings:
                paths = f" ({', '.join(paths)})" if (paths := self.paths[row.factor]) else ""
                yield f"    {row.factor} = {row.value:g} {row.unit} rates {row.rating:.4g}{paths}"
