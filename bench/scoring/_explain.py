"""Why a node has its score: from the mean down to the runs, their ruling observables and the recorded evidence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Literal

import polars as pl
from pydantic import Field

from bench.contracts import Evidence, Observation, Outcome
from bench.documents import Document
from decompositions import Decomposition, Level, Observable

from ._difficulty import Difficulty, ObservableDifficulty, Standing, absence_of
from ._report import NodeReport
from ._scores import NodeScore, score_run
from ._table import ScoredRun

State = Literal["failed", "near miss", "achieved", "not considered", "not exercisable"]
RunState = Literal["failed", "passed", "not considered", "excluded"]
_STATE_ORDER: tuple[State, ...] = (
    "failed",
    "near miss",
    "achieved",
    "not considered",
    "not exercisable",
)


@dataclass(frozen=True, slots=True)
class Sources:
    """Where a reviewer finds each run: recording and reason by realization; table rows by (run, observable)."""

    recordings: Mapping[str, str] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    rows: Mapping[tuple[str, str], str] = field(default_factory=dict)


class FactorExplanation(Document):
    """One key factor of an observable in the situation of a run; `ruling` is true where its rating is the difficulty."""

    factor: str
    value: float
    unit: str
    rating: float
    ruling: bool


class ObservableExplanation(Document):
    """One observable in one run, with the evidence for its outcome."""

    id: str
    title: str
    state: State
    essential: bool = Field(description="The verdict of the principle rests on it.")
    ruling: bool = Field(description="It gives the node its score in this run.")
    x: float | None
    threshold: float
    difficulty: float | None = Field(description="Null where it is not known.")
    factors: tuple[FactorExplanation, ...] = Field(description="Its key factors, the ruling ones first.")
    credit: float = Field(description="Points of partial credit within the score; negative on a near miss.")
    score: float | None
    reason: str = Field(
        description="For an observable that was not considered: when a run considers it, or what is absent."
    )
    standing: Standing = Field(
        description="What it counts for in this configuration; the configured sensor enters no node."
    )
    overruled: bool = Field(
        description="Its measure considered it although the configuration cannot exercise it."
    )
    evidence: tuple[Evidence, ...]
    evidence_left_out: int
    stages: str = Field(
        description="Of one that was not achieved: how far the agent came with whom it is about; empty where it is about nobody."
    )
    row: str | None = Field(description="Place in the table that the observation came from.")


class RunExplanation(Document):
    """One run: the node's score in it, the path down to the observable that ruled it, and the observables."""

    run: str
    agent: str
    design_point: str
    state: RunState = Field(
        description="failed: some considered observable was not achieved; excluded: the bench spoilt the run."
    )
    verdict: bool | None = Field(
        description="Whether the run passed the principle; null where nothing essential was considered, and for other nodes."
    )
    outcome: Outcome
    reason: str
    recording: str | None
    difficulty: float | None
    score: float | None
    achieved: int
    considered: int
    ruled_by: tuple[str, ...] = Field(
        description="From the node down along the child with the lowest score; empty without a score."
    )
    observables: tuple[ObservableExplanation, ...]
    observables_left_out: int


class AgentExplanation(Document):
    """The node's numbers for one agent and the runs behind them, failures first."""

    summary: NodeReport
    scored_runs: tuple[str, ...] = Field(
        description="The runs that the score is the mean of, at most `limit` of them."
    )
    runs: tuple[RunExplanation, ...]
    runs_left_out: dict[str, int] = Field(description="Runs beyond the limit, by state.")


class Explanation(Document):
    """The document that `rebar score --explain NODE --json` prints."""

    format: Literal["rebar.score-explanation/1"] = "rebar.score-explanation/1"
    source: str
    decomposition: str
    id: str
    level: Level
    title: str
    asks: str
    essential: tuple[str, ...] = Field(description="Key attributes that the verdict of a principle rests on.")
    essential_reason: str = Field(description="Why these, where the decomposition says so.")
    limit: int = Field(
        description="Maximum of runs for each agent, observables for each run and evidence for each observable; 0 is all."
    )
    agents: tuple[AgentExplanation, ...]


