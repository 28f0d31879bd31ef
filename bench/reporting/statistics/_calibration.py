"""Rated difficulty against outcomes, over several agents: what `rebar calibrate` shows.

Trials are considered runs. Of a key attribute they are those of competence (docs/rulings.md, 17): a trial
passes when every considered observable under the node is achieved. Of a key factor table they are the runs in
which an observable with this table was considered.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise
from pathlib import Path

import networkx as nx
import polars as pl

from bench.agents import installed_agents
from bench.errors import Fault, SetupError, command_line
from bench.scoring import EXCLUDED_OUTCOMES, Standing, rate
from bench.simspec import factor_values
from bench.statistics import (
    SIGNIFICANCE,
    ColumnRate,
    DifficultySlope,
    RankAssociation,
    RefittedTable,
    column_rates,
    difficulty_slope,
    nearest_column,
    rank_association,
    refit_table,
)
from decompositions import Decomposition, KeyFactor, Level

from .._campaign_data import ReportData
from .._campaign_folder import load_report_data
from ._agent_comparison import scene_digest


class TableResult(StrEnum):
    """What the runs show about a table."""

    CONTRADICTED = "contradicted"
    COLUMNS_DISORDERED = "columns out of order"
    AGREES = "agrees"
    OPEN = "open"
    UNTESTED = "untested"


@dataclass(frozen=True, slots=True)
class NodeCalibration:
    """How failure at a key attribute depends on its rated difficulty."""

    node: str
    title: str
    slope: DifficultySlope


@dataclass(frozen=True, slots=True)
class ColumnDisorder:
    """Two neighbouring columns with runs, of which the easier one failed more often beyond chance."""

    easier: int
    harder: int
    association: RankAssociation


@dataclass(frozen=True, slots=True)
class TableCalibration:
    """One key factor table against the failures of the observables that use it.

    `name` is that of a shared table, else `OBSERVABLE/FACTOR`. `proposed` are ratings in the order of the
    outcomes, only where these contradict the table; None there too if no table has this order, for the reason
    in `no_proposal`.
    """

    name: str
    is_shared: bool
    row: KeyFactor
    observables: tuple[str, ...]
    association: RankAssociation
    columns: tuple[ColumnRate, ...] = ()
    disorders: tuple[ColumnDisorder, ...] = ()
    proposed: RefittedTable | None = None
    no_proposal: str = ""

    @property
    def result(self) -> TableResult:
        if self.association.contradicts():
            return TableResult.CONTRADICTED
        if self.disorders:
            return TableResult.COLUMNS_DISORDERED
        if self.association.p is None:
            return TableResult.UNTESTED
        return TableResult.AGREES if self.association.agrees() else TableResult.OPEN

    @property
    def is_contradicted(self) -> bool:
        """Whether the runs contradict the order of the table, as a whole or in neighbouring columns."""
        return self.result in (TableResult.CONTRADICTED, TableResult.COLUMNS_DISORDERED)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Rated difficulty against outcomes. `overall` pools all observables; `excluded` are agents left out."""

    folders: tuple[Path, ...]
    agents: tuple[str, ...]
    excluded: tuple[str, ...]
    runs: int
    design_points: int
    decomposition: Decomposition
    overall: DifficultySlope
    nodes: tuple[NodeCalibration, ...]
    tables: tuple[TableCalibration, ...]
    notes: tuple[str, ...] = ()

    @property
    def contradicted(self) -> tuple[TableCalibration, ...]:
        """The tables that the runs contradict."""
        return tuple(table for table in self.tables if table.is_contradicted)


