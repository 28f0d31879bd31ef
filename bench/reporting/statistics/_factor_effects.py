"""Which factors of a campaign's design matter to confidence, passes and score."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import polars as pl

from bench.realization import INACTIVE
from bench.statistics import (
    FactorIndependence,
    FactorLevel,
    NodeFactorAnalysis,
    OddsRatio,
    factor_frame,
    node_factors,
)

from .._campaign_data import ReportData
from ._design_quality import campaign_design_points

# The conventional level. For effects it is compared with adjusted p values.
SIGNIFICANCE_LEVEL = 0.05
# A smaller share is printed as 0.0 %: no reader would believe that it matters.
LEAST_SHARE = 0.0005
# With fewer failures a factor that seems to matter is chance: ten events are the rule for a single term of a logistic regression
# (Peduzzi et al. 1996, Journal of Clinical Epidemiology 49(12), 1373-1379).
MIN_FAILURES = 10


@dataclass(frozen=True, slots=True)
class FactorRow:
    """One factor (or interaction) at one node of one agent, as a reader sees it.

    Shares are omega squared, p values adjusted.
    """

    factor: str
    confidence_share: float | None
    confidence_p: float | None
    score_share: float | None
    score_p: float | None
    odds: tuple[OddsRatio, ...]
    passes_p: float | None
    note: str

    @property
    def significant_tests(self) -> tuple[str, ...]:
        """The tests that are significant: confidence, passes, score."""
        tests = (
            ("confidence", self.confidence_p, self.confidence_share),
            ("passes", self.passes_p, None),
            ("score", self.score_p, self.score_share),
        )
        return tuple(
            name
            for name, p, share in tests
            if p is not None and p < SIGNIFICANCE_LEVEL and (share is None or share >= LEAST_SHARE)
        )


@dataclass(frozen=True, slots=True)
class FactorTable:
    """One node of one agent: its factors, and notes on the analysis."""

    agent: str
    node: str
    runs: int
    rows: tuple[FactorRow, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FactorEffects:
    """The whole section.

    `note` is the reason why there is none, else empty; `frame` holds every test (FACTOR_COLUMNS). `too_few` names nodes and
    agents with too few failures to ask.
    """

    tables: tuple[FactorTable, ...]
    independence: FactorIndependence | None
    frame: pl.DataFrame
    note: str = ""
    too_few: tuple[str, ...] = ()

    @property
    def significant_effects(self) -> list[tuple[FactorTable, FactorRow]]:
        """The significant effects on confidence or passes, over all nodes and agents."""
        rows = ((table, row) for table in self.tables for row in table.rows)
        return [(table, row) for table, row in rows if {"confidence", "passes"} & set(row.significant_tests)]

    @property
    def score_only_effects(self) -> list[tuple[str, list[str]]]:
        """Factors with a significant effect on scores alone, each with the nodes and agents.

        Such a factor may change only the difficulty, which a score contains.
        """
        places: dict[str, list[str]] = {}
        for table in self.tables:
            for row in table.rows:
                if row.significant_tests == ("score",):
                    places.setdefault(row.factor, []).append(f"{table.node} of {table.agent}")
        return list(places.items())


def factor_effects(data: ReportData) -> FactorEffects:
    """Every node under study, each agent for itself, over the factors of the campaign's design."""
    levels, note = _levels(data)
    tallies = [
        tally
        for node in data.study
        for agent in data.agents
        if (tally := data.tally(agent, node)) is not None and tally.considered
    ]
    few = [tally for tally in tallies if tally.considered - tally.passed < MIN_FAILURES]
    analyses = [
        analysis
        for tally in tallies
        if tally not in few
        and (analysis := node_factors(data.scores, levels, tally.agent, tally.node)) is not None
    ]
    if levels and not tallies:
        note = "No run was considered, so there is no analysis."
    elif levels and not analyses:
        note = f"Fewer than {MIN_FAILURES} runs of each agent failed each node, too few to ask which factor matters."
    # All tests of the section at once: their p values are adjusted together, and the tables below read them
    # from here.
    frame = factor_frame(analyses)
    return FactorEffects(
        tables=tuple(_table(analysis, frame) for analysis in analyses),
        independence=analyses[0].confidence.independence if analyses else None,
        frame=frame,
        note=note,
        too_few=tuple(
            f"{tally.node} of {tally.agent} ({tally.considered - tally.passed} failed)" for tally in few
        ),
    )


