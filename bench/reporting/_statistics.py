"""Statistics of campaigns as the report and the command line show them: which factors matter, and two agents on the same scenes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import plotly.graph_objects as go
import polars as pl

from bench.errors import Fault, SetupError
from bench.realization import INACTIVE
from bench.scoring import NodeComparison, compare_nodes
from bench.simspec import SimSpec
from bench.statistics import FactorLevel, Independence, NodeFactors, OddsRatio, factor_frame, node_factors

from ._data import ReportData, load_report_data
from ._design import points_of

SHOWN_LEVELS = ("principle", "ka")
FOUND_BELOW = 0.05


@dataclass(frozen=True, slots=True)
class Side:
    """One agent of one campaign."""

    label: str
    folder: Path
    agent: str
    data: ReportData


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two sides over the scenes that both flew; `scenes` counts those, whether a node was considered in them or not."""

    first: str
    second: str
    scenes: int
    nodes: tuple[NodeComparison, ...]

    def verdicts(self) -> list[str]:
        """A sentence for each node."""
        return [one.verdict(self.first, self.second) for one in self.nodes]


def compare_campaigns(
    folders: Sequence[Path], agents: Sequence[str] = (), nodes: Sequence[str] = (), *, seed: int = 0
) -> Comparison:
    """Compare two agents of one campaign's folder, or one agent each of two folders.

    Without `agents`: the two of one folder, or each folder's only one (else the one that both have). Without `nodes`: every
    principle and key attribute. Raises SetupError with every reason for which they cannot be compared.
    """
    first, second = _sides(folders, agents)
    faults = [*_unlike(first, second), *_unknown(first.data, nodes)]
    if faults:
        raise SetupError(faults)
    mine, other = _met(first, second)
    scenes = mine["realization"].n_unique()
    if not scenes:
        raise SetupError(
            Fault(
                f"{first.label} and {second.label}",
                "flew no scene in common",
                "compare agents of one campaign, or run the same campaign (base, design, seed) with the other agent",
            )
        )
    asked = nodes or [one.id for one in first.data.nodes.values() if one.level in SHOWN_LEVELS]
    return Comparison(first.label, second.label, scenes, compare_nodes(mine, other, asked, seed=seed))


def compare_agents(data: ReportData, first: str, second: str) -> tuple[NodeComparison, ...]:
    """Two agents of one campaign at the nodes under study."""
    mine, other = (data.scores.filter(pl.col("agent") == agent) for agent in (first, second))
    return compare_nodes(mine, other, data.study)


def _sides(folders: Sequence[Path], agents: Sequence[str]) -> tuple[Side, Side]:
    if len(folders) not in (1, 2) or len(agents) not in (0, 2):
        raise SetupError(Fault("compare", "two sides are compared", "name one folder or two, and two agents or none"))
    data = [load_report_data(folder) for folder in folders]
    if faults := [
        Fault(str(folder), "holds no scores", f"`rebar score {folder}` makes them")
        for folder, one in zip(folders, data, strict=True)
        if not one.scores.height
    ]:
        raise SetupError(faults)
    places, there = [(folders[0], data[0]), (folders[-1], data[-1])], [_agents(data[0]), _agents(data[-1])]
    chosen = tuple(agents) or _chosen(folders, there)
    if faults := [
        Fault("--agents", f"{agent!r} is not in {place[0]}", f"agents there: {', '.join(known)}")
        for agent, place, known in zip(chosen, places, there, strict=True)
        if agent not in known
    ]:
        raise SetupError(faults)
    if chosen[0] == chosen[1] and len(folders) == 1:
        raise SetupError(Fault("--agents", "both sides are the same agent of the same campaign", "name two agents"))
    labels = _labels(chosen, folders)
    first, second = (Side(label, folder, agent, one) for label, (folder, one), agent in zip(labels, places, chosen, strict=True))
    return first, second


def _agents(data: ReportData) -> list[str]:
    flown = set(data.scores["agent"])
    return [one for one in data.agents if one in flown]


def _chosen(folders: Sequence[Path], there: Sequence[Sequence[str]]) -> tuple[str, ...]:
    if len(folders) == 1:
        if len(there[0]) == 2:
            return tuple(there[0])
    elif len(there[0]) == len(there[1]) == 1:
        return there[0][0], there[1][0]
    elif len(shared := [one for one in there[0] if one in there[1]]) == 1:
        return shared[0], shared[0]
    said = "; ".join(f"{folder} has {', '.join(known)}" for folder, known in zip(folders, there, strict=False))
    raise SetupError(Fault("--agents", f"it is not plain which two are meant: {said}", "name them: --agents FIRST SECOND"))


