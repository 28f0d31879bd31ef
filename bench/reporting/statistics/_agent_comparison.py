"""Two agents compared on the scenes that both flew, in one campaign or in two."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from bench.errors import Fault, SetupError
from bench.scoring import EXCLUDED_OUTCOMES
from bench.simspec import SimSpec
from bench.statistics import NodeComparison, compare_nodes

from .._campaign_data import ReportData
from .._campaign_folder import load_report_data

SHOWN_LEVELS = ("principle", "ka")


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
    return Comparison(
        first.label, second.label, scenes, compare_nodes(mine, other, asked, excluded_outcomes=EXCLUDED_OUTCOMES, seed=seed)
    )


def compare_agents(data: ReportData, first: str, second: str) -> tuple[NodeComparison, ...]:
    """Two agents of one campaign at the nodes under study."""
    mine, other = (data.scores.filter(pl.col("agent") == agent) for agent in (first, second))
    return compare_nodes(mine, other, data.study, excluded_outcomes=EXCLUDED_OUTCOMES)


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