def calibrate(folders: Sequence[Path], agents: Sequence[str] = (), *, seed: int = 0) -> Calibration:
    """Check the rated difficulty of the runs in campaign folders against their outcomes.

    Without `agents`: all but null agents and the oracle. An agent of the same name in several folders is one
    agent. Raises SetupError with every reason for which nothing can be checked.
    """
    source = _Source.of(folders)
    flown = tuple(dict.fromkeys(source.trials["agent"].sort()))
    chosen = _chosen_agents(flown, agents)
    trials = source.trials.filter(pl.col("agent").is_in(chosen))
    observables = trials.filter(level=str(Level.OBSERVABLE), standing=str(Standing.COUNTED))
    attributes = trials.filter(level=str(Level.KEY_ATTRIBUTE))
    calibration = Calibration(
        folders=tuple(folders),
        agents=chosen,
        excluded=tuple(agent for agent in flown if agent not in chosen),
        runs=trials.select("folder", "realization").n_unique(),
        design_points=trials["point"].n_unique(),
        decomposition=source.decomposition,
        overall=_slope(observables),
        nodes=tuple(
            NodeCalibration(
                node, source.decomposition.nodes[node].title, _slope(attributes.filter(node=node))
            )
            for node in source.decomposition.key_attributes
        ),
        tables=tuple(
            _table_calibration(table, source.rated(table, observables), seed)
            for table in _tables(source.decomposition)
        ),
        notes=source.notes,
    )
    _require_difficulties(calibration)
    return calibration


@dataclass(frozen=True, slots=True)
class _Source:
    """The considered trials of campaigns that share a decomposition.

    `trials` has the columns folder, realization, point, scene, agent, node, level, standing, difficulty and
    failed. A point is a design point; those of two campaigns are one if they have a scene in common.
    """

    decomposition: Decomposition
    trials: pl.DataFrame
    factors: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]

    @classmethod
    def of(cls, folders: Sequence[Path]) -> _Source:
        if twice := [folder for number, folder in enumerate(folders) if folder in folders[:number]]:
            raise SetupError(Fault(str(twice[0]), "is named twice", "name each folder once"))
        data = [load_report_data(folder) for folder in folders]
        _require_scores(folders, data)
        _require_one_decomposition(folders, data)
        frames: list[pl.DataFrame] = []
        factors: dict[str, Mapping[str, float]] = {}
        faults: list[Fault] = []
        for folder, campaign in zip(folders, data, strict=True):
            scenes = {name: scene_digest(simspec) for name, simspec in campaign.simspecs.items()}
            # Reading factors takes longer than the digest, and agents share scenes.
            new = {scene: name for name, scene in scenes.items() if scene not in factors}
            factors |= {scene: factor_values(campaign.simspecs[name]) for scene, name in new.items()}
            considered = _considered(campaign.scores)
            if missing := sorted(set(considered["realization"]) - set(scenes)):
                faults.append(
                    Fault(
                        str(folder / "simspecs" / f"{missing[0]}.json"),
                        f"is missing or damaged, as for {len(missing)} runs with scores",
                        "restore the file, or delete scores.parquet and run `rebar score`",
                    )
                )
                continue
            frames.append(
                considered.with_columns(
                    folder=pl.lit(str(folder)),
                    scene=pl.col("realization").replace_strict(scenes, return_dtype=pl.String),
                )
            )
        if faults:
            raise SetupError(faults)
        document = data[0].document
        assert document is not None  # _require_one_decomposition
        # In an order of their content: the same runs give the same numbers in one folder or in two.
        trials = pl.concat(frames).sort("scene", "agent", "node", "failed")
        return cls(document, _with_points(trials), factors, _notes(folders, data))

    def rated(self, table: _Table, observables: pl.DataFrame) -> pl.DataFrame:
        """The trials of the observables that use a table, with the rating of their scene."""
        row = table.row
        ratings = {
            scene: rate(row, values[row.factor], self.decomposition.policies)
            for scene, values in self.factors.items()
            if row.factor in values and not row.is_absent(values[row.factor])
        }
        rated = pl.DataFrame(
            {"scene": list(ratings), "rating": list(ratings.values())},
            schema={"scene": pl.String, "rating": pl.Float64},
        )
        return observables.filter(pl.col("node").is_in(table.observables)).join(
            rated, on="scene", how="inner", maintain_order="left"
        )


@dataclass(frozen=True, slots=True)
class _Table:
    name: str
    is_shared: bool
    row: KeyFactor
    observables: tuple[str, ...]


