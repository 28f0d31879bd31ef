"""The document of a decomposition: what an agent is tested on, from five principles down to measured
observables.

The format is `rebar.decomposition/1`, written in YAML. Every node lists its children by id, so that a node
may have many parents. `_checks` finds what pydantic cannot see in one field (cycles, orphans, tables without
a direction), and reports all faults of a document at once.
"""

from __future__ import annotations

import unicodedata
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from bench.documents import Document


def _checked_id(text: str) -> str:
    if text != text.strip():
        raise ValueError("an id has no blanks at its ends; remove them")
    # Line breaks and other control characters, and those that reverse or join text, would make two ids look
    # alike in a table, or break its lines.
    if any(unicodedata.category(character) in _REFUSED_CATEGORIES for character in text):
        raise ValueError("an id is one line of text without control characters; remove them")
    return text


_REFUSED_CATEGORIES = ("Cc", "Cf", "Cs", "Zl", "Zp")
# Ruling 19: ids are text, also those of other people's assessments ("3.2 (a)").
NodeId = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(_checked_id)]
Sentence = Annotated[str, Field(min_length=1, max_length=2000)]
Option = bool | int | float | str


def _stated_unit(unit: object) -> object:
    if unit in (None, "", 1):
        raise ValueError('a factor without a dimension has the unit "1"; write it so, in quotes')
    return unit


class Level(StrEnum):
    """The four levels of a decomposition, from the most general down."""

    PRINCIPLE = "principle"
    KEY_ATTRIBUTE = "ka"
    VAB = "vab"
    OBSERVABLE = "observable"


# A digest of the document identifies scores, so the order of fields in these classes must not change.
class Policies(Document):
    """The rules of scoring by name, each with the published rule as its default; docs/rulings.md has the
    reasons.
    """

    shared_value: Literal["lower", "higher"] = Field(
        "lower", description="Rating of a value that stands in two columns of a table."
    )
    easier_than_table: Literal["zero", "first"] = Field(
        "zero", description="Rating of a value easier than the first column: 0, or the first rating."
    )
    factor_rule: Literal["minimum", "mean"] = Field(
        "minimum",
        description="How the difficulty of an observable follows from the ratings of its key factors.",
    )
    credit_points: float = Field(
        4.0, ge=0.0, le=100.0, description="Points for each unit of x above the threshold."
    )
    near_miss: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="How far below its threshold a failed observable still scores; 0 means never.",
    )
    inner_score: Literal["minimum", "mean"] = Field(
        "minimum", description="Score of an inner node over those of its children that have one."
    )
    confidence: Literal["observables", "children"] = Field(
        "observables",
        description="What the confidence of an inner node counts: its distinct descendant observables, or its children.",
    )
    over_runs: Literal["mean_of_ratios", "pooled_counts"] = Field(
        "mean_of_ratios", description="Confidence of a node over many runs."
    )


class KeyFactor(Document):
    """One row of a key factor table: how hard one number of the configuration makes a situation.

    `values` belong to `ratings` column by column, and rise or fall along them. `reason` explains where the
    table begins and ends.

    With `absent` a situation may hold nothing of the kind: the observable is then not exercisable there, and
    has no difficulty (docs/rulings.md 14).
    """

    factor: str = Field(min_length=1, max_length=63, description="Name of the key factor in the SimSpec.")
    unit: Annotated[
        str,
        BeforeValidator(_stated_unit),
        Field(
            min_length=1,
            max_length=16,
            description='Unit of the values; must be the unit of the factor, "1" for one without a dimension.',
        ),
    ]
    ratings: tuple[float, ...] = Field(
        max_length=101, description="Difficulty of each column, rising, 0 to 100."
    )
    values: tuple[float, ...] = Field(max_length=101, description="Value of the factor in each column.")
    mapping: Literal["linear", "step"] = Field(
        "linear", description="Between two columns: linear, or the rating of the column at or below."
    )
    reason: Sentence
    absent: float | None = Field(
        None,
        description="Value of the factor in a situation that holds nothing of the kind: there the observable is not exercisable. A value still easier counts as absent too, and so does a factor without any value where `absent` is stated.",
    )

    def is_absent(self, value: float | None) -> bool:
        """Whether a value of the factor means that the situation holds nothing of the kind."""
        if self.absent is None:
            return False
        if value is None:
            return True
        rises = self.values[-1] > self.values[0]
        return value <= self.absent if rises else value >= self.absent


