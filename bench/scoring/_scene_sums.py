"""A score table summed over the runs of each scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from bench.arrays import Bools, Counts, Floats

from ._table import EXCLUDED_OUTCOMES

ALL = "all"


@dataclass(frozen=True, slots=True)
class TextCodes:
    """A column of texts as numbers in the order of first appearance, -1 where a text is null."""

    names: tuple[str, ...]
    numbers: NDArray[np.int32]

    @classmethod
    def of(cls, column: pl.Series) -> TextCodes:
        distinct = column.drop_nulls().unique(maintain_order=True)
        if column.dtype == pl.Categorical:
            # By their numbers: as texts, a column of a large table would take several times its memory.
            numbers = distinct.to_physical().to_numpy()
            # A null gets the number after all others, at which nothing is placed.
            null = int(numbers.max(initial=0)) + 1
            place = np.full(null + 1, -1, dtype=np.int32)
            place[numbers] = np.arange(len(distinct))
            codes = column.to_physical().fill_null(null).to_numpy()
            return cls(tuple(distinct.cast(pl.String)), place[codes])
        names = distinct.cast(pl.String)
        places = column.cast(pl.String).cast(pl.Enum(names)).to_physical().cast(pl.Int32)
        return cls(tuple(names), places.fill_null(-1).to_numpy())


@dataclass(frozen=True, slots=True)
class SceneSums:
    """A score table summed over the runs of each scene: an agent in a design point of a configuration.

    Scenes are sorted by the numbers of agent, configuration and design point (-1: none). `sums` are (scenes,
    nodes), added in the order of the table, so that they are the same on any number of cores. `low` and
    `high` are the lowest and highest difficulty.
    """

    agents: tuple[str, ...]
    configurations: tuple[str, ...]
    design_points: tuple[str, ...]
    nodes: tuple[str, ...]
    levels: tuple[str, ...]
    agent: Counts
    configuration: Counts
    point: Counts
    sums: Mapping[str, NDArray[Any]]
    low: Floats
    high: Floats

    def together(self) -> SceneSums:
        """The same with all configurations merged into one."""
        order = np.lexsort((self.point, self.agent))
        agent, point = self.agent[order], self.point[order]
        first = np.flatnonzero((np.diff(agent, prepend=-2) != 0) | (np.diff(point, prepend=-2) != 0))
        return replace(
            self,
            configurations=(ALL,),
            agent=agent[first],
            configuration=np.zeros(first.size, dtype=np.int64),
            point=point[first],
            sums={name: np.add.reduceat(values[order], first) for name, values in self.sums.items()},
            low=np.minimum.reduceat(self.low[order], first),
            high=np.maximum.reduceat(self.high[order], first),
        )

    def configured(self) -> SceneSums:
        """The scenes that have a configuration."""
        has = self.configuration >= 0
        if has.all():
            return self
        return replace(
            self,
            agent=self.agent[has],
            configuration=self.configuration[has],
            point=self.point[has],
            sums={name: values[has] for name, values in self.sums.items()},
            low=self.low[has],
            high=self.high[has],
        )

    @property
    def starts(self) -> Counts:
        """Index of the first scene of each block: the scenes of one agent in one configuration."""
        return np.flatnonzero(
            (np.diff(self.agent, prepend=-2) != 0) | (np.diff(self.configuration, prepend=-2) != 0)
        )

    def total(self, name: str) -> NDArray[Any]:
        """Sums over each block, as (blocks, nodes)."""
        values = self.sums[name]
        return np.add.reduceat(
            values, self.starts, dtype=np.float64 if values.dtype.kind == "f" else np.int64
        )


def scene_sums(scores: pl.DataFrame) -> SceneSums:
    agent, configuration, point = (
        TextCodes.of(scores[name]) for name in ("agent", "configuration", "design_point")
    )
    places, points = len(configuration.names) + 1, len(point.names) + 1
    keys, scene = _dense_codes(
        ((agent.numbers + np.int64(1)) * places + configuration.numbers + 1) * points + point.numbers + 1
    )
    names = {"agents": agent.names, "configurations": configuration.names, "design_points": point.names}
    # Arrays as long as the table, which may be large.
    del agent, configuration, point
    node = TextCodes.of(scores["node"])
    shape = (keys.size, len(node.names))
    slot = scene * shape[1] + node.numbers
    a_row = np.zeros(shape[1], dtype=np.int64)
    # The last row of each node is as good as any other: a node has one level.
    a_row[node.numbers] = np.arange(scores.height)
    low, high = _ends(scores, slot, shape[0] * shape[1])
    return SceneSums(
        **names,
        nodes=node.names,
        levels=tuple(scores["level"].gather(a_row)),
        agent=keys // (points * places) - 1,
        configuration=keys // points % places - 1,
        point=keys % points - 1,
        sums={name: values.reshape(shape) for name, values in _summed(scores, slot, shape[0] * shape[1])},
        low=low.reshape(shape),
        high=high.reshape(shape),
    )


def _ends(scores: pl.DataFrame, slot: Counts, size: int) -> tuple[Floats, Floats]:
    """Lowest and highest difficulty of each slot; infinite where it has none."""
    low, high = np.full(size, np.inf), np.full(size, -np.inf)
    rated, is_known = column_values(scores, "difficulty")
    if not is_known.all():
        slot, rated = slot[is_known], rated[is_known]
    np.minimum.at(low, slot, rated)
    np.maximum.at(high, slot, rated)
    return low, high


def _summed(scores: pl.DataFrame, slot: Counts, size: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Counts of runs and sums of values in each slot, one column at a time, because a table may be large."""

    def count_rows(where: NDArray[Any]) -> NDArray[np.int32]:
        # bincount adds in float64, which is exact for whole numbers.
        return np.bincount(slot, weights=where, minlength=size).astype(np.int32)

    is_counted = (~scores["outcome"].is_in(EXCLUDED_OUTCOMES)).to_numpy()
    yield "runs", count_rows(is_counted)
    yield "excluded", count_rows(~is_counted)
    # Runs whose design point stopped early.
    yield "until_settled", count_rows(is_counted & (column_values(scores, "until_settled")[0] > 0))
    for name, known_name in (("confidence", "considered"), ("score", "scored"), ("passed_score", "passable")):
        values, is_known = column_values(scores, name)
        yield known_name, count_rows(is_known)
        yield name, np.bincount(slot, weights=values, minlength=size)
        if name != "passed_score":
            yield f"{name}_squared", np.bincount(slot, weights=values**2, minlength=size)
    achieved, considered = column_values(scores, "achieved")[0], column_values(scores, "considered")[0]
    yield "achieved", count_rows(achieved)
    yield "asked", count_rows(considered)
    is_trial = is_counted & (considered > 0)
    yield "trials", count_rows(is_trial)
    yield "passes", count_rows(is_trial & (achieved == considered))
    passed, has_verdict = column_values(scores, "verdict")
    yield "verdicts", count_rows(is_counted & has_verdict)
    yield "verdicts_passed", count_rows(is_counted & (passed > 0))


def column_values(scores: pl.DataFrame, name: str) -> tuple[Floats, Bools]:
    """Values of a column (0 where null) and whether they are known."""
    column = scores[name]
    return column.cast(pl.Float64).fill_null(0.0).to_numpy(), column.is_not_null().to_numpy()


def _dense_codes(keys: Counts) -> tuple[Counts, Counts]:
    """Distinct keys, rising, and the number of each entry's; without sorting where the keys are dense enough."""
    size = int(keys.max()) + 1
    # Sorting is slower than a table over all keys, unless most of that table would be empty. 4 is chosen, not
    # measured.
    if size > 4 * keys.size:
        distinct, number = np.unique(keys, return_inverse=True)
        return distinct, number
    present = np.zeros(size, dtype=np.bool_)
    present[keys] = True
    return np.flatnonzero(present), (np.cumsum(present) - 1)[keys]