def _tables(decomposition: Decomposition) -> list[_Table]:
    """Every table once: shared ones with all observables that use them, then those of single observables."""
    observables = decomposition.observables.values()
    shared = [
        _Table(name, True, row, tuple(leaf.id for leaf in observables if name in leaf.key_factors))
        for name, row in decomposition.document.tables.items()
    ]
    single = [
        _Table(f"{leaf.id}/{row.factor}", False, row, (leaf.id,))
        for leaf in observables
        for row in leaf.key_factors
        if not isinstance(row, str)
    ]
    return [*shared, *single]


def _considered(scores: pl.DataFrame) -> pl.DataFrame:
    """The trials in a score table: considered, with a difficulty, and not spoilt by the bench."""
    rows = scores.filter(
        ~pl.col("outcome").is_in(EXCLUDED_OUTCOMES),
        pl.col("considered") > 0,
        pl.col("difficulty").is_not_null(),
    )
    # Where results decided how many replicates there are, only the first of a design point is a fair sample.
    first = pl.col("replicate") == pl.col("replicate").min().over("design_point", "agent")
    return rows.filter(~pl.col("until_settled") | first).select(
        "realization",
        "design_point",
        "agent",
        "node",
        "level",
        "standing",
        "difficulty",
        failed=pl.col("achieved") < pl.col("considered"),
    )


def _with_points(trials: pl.DataFrame) -> pl.DataFrame:
    """Names the design points across folders: two that share a scene are one, and their runs not independent."""
    places = trials.select("folder", "design_point", "scene").unique(maintain_order=True)
    graph: nx.Graph[tuple[str, ...]] = nx.Graph()
    graph.add_edges_from(((folder, point), (scene,)) for folder, point, scene in places.iter_rows())
    point_of = {
        member[0]: f"point {number}"
        for number, component in enumerate(nx.connected_components(graph))
        for member in component
        if len(member) == 1
    }
    return trials.with_columns(point=pl.col("scene").replace_strict(point_of, return_dtype=pl.String))


def _slope(trials: pl.DataFrame) -> DifficultySlope:
    return difficulty_slope(
        trials["difficulty"].to_numpy(),
        trials["failed"].to_numpy(),
        trials["agent"].to_list(),
        trials["point"].to_list(),
    )


def _table_calibration(table: _Table, trials: pl.DataFrame, seed: int) -> TableCalibration:
    association = _association(trials, trials["rating"], seed)
    calibration = TableCalibration(table.name, table.is_shared, table.row, table.observables, association)
    # A situation easier than the first column is in no column.
    inside = trials.filter(pl.col("rating") >= table.row.ratings[0])
    if association.p is None or not inside.height:
        return calibration
    inside = inside.with_columns(
        column=pl.Series(nearest_column(inside["rating"].to_numpy(), table.row.ratings))
    )
    strata = list(zip(inside["agent"], inside["node"], strict=True))
    columns = column_rates(inside["column"].to_numpy(), inside["failed"].to_numpy(), strata)
    disorders = _disorders(inside, columns, seed)
    if not association.contradicts() and not disorders:
        return replace(calibration, columns=columns)
    proposed, no_proposal = _proposal(table.row, association, columns)
    return replace(
        calibration, columns=columns, disorders=disorders, proposed=proposed, no_proposal=no_proposal
    )


def _association(trials: pl.DataFrame, rating: pl.Series, seed: int) -> RankAssociation:
    return rank_association(
        rating.to_numpy(),
        trials["failed"].to_numpy(),
        trials["agent"].to_list(),
        trials["node"].to_list(),
        trials["point"].to_list(),
        seed=seed,
    )