def _labels(agents: Sequence[str], folders: Sequence[Path]) -> tuple[str, str]:
    if agents[0] != agents[1]:
        return agents[0], agents[1]
    names = [folder.resolve().name for folder in folders]
    return (names[0], names[1]) if names[0] != names[1] else (str(folders[0]), str(folders[1]))


def _unlike(first: Side, second: Side) -> list[Fault]:
    digests = first.data.decomposition_sha256, second.data.decomposition_sha256
    if digests[0] is not None and digests[0] == digests[1]:
        return []
    return [
        Fault(
            f"{first.folder} and {second.folder}",
            "were scored over different decompositions, or one that cannot be read",
            "`rebar score FOLDER --decomposition NAME` scores both over one",
        )
    ]


def _unknown(data: ReportData, nodes: Iterable[str]) -> list[Fault]:
    return [
        Fault("--node", f"there is no node {node!r}", f"for example {', '.join(data.study)}")
        for node in nodes
        if node not in data.nodes
    ]


def _met(first: Side, second: Side) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Both sides' rows of the scenes that both flew, the second's named as the first's are."""
    mine, other = (side.data.scores.filter(pl.col("agent") == side.agent) for side in (first, second))
    here, there = _scenes(first, mine), _scenes(second, other)
    shared = {there[scene]: here[scene] for scene in here if scene in there}
    key = pl.col("realization")
    named = mine.unique("realization").filter(key.is_in(list(shared.values()))).select("realization", "design_point", "replicate")
    renamed = other.with_columns(key.cast(pl.String).replace_strict(shared, default=None, return_dtype=pl.String)).drop_nulls(
        "realization"
    )
    return (
        mine.filter(key.is_in(list(shared.values()))),
        renamed.drop("design_point", "replicate").join(named, on="realization", how="inner"),
    )


def _scenes(side: Side, rows: pl.DataFrame) -> dict[str, str]:
    """The realization that flew each scene, by a digest of everything that its SimSpec says but for name and agent."""
    flown = rows["realization"].unique(maintain_order=True)
    return {_scene(side.data.simspecs[one]): one for one in flown if one in side.data.simspecs}