def _levels(data: ReportData) -> tuple[dict[str, Mapping[str, FactorLevel | None]], str]:
    stated = data.campaign.get("design")
    if not isinstance(stated, Mapping) or not stated.get("factors"):
        return {}, "The campaign's design varies no factor."
    points = campaign_design_points(data)
    if points is None:
        return {}, "The campaign's design cannot be read, so scores cannot be held against its factors."
    # Only a factor with a condition can be inactive; another one may have a level of that name.
    switched = {factor["name"] for factor in stated["factors"] if factor.get("when")}
    return {point.id: _active(point.levels, switched) for point in points}, ""


def _active(levels: Mapping[str, FactorLevel], switched: set[str]) -> dict[str, FactorLevel | None]:
    """Levels with None for conditional factors that are inactive; of any other factor that word is a level."""
    return {name: None if name in switched and level == INACTIVE else level for name, level in levels.items()}


def _table(analysis: NodeFactorAnalysis, frame: pl.DataFrame) -> FactorTable:
    tests = frame.filter(pl.col("agent") == analysis.agent, pl.col("node") == analysis.node)
    adjusted = {
        (row["of"], row["test"], row["factor"]): row["p_adjusted"] for row in tests.iter_rows(named=True)
    }
    confidence = {effect.term: effect for effect in analysis.confidence.effects}
    score = {effect.term: effect for effect in analysis.score.effects}
    terms = dict.fromkeys([*confidence, *score, *(test.factor for test in analysis.passes.tests)])
    rows = [
        FactorRow(
            factor=term,
            confidence_share=confidence[term].omega2 if term in confidence else None,
            confidence_p=adjusted.get(("confidence", "anova", term)),
            score_share=score[term].omega2 if term in score else None,
            score_p=adjusted.get(("score", "anova", term)),
            odds=tuple(odds for odds in analysis.passes.odds if odds.factor == term),
            passes_p=adjusted.get(("passes", "logistic", term)),
            note=next((effects[term].note for effects in (confidence, score) if term in effects), ""),
        )
        for term in terms
    ]
    # Interactions are many and mostly nothing: only those that were found are shown, the frame holds the
    # rest.
    shown = tuple(row for row in rows if " x " not in row.factor or row.significant_tests)
    return FactorTable(analysis.agent, analysis.node, analysis.confidence.n, shown, tuple(_notes(analysis)))


def _notes(analysis: NodeFactorAnalysis) -> Iterable[str]:
    for name, variance in (("Confidence", analysis.confidence), ("Scores", analysis.score)):
        if variance.note:
            yield f"{name}: {variance.note}."
        violations = [
            text
            for p, text in (
                (variance.normal_p, "not normal"),
                (variance.equal_spread_p, "not equally spread"),
            )
            if p is not None and p < SIGNIFICANCE_LEVEL
        ]
        if violations:
            yield f"{name}: residuals are {' and '.join(violations)}, so p is rough."
    if analysis.passes.note:
        yield f"Passes: {analysis.passes.note}."
    # Confidence and score often leave out the same term for the same reason; the note names it once.
    exclusions = dict.fromkeys(
        f"{exclusion.term} ({exclusion.reason})"
        for exclusion in (*analysis.confidence.left_out, *analysis.score.left_out)
    )
    if exclusions:
        yield f"Left out: {', '.join(exclusions)}."