def _disorders(trials: pl.DataFrame, columns: Sequence[ColumnRate], seed: int) -> tuple[ColumnDisorder, ...]:
    """Neighbouring columns in the wrong order, by the bound of Bonferroni over all pairs of neighbours."""
    disorders = []
    for easier, harder in pairwise(columns):
        if harder.rate >= easier.rate:
            continue
        pair = trials.filter(pl.col("column").is_in([easier.column, harder.column]))
        association = _association(pair, pair["column"], seed)
        if association.contradicts(SIGNIFICANCE / (len(columns) - 1)):
            disorders.append(ColumnDisorder(easier.column, harder.column, association))
    return tuple(disorders)


def _proposal(
    row: KeyFactor, association: RankAssociation, columns: Sequence[ColumnRate]
) -> tuple[RefittedTable | None, str]:
    rising = not association.contradicts()
    # `absent` lies on the easier side of the table, which would become the harder one.
    if not rising and row.absent is not None:
        return None, "a table with `absent` cannot be turned around; reconsider whether this factor is one"
    proposed = refit_table(row.ratings, row.values, columns, rising=rising)
    if proposed is None or len(proposed.ratings) < 2:
        return None, "the failure rates have no order; reconsider whether this factor is one"
    return proposed, ""


def _chosen_agents(flown: Sequence[str], agents: Sequence[str]) -> tuple[str, ...]:
    faults = [
        Fault("--agent", f"{agent!r} has no considered run here", f"agents: {', '.join(flown)}")
        for agent in agents
        if agent not in flown
    ]
    if faults:
        raise SetupError(faults)
    # Null agents and the oracle are left out unless they are named: the first fail for want of trying and the
    # other knows the truth, so neither shows how hard a situation is.
    others = {*installed_agents("floor"), *installed_agents("ceiling")}
    chosen = tuple(dict.fromkeys(agents)) or tuple(agent for agent in flown if agent not in others)
    if len(chosen) < 2:
        only = f"only {chosen[0]!r}" if chosen else "none"
        raise SetupError(
            Fault(
                "calibrate",
                f"needs two agents or more, and there is {only} (null agents and the oracle do not count)",
                "a single agent cannot tell a hard situation from its own weakness; "
                "add folders of other agents over the same decomposition",
            )
        )
    return chosen


def _require_scores(folders: Iterable[Path], data: Iterable[ReportData]) -> None:
    faults = [
        Fault(str(folder), "holds no scores", f"`{command_line('rebar', 'score', folder)}` makes them")
        for folder, campaign in zip(folders, data, strict=True)
        if not campaign.scores.height
    ]
    if faults:
        raise SetupError(faults)


def _require_one_decomposition(folders: Sequence[Path], data: Sequence[ReportData]) -> None:
    digests = [campaign.decomposition_sha256 for campaign in data]
    faults = [
        Fault(
            str(folder),
            "has no readable decomposition"
            if digest is None
            else f"has another decomposition than {folders[0]}",
            f"`{command_line('rebar', 'score', folder)} --decomposition NAME` scores it over the one that you mean",
        )
        for folder, digest in zip(folders, digests, strict=True)
        # Two unreadable decompositions are not the same one.
        if digest is None or digest != digests[0]
    ]
    if faults:
        raise SetupError(faults)


def _require_difficulties(calibration: Calibration) -> None:
    # Observables differ in difficulty in a single scene, too, but that says nothing about a situation.
    difficulties = max((node.slope.difficulties for node in calibration.nodes), default=0)
    ratings = max((table.association.ratings for table in calibration.tables), default=0)
    if max(difficulties, ratings) < 2:
        raise SetupError(
            Fault(
                ", ".join(map(str, calibration.folders)),
                "every node has one difficulty in all of these runs, so there is nothing to compare",
                "vary the key factors in the campaign's design; `rebar difficulty` shows them",
            )
        )


def _notes(folders: Sequence[Path], data: Sequence[ReportData]) -> tuple[str, ...]:
    notes = []
    for folder, campaign in zip(folders, data, strict=True):
        if campaign.campaign.get("fidelity") == "overhead":
            notes.append(f"{folder} was flown by surrogates, which show no difficulty of the real agent.")
        if campaign.scores["until_settled"].any():
            notes.append(f"{folder} ended design points early: only the first replicate of each counts here.")
    return tuple(notes)