def _scene(simspec: SimSpec) -> str:
    return hashlib.sha256(simspec.model_dump_json(exclude={"name", "agent"}).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class FactorRow:
    """One factor (or interaction) at one node of one agent, as a reader sees it. Shares are omega squared, p values adjusted."""

    factor: str
    confidence_share: float | None
    confidence_p: float | None
    score_share: float | None
    score_p: float | None
    odds: tuple[OddsRatio, ...]
    passes_p: float | None
    note: str

    @property
    def found(self) -> tuple[str, ...]:
        """Where its tests find something: confidence, passes, score."""
        tests = (("confidence", self.confidence_p), ("passes", self.passes_p), ("score", self.score_p))
        return tuple(name for name, p in tests if p is not None and p < FOUND_BELOW)


@dataclass(frozen=True, slots=True)
class FactorTable:
    """One node of one agent: its factors, and what must be said of the analysis."""

    agent: str
    node: str
    runs: int
    rows: tuple[FactorRow, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FactorsMatter:
    """The whole section. `note` says why there is none, and is empty otherwise; `frame` holds every test (FACTOR_COLUMNS)."""

    tables: tuple[FactorTable, ...]
    independence: Independence | None
    frame: pl.DataFrame
    note: str = ""

    @property
    def found(self) -> list[tuple[FactorTable, FactorRow]]:
        """What was found in confidence or passes, over all nodes and agents."""
        rows = ((table, row) for table in self.tables for row in table.rows)
        return [(table, row) for table, row in rows if {"confidence", "passes"} & set(row.found)]

    @property
    def found_in_scores(self) -> list[tuple[str, list[str]]]:
        """Factors that were found in scores alone, each with the nodes and agents; difficulty may be all that they move."""
        places: dict[str, list[str]] = {}
        for table in self.tables:
            for row in table.rows:
                if row.found == ("score",):
                    places.setdefault(row.factor, []).append(f"{table.node} of {table.agent}")
        return list(places.items())


def factors_that_matter(data: ReportData) -> FactorsMatter:
    """Every node under study, each agent for itself, over the factors of the campaign's design."""
    levels, note = _levels(data)
    analyses = [
        one for node in data.study for agent in data.agents if (one := node_factors(data.scores, levels, agent, node)) is not None
    ]
    if levels and not analyses:
        note = "No run was considered, so nothing can be said."
    frame = factor_frame(analyses)
    return FactorsMatter(
        tables=tuple(_table(one, frame) for one in analyses),
        independence=analyses[0].confidence.independence if analyses else None,
        frame=frame,
        note=note,
    )


def _levels(data: ReportData) -> tuple[dict[str, Mapping[str, FactorLevel | None]], str]:
    stated = data.campaign.get("design")
    if not isinstance(stated, Mapping) or not stated.get("factors"):
        return {}, "The campaign's design varies no factor."
    points = points_of(data)
    if points is None:
        return {}, "The campaign's design cannot be read, so scores cannot be held against its factors."
    switched = {one["name"] for one in stated["factors"] if one.get("when")}
    return {point.id: _active(point.levels, switched) for point in points}, ""


def _active(levels: Mapping[str, FactorLevel], switched: set[str]) -> dict[str, FactorLevel | None]:
    """Levels with None for conditional factors that are inactive; of any other factor that word is a level."""
    return {name: None if name in switched and level == INACTIVE else level for name, level in levels.items()}


def _table(one: NodeFactors, frame: pl.DataFrame) -> FactorTable:
    mine = frame.filter(pl.col("agent") == one.agent, pl.col("node") == one.node)
    adjusted = {(row["of"], row["test"], row["factor"]): row["p_adjusted"] for row in mine.iter_rows(named=True)}
    confidence = {effect.term: effect for effect in one.confidence.effects}
    score = {effect.term: effect for effect in one.score.effects}
    terms = dict.fromkeys([*confidence, *score, *(test.factor for test in one.passes.tests)])
    rows = [
        FactorRow(
            factor=term,
            confidence_share=confidence[term].omega2 if term in confidence else None,
            confidence_p=adjusted.get(("confidence", "anova", term)),
            score_share=score[term].omega2 if term in score else None,
            score_p=adjusted.get(("score", "anova", term)),
            odds=tuple(odds for odds in one.passes.odds if odds.factor == term),
            passes_p=adjusted.get(("passes", "logistic", term)),
            note=next((effects[term].note for effects in (confidence, score) if term in effects), ""),
        )
        for term in terms
    ]
    # Interactions are many and mostly nothing: only those that were found are shown, the frame holds the rest.
    shown = tuple(row for row in rows if " x " not in row.factor or row.found)
    return FactorTable(one.agent, one.node, one.confidence.n, shown, tuple(_notes(one)))


def _notes(one: NodeFactors) -> Iterable[str]:
    for name, found in (("Confidence", one.confidence), ("Scores", one.score)):
        if found.note:
            yield f"{name}: {found.note}."
        rough = [
            text
            for p, text in ((found.normal_p, "not normal"), (found.equal_spread_p, "not equally spread"))
            if p is not None and p < FOUND_BELOW
        ]
        if rough:
            yield f"{name}: residuals are {' and '.join(rough)}, so p is rough."
    if one.passes.note:
        yield f"Passes: {one.passes.note}."
    out = dict.fromkeys(f"{left.term} ({left.reason})" for left in (*one.confidence.left_out, *one.score.left_out))
    if out:
        yield f"Left out: {', '.join(out)}."


def factors_figure(matter: FactorsMatter) -> go.Figure:
    """A disc for each node, agent and main effect: its area is the share of the confidence's variance; dark where it was found."""
    rows = [table for table in matter.tables if any(row.confidence_share is not None for row in table.rows)]
    factors = list(dict.fromkeys(row.factor for table in rows for row in table.rows if " x " not in row.factor))
    discs = [
        (factors.index(row.factor), place, row.confidence_share, row.confidence_p)
        for place, table in enumerate(rows)
        for row in table.rows
        if row.factor in factors and row.confidence_share is not None
    ]
    figure = go.Figure(
        layout={
            "template": go.layout.Template(),
            "height": 90 + 34 * max(1, len(rows)),
            "margin": {"l": 260, "r": 24, "t": 10, "b": 46},
            "paper_bgcolor": "var(--paper)",
            "plot_bgcolor": "var(--paper)",
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": "var(--ink)"},
            "showlegend": False,
        }
    )
    figure.add_scatter(
        x=[x for x, *_ in discs],
        y=[y for _, y, *_ in discs],
        mode="markers",
        marker={
            "symbol": "circle",
            "size": [3.0 + 27.0 * share**0.5 for *_, share, _ in discs],
            "color": ["var(--accent)" if p is not None and p < FOUND_BELOW else "var(--bar)" for *_, p in discs],
            "line": {"color": "var(--bar-edge)", "width": 1},
        },
        hovertext=[f"{factors[x]}: {100 * share:.1f} % of the variance of confidence" for x, _, share, _ in discs],
        hoverinfo="text",
    )
    axis = {"showgrid": True, "gridcolor": "var(--grid)", "zeroline": False, "fixedrange": True}
    figure.update_layout(
        xaxis={**axis, "tickvals": list(range(len(factors))), "ticktext": factors, "range": [-0.6, len(factors) - 0.4]},
        yaxis={
            **axis,
            "tickvals": list(range(len(rows))),
            "ticktext": [f"{table.node} {table.agent}" for table in rows],
            "range": [len(rows) - 0.4, -0.6],
        },
    )
    return figure
