"""Jensen-Shannon divergence between the results of two agents (or campaigns) at one node.

A run falls into one class: not considered, failed (considered, but without a score), or a band of scores.
Bands are 20 points wide, ending where tensions end; 10 from 50 runs a side, 5 from 200. Lin, J. (1991),
"Divergence measures based on the Shannon entropy", IEEE Transactions on Information Theory 37(1), 145-151;
base 2, so that it lies in [0, 1].
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import rel_entr

from bench.arrays import Floats

SHUFFLES = 2000
# Bounds the memory of one matrix product; the draws do not depend on it.
SHUFFLES_PER_BATCH = 20
# Least number of runs a side and the width of bands from there on. Chosen, not measured.
BAND_WIDTHS = ((200, 5.0), (50, 10.0), (0, 20.0))
NOT_CONSIDERED, FAILED, BANDS = 0, 1, 2


@dataclass(frozen=True, slots=True)
class NodeOutcome:
    """The result of a node in one run: a score, failed without a score, or not considered."""

    score: float | None
    considered: bool


@dataclass(frozen=True, slots=True)
class Divergence:
    """`value` is in bits, [0, 1]; `by_chance` is its mean over shuffled labels, which is above 0 in small samples.

    `p` is the share of shuffles (the data itself included) that diverge at least as much. `band` is the width
    of score bands in points.
    """

    value: float
    by_chance: float
    p: float
    band: float
    first: int
    second: int
    paired: bool


def divergence(
    first: Sequence[NodeOutcome],
    second: Sequence[NodeOutcome],
    *,
    paired: bool,
    clusters: tuple[Sequence[Hashable], Sequence[Hashable]] | None = None,
    seed: int = 0,
    shuffles: int = SHUFFLES,
) -> Divergence | None:
    """Compare two sets of runs; None where either is empty.

    `paired` runs have the same order on both sides, and a shuffle swaps within pairs; otherwise it mixes all
    runs, or with `clusters` (the design point of each run of the sides) all clusters, whose runs stay together:
    replicates agree, and runs that are mixed one by one would make p too small. Raises ValueError for paired sides of different length. The same seed gives the same p.
    """
    if not first or not second:
        return None
    if paired and len(first) != len(second):
        raise ValueError(f"{len(first)} and {len(second)} runs cannot be paired")
    band = _band_width(first, second)
    classes = [_outcome_class(first_rows, band) for first_rows in (*first, *second)]
    columns = {kind: place for place, kind in enumerate(sorted(set(classes)))}
    indicators = np.eye(len(columns))[[columns[kind] for kind in classes]]
    first_rows, second_rows = indicators[: len(first)], indicators[len(first) :]
    units, first_units = indicators, len(first)
    if clusters:
        by_side = [
            _summed(rows, of_rows) for rows, of_rows in zip((first_rows, second_rows), clusters, strict=True)
        ]
        units, first_units = np.vstack(by_side), len(by_side[0])
    value = float(js_divergence(first_rows.sum(axis=0), second_rows.sum(axis=0)))
    rng = np.random.Generator(np.random.PCG64(seed))
    shuffled = (
        _shuffled_pairs(first_rows, second_rows, rng, shuffles)
        if paired
        else _shuffled_runs(units, first_units, rng, shuffles)
    )
    by_chance = js_divergence(shuffled, indicators.sum(axis=0) - shuffled)
    # 1e-12: equal divergences from different shuffles differ in their last bits.
    p = (1 + int((by_chance >= value - 1e-12).sum())) / (shuffles + 1)
    return Divergence(value, float(by_chance.mean()), p, band, len(first), len(second), paired)


def distributions(first: Sequence[NodeOutcome], second: Sequence[NodeOutcome]) -> dict[str, tuple[int, int]]:
    """Number of runs of both sides by the classes that `divergence` compares, in their order."""
    band = _band_width(first, second)
    counts = [Counter(_outcome_class(outcome, band) for outcome in side) for side in (first, second)]
    return {
        _class_name(kind, band): (counts[0][kind], counts[1][kind]) for kind in sorted(counts[0] | counts[1])
    }


def _band_width(first: Sequence[NodeOutcome], second: Sequence[NodeOutcome]) -> float:
    return next(width for min_size, width in BAND_WIDTHS if min(len(first), len(second)) >= min_size)


def _class_name(kind: int, band: float) -> str:
    if kind < BANDS:
        return "not considered" if kind == NOT_CONSIDERED else "failed"
    low = (kind - BANDS - 1) * band
    if low >= 100:
        return "score above 100"
    return f"score above {low:g} to {low + band:g}" if low else f"score up to {band:g}"


def js_divergence(first: Floats, second: Floats) -> Floats:
    """Divergence of two rows (or arrays of rows) of counts or weights over the same classes, in bits."""
    p = first / first.sum(axis=-1, keepdims=True)
    q = second / second.sum(axis=-1, keepdims=True)
    middle = (p + q) / 2
    bits: Floats = (rel_entr(p, middle) + rel_entr(q, middle)).sum(axis=-1) / (2.0 * np.log(2.0))
    return np.clip(bits, 0.0, 1.0)


def _outcome_class(outcome: NodeOutcome, band: float) -> int:
    if not outcome.considered:
        return NOT_CONSIDERED
    if outcome.score is None:
        return FAILED
    # Bands end at 20, 40, ... inclusive, like tensions; scores below 0 fall into the first band, those above
    # 100 into the last.
    rounded = round(outcome.score / band, 9)
    return BANDS + int(min(max(np.ceil(rounded), 1), np.ceil(100 / band) + 1))


def _summed(indicators: Floats, clusters: Sequence[Hashable]) -> Floats:
    """A row for each cluster: its number of runs in each class."""
    places = {cluster: place for place, cluster in enumerate(dict.fromkeys(clusters))}
    rows = np.zeros((len(places), indicators.shape[1]))
    np.add.at(rows, [places[cluster] for cluster in clusters], indicators)
    return rows


def _shuffled_pairs(first: Floats, second: Floats, rng: np.random.Generator, shuffles: int) -> Floats:
    swap_change, start = second - first, first.sum(axis=0)
    sums = []
    for done in range(0, shuffles, SHUFFLES_PER_BATCH):
        swapped = rng.integers(0, 2, size=(min(SHUFFLES_PER_BATCH, shuffles - done), len(first)))
        sums.append(start + swapped.astype(np.float64) @ swap_change)
    return np.vstack(sums)


def _shuffled_runs(indicators: Floats, first_size: int, rng: np.random.Generator, shuffles: int) -> Floats:
    return np.array(
        [indicators[rng.permutation(len(indicators))[:first_size]].sum(axis=0) for _ in range(shuffles)]
    )
