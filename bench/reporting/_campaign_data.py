"""What the report knows about a campaign, before it becomes sentences, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import polars as pl

from bench.contracts import AnyFact, Fact, Outcome, fact_of
from bench.scoring import NodeFloor, tension_of, worst_first
from bench.simspec import SimSpec
from decompositions import Decomposition

# As `bench.scoring` writes it into the column `configuration` of a summary.
ALL_CONFIGURATIONS = "all"

# In per cent, as text: they are parts of column names of a summary (competence_50_low).
PASS_RATES = ("50", "90")

# From general to specific, in the spelling of scores.parquet.
LEVEL_ORDER = ("principle", "ka", "vab", "observable")


@dataclass(frozen=True, slots=True)
class Run:
    """One realization: what it was, how it ended, and where its recording is (None when there is none).

    `after_stop` says that it was flown although earlier replicates had decided the question: it counts in no
    number. `facts` are those of its result, by key. `probes` counts what was refused, and `losses` what was lost on the
    links, by kind. `root_seed` is that of the SimSpec; None where there is none.
    """

    realization: str
    design_point: str
    replicate: int
    agent: str
    configuration: str | None
    outcome: Outcome | None
    reason: str = ""
    simulated_s: float = 0.0
    cpu_s: float = 0.0
    recording: Path | None = None
    recording_sha256: str | None = None
    after_stop: bool = False
    facts: Mapping[str, Fact] = field(default_factory=dict)
    probes: Mapping[str, int] = field(default_factory=dict)
    losses: Mapping[str, int] = field(default_factory=dict)
    root_seed: int | None = None

    def fact(self, kind: type[AnyFact]) -> AnyFact | None:
        """The fact of this kind; None where the result has none."""
        return fact_of(self.facts, kind)

    @property
    def counts(self) -> bool:
        """Whether it enters numbers: it ended by something that the agent answers for, and before the stop."""
        return self.outcome is not None and self.outcome.counts and not self.after_stop

    @property
    def scene(self) -> tuple[str, int]:
        """Runs of different agents with the same scene can be compared one to one."""
        return (self.design_point, self.replicate)


@dataclass(frozen=True, slots=True)
class Node:
    """One node of the decomposition, as far as it is known; without the document only its id is."""

    id: str
    level: str
    title: str
    asks: str = ""
    children: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ReportedCompetence:
    """Competence at one pass rate: the value, its 95 % lower bound, and whether nothing shows where it ends."""

    value: float
    low: float
    at_least: bool


@dataclass(frozen=True, slots=True)
class Passes:
    """How many runs passed, of how many, and the 95 % interval of the share that pass."""

    passed: int
    runs: int
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Tally:
    """One node of one agent over one configuration (or all): the means and the counts beside them.

    `passed_low` and `passed_high` are the 95 % interval of the share of considered runs that pass. The verdict is that of a
    principle, by its essential key attributes alone (docs/rulings.md 27); None at other levels.
    `raised` flags a score above `passed_score`, what it would be had every failed observable passed at its
    threshold. `competence` is by pass rate in per cent ("50", "90"); empty in a single configuration, and
    where the runs do not show that failures rise with difficulty (docs/rulings.md 17).
    """

    agent: str
    configuration: str
    node: str
    level: str
    runs: int
    considered: int
    passed: int
    passed_low: float
    passed_high: float
    verdict_passed: int | None
    verdict_considered: int | None
    verdict_low: float | None
    verdict_high: float | None
    scored: int
    score: float | None
    passed_score: float | None
    raised: bool
    confidence: float | None
    confidence_low: float | None
    confidence_high: float | None
    difficulty_low: float | None
    difficulty_high: float | None
    method: str = ""
    design_points: int = 0
    score_low: float | None = None
    score_high: float | None = None
    competence: Mapping[str, ReportedCompetence] = field(default_factory=dict)

    @property
    def passes(self) -> Passes:
        """The verdict of a principle; for any other node the considered runs, of which those pass that achieved everything."""
        if self.level != "principle":
            return Passes(self.passed, self.considered, self.passed_low, self.passed_high)
        # Every principle of a summary has these four.
        assert self.verdict_passed is not None
        assert self.verdict_considered is not None
        assert self.verdict_low is not None
        assert self.verdict_high is not None
        return Passes(self.verdict_passed, self.verdict_considered, self.verdict_low, self.verdict_high)


Tallies = dict[tuple[str, str, str], Tally]
"""By agent, configuration and node."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """A difficulty configuration: its label here, its key, and the studied nodes' difficulties."""

    label: str
    key: str
    difficulty: Mapping[str, float]
    runs: Mapping[str, int]
    factors: Mapping[str, tuple[float, ...]]

    @property
    def n(self) -> int:
        """Runs of all agents in this configuration."""
        return sum(self.runs.values())

    @property
    def tension(self) -> int | None:
        """1 to 5, from the lowest of the studied difficulties; None where no studied node has one."""
        return tension_of(min(self.difficulty.values())) if self.difficulty else None