class _TitledNode(Document):
    id: NodeId
    title: str = Field(min_length=1, max_length=120)
    asks: Sentence = Field(description="The demand on the agent, in one sentence.")


class InnerNode(_TitledNode):
    """A node that is judged by its children."""

    children: tuple[NodeId, ...]


class Principle(InnerNode):
    """One of the principles of responsible use; its children are key attributes.

    A run passes it when every considered observable under its essential key attributes is achieved (docs/rulings.md 27).
    """

    essential: tuple[NodeId, ...] = Field(
        (), description="Key attributes among its children that its verdict rests on; empty means all."
    )
    essential_reason: Sentence | None = Field(
        None, description="Why these key attributes; needed where some are named."
    )


class KeyAttribute(InnerNode):
    """A testable criterion within the mission; its children are VABs."""


class Vab(InnerNode):
    """A value, action or behaviour; its children are observables."""


class Observable(_TitledNode):
    """A leaf: one number measured in a run and compared with a threshold."""

    measure: str | None = Field(
        None,
        pattern=r"^[a-z][a-z0-9_]{0,62}$",
        description="Measure, by its name in the group rebar.measures. "
        "Left out only where measured values are given with the runs.",
    )
    options: dict[str, Option] = Field({}, description="Options of the measure.")
    # `_checks` tests the limits of the next numbers, so that its message can name the node; the schema has
    # them for editors.
    threshold: float = Field(
        description="Least measured value that achieves the observable.",
        json_schema_extra={"minimum": 0.0, "maximum": 1.0},
    )
    threshold_reason: Sentence | None = Field(
        None, description="Why this threshold. Left out only where measured values are given with the runs."
    )
    partial_credit: bool = Field(
        False, description="Whether the excess over the threshold changes the score."
    )
    near_miss: float | None = Field(
        None,
        description="Overrides the policy of the same name; only with partial_credit.",
        json_schema_extra={"minimum": 0.0, "maximum": 1.0},
    )
    considered: Sentence = Field(
        description="When a run exercises it, decided by the scenario and the truth."
    )
    always_considered: bool = False
    key_factors: tuple[str | KeyFactor, ...] = Field(
        (),
        description="Rows of its key factor table: names among `tables`, or complete rows. "
        "Empty only where difficulties are given with the runs.",
    )
    subject: Literal["agent", "perception"] = Field(
        "agent",
        description="Whose quality it measures. An observable about the detections that the bench simulates describes the configured sensor.",
    )


class DecompositionDocument(Document):
    """A decomposition file."""

    # Required, unlike other fields: a file must say which format it has, so that a later format can be told
    # apart.
    format: Literal["rebar.decomposition/1"]
    name: str = Field(pattern=r"^[a-z][a-z0-9-]{0,62}$")
    title: str = Field(min_length=1, max_length=120)
    description: str = ""
    policies: Policies = Policies()
    study: tuple[NodeId, ...] = Field(
        (), description="Key attributes whose difficulties make a difficulty configuration; empty means all."
    )
    tables: dict[str, KeyFactor] = Field(
        {}, description="Rows of key factor tables that observables share, by name."
    )
    principles: tuple[Principle, ...] = ()
    key_attributes: tuple[KeyAttribute, ...] = ()
    vabs: tuple[Vab, ...] = ()
    observables: tuple[Observable, ...] = Field(json_schema_extra={"minItems": 1})
