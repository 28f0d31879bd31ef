"""Scores as one JSON document: the same for a run, a campaign and a table from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import polars as pl
from pydantic import Field

from bench.contracts import Outcome
from bench.documents import Document

from ._difficulty import Standing
from ._floor import NodeFloor
from ._statements import StatementReport
from ._table import OVERRULED

Points = Annotated[float, Field(description="On the scale of difficulty.")]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Count = Annotated[int, Field(ge=0)]


class NodeReport(Document):
    """One node of one agent over its runs in one difficulty configuration, or in `all` of them together."""

    agent: str
    configuration: str = Field(description="Difficulties of the studied key attributes; `all` is every run.")
    id: str
    level: Literal["principle", "ka", "vab", "observable"]
    title: str
    difficulty_low: Points | None = Field(
        description="Lowest difficulty among the runs; null where none is known."
    )
    difficulty_high: Points | None = Field(description="Highest difficulty among the runs.")
    runs: Count = Field(description="Runs whose outcome the agent answers for.")
    excluded: Count = Field(description="Runs that the bench spoilt; no other number counts them.")
    design_points: Count = Field(description="Distinct design points of the considered runs.")
    considered: Count = Field(description="Runs in which the node was considered.")
    passed: Count = Field(description="Considered runs in which every considered observable was achieved.")
    passed_low: Share = Field(
        description="Lower end of the two-sided 95 % interval of the share of considered runs that pass."
    )
    passed_high: Share = Field(description="Upper end of that interval.")
    verdict_passed: Count | None = Field(
        None,
        description="Of a principle: runs in which every considered observable under its essential key attributes was achieved.",
    )
    verdict_considered: Count | None = Field(
        None, description="Runs in which some such observable was considered: the others have no verdict."
    )
    verdict_low: Share | None = Field(
        None, description="Lower end of the two-sided 95 % interval of the share that pass the principle."
    )
    verdict_high: Share | None = Field(None, description="Upper end of that interval.")
    scored: Count = Field(description="Runs in which the node has a score.")
    score: Points | None = Field(description="Mean over the scored runs: the ARL. Null: not scored.")
    score_low: Points | None = Field(
        None,
        description="Lower end of the range (95 %) of the score if the same design were flown again with new seeds. Null: too few replicates.",
    )
    score_high: Points | None = Field(None, description="Upper end of that range.")
    raised_by_failure: bool = Field(
        description="The score is higher than if every failed observable had passed at its threshold."
    )
    confidence: Share | None = Field(description="Mean over the considered runs. Null: never considered.")
    confidence_low: Share = Field(description="Lower end of its two-sided 95 % interval.")
    confidence_high: Share = Field(description="Upper end of that interval.")
    method: str = Field(description="Method of the interval of the confidence.")
    competence_50: Points | None = Field(
        None,
        description="Highest tested difficulty at which half of such runs pass; in `all`, and only where `failures_rise`. A failure never raises it.",
    )
    competence_50_low: Points | None = Field(None, description="One-sided 95 % lower bound of competence_50.")
    competence_50_at_least: bool | None = Field(
        None, description="True where competence_50 is the highest difficulty that was tested."
    )
    competence_90: Points | None = Field(None, description="Like competence_50, for nine runs in ten.")
    competence_90_low: Points | None = None
    competence_90_at_least: bool | None = None
    failures_rise: bool | None = Field(
        None,
        description="The runs show that failures rise with difficulty (95 % interval of the trend); in `all` only.",
    )
    exercisable: Count = Field(
        0, description="Runs whose configuration gives the node a difficulty, spoilt ones included."
    )
    overruled: Count = Field(
        0, description="Runs in which a measure considered it although the configuration cannot exercise it."
    )
    configured_sensor: bool = Field(
        False, description="It describes the sensor that the bench simulates, and enters no other node."
    )
    floor: Share | None = Field(
        None,
        description="Best confidence of a null agent, in `all` only. Null: not flown, or never considered.",
    )
    ceiling: Share | None = Field(
        None, description="Confidence of an agent that is given the truth, in `all` only."
    )
    discriminates: bool | None = Field(
        None, description="False for an observable whose floor is above a half or nine tenths of its ceiling."
    )


class RunNode(Document):
    """One node in one run."""

    id: str
    level: Literal["principle", "ka", "vab", "observable"]
    difficulty: Points | None = Field(description="Null where it is not known.")
    score: Points | None = Field(description="Null: not scored.")
    confidence: Share | None = Field(description="Null: not considered.")
    achieved: Count = Field(description="Distinct descendant observables that were achieved.")
    considered: Count = Field(description="Distinct descendant observables that were considered.")
    x: Share | None = Field(description="Measured value, for considered observables only.")
    standing: Literal["counted", "configured sensor", "not exercisable", "overruled"] | None = Field(
        None,
        description="What an observable counts for in this configuration; overruled: not exercisable, although its measure considered it. Null for other nodes.",
    )


class RunReport(Document):
    """One run with all of its nodes."""

    run: str
    agent: str
    design_point: str
    replicate: int
    configuration: str
    outcome: Outcome
    recording: str | None = Field(description="Path of the recording, where there is one.")
    nodes: tuple[RunNode, ...]


class CompletenessReport(Document):
    """Whether the numbers are over all runs of a campaign."""

    folder: str = Field(description="The campaign's folder, as the user named it.")
    complete: bool = Field(description="Every run counts, was not needed, or is accepted as missing.")
    running: bool = Field(description="Another process was writing in the folder: the numbers will change.")
    total: Count = Field(description="Runs of the campaign, null agents and oracle included.")
    missing: dict[str, Count] = Field(description="Missing runs by outcome; `not finished` without a result.")
    accepted: tuple[str, ...] = Field(description="Missing runs that somebody took as they are (--accept).")


class ScoreReport(Document):
    """The document that `rebar score --json` prints."""

    format: Literal["rebar.score-report/1"] = "rebar.score-report/1"
    kind: Literal["campaign", "run", "observations"]
    source: str = Field(description="The folder or file that was scored, as the user named it.")
    fidelity: Literal["full", "overhead"] | None = Field(
        None,
        description="overhead: surrogates on a ground plan, not the agents themselves. Null where it is not known.",
    )
    completeness: CompletenessReport | None = Field(
        None, description="Of a campaign; null for a run and for a table."
    )
    decomposition: str
    decomposition_sha256: str = Field(
        description="Digest of the decomposition: scores are comparable where it is equal."
    )
    study: tuple[str, ...] = Field(description="Key attributes whose difficulties make a configuration.")
    absent: Count = Field(
        description="Pairs of run and observable without an observation: they count as not considered."
    )
    nodes: tuple[NodeReport, ...]
    runs: tuple[RunReport, ...] | None = Field(
        None, description="With --per-run, or where a single run was named."
    )
    statements: tuple[StatementReport, ...] = Field(
        (), description="What each agent states of its confidence and error, over all runs that count."
    )


# The document says `id`, `score` and `confidence` where the tables have longer column names.
_FIELD_OF_COLUMN = {"node": "id", "score_mean": "score", "confidence_mean": "confidence"}


def node_reports(
    scores: pl.DataFrame, summary: pl.DataFrame, floors: Mapping[str, NodeFloor] | None = None
) -> tuple[NodeReport, ...]:
    """The rows of a summary, each with what it counts for, and with floor and ceiling where they are known."""
    standings = _standings(scores)
    nodes = (NodeReport.model_validate(_node(row, standings)) for row in summary.iter_rows(named=True))
    return tuple(_with_floor(node, floors or {}) for node in nodes)


def run_reports(scores: pl.DataFrame, recordings: Mapping[str, str] | None = None) -> tuple[RunReport, ...]:
    """The runs of a score table, in its order."""
    reports = []
    for frame in scores.partition_by("realization", maintain_order=True):
        rows: Sequence[dict[str, Any]] = frame.to_dicts()
        first = rows[0]
        reports.append(
            RunReport(
                run=first["realization"],
                agent=first["agent"],
                design_point=first["design_point"],
                replicate=first["replicate"],
                configuration=first["configuration"],
                outcome=Outcome(first["outcome"]),
                recording=(recordings or {}).get(first["realization"]),
                nodes=tuple(RunNode.model_validate(_run_node(row)) for row in rows),
            )
        )
    return tuple(reports)


def _with_floor(node: NodeReport, floors: Mapping[str, NodeFloor]) -> NodeReport:
    beside = floors.get(node.id)
    # Floor and ceiling are over a share of all scenes, so they stand beside no single configuration.
    if beside is None or beside.floor is None or node.configuration != "all":
        return node
    discriminates = not beside.flaw if node.level == "observable" else None
    return node.model_copy(
        update={"floor": beside.floor, "ceiling": beside.ceiling, "discriminates": discriminates}
    )


def _node(
    row: Mapping[str, Any], standings: Mapping[tuple[str, str, str], Mapping[str, Any]]
) -> dict[str, Any]:
    named = {_FIELD_OF_COLUMN.get(name, name): value for name, value in row.items()}
    if not row.get("failures_rise"):
        # Competence assumes it (docs/rulings.md 17).
        named = {name: value for name, value in named.items() if not name.startswith("competence_")}
    named |= standings.get((row["agent"], row["configuration"], row["node"]), {})
    return {name: value for name, value in named.items() if name in NodeReport.model_fields}


def _run_node(row: Mapping[str, Any]) -> dict[str, Any]:
    named = {_FIELD_OF_COLUMN.get(name, name): value for name, value in row.items()}
    return {name: value for name, value in named.items() if name in RunNode.model_fields}


def _standings(scores: pl.DataFrame) -> dict[tuple[str, str, str], dict[str, Any]]:
    """`exercisable`, `overruled` and `configured_sensor` by agent, configuration (and `all`) and node."""
    key = ["agent", "configuration", "node"]
    rows = scores.select(*(pl.col(name).cast(pl.String) for name in key), "difficulty", "standing")
    with_totals = pl.concat([rows, rows.with_columns(pl.lit("all").alias("configuration"))])
    grouped = with_totals.group_by(key).agg(
        exercisable=pl.col("difficulty").is_not_null().sum(),
        overruled=(pl.col("standing") == OVERRULED).sum(),
        configured_sensor=(pl.col("standing") == str(Standing.CONFIGURED_SENSOR)).any(),
    )
    fields = ("exercisable", "overruled", "configured_sensor")
    return {
        (row["agent"], row["configuration"], row["node"]): {
            name: row[name] if row[name] is not None else 0 for name in fields
        }
        for row in grouped.iter_rows(named=True)
    }
