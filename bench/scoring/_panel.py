"""What a decomposition measures in fact, over a panel of agents: redundancy, discrimination, floors, worse is better."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import sqrt

import numpy as np
import polars as pl
from pydantic import Field

from bench.arrays import Counts, Floats
from bench.documents import Document

from ._difficulty import Standing
from ._floor import SCENE, common_runs, node_floors

LEAST_PARTICIPATION_RATIO = 12.0
LEAST_SEPARATING_KEY_ATTRIBUTES = 30
LEAST_SESSIONS = 10
"""Two observables are compared over so many common sessions at least: fewer agree by chance. Chosen, not measured."""

ERROR_RATE = 0.05
"""Of taking two equal agents of the panel for different ones in a node; shared among their pairs (Bonferroni)."""

TINY = 1e-9
"""Means of the same numbers in another order differ by less."""

NODE_LEVELS = ("principle", "ka")


class PanelNode(Document):
    """The clearest difference between two agents in a node, over the scenes that both have flown; and its floor beside the
    best tested agent, over the scenes that all agents have flown. Mean confidences, 0 to 1.
    """

    id: str
    level: str
    lower: str
    higher: str
    difference: float
    noise: float | None = Field(
        description="Difference that replicates alone explain. Null: nothing was flown twice by both."
    )
    separated: bool = Field(description="Whether the difference is beyond the noise")
    floor: float | None = None
    floor_agents: tuple[str, ...] = ()
    best: float | None = None
    best_agents: tuple[str, ...] = ()


class Panel(Document):
    """What the tested agents show about a decomposition: about its observables that are about the agent."""

    agents: tuple[str, ...]
    sessions: int
    observables: int = Field(description="Considered in some session")
    equal: tuple[tuple[str, str, int], ...] = Field(
        description="Pairs with the same x wherever both are considered, but not one x; in how many sessions"
    )
    always_passed: Mapping[str, int] = Field(
        description="Passed in every session that considers it; how many do"
    )
    constant: tuple[str, ...] = Field(description="The same x in all sessions: correlated with none")
    unknown_correlations: int = Field(
        description="Pairs of the others with too few common sessions, or constant in them"
    )
    participation_ratio: float | None
    nodes: tuple[PanelNode, ...]
    worse_is_better: tuple[PanelNode, ...]
    bounds: Mapping[str, bool] = Field(description="What is asked, with whether the panel shows it")


def panel_of(
    tested: pl.DataFrame, floor: pl.DataFrame, oracle: str | None, order: tuple[str, str] | None = None
) -> Panel:
    """The panel in a score table of tested agents and one of null agents and the agent named `oracle`.

    `order` names a worse agent and a better one. Raises ValueError where it names an agent that is not tested.
    """
    agents = tuple(sorted(tested["agent"].unique()))
    if order is not None and not set(order) <= set(agents):
        raise ValueError(f"the tested agents are {', '.join(agents)}")
    judged = tested.filter(pl.col("standing") == str(Standing.COUNTED), pl.col("x").is_not_null())
    names: list[str] = judged["node"].unique(maintain_order=True).sort().to_list()
    wide = judged.pivot(on="node", index="realization", values="x")
    x = wide.select(names).to_numpy().astype(np.float64).reshape(len(wide), len(names))
    varies = np.array([np.nanmax(column) - np.nanmin(column) > TINY for column in x.T], dtype=np.bool_)
    correlations = pairwise_correlations(x[:, varies])
    passed = judged.group_by("node").agg(pl.len(), pl.col("achieved").min()).filter(pl.col("achieved") > 0)
    equal = tuple(_equal(names, x))
    ordered = [] if order is None else _differences(tested, [order], (*NODE_LEVELS, "observable"))
    always_passed = dict(passed.sort("node").select("node", "len").iter_rows())
    ratio = participation_ratio(correlations)
    nodes = tuple(_nodes(tested, floor, oracle, agents))
    return Panel(
        agents=agents,
        sessions=tested["realization"].n_unique(),
        observables=len(names),
        equal=equal,
        always_passed=always_passed,
        constant=tuple(name for name, is_varying in zip(names, varies, strict=True) if not is_varying),
        unknown_correlations=int(np.isnan(correlations).sum()) // 2,
        participation_ratio=ratio,
        nodes=nodes,
        worse_is_better=tuple(
            node for (node,) in ordered if node.separated and (node.higher, node.lower) == order
        ),
        bounds=_bounds(len(equal), len(always_passed), ratio or 0.0, nodes),
    )


def _bounds(equal: int, always_passed: int, ratio: float, nodes: Sequence[PanelNode]) -> dict[str, bool]:
    principles, kas = ([node.separated for node in nodes if node.level == level] for level in NODE_LEVELS)
    apart = f"separate two agents: {sum(principles)} of {len(principles)}, at least all"
    kas_apart = f"separate two agents: {sum(kas)} of {len(kas)}, at least {LEAST_SEPARATING_KEY_ATTRIBUTES}"
    least = f"participation ratio: {ratio:.1f}, at least {LEAST_PARTICIPATION_RATIO:g}"
    return {
        f"pairs of equal observables: {equal}, at most 0": equal == 0,
        f"observables that always pass: {always_passed}, at most 0": always_passed == 0,
        least: ratio >= LEAST_PARTICIPATION_RATIO,
        f"principles that {apart}": bool(principles) and all(principles),
        f"key attributes that {kas_apart}": sum(kas) >= LEAST_SEPARATING_KEY_ATTRIBUTES,
    }


def pairwise_correlations(x: Floats) -> Floats:
    """Pearson's correlations (o, o) of columns of `x` (s, o), each over the rows in which both have a value.

    NaN over fewer rows than LEAST_SESSIONS, and where one of the two is constant in them.
    """
    known = ~np.isnan(x)
    # Centred first: else the sums of squares lose digits.
    filled = np.where(known, x - np.nanmean(x, axis=0) if x.size else 0.0, 0.0)
    mask = known.astype(np.float64)
    rows = mask.T @ mask
    with np.errstate(divide="ignore", invalid="ignore"):
        # Of the column of the first index, over the rows that it has in common with the second.
        mean = filled.T @ mask / rows
        variance = (filled**2).T @ mask / rows - mean**2
        correlations: Floats = (filled.T @ filled / rows - mean * mean.T) / np.sqrt(variance * variance.T)
    correlations[(rows < LEAST_SESSIONS) | ~(np.minimum(variance, variance.T) > TINY**2)] = np.nan
    np.fill_diagonal(correlations, 1.0)
    return correlations


def participation_ratio(correlations: Floats) -> float | None:
    """(sum of eigenvalues)^2 / (sum of their squares) of a correlation matrix (o, o): how many independent quantities it
    amounts to, from 1, where all are one, to o, where none depends on another. None for an empty matrix.

    The eigenvalues of a symmetric matrix sum to its trace, their squares to the sum of its squared elements. An unknown
    correlation, NaN, counts with the mean square of the known ones: as 0 it would raise the ratio.
    """
    count = len(correlations)
    others = correlations[~np.eye(count, dtype=np.bool_)]
    known = others[~np.isnan(others)]
    mean_square = float(np.mean(known**2)) if len(known) else 0.0
    return count / (1.0 + (count - 1) * mean_square) if count else None


def _equal(names: Sequence[str], x: Floats) -> Iterator[tuple[str, str, int]]:
    for first, second in combinations(range(len(names)), 2):
        common = ~np.isnan(x[:, [first, second]]).any(axis=1)
        values, others = x[common, first], x[common, second]
        # Where both are constant, nothing is known of either.
        if len(values) < LEAST_SESSIONS or np.ptp(values) <= TINY:
            continue
        if np.abs(values - others).max() <= TINY:
            yield names[first], names[second], len(values)


def _nodes(
    tested: pl.DataFrame, floor: pl.DataFrame, oracle: str | None, agents: Sequence[str]
) -> Iterator[PanelNode]:
    pairs = list(combinations(agents, 2))
    # Of the same scenes, for the same reason as a floor: on others an agent could be lucky alone.
    common = common_runs(pl.concat([tested, floor]))
    is_tested = pl.col("agent").is_in(agents)
    floors = node_floors(common.filter(~is_tested), oracle)
    best = node_floors(common.filter(is_tested), None)
    for differences in _differences(tested, pairs, NODE_LEVELS):
        clearest = max(differences, key=lambda node: (node.separated, node.difference))
        rated, top = floors.get(clearest.id), best.get(clearest.id)
        yield clearest.model_copy(
            update={
                "floor": rated and rated.floor,
                "floor_agents": rated.floor_agents if rated else (),
                "best": top and top.floor,
                "best_agents": top.floor_agents if top else (),
            }
        )


def _differences(
    scores: pl.DataFrame, pairs: Sequence[tuple[str, str]], levels: Sequence[str]
) -> Iterator[list[PanelNode]]:
    """For each node of these levels the difference of each pair that was considered in it in the same scenes."""
    rows = scores.filter(pl.col("level").is_in(levels), pl.col("confidence").is_not_null())
    by_node = rows.partition_by("node", as_dict=True)
    for name in scores["node"].unique(maintain_order=True):
        if (name,) not in by_node:
            continue
        of_node = by_node[(name,)]
        wide = of_node.pivot(on="agent", index=SCENE, values="confidence")
        point = np.unique(wide["design_point"].to_numpy(), return_inverse=True)[1]
        differences = []
        for pair in pairs:
            if not set(pair) <= set(wide.columns):
                continue
            apart = (wide[pair[1]] - wide[pair[0]]).to_numpy().astype(np.float64)
            common = ~np.isnan(apart)
            if common.any():
                mean, noise = _mean_and_noise(apart[common], point[common], len(pairs))
                lower, higher = pair if mean >= 0.0 else pair[::-1]
                node = {"id": name, "level": of_node["level"][0], "lower": lower, "higher": higher}
                separated = noise is not None and abs(mean) > noise + TINY
                differences.append(PanelNode(**node, difference=abs(mean), noise=noise, separated=separated))
        if differences:
            yield differences


def _mean_and_noise(apart: Floats, point: Counts, comparisons: int) -> tuple[float, float | None]:
    """The mean of paired differences, and half the width of Student's interval round it.

    What varies are the replicates of the design points, which are fixed, with one variance for all.
    """
    # Loads a CPU second of distributions.
    from scipy import stats

    _, of_point, counts = np.unique(point, return_inverse=True, return_counts=True)
    again = counts[of_point] > 1
    if not again.any():
        return float(apart.mean()), None
    if not again.all():
        # A design point flown once says nothing about its noise.
        return _mean_and_noise(apart[again], point[again], comparisons)
    mean = float(apart.mean())
    freedom = len(apart) - len(counts)
    residuals = apart - (np.bincount(of_point, apart) / counts)[of_point]
    error = sqrt(float((residuals**2).sum()) / freedom / len(apart))
    return mean, float(stats.t.ppf(1.0 - ERROR_RATE / 2.0 / comparisons, freedom)) * error