@dataclass(frozen=True, slots=True)
class ReportData:
    """Everything that the report shows, before it becomes sentences, tables and figures.

    `scores` has the columns SCORE_COLUMNS of bench.scoring, its texts as categories.
    """

    name: str
    description: str
    study: tuple[str, ...]
    agents: tuple[str, ...]
    runs: tuple[Run, ...]
    nodes: Mapping[str, Node]
    roots: tuple[str, ...]
    scores: pl.DataFrame
    tallies: Mapping[tuple[str, str, str], Tally]
    configurations: tuple[Configuration, ...]
    simspecs: Mapping[str, SimSpec]
    campaign: Mapping[str, Any]
    decomposition: str
    decomposition_sha256: str | None
    manifest: Mapping[str, Any]
    notes: tuple[str, ...] = field(default=())
    document: Decomposition | None = None
    floors: Mapping[str, NodeFloor] = field(default_factory=dict)
    floor_sessions: int = 0

    @property
    def undiscriminating(self) -> list[NodeFloor]:
        """Observables that do not discriminate (docs/rulings.md, 24), the worst first."""
        return [node for node in worst_first(self.floors) if node.flaw]

    def tally(self, agent: str, node: str, configuration: str = ALL_CONFIGURATIONS) -> Tally | None:
        """Means and counts, or None when the node has no row at all there."""
        return self.tallies.get((agent, configuration, node))

    def title(self, node: str) -> str:
        """The node's title, or its id when the decomposition is not at hand."""
        return self.nodes[node].title if node in self.nodes else node


def tallies_of(summary: pl.DataFrame) -> Tallies:
    """Rows of a summary frame (columns SUMMARY_COLUMNS of bench.scoring) by agent, configuration and node."""
    return {
        (row["agent"], row["configuration"], row["node"]): _tally(row)
        for row in summary.iter_rows(named=True)
    }


# Where a column of a summary has another name.
_COLUMNS = {
    "score": "score_mean",
    "passed_score": "passed_score_mean",
    "raised": "raised_by_failure",
    "confidence": "confidence_mean",
}


def _tally(row: Mapping[str, Any]) -> Tally:
    names = [field.name for field in fields(Tally) if field.name != "competence"]
    competence = {
        rate: ReportedCompetence(value, row[f"competence_{rate}_low"], row[f"competence_{rate}_at_least"])
        for rate in PASS_RATES
        if row["failures_rise"] and (value := row[f"competence_{rate}"]) is not None
    }
    return Tally(**{name: row[_COLUMNS.get(name, name)] for name in names}, competence=competence)


def stopped_early(scores: pl.DataFrame) -> bool:
    """Whether design points of this campaign stop once their question is decided."""
    return bool(scores["until_settled"].any())
