"""A decomposition as a document: what is asked of an agent, from five principles down to what can be measured.

The format is `rebar.decomposition/1`, written in YAML. Every node names its children by id, so one node may stand under
many. What pydantic cannot see in one field (cycles, orphans, tables without a direction) is checked in `_checks`, so that
a document with ten faults is told all ten.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from bench.documents import Document

NodeId = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,31}$")]
Sentence = Annotated[str, Field(min_length=1, max_length=2000)]
Option = bool | int | float | str


class Level(StrEnum):
    """The four levels of a decomposition, from the most general down."""

    PRINCIPLE = "principle"
    KEY_ATTRIBUTE = "ka"
    VAB = "vab"
    OBSERVABLE = "observable"


class Policies(Document):
    """The rules of scoring by name, each with the published rule as its default; docs/scoring.md gives the formulas."""

    shared_value: Annotated[
        Literal["lower", "higher"], Field(description="Rating of a value that stands in two columns of a table.")
    ] = "lower"
    easier_than_table: Annotated[
        Literal["zero", "first"], Field(description="Rating of what is easier than the first column: 0, or the first rating.")
    ] = "zero"
    factor_rule: Annotated[
        Literal["minimum", "mean"], Field(description="How the ratings of its key factors make the difficulty of an observable.")
    ] = "minimum"
    credit_points: Annotated[
        float, Field(ge=0.0, le=100.0, description="Points that a full excess of x over its threshold is worth.")
    ] = 4.0
    near_miss: Annotated[
        float,
        Field(ge=0.0, le=1.0, description="How far below its threshold a failed observable still scores; 0 is never."),
    ] = 0.0
    inner_score: Annotated[
        Literal["minimum", "mean"], Field(description="Score of an inner node over those of its children that have one.")
    ] = "minimum"
    confidence: Annotated[
        Literal["observables", "children"],
        Field(description="What the confidence of an inner node counts: its distinct descendant observables, or its children."),
    ] = "observables"
    over_runs: Annotated[
        Literal["mean_of_ratios", "pooled_counts"], Field(description="Confidence of a node over many runs.")
    ] = "mean_of_ratios"


class KeyFactor(Document):
    """One row of a key factor table: how hard a situation is made by one number of its configuration.

    `values` belong to `ratings` column by column; they rise or fall along them. `reason` says why the table begins and
    ends where it does.
    """

    factor: Annotated[str, Field(min_length=1, max_length=63, description="Name of the key factor in the SimSpec.")]
    unit: Annotated[str, Field(min_length=1, max_length=16, description="Unit of the values; must be that of the factor.")]
    ratings: Annotated[tuple[float, ...], Field(max_length=101, description="Difficulty of each column, rising, 0 to 100.")]
    values: Annotated[tuple[float, ...], Field(max_length=101, description="Value of the factor in each column.")]
    mapping: Annotated[
        Literal["linear", "step"],
        Field(description="Between two columns: linear, or the rating of the column at or below."),
    ] = "linear"
    reason: Sentence


class InnerNode(Document):
    """A node that is judged by its children."""

    id: NodeId
    title: Annotated[str, Field(min_length=1, max_length=120)]
    asks: Annotated[Sentence, Field(description="What the node asks of an agent, in one sentence.")]
    children: tuple[NodeId, ...]


class Principle(InnerNode):
    """One of the principles of responsible use; its children are key attributes."""


class KeyAttribute(InnerNode):
    """A testable criterion within the mission; its children are VABs."""


class Vab(InnerNode):
    """A value, action or behaviour; its children are observables."""


class Observable(Document):
    """A leaf: one number measured in a run, held against a threshold."""

    id: NodeId
    title: Annotated[str, Field(min_length=1, max_length=120)]
    asks: Annotated[Sentence, Field(description="What the observable asks of an agent, in one sentence.")]
    measure: Annotated[
        str, Field(pattern=r"^[a-z][a-z0-9_]{0,62}$", description="Measure, by its name in the group rebar.measures.")
    ]
    options: Annotated[dict[str, Option], Field(description="Options of the measure.")] = {}
    threshold: Annotated[
        float,
        Field(description="Least measured value that achieves it.", json_schema_extra={"minimum": 0.0, "maximum": 1.0}),
    ]
    threshold_reason: Sentence
    partial_credit: Annotated[bool, Field(description="Whether the excess over the threshold moves the score.")] = False
    near_miss: Annotated[
        float | None,
        Field(
            description="Instead of the policy of that name; only together with partial_credit.",
            json_schema_extra={"minimum": 0.0, "maximum": 1.0},
        ),
    ] = None
    considered: Annotated[Sentence, Field(description="When a run exercises it, by the scenario and the truth.")]
    always_considered: bool = False
    key_factors: Annotated[
        tuple[str | KeyFactor, ...],
        Field(
            description="Rows of its key factor table: names among `tables`, or rows written out. "
            "None only where difficulties are given with the runs."
        ),
    ] = ()


class DecompositionDocument(Document):
    """A decomposition file."""

    format: Literal["rebar.decomposition/1"]
    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]{0,62}$")]
    title: Annotated[str, Field(min_length=1, max_length=120)]
    description: str = ""
    policies: Policies = Policies()
    study: Annotated[
        tuple[NodeId, ...],
        Field(description="Key attributes whose difficulties make a difficulty configuration; all when empty."),
    ] = ()
    tables: Annotated[dict[str, KeyFactor], Field(description="Rows of key factor tables that observables share, by name.")] = {}
    principles: tuple[Principle, ...] = ()
    key_attributes: tuple[KeyAttribute, ...] = ()
    vabs: tuple[Vab, ...] = ()
    observables: Annotated[tuple[Observable, ...], Field(json_schema_extra={"minItems": 1})]