def explain(
    decomposition: Decomposition,
    node: str,
    runs: Sequence[ScoredRun],
    scores: pl.DataFrame,
    summaries: Sequence[NodeReport],
    sources: Sources,
    source: str = "",
    limit: int = 0,
) -> Explanation:
    """Walk from a node's numbers to the evidence behind them.

    `scores` is the score table of the runs; `summaries` are the node's rows over all configurations, one for
    each agent. Raises KeyError for an unknown node.
    """
    subject = decomposition.nodes[node]
    is_principle = subject.level is Level.PRINCIPLE
    essential = decomposition.essential_observables(node) if is_principle else ()
    explainer = _Explainer(
        decomposition,
        node,
        sources,
        limit,
        _scored(scores, node),
        frozenset(essential),
        _verdicts(scores, node),
    )
    return Explanation(
        source=source,
        decomposition=decomposition.name,
        id=node,
        level=subject.level,
        title=subject.title,
        asks=subject.asks,
        essential=decomposition.essential(node) if is_principle else (),
        essential_reason=decomposition.essential_reason(node) if is_principle else "",
        limit=limit,
        agents=tuple(
            explainer.agent(summary, [run for run in runs if run.agent == summary.agent])
            for summary in summaries
        ),
    )


@dataclass(frozen=True, slots=True)
class _Explainer:
    """Builds one explanation, part by part, from what all parts share."""

    decomposition: Decomposition
    node: str
    sources: Sources
    limit: int
    scored: Mapping[str, NodeScore]
    essential: frozenset[str]
    verdicts: Mapping[str, bool | None]

    def agent(self, summary: NodeReport, runs: Sequence[ScoredRun]) -> AgentExplanation:
        ordered = sorted(runs, key=self._rank)
        scored = [run.realization for run in runs if self.scored[run.realization].score is not None]
        limit = self.limit or len(ordered)
        return AgentExplanation(
            summary=summary,
            scored_runs=tuple(scored[:limit]),
            runs=tuple(self._run(run) for run in ordered[:limit]),
            runs_left_out=dict(Counter(self._state(run) for run in ordered[limit:])),
        )

    def _rank(self, run: ScoredRun) -> tuple[bool, int, float, float]:
        """Sorting key: failures of the verdict, then others, lowest confidence and score first; then passes upwards."""
        score = self.scored[run.realization]
        order = ("failed", "passed", "not considered", "excluded").index(self._state(run))
        return (
            self.verdicts.get(run.realization) is not False,
            order,
            score.confidence or 0.0,
            -1.0 if score.score is None else score.score,
        )

    def _state(self, run: ScoredRun) -> RunState:
        score = self.scored[run.realization]
        if not run.outcome.counts:
            return "excluded"
        if not score.considered:
            return "not considered"
        return "passed" if score.achieved == score.considered else "failed"

    def _run(self, run: ScoredRun) -> RunExplanation:
        # Whatever was observed in an excluded run counts nowhere.
        counted = run.observations if run.outcome.counts else ()
        # `self.scored` has this node only; the path down needs every node of the run.
        scores = score_run(self.decomposition, run.difficulty, counted)
        node_score, path = scores[self.node], self._ruling_path(scores, run.difficulty)
        observed = {observation.observable: observation for observation in counted}
        leaves = [
            self._observable(run, leaf, observed.get(leaf), scores[leaf], ruling=leaf in path)
            for leaf in self.decomposition.observables_under(self.node)
        ]
        leaves.sort(key=lambda leaf: (_STATE_ORDER.index(leaf.state), not leaf.essential, not leaf.ruling))
        limit = self.limit or len(leaves)
        # The ruling observable is what a reviewer looks for, so it is shown beyond the limit too.
        shown = leaves[:limit] + [leaf for leaf in leaves[limit:] if leaf.ruling]
        return RunExplanation(
            run=run.realization,
            agent=run.agent,
            design_point=run.design_point,
            state=self._state(run),
            verdict=self.verdicts.get(run.realization),
            outcome=run.outcome,
            reason=self.sources.reasons.get(run.realization, ""),
            recording=self.sources.recordings.get(run.realization),
            difficulty=run.difficulty.of(self.node),
            score=node_score.score,
            achieved=node_score.achieved,
            considered=node_score.considered,
            ruled_by=path,
            observables=tuple(shown) if run.outcome.counts else (),
            observables_left_out=len(leaves) - len(shown),
        )

    def _ruling_path(self, scores: Mapping[str, NodeScore], difficulty: Difficulty) -> tuple[str, ...]:
        """Ids from the node down to the first observable that gives the minimum; empty where no child rules."""
        node = self.node
        # A mean has no ruling child: every child moves it.
        if scores[node].score is None or self.decomposition.policies.inner_score != "minimum":
            return ()
        path = [node]
        uncounted = {
            leaf for leaf, rated in difficulty.observables.items() if rated.standing is not Standing.COUNTED
        }
        while children := self.decomposition.children(node):
            # A configured sensor may have the same score by chance, but rules nothing.
            node = next(
                child
                for child in children
                if scores[child].score == scores[node].score and child not in uncounted
            )
            path.append(node)
        return tuple(path)

    def _observable(
        self, run: ScoredRun, leaf: str, observation: Observation | None, score: NodeScore, *, ruling: bool
    ) -> ObservableExplanation:
        observable, difficulty = self.decomposition.observables[leaf], run.difficulty.observables[leaf]
        exercisable = difficulty.standing is not Standing.NOT_EXERCISABLE
        state: State = _state(score) if exercisable else "not exercisable"
        evidence = observation.evidence if observation else ()
        limit = self.limit or len(evidence)
        return ObservableExplanation(
            id=leaf,
            title=observable.title,
            state=state,
            essential=leaf in self.essential,
            ruling=ruling,
            x=observation.x if observation and observation.considered and exercisable else None,
            threshold=observable.threshold,
            difficulty=difficulty.difficulty,
            factors=_factors(difficulty),
            credit=0.0
            if score.score is None or difficulty.difficulty is None
            else score.score - difficulty.difficulty,
            score=score.score,
            reason="" if score.considered else _consideration(observable, observation, difficulty),
            standing=difficulty.standing,
            overruled=not exercisable and observation is not None and observation.considered,
            evidence=evidence[:limit],
            evidence_left_out=len(evidence[limit:]),
            stages=observation.stages if observation and state in ("failed", "near miss") else "",
            row=self.sources.rows.get((run.realization, leaf)),
        )


def _scored(scores: pl.DataFrame, node: str) -> dict[str, NodeScore]:
    """The node's score in every run of the score table."""
    # Tables read from Parquet may hold categoricals, which do not compare with a text.
    rows = scores.filter(pl.col("node").cast(pl.String) == node).select(
        "realization", "score", "confidence", "achieved", "considered"
    )
    return {
        str(name): NodeScore(node, score, confidence, achieved, considered)
        for name, score, confidence, achieved, considered in rows.iter_rows()
    }


def _verdicts(scores: pl.DataFrame, node: str) -> dict[str, bool | None]:
    """The principle's verdict in every run of the score table."""
    rows = scores.filter(pl.col("node").cast(pl.String) == node).select("realization", "verdict")
    return {str(name): verdict for name, verdict in rows.iter_rows()}


def _state(score: NodeScore) -> State:
    if not score.considered:
        return "not considered"
    if score.achieved:
        return "achieved"
    return "failed" if score.score is None else "near miss"


def _consideration(
    observable: Observable, observation: Observation | None, difficulty: ObservableDifficulty
) -> str:
    if difficulty.standing is Standing.NOT_EXERCISABLE:
        overruled = ", which overrules its measure" if observation and observation.considered else ""
        return f"this situation holds nothing that exercises it{overruled}: {absence_of(difficulty)}"
    if observation and observation.failure:
        return f"its measure failed: {observation.failure}"
    return (
        f"considered when: {observable.considered}"
        if observation
        else f"there is no observation of it; considered when: {observable.considered}"
    )


def _factors(rated: ObservableDifficulty) -> tuple[FactorExplanation, ...]:
    return tuple(
        FactorExplanation(**asdict(row), ruling=row.factor in rated.ruled_by) for row in rated.ratings
    )
